"""Toileting: lift the lid of the toilet by its lip."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.pose import Array, Pose, about_z, quaternion_from_rpy
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..devices import Wheelchair, add_stand, needs_stand, spawn_fitted
from ..reach import Trial
from ..rectangle import Rectangle
from ..registry import register_task
from ..scenes.step_peak import StepPeak
from ..state import Seen, State, Values, clip, degrees, greatest, tolerance
from ..task import CHAIR_ROBOTS, STANDING_CAREGIVER, Role, Task
from ..task_options import TaskOptions

OPEN_ANGLE_DEG = 60.0  # of the lid: the paper has a threshold and does not tell it; our own choice
GENTLE_FORCE = 30.0  # [N] on the toilet, free of penalty; its lid weighs 12 N; our own choice
ROUGH_FORCE = 100.0  # [N] on the toilet, full penalty: what Stretch can lift; our own choice
# [N] from which `tool_delta` gives way, of 15 N else: it would slide off under the weight of the lid.
CONTACT_FORCE = 40.0  # our own choice
START = (0.075, 0.0, -0.02)  # [m] from the lip to the tool: out, across, up; our own choice
START_SPREAD = (0.025, 0.04, 0.05)  # [m] uniform, each way; our own choice
REACH_ANGLE = math.radians(20)  # that a hand may be turned away from straight; our own choice
HAND = 0.03  # [m] of the hand beyond the tool, to ask whether the open lid can be reached
HELD_AT = 0.38  # [m] from the hinge, where the open lid is then pushed; our own choice
DISTANCES = (
    1.2,
    1.1,
    1.0,
    0.9,
    1.3,
)  # [m] from the wall to a robot, the best first; our own choice
ASIDES = (0.0, 0.25, -0.25)  # [m] and beside the middle; our own choice
STAND = 0.5  # [m] height of the stand of an arm that has no base; our own choice
CLEAR, OFF_WALL = 0.003, 0.002  # [m] between robot and toilet, and walls, at the start


@dataclass(frozen=True)
class ToiletingOptions(TaskOptions):
    """Settings of the toileting task.

    Attributes:
        reward: `paper` as in the RCareWorld paper; `shaped` adds the way to the lip, and gentleness.
        open_angle_deg: Angle of the lid above which it counts as open [degrees]. From 92 on it stays
            up by itself.
        force_limit: Force on a person that ends the episode as a failure [N].
    """

    SHAPED_WEIGHTS = {"approach": 0.3, "open_angle": 0.7, "gentle": 0.2}  # our own choice

    open_angle_deg: float = OPEN_ANGLE_DEG

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.open_angle_deg <= 95:
            raise ValueError(f"open_angle_deg must be in (0, 95], got {self.open_angle_deg}")


@dataclass(frozen=True, eq=False)
class ToiletingState(State):
    """What toileting reads."""

    angle: float  # how far the lid is open [rad]
    speed: float  # how fast it opens [rad/s]
    lip: Array  # the underside of its lip [m], shape [3]
    gap: Array  # from the tool to there [m], shape [3]
    distance: float  # length of that [m]
    push: float  # greatest force on the toilet in the control step [N]
    peak_push: float  # that of the episode
    peak_angle: float  # greatest angle of the episode [rad]
    time_to_open: float  # when the lid was first open [s]; -1 before


@register_task("toileting")
class Toileting(Task):
    """A robot in the bathroom lifts the lid of the toilet, for somebody who cannot.

    The lid is a link on a hinge and moves only by contact. The origin is the toilet's frame: on the
    floor at the wall behind it, x out of the wall.
    Randomised at reset: where the hand starts in front of the lip.
    Success and failure: the lid over its angle; force above the limit on a person, if one is there.
    Tolerance: that angle is divided by it.

    Attributes:
        fingers: How far the hand reaches ahead of its tool [m].
    """

    robot = Role(Robot, default="stretch_re1", partner="scripted", contact_force=CONTACT_FORCE)
    recipient = Role(
        Human,
        default=None,
        optional=True,
        posture="wheelchair",
        partner="still",
        movable=("neck", "head"),
    )
    caregiver = STANDING_CAREGIVER

    reachable_by = CHAIR_ROBOTS | {"hsr", "stretch_re1_dex"}
    least_success = 95
    Options = ToiletingOptions
    room_kinds = ("bathroom",)
    paper_terms = ("open_angle",)
    footprint = Rectangle(0.73, -0.3, 1.55, 0.37)  # [m] before the bowl
    site = "toilet"
    bystanders = ()
    options: ToiletingOptions
    state: ToiletingState
    fingers: float

    def free_floor(self) -> Rectangle:
        """Return the floor before the bowl, and that beside it where somebody waits [m]."""
        people = [role for role in ("recipient", "caregiver") if role in self.cast]
        if not people:
            return self.footprint
        x0, x1 = 0.05 if "recipient" in people else 0.73, 1.75 if "caregiver" in people else 1.55
        return Rectangle(x0, -1.05, x1, 0.37)

    def furnish(self, world: World) -> dict[str, Pose]:
        self._fixture = self.place.fixture("toilet")
        places = {"robot": self._robot_place(DISTANCES[0], 0.0)}
        places["caregiver"] = Pose((1.45, -0.75, 0.0), about_z(math.radians(150)))
        if "recipient" in self.cast:
            places["recipient"] = self._seat(world)
        return places

    def _robot_place(self, distance: float, aside: float) -> Pose:
        """Return where the robot's root goes, so that it looks, or its arm reaches, at the toilet."""
        height = STAND if needs_stand(self.robot) else 0.0
        name = "table" if self.robot.config.base is not None else "floor"
        return self.robot.mount(name, Pose((distance, aside, height), about_z(math.pi)))

    def _seat(self, world: World) -> Pose:
        """Add a wheelchair beside the toilet, and return where its user sits."""
        posture = self.recipient.posture
        self.need(posture, posture.arms == "armrests", "sit in the wheelchair")
        self.chair = Wheelchair(mounts="none")
        return spawn_fitted(self.chair, self.recipient, world, Pose((0.6, -0.68, 0.0)))

    def build(self, world: World) -> None:
        if self.chair is not None:
            self.let_overlap(self.chair.body)
        self._body = self._fixture.body
        lid = self._fixture.model.joints["lid"]
        self._lid = [self._body.joint("lid").index]
        self._tool = self.robot.tool_index
        self._pushing = StepPeak(partial(world.contact_force, self.robot.body, self._body))
        self._hinge = np.array(lid.at) * (1, 0, 1)
        self._lip = np.array(self._fixture.frames["handle_lid"].position) - self._hinge
        self._stand_robot(world)

    def _stand_robot(self, world: World) -> None:
        """Find the place from which the robot reaches the lip, and the lid when it is open."""
        robot, aims = self.robot, [self._start_pose(np.zeros(3)), self._open_pose()]
        places = itertools.product(DISTANCES, ASIDES)
        search = self.search(
            world,
            clear_of=[(self._body, CLEAR), *((w, OFF_WALL) for _, w in self.place.obstacles)],
            within=lambda found: found.is_within(0.02, REACH_ANGLE),
        )
        found = search.find(
            [Trial(aims, self._robot_place(*place)) for place in places], "the lid of the toilet"
        )
        self._posture = found.posture
        robot.set_posture(found.posture)
        out = robot.tool_pose().position[0] - self.lip_at(0.0)[0]
        self.fingers = float(out) - world.separation(robot.body, self._body, within=out)
        if needs_stand(self.robot):
            add_stand(world, found.base)

    def _start_pose(self, offset: Array) -> Pose:
        """Return a start pose of the tool: in front of the lip, level, pointing at it."""
        at = self.lip_at(0.0) + START + offset * START_SPREAD
        return Pose(tuple(at.tolist()), _AHEAD)

    def _open_pose(self) -> Pose:
        """Return where the tool is about to push the lid over its angle."""
        angle = math.radians(self.options.open_angle_deg)
        out = np.array((math.sin(angle), 0.0, -math.cos(angle)))
        at = self.lip_at(angle, HELD_AT) + HAND * out
        return Pose(tuple(at.tolist()), _AHEAD)

    def reset(self, rng: np.random.Generator) -> None:
        start = self._start_pose(rng.uniform(-1, 1, 3))
        # From where it was found to be clear: a base that slides must not slide into a wall.
        self.robot.set_tool(start, self._posture)
        self._pushing.take()

    def after_substep(self) -> None:
        self._pushing.after_substep()

    def read(self, now: State, before: ToiletingState | None) -> ToiletingState:
        push = self._pushing.take()
        (angle,), (speed,) = self._body.joint_states(self._lid)
        lip = self.lip_at(angle)
        gap = lip - self.robot.body.link_pose(self._tool).position
        opened = -1.0 if before is None else before.time_to_open
        return ToiletingState(
            **vars(now),
            angle=angle,
            speed=speed,
            lip=lip,
            gap=gap,
            distance=math.sqrt(float(gap @ gap)),
            push=push,
            peak_push=max(push, 0.0 if before is None else before.peak_push),
            peak_angle=max(angle, 0.0 if before is None else before.peak_angle),
            time_to_open=now.time if opened < 0 and self._is_open(angle) else opened,
        )

    def _is_open(self, angle: Values) -> Values:
        return angle * self.options.tolerance > math.radians(self.options.open_angle_deg)

    def observables(self, role: str) -> Sequence[Seen]:
        return [
            Seen("lid_angle", "rad", 1, lambda s: s.angle),
            Seen("lid_speed", "rad/s", 1, lambda s: s.speed),
            Seen("lip_position", "m", 3, lambda s: s.lip),
            Seen("tool_to_lip", "m", 3, lambda s: s.gap),
            Seen("toilet_force", "N", 1, lambda s: s.push),
            self.contact_force(),
            self.time_left(),
        ]

    def rewards(self, role: str, state: ToiletingState) -> Mapping[str, Values]:
        terms = {"open_angle": clip(state.angle, 0.0, math.inf)}
        if self.options.reward == "shaped":
            share = clip(state.angle / math.radians(self.options.open_angle_deg), 0.0, 1.0)
            near = tolerance(state.distance, bounds=(0, 0.05), margin=0.3)
            rough = (state.push - GENTLE_FORCE) / (ROUGH_FORCE - GENTLE_FORCE)
            # A lid that is being lifted has been reached, wherever the hand is by then.
            terms = {"approach": greatest([near, share]), "open_angle": share}
            terms["gentle"] = -clip(rough, 0.0, 1.0)
            terms = self.options.weighted(terms)
        # An episode that ends well is paid as if it had gone on so: else to hold the lid just below
        # its angle would pay more than to open it.
        step = sum(terms.values())
        return {**terms, "opened": self.for_the_rest(state, self.succeeded(state), step)}

    def metrics(self, state: ToiletingState) -> Mapping[str, Values]:
        return {
            "lid_angle_deg": degrees(state.angle),
            "peak_lid_angle_deg": degrees(state.peak_angle),
            "toilet_force_n": state.push,
            "peak_toilet_force_n": state.peak_push,
            "time_to_open_s": state.time_to_open,
        }

    def is_success(self, state: ToiletingState) -> Values:
        return self._is_open(state.angle)

    def lip_at(self, angle: float, from_hinge: float | None = None) -> Array:
        """Return where the underside of the lid is in the world [m], shape [3].

        Args:
            angle: How far the lid is open [rad].
            from_hinge: How far from the hinge, along the lid [m]; its lip if None.
        """
        along = self._lip[0] if from_hinge is None else from_hinge
        up, c, s = self._lip[2], math.cos(angle), math.sin(angle)
        return self._hinge + np.array((along * c - up * s, 0.0, along * s + up * c))

    def camera(self) -> Camera:
        side = -1.0  # the open one: there is a wall on the other side
        if (room := self.place.room) is not None:
            side = math.copysign(1.0, room.y0 + room.y1)
        if self.people:
            return Camera(eye=(1.1, 2.3 * side, 2.3), target=(0.8, -0.1, 0.5), fov_deg=52)
        return Camera(eye=(2.1, 1.12 * side, 1.6), target=(0.75, 0.05, 0.55), fov_deg=58)


_AHEAD = tuple(quaternion_from_rpy(0.0, -0.5 * math.pi, 0.0).tolist())  # z at the toilet, x up
