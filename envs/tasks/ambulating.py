"""Ambulating: work the door in the way of a wheelchair, with the arm on it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from rcare_marl.agents.control import ToolDelta
from rcare_marl.agents.human import Human
from rcare_marl.agents.kinematics import IkResult
from rcare_marl.agents.robot import Robot
from rcare_marl.agents.robot_config import no_reach
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Array, Pose, quaternion_from_matrix
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..devices.dry_friction import grip
from ..devices.powered_wheelchair import PoweredWheelchair
from ..devices.stand import add_stand
from ..devices.wheelchair import Wheelchair, chair_for
from ..homes.care_home import CareHome
from ..homes.door import KNOB_TURN, LEVER_TURN, RELEASE
from ..homes.fixture import set_up_door
from ..homes.plan import Opening
from ..homes.rectangle import Rectangle
from ..homes.rule import Rules
from ..registry import register_task
from ..rewards import tolerance
from ..scenes.door_approach import STANDING, WIDE_ENOUGH, DoorApproach, is_free_beyond
from ..scenes.way_through import WayThrough
from ..task import Role, Task
from ..task_options import TaskOptions

# [rad] that a handle is turned when the latch is free: that of our doors. The paper has a threshold.
TURNED = {"knob": RELEASE * KNOB_TURN, "lever": RELEASE * LEVER_TURN}
COMFORT_FORCE = 10.0  # [N] free of penalty below: Assistive Gym, config.ini
TIME_LIMIT, THROUGH_LIMIT = 30.0, 60.0  # [s]; to open, and to drive through; our own choice
# [N] from which `tool_delta` gives way, of 15 N else: hardware asks for up to 35 N.
CONTACT_FORCE = 60.0  # our own choice
KNOB_FRICTION = 1.0  # [1] of brass under the rubber of fingers; our own choice
BEFORE = 0.14  # [m] from the handle to the tool at the start; our own choice
OPEN_SHARE = 0.3  # of `progress`, for the open door on the way through; our own choice
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

    robot = Role(Robot, default="kinova_gen3", partner="scripted", gripper="commanded")
    recipient = Role(
        Human, default="daniel", posture="wheelchair", movable=("neck", "head"), partner="still"
    )

    Options = AmbulatingOptions
    room_kinds = ("bedroom", "other", "living", "lounge", "kitchen", "bathroom")
    site = "door"
    time_limit = TIME_LIMIT
    options: AmbulatingOptions
    way: WayThrough | None = None
    facing: tuple[float, ...]

    def __init__(self, options: AmbulatingOptions) -> None:
        super().__init__(options)
        self._drives = options.goal == "through"
        self.time_limit = THROUGH_LIMIT if self._drives else TIME_LIMIT

    def floor_before(self, home: CareHome, opening: Opening, is_turned: bool) -> Rectangle | None:
        if self._drives and (is_turned or not is_free_beyond(home, opening)):
            return None  # turned, a hinged door swings against the chair
        rules, side, robot = Rules(self.level), self.options.mount, self.robot
        at = DoorApproach.planned(opening, rules, is_turned, robot, side, self._drives)
        return at.floor(robot.mount_named(at.robot_mount))

    def furnish(self, world: World) -> dict[str, Pose]:
        if (posture := self.recipient.posture).arms != "armrests":
            raise ConfigError(f"one drives who sits in the wheelchair, not {posture.description}")
        self.lay_floor(world)
        if self.stage is not None and self.built is not None:
            self.door = self.built.doors[self.stage.fixture]
            if self.options.clear_width is not None:
                raise ConfigError("clear_width is for a door on a bare floor: a house has its own")
        else:
            hinge: Literal["low", "high"] = "high" if self.options.mount == "left" else "low"
            clear = self.options.clear_width
            self.door = set_up_door(world, level=self.level, hinge=hinge, clear_width=clear)
        self.approach = DoorApproach.of(self.door, self.robot, self.options.mount, self._drives)
        self._kind, self._touched = self.approach.hardware, self.approach.touched
        mount, side = self.approach.robot_mount, self.approach.side
        self._mount = self.robot.mount_named(mount)
        self.robot.rides = self.recipient.rides = self._drives
        powered = PoweredWheelchair(mount=self._mount, side=side) if self._drives else None
        self.chair: Wheelchair = powered or chair_for(self._mount, side)
        soles = self.recipient.soles(self.chair.frame("seat_back"))
        self.chair.fit_footplates(soles["left"], soles["right"])
        self.chair.spawn(world, self.approach.chair(self._mount))
        rests = [self.chair.frame_in_world(f"armrest_{side}") for side in ("left", "right")]
        self.recipient.use_arm_rests(*rests)
        place = self.robot.mount(mount, self.frame_of(mount))
        place = place if powered is None else powered.robot_place()
        return {"robot": place, "recipient": self.chair.frame_in_world("seat_back")}

    def frame_of(self, mount: str) -> Pose:
        if mount == STANDING:
            return self.approach.stand()
        return self.chair.pose if mount.startswith("wheelchair") else Pose()

    def build(self, world: World) -> None:
        self._world = world
        self.recipient.ignore(self.chair.body)  # the posture already keeps them apart
        if self.chair.carries_robot:
            world.set_collision(self.robot.body, self.chair.body, False)
        if isinstance(chair := self.chair, PoweredWheelchair):
            self.way = WayThrough(world, self.door, chair, self.recipient)
            for rider in (self.robot, self.recipient):
                chair.carry(rider)
            self.robot.add_part(chair.drive_part())
        if self._mount.stand:
            add_stand(world, self.robot.body.base_pose())
        body = self.door.body
        if self._kind != "slider":
            self._joint = [body.joint(self._kind).index]
            grip(world, body, [body.link_index("handle")], friction=KNOB_FRICTION)
        self._tool, self.facing = self.robot.tool_index, AHEAD
        self._touching = partial(world.contact_force, self.robot.body, body)
        if isinstance(control := self.robot.control, ToolDelta):
            control.contact_force = CONTACT_FORCE
        movers = [a.body for a in self.cast.values() if isinstance(a, Robot)]
        self._safety = self.measure(self.recipient, world, movers)
        home = self.robot.config.postures["home"]
        self._seed = None  # or from `home`, elbow up, where furniture or a jamb is beside it
        if self.stage is not None or self._drives:
            self._seed = [home.get(joint, 0.0) for joint in self.robot.arm.names]
        found = self._start(np.zeros(3))
        if not found.is_within(0.02, 0.1):
            self.facing = ASIDE  # a hand that does not roll
            found = self._start(np.zeros(3))
        if not found.is_within(0.02, 0.1):
            robot = self.robot
            raise ConfigError(
                f"{no_reach(robot.config, robot.files.model.name, robot.moves)} the handle of the "
                f"door: it misses its place before it by {found.distance:.2f} m"
            )
        self.robot.set_posture(found.posture)
        if world.contact_force(self.recipient.body) > 0:
            raise ConfigError("the robot touches the person before the episode begins")

    def _start(self, offset: Array) -> IkResult:
        """Return a start posture: the tool before the handle, level, pointing at it."""
        at = np.add(self.approach.handle, (0.0, -BEFORE, 0.0))
        pose = Pose(tuple((at + offset * START_SPREAD).tolist()), self.facing)
        return self.robot.solve_ik(pose, seed=self._seed)

    def reset(self, rng: np.random.Generator) -> None:
        self.robot.set_posture(self._start(rng.uniform(-1, 1, 3)).posture)
        self._safety.reset()
        self._push = self._peak_push = self._step_push = 0.0
        self._best, self._time_to_open = 0.0, -1.0
        if self.way is not None:
            self.way.reset()

    def after_substep(self) -> None:
        push = self._touching()
        if push > self._step_push:
            self._step_push = push
        if self.way is not None:
            self.way.after_substep()
        self._safety.after_substep()

    def after_step(self) -> None:
        self._safety.after_step(self.control_dt)
        self._push, self._step_push = self._step_push, 0.0
        self._peak_push = max(self._peak_push, self._push)
        self._opening = self.door.angle
        if self._kind == "slider":
            self._turn = 0.0
            self._progress = self._opening / WIDE_ENOUGH
        else:
            self._turn = abs(self.door.body.joint_states(self._joint)[0][0])
            self._progress = self._turn / TURNED[self._kind]
        self._at = np.array(self.door.frame_in_world(self._touched).position)
        self._gap = self._at - self.robot.body.link_pose(self._tool).position
        # A handle springs back: what counts is that the latch was free.
        self._best = max(self._best, self._progress)
        if self._time_to_open < 0 and self._best >= 1:
            self._time_to_open = self._world.time
        if self.way is not None:
            self.way.after_step()
            opened = OPEN_SHARE * min(self._best, 1.0)
            self._progress = opened + (1 - OPEN_SHARE) * self.way.share

    def observables(self, role: str) -> Sequence[Observable]:
        return [
            Observable("handle_turn", "rad", 1, lambda: (self._turn,)),
            Observable("door_opening", "rad or m", 1, lambda: (self._opening,)),
            Observable("handle_position", "m", 3, lambda: self._at),
            Observable("tool_to_handle", "m", 3, lambda: self._gap),
            Observable("door_force", "N", 1, lambda: (self._push,)),
            Observable("contact_force", "N", 1, lambda: (self._safety.force,)),
            Observable("time_left", "s", 1, lambda: (self.time_limit - self._world.time,)),
            *(self.way.observables() if self.way is not None else ()),
        ]

    def rewards(self, role: str) -> Mapping[str, float]:
        missing = max(WIDE_ENOUGH - self._opening, 0.0)
        slides = self._kind == "slider"
        terms = {"distance": -missing} if slides else {"rotation_angle": self._turn}
        # What a step would pay at its best: an episode that ends well is paid as if it had gone on so.
        best = 0.0 if slides else TURNED[self._kind]
        if self.way is not None:
            terms["way"], best = self.way.share, 1.0
        if self.options.reward == "shaped":
            share = min(max(self._progress, 0.0), 1.0)
            near = tolerance(float(np.linalg.norm(self._gap)), bounds=(0, 0.05), margin=0.3)
            excess = self.options.discomfort(self._safety.force, COMFORT_FORCE)
            terms = {"approach": max(near, share), "progress": share, "comfort": -excess}
            terms = self.options.weighted(terms)
            best = self.options.weight("approach") + self.options.weight("progress")
        left = max(self.time_limit - self._world.time, 0.0) / self.control_dt
        terms["opened"] = best * left if self.is_success() else 0.0
        return terms

    def metrics(self) -> Mapping[str, float]:
        return {
            **self._safety.metrics(),
            "handle_turn_deg": math.degrees(self._turn),
            "opening": self._opening,
            "latched": float(self.door.is_latched),
            "progress": self._best,
            "door_force_n": self._push,
            "peak_door_force_n": self._peak_push,
            "time_to_open_s": self._time_to_open,
            **(self.way.metrics() if self.way is not None else {}),
        }

    def is_success(self) -> bool:
        share = self._best if self.way is None else self.way.share
        return share * self.options.tolerance >= 1 and not self.is_failure()

    def is_failure(self) -> bool:
        return self._safety.peak_force > self.options.force_limit

    @property
    def hardware(self) -> str:
        """What opens the door: `knob`, `lever` or `slider`."""
        return self._kind

    def opening(self) -> float:
        """Return how far the door is open [rad], or slid into the wall [m]."""
        return self._opening

    def handle_position(self) -> Array:
        """Return where the handle is touched [m], shape [3]: a knob, a bar, or the end of a lever."""
        return self._at

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
