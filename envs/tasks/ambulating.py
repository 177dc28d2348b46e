"""Ambulating: work the door in the way of a wheelchair, with the arm on it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.pose import Array, Pose, quaternion_from_matrix
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..devices import PoweredWheelchair, Wheelchair, add_stand, chair_for, grip, spawn_fitted
from ..place import DoorSite
from ..reach import Trial
from ..rectangle import Rectangle
from ..registry import register_task
from ..scenes.door_approach import STANDING, WIDE_ENOUGH, DoorApproach, is_free_beyond
from ..scenes.step_peak import StepPeak
from ..scenes.way_through import WayState, WayThrough
from ..state import Seen, State, Values, clip, degrees, greatest, tolerance
from ..task import CHAIR_ROBOTS, Role, Task
from ..task_options import TaskOptions

COMFORT_FORCE = 10.0  # [N] free of penalty below: Assistive Gym, config.ini
TIME_LIMIT, THROUGH_LIMIT = 30.0, 60.0  # [s]; to open, and to drive through; our own choice
# [N] from which `tool_delta` gives way, of 15 N else: hardware asks for up to 35 N.
CONTACT_FORCE = 60.0  # our own choice
# [N·m] with which the hand may turn a knob that asks for 0.80.
CONTACT_TORQUE = 1.5  # our own choice
KNOB_FRICTION = 1.0  # [1] of brass under the rubber of fingers; our own choice
BEFORE = 0.14  # [m] from the handle to the tool at the start; our own choice
OPEN_SHARE = 0.3  # of `progress`, for the open door on the way through; our own choice
HARDWARE = ("knob", "lever", "slider")
START_SPREAD = (0.05, 0.03, 0.05)  # [m] along the wall, out, up; uniform, each way; our own choice


@dataclass(frozen=True)
class AmbulatingOptions(TaskOptions):
    """Settings of the ambulating task.

    Attributes:
        reward: `paper` as in the RCareWorld paper; `shaped` adds the way to the handle, and comfort.
        mount: Side of the wheelchair that the robot is mounted on; `handle` for that of the handle, so
            that the chair is before the gap, and the right one before a panel.
        force_limit: Force on the person that ends the episode as a failure [N].
        goal: `open` as in the paper; `through` for a chair with a drive, which the robot's role steers
            through the door as well.
        clear_width: Of the door on a bare floor [m]; that of the level if None.
    """

    SHAPED_WEIGHTS = {"approach": 0.3, "progress": 0.7, "comfort": 0.5}  # our own choice

    mount: Literal["handle", "left", "right"] = "handle"
    goal: Literal["open", "through"] = "open"
    clear_width: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.clear_width is not None and not 0.5 <= self.clear_width <= 1.2:
            raise ValueError(f"clear_width must lie in [0.5, 1.2], got {self.clear_width} m")


@dataclass(frozen=True, eq=False)
class AmbulatingState(State):
    """What ambulating reads."""

    kind: Array  # 1 where it is a knob, a lever, a panel that slides; shape [3]
    slides: float  # which way a panel slides along the wall, 1 or -1; 0 of other doors
    turn: float  # how far the handle is turned [rad]; 0 where a panel slides
    opening: float  # how far the door is open [rad], or slid into the wall [m]
    is_latched: bool  # whether the latch holds it
    handle: Array  # where it is touched [m], shape [3]: a knob, a bar, or the end of a lever
    gap: Array  # from the tool to there [m], shape [3]
    distance: float  # length of that [m]
    push: float  # greatest force on the door in the control step [N]
    peak_push: float  # that of the episode
    progress: float  # share of what is to be done that is done
    best: float  # greatest share of the opening of the episode
    time_to_open: float  # when the door was first open [s]; -1 before
    way: WayState | None  # of the chair through the door; None where it is not to drive


@register_task("ambulating")
class Ambulating(Task):
    """A robot on the wheelchair works the door before which the person in it sits.

    Doors are those of the level: a knob or a lever with a spring and a latch, or a panel that slides.
    The origin is the door's frame: on the floor in the gap, y through the door and away.
    Randomised at reset: where the hand starts before the handle.
    Success and failure: the handle turned until the latch is free, or the panel open as wide as a
    wheelchair, or all of the chair driven through; force above the limit on the person.
    Tolerance: how far the handle, the panel or the chair has to go is divided by it.

    Attributes:
        door: The door.
        approach: Where chair and robot are before it.
        chair: The wheelchair.
        way: Its way through the door, where it is to drive through.
        facing: How the tool is turned at the start: `AHEAD`, or `ASIDE` if its hand does not roll.
    """

    robot = Role(
        Robot,
        default="kinova_gen3",
        partner="scripted",
        gripper="commanded",
        contact_force=CONTACT_FORCE,
        contact_torque=CONTACT_TORQUE,
    )
    recipient = Role(
        Human, default="daniel", posture="wheelchair", movable=("neck", "head"), partner="still"
    )

    reachable_by = CHAIR_ROBOTS | {"hsr", "stretch_re1_dex"}
    least_success = 95
    Options = AmbulatingOptions
    room_kinds = ("bedroom", "other", "living", "lounge", "kitchen", "bathroom")
    paper_terms = ("distance", "rotation_angle")
    site = "door"
    time_limit = TIME_LIMIT
    options: AmbulatingOptions
    state: AmbulatingState
    chair: Wheelchair
    way: WayThrough | None = None
    facing: tuple[float, ...]

    def __init__(self, options: AmbulatingOptions) -> None:
        super().__init__(options)
        self._drives = options.goal == "through"
        self.time_limit = THROUGH_LIMIT if self._drives else TIME_LIMIT

    def floor_before(self, site: DoorSite) -> Rectangle | None:
        if self._drives and (site.is_turned or not is_free_beyond(site)):
            return None  # turned, a hinged door swings against the chair
        at = DoorApproach.planned(site, self.robot, self.options.mount, self._drives)
        return at.floor(self.robot.mount_named(at.robot_mount))

    def furnish(self, world: World) -> dict[str, Pose]:
        posture = self.recipient.posture
        self.need(posture, posture.arms == "armrests", "sit in the wheelchair")
        self.door = self.place.door(
            hinge="high" if self.options.mount == "left" else "low",
            clear_width=self.options.clear_width,
        )
        self.approach = DoorApproach.of(self.door, self.robot, self.options.mount, self._drives)
        mount, side = self.approach.robot_mount, self.approach.side
        self._mount = self.robot.mount_named(mount)
        self.robot.rides = self.recipient.rides = self._drives
        powered = PoweredWheelchair(mount=self._mount, side=side) if self._drives else None
        self.chair = powered or chair_for(self._mount, side)
        at = self.approach.chair(self._mount)
        seat = spawn_fitted(self.chair, self.recipient, world, at)
        place = self.robot.mount(mount, self.frame_of(mount))
        place = place if powered is None else powered.robot_place()
        return {"robot": place, "recipient": seat}

    def frame_of(self, mount: str) -> Pose:
        return self.approach.stand() if mount == STANDING else super().frame_of(mount)

    def build(self, world: World) -> None:
        self.let_overlap(self.chair.body)
        if isinstance(chair := self.chair, PoweredWheelchair):
            self.way = WayThrough(world, self.door, chair, self.recipient)
            for rider in (self.robot, self.recipient):
                chair.carry(rider)
            self.robot.add_part(chair.drive_part())
        if self._mount.stand:
            add_stand(world, self.robot.body.base_pose())
        body = self.door.body
        if self.hardware != "slider":
            self._joint = [body.joint(self.hardware).index]
            grip(world, body, [body.link_index("handle")], friction=KNOB_FRICTION)
        self._tool, self.facing = self.robot.tool_index, AHEAD
        self._pushing = StepPeak(partial(world.contact_force, self.robot.body, body))
        home = self.robot.config.postures["home"]
        # Or from `home`, elbow up, where furniture or a jamb is beside it.
        seed: Array | None = None
        if self.place.room is not None or self._drives:
            seed = np.array([home.get(j, 0.0) for j in self.robot.arm.names])
        trials = []
        for self.facing in (AHEAD, ASIDE):  # the second of a hand that does not roll
            trials.append(Trial([self._start_pose(np.zeros(3))], seed=seed, hold=self.facing))
        found = self.search(world).find(trials, "the handle of the door")
        self.facing, self._posture = found.trial.hold, found.posture
        self.robot.set_posture(found.posture)

    def _start_pose(self, offset: Array) -> Pose:
        """Return a start pose of the tool: before the handle, level, pointing at it."""
        at = np.add(self.approach.handle, (0.0, -BEFORE, 0.0))
        return Pose(tuple((at + offset * START_SPREAD).tolist()), self.facing)

    def reset(self, rng: np.random.Generator) -> None:
        start = self._start_pose(rng.uniform(-1, 1, 3))
        self.robot.set_tool(start, self._posture)
        self._pushing.take()
        if self.way is not None:
            self.way.reset()

    def after_substep(self) -> None:
        self._pushing.after_substep()
        if self.way is not None:
            self.way.after_substep()

    def read(self, now: State, before: AmbulatingState | None) -> AmbulatingState:
        push, opening, turn = self._pushing.take(), self.door.angle, 0.0
        progress = opening / WIDE_ENOUGH
        if self.hardware != "slider":
            turn = abs(self.door.body.joint_states(self._joint)[0][0])
            progress = turn / self.door.release_angle
        at = np.array(self.door.frame_in_world(self.approach.touched).position)
        gap = at - self.robot.body.link_pose(self._tool).position
        # A handle springs back: what counts is that the latch was free.
        best = max(progress, 0.0 if before is None else before.best)
        opened = -1.0 if before is None else before.time_to_open
        way = None
        if self.way is not None:
            way = self.way.read(None if before is None else before.way)
            progress = OPEN_SHARE * min(best, 1.0) + (1 - OPEN_SHARE) * way.share
        return AmbulatingState(
            **vars(now),
            kind=np.array([self.hardware == kind for kind in HARDWARE], float),
            slides=self.approach.slides_along if self.hardware == "slider" else 0.0,
            turn=turn,
            opening=opening,
            is_latched=self.door.is_latched,
            handle=at,
            gap=gap,
            distance=float(np.linalg.norm(gap)),
            push=push,
            peak_push=max(push, 0.0 if before is None else before.peak_push),
            progress=progress,
            best=best,
            time_to_open=now.time if opened < 0 and best >= 1 else opened,
            way=way,
        )

    def observables(self, role: str) -> Sequence[Seen]:
        way = [
            Seen("chair_place", "m or rad", 3, lambda s: s.way.place),
            Seen("way_left", "m", 1, lambda s: s.way.left),
            Seen("chair_force", "N", 1, lambda s: s.way.force),
        ]
        return [
            Seen("handle_turn", "rad", 1, lambda s: s.turn),
            Seen("door_opening", "rad or m", 1, lambda s: s.opening),
            Seen("handle_position", "m", 3, lambda s: s.handle),
            Seen("tool_to_handle", "m", 3, lambda s: s.gap),
            Seen("handle_kind", "1", 3, lambda s: s.kind),
            Seen("slides_along", "1", 1, lambda s: s.slides),
            Seen("door_force", "N", 1, lambda s: s.push),
            self.contact_force(),
            self.time_left(),
            *(way if self._drives else ()),
        ]

    def rewards(self, role: str, state: AmbulatingState) -> Mapping[str, Values]:
        slides = self.hardware == "slider"
        missing = clip(WIDE_ENOUGH - state.opening, 0.0, math.inf)
        terms = {"distance": -missing} if slides else {"rotation_angle": state.turn}
        # What a step would pay at its best: an episode that ends well is paid as if it had gone on so.
        best = self.door.release_angle
        if state.way is not None:
            terms["way"], best = state.way.share, 1.0
        if self.options.reward == "shaped":
            share = clip(state.progress, 0.0, 1.0)
            near = tolerance(state.distance, bounds=(0, 0.05), margin=0.3)
            excess = self.options.discomfort(state.force, COMFORT_FORCE)
            terms = {"approach": greatest([near, share]), "progress": share, "comfort": -excess}
            terms = self.options.weighted(terms)
            best = self.options.weight("approach") + self.options.weight("progress")
        return {**terms, "opened": self.for_the_rest(state, self.succeeded(state), best)}

    def metrics(self, state: AmbulatingState) -> Mapping[str, Values]:
        found = {
            "handle_turn_deg": degrees(state.turn),
            "opening": state.opening,
            "latched": state.is_latched,
            "progress": state.best,
            "door_force_n": state.push,
            "peak_door_force_n": state.peak_push,
            "time_to_open_s": state.time_to_open,
        }
        if state.way is not None:
            found["way_through_m"] = -state.way.left
            found["chair_force_n"] = state.way.force
            found["peak_chair_force_n"] = state.way.peak
        return found

    def is_success(self, state: AmbulatingState) -> Values:
        share = state.best if state.way is None else state.way.share
        return share * self.options.tolerance >= 1

    @property
    def hardware(self) -> str:
        """What opens the door: `knob`, `lever` or `slider`."""
        return self.approach.hardware

    def camera(self) -> Camera:
        side = -1.0 if self.approach.side == "left" else 1.0
        if self._drives:  # into the gap
            return Camera(eye=(0.9 * side, -3.2, 2.2), target=(0.0, 0.1, 0.75), fov_deg=48)
        return Camera(eye=(1.9 * side, -2.0, 1.75), target=(0.1 * side, -0.4, 0.8), fov_deg=52)


def _towards_door(*rows: tuple[float, float, float]) -> tuple[float, ...]:
    return tuple(quaternion_from_matrix(np.array(rows)).tolist())


# z of the tool at the door, x up or along the wall
AHEAD = _towards_door((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
ASIDE = _towards_door((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
