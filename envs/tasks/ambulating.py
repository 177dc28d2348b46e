"""Ambulating: work the door in the way of a wheelchair, with the arm on it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcare_marl.agents.control import ToolDelta
from rcare_marl.agents.human import Human
from rcare_marl.agents.robot import Robot
from rcare_marl.agents.robot_config import no_reach
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Array, Pose, quaternion_from_matrix
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..devices.dry_friction import grip
from ..devices.stand import add_stand
from ..devices.wheelchair import chair_for
from ..homes.door import KNOB_TURN, LEVER_TURN, RELEASE
from ..homes.fixture import set_up_door
from ..homes.rectangle import Rectangle
from ..homes.rule import Rules
from ..registry import register_task
from ..rewards import tolerance
from ..safety import SafetyMeter
from ..task import Role, Task
from ..task_options import TaskOptions

# [rad] that a handle is turned when the latch is free: that of our doors. The paper has a threshold.
TURNED = {"knob": RELEASE * KNOB_TURN, "lever": RELEASE * LEVER_TURN}
WIDE_ENOUGH = 0.7  # [m] that a panel must be open: a wheelchair of 0.66 m and hands; our own choice
COMFORT_FORCE = 10.0  # [N] free of penalty below: Assistive Gym, config.ini
TIME_LIMIT = 30.0  # [s]; our own choice
# [N] from which `tool_delta` gives way, of 15 N else: hardware asks for up to 35 N.
CONTACT_FORCE = 60.0  # our own choice
KNOB_FRICTION = 1.0  # [1] of brass under the rubber of fingers; our own choice
BEFORE = 0.14  # [m] from the handle to the tool at the start; our own choice
START_SPREAD = (0.05, 0.03, 0.05)  # [m] along the wall, out, up; uniform, each way; our own choice
# [m] along and off the wall from the middle of the handle's way to where the robot is mounted.
BASE_AT = (0.0, -0.7)  # our own choice


@dataclass(frozen=True)
class AmbulatingOptions(TaskOptions):
    """Settings of the ambulating task.

    Attributes:
        reward: `paper` as in the RCareWorld paper; `shaped` adds the way to the handle, and comfort.
        mount: Side of the wheelchair that the robot is mounted on; `handle` for that of the handle, so
            that the chair is before the gap, and the right one before a panel.
        force_limit: Force on the person that ends the episode as a failure [N].
    """

    SHAPED_WEIGHTS = {"approach": 0.3, "progress": 0.7, "comfort": 0.5}  # our own choice

    mount: Literal["handle", "left", "right"] = "handle"


@register_task("ambulating")
class Ambulating(Task):
    """A robot on the wheelchair works the door before which the person in it sits.

    Doors are those of the level: a knob or a lever with a spring and a latch, or a panel that slides.
    The origin is the door's frame: on the floor in the gap, y through the door and away.
    Randomised at reset: where the hand starts before the handle.
    Success and failure: the handle turned until the latch is free, or the panel open as wide as a
    wheelchair; force above the limit on the person.
    """

    robot = Role(Robot, default="kinova_gen3", partner="scripted", gripper="commanded")
    recipient = Role(
        Human, default="daniel", posture="wheelchair", movable=("neck", "head"), partner="still"
    )

    Options = AmbulatingOptions
    room_kinds = ("bedroom", "other", "living", "lounge", "kitchen", "bathroom")
    footprint = Rectangle(-0.55, -1.75, 0.55, -0.1)  # [m] before a door that swings
    site = "door"
    time_limit = TIME_LIMIT
    options: AmbulatingOptions

    def free_floor(self) -> Rectangle:
        """Return the floor before the door [m]; before a panel the chair is to one side."""
        if Rules(self.level).choice("door_hardware") != "slider":
            return self.footprint
        left = self.options.mount == "left"
        return Rectangle(-0.45 if left else -0.8, -1.75, 0.8 if left else 0.45, -0.1)

    def furnish(self, world: World) -> dict[str, Pose]:
        if (posture := self.recipient.posture).arms != "armrests":
            raise ConfigError(f"one drives who sits in the wheelchair, not {posture.description}")
        self.lay_floor(world)
        if self.stage is not None and self.built is not None:
            self._door = self.built.doors[self.stage.fixture]
        else:
            hinge: Literal["low", "high"] = "high" if self.options.mount == "left" else "low"
            self._door = set_up_door(world, level=self.level, hinge=hinge)
        self._kind = self._door.opening.hardware
        self._touched = "lever_outside" if self._kind == "lever" else "handle_outside"
        side: Literal["left", "right"] = "left" if self._is_left() else "right"
        mount = f"wheelchair_{side}"
        self._mount = self.robot.mount_named(mount)
        self._chair = chair_for(self._mount, side)
        soles = self.recipient.soles(self._chair.frame("seat_back"))
        self._chair.fit_footplates(soles["left"], soles["right"])
        self._chair.spawn(world, self._chair_place())
        rests = [self._chair.frame_in_world(f"armrest_{side}") for side in ("left", "right")]
        self.recipient.use_arm_rests(*rests)
        return {
            "robot": self.robot.mount(mount, self._chair.pose),
            "recipient": self._chair.frame_in_world("seat_back"),
        }

    def _is_left(self) -> bool:
        """Return whether the robot is on the left of the chair, as one sits in it."""
        if self.options.mount != "handle":
            return self.options.mount == "left"
        return self._kind != "slider" and self._door.frame(self._touched).position[0] < 0

    def _chair_place(self) -> Pose:
        """Return where the chair stands: facing the door, its robot before the handle."""
        way = 0.5 * WIDE_ENOUGH * self._sign if self._kind == "slider" else 0.0
        along, off = self._door.frame(self._touched).position[0] + way + BASE_AT[0], BASE_AT[1]
        x, y, _ = self._mount.position
        return Pose((along + y, off - x, 0.0), (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)))

    @property
    def _sign(self) -> float:
        """Which way a panel slides, along x."""
        return math.copysign(1.0, -self._door.frame("handle_outside").position[0])

    def frame_of(self, mount: str) -> Pose:
        return self._chair.pose if mount.startswith("wheelchair") else Pose()

    def build(self, world: World) -> None:
        self._world = world
        self.recipient.ignore(self._chair.body)  # the posture already keeps them apart
        if self._chair.carries_robot:
            world.set_collision(self.robot.body, self._chair.body, False)
        if self._mount.stand:
            add_stand(world, self.robot.body.base_pose())
        body = self._door.body
        if self._kind != "slider":
            self._joint = [body.joint(self._kind).index]
            grip(world, body, [body.link_index("handle")], friction=KNOB_FRICTION)
        self._tool = self.robot.tool_index
        if isinstance(control := self.robot.control, ToolDelta):
            control.contact_force = CONTACT_FORCE
        movers = [a.body for a in self.cast.values() if isinstance(a, Robot)]
        limit = self.options.force_limit
        self._safety = SafetyMeter(self.recipient, world, movers, force_limit=limit)
        found = self.robot.solve_ik(self._start_pose(np.zeros(3)))
        if not found.is_within(0.02, 0.1):
            robot = self.robot
            raise ConfigError(
                f"{no_reach(robot.config, robot.files.model.name, robot.moves)} the handle of the "
                f"door: it misses its place before it by {found.distance:.2f} m"
            )
        self.robot.set_posture(found.posture)
        if world.contact_force(self.recipient.body) > 0:
            raise ConfigError("the robot touches the person before the episode begins")

    def _start_pose(self, offset: Array) -> Pose:
        """Return a start pose of the tool: before the handle, level, pointing at it."""
        at = np.add(self._door.frame(self._touched).position, (0.0, -BEFORE, 0.0))
        return Pose(tuple((at + offset * START_SPREAD).tolist()), AHEAD)

    def reset(self, rng: np.random.Generator) -> None:
        start = self._start_pose(rng.uniform(-1, 1, 3))
        self.robot.set_posture(self.robot.solve_ik(start).posture)
        self._safety.reset()
        self._push = self._peak_push = self._step_push = 0.0
        self._best, self._time_to_open = 0.0, -1.0

    def after_substep(self) -> None:
        push = self._world.contact_force(self.robot.body, self._door.body)
        if push > self._step_push:
            self._step_push = push
        self._safety.after_substep()

    def after_step(self) -> None:
        self._safety.after_step(self.control_dt)
        self._push, self._step_push = self._step_push, 0.0
        self._peak_push = max(self._peak_push, self._push)
        self._opening = self._door.angle
        if self._kind == "slider":
            self._turn = 0.0
            self._progress = self._opening / WIDE_ENOUGH
        else:
            self._turn = abs(self._door.body.joint_states(self._joint)[0][0])
            self._progress = self._turn / TURNED[self._kind]
        self._at = np.array(self._door.frame_in_world(self._touched).position)
        self._gap = self._at - self.robot.body.link_pose(self._tool).position
        # A handle springs back: what counts is that the latch was free.
        self._best = max(self._best, self._progress)
        if self._time_to_open < 0 and self._best >= 1:
            self._time_to_open = self._world.time

    def observables(self, role: str) -> Sequence[Observable]:
        return [
            Observable("handle_turn", "rad", 1, lambda: (self._turn,)),
            Observable("door_opening", "rad or m", 1, lambda: (self._opening,)),
            Observable("handle_position", "m", 3, lambda: self._at),
            Observable("tool_to_handle", "m", 3, lambda: self._gap),
            Observable("door_force", "N", 1, lambda: (self._push,)),
            Observable("contact_force", "N", 1, lambda: (self._safety.force,)),
            Observable("time_left", "s", 1, lambda: (self.time_limit - self._world.time,)),
        ]

    def rewards(self, role: str) -> Mapping[str, float]:
        missing = max(WIDE_ENOUGH - self._opening, 0.0)
        slides = self._kind == "slider"
        terms = {"distance": -missing} if slides else {"rotation_angle": self._turn}
        # What a step would pay at its best: an episode that ends well is paid as if it had gone on so.
        best = 0.0 if slides else TURNED[self._kind]
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
            "latched": float(self._door.is_latched),
            "progress": self._best,
            "door_force_n": self._push,
            "peak_door_force_n": self._peak_push,
            "time_to_open_s": self._time_to_open,
        }

    def is_success(self) -> bool:
        return self._best >= 1 and not self.is_failure()

    def is_failure(self) -> bool:
        return self._safety.peak_force > self.options.force_limit

    @property
    def hardware(self) -> str:
        """What opens the door: `knob`, `lever` or `slider`."""
        return self._kind

    @property
    def slides_along(self) -> float:
        """Which way a panel slides: 1 along x, -1 against it."""
        return self._sign

    def opening(self) -> float:
        """Return how far the door is open [rad], or slid into the wall [m]."""
        return self._opening

    def handle_position(self) -> Array:
        """Return where the handle is touched [m], shape [3]: a knob, a bar, or the end of a lever."""
        return self._at

    def camera(self) -> Camera:
        side = math.copysign(
            1.0, self.robot.body.base_pose().position[0] - self._chair.pose.position[0]
        )
        return Camera(eye=(1.9 * side, -2.0, 1.75), target=(0.1 * side, -0.4, 0.8), fov_deg=52)


AHEAD = tuple(
    quaternion_from_matrix(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])).tolist()
)  # z at the door, x up
