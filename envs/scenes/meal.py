"""A person in the wheelchair to whose mouth a robot brings something."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.pose import Array, Pose, about_z
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..devices import Wheelchair, chair_for, spawn_fitted
from ..rectangle import Rectangle
from ..state import State
from ..task import CHAIR_ROBOTS, STANDING_CAREGIVER, Role, Task
from ..task_options import TaskOptions
from .refusal import Refusal, turns_away

MOUTH_RADIUS = 0.03  # [m] what comes within this of the mouth goes in: Assistive Gym, feeding.py
OPEN_MOUTH = math.radians(10)  # of the jaw, before anything goes in; our own choice
MOUTH_IN_FRONT = (
    0.01  # [m] the place to bring things to lies this far before the lips; our own choice
)
MOVABLE = ("spine1_flexion", "spine1_lateral_flexion_left", "neck", "head", "jaw_opening")
OFFERED, TAKEN_AWAY = 0.22, 0.26  # [m] from the mouth: within offered, beyond no more; own choice
# [m] that an arm had better keep from the recipient; [rad] what it costs to touch them; own choices
ROOM, CROWDED = 0.08, 1.0
ROBOT_ROOM = 0.6  # [m] about the base of a robot, its elbows too; own choice
HELPER_AT = (0.15, 0.85)  # [m] beside the chair, where a caregiver stands; our own choice


class Mouth:
    """Where a person's mouth is, which way the face looks, and whether it is open.

    Attributes:
        position: The place to bring things to, in front of the lips, in the world [m], shape [3].
        face: Where the face looks, a unit vector, shape [3].
        ahead: The same, level.
        jaw: How far the jaw is open [rad].
    """

    def __init__(self, person: Human) -> None:
        self._person = person
        self.sense()

    def sense(self) -> None:
        """Look where it is now."""
        lips, self.face = self._person.mouth_and_face()
        self.position = lips + MOUTH_IN_FRONT * self.face
        self.jaw = self._person.angle("jaw_opening")
        x, y = self.face[:2].tolist()
        length = max(math.hypot(x, y), 1e-9)
        self.ahead: Array = np.array((x / length, y / length, 0.0))

    @property
    def is_open(self) -> bool:
        """Whether anything goes in."""
        return self.jaw >= OPEN_MOUTH

    def takes(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return which points in the world [m], shape [n, 3], go in, shape [n]; none if it is closed."""
        if not self.is_open:
            return np.zeros(len(points), np.bool_)
        apart = points - self.position
        return np.asarray(np.einsum("na,na->n", apart, apart) < MOUTH_RADIUS**2)


@dataclass(frozen=True)
class MealOptions(TaskOptions):
    """Settings of a meal.

    Attributes:
        mount: Side of the wheelchair that the robot is mounted on.
    """

    mount: Literal["left", "right"] = "right"


class Meal(Task):
    """Brings something to the mouth of a person in the wheelchair; a task says what, and what counts.

    Attributes:
        use: What the robot is mounted for, where it has a mount of its own for that.
        chair: The wheelchair.
    """

    robot = Role(Robot, default="kinova_gen3", partner="scripted")
    recipient = Role(
        Human,
        default="karan",
        posture="wheelchair",
        movable=MOVABLE,
        partner="cooperative",
        speaks=True,
    )
    caregiver = STANDING_CAREGIVER

    room_kinds = ("dining", "kitchen", "living", "lounge", "bedroom")
    reachable_by: Collection[str] = CHAIR_ROBOTS | {"stretch_re1_dex"}
    least_success = 95
    use = "meal"
    footprint = Rectangle(-0.8, -1.0, 1.2, 1.1)  # [m] the chair, a robot or helper at its side
    options: MealOptions
    chair: Wheelchair

    def free_floor(self) -> Rectangle:
        x, y, _ = self.robot.mount_named(self._mount).pose.position
        return Rectangle.around([self.footprint, Rectangle(x, y, x, y).grown(ROBOT_ROOM)])

    @property
    def _mount(self) -> str:
        return self.robot.config.mount_for(f"wheelchair_{self.options.mount}", self.use)

    def furnish(self, world: World) -> dict[str, Pose]:
        posture = self.recipient.posture
        self.need(posture, posture.arms == "armrests", "sit in the wheelchair")
        self.chair = chair_for(self.robot.mount_named(self._mount), self.options.mount)
        seat = spawn_fitted(self.chair, self.recipient, world)
        return {
            "robot": self.mounted(self.robot, self._mount),
            "recipient": seat,
            "caregiver": Pose((*HELPER_AT, 0.0), about_z(-math.pi / 2)),  # facing the chair
        }

    def build(self, world: World) -> None:
        """Let people and a robot on the chair be where they are in it."""
        self.let_overlap(self.chair.body)
        self._head_dofs = [d for d in self.recipient.movable if d.startswith(("neck", "head"))]

    def crowding(self) -> float:
        """Return what it costs that the arm is so near the recipient as it is [rad], for `search`."""
        gap = self.world.separation(self.robot.body, self.recipient.body, within=ROOM)
        return CROWDED * (1.0 - gap / ROOM)

    def turn_head(self, rng: np.random.Generator, turn: float, tilt: float) -> None:
        """Turn and tilt the head of the recipient at random, uniformly each way up to two angles [rad]."""
        turned, tilted = rng.uniform(-turn, turn) / 2, rng.uniform(-tilt, tilt) / 2
        start = {f"{part}_rotation_left": turned for part in ("neck", "head")}
        start |= {f"{part}_flexion": tilted for part in ("neck", "head")}
        self.recipient.set_angles({d: a for d, a in start.items() if d in self._head_dofs})

    def refused(self, now: State, before: Any, face: Array, way: Array) -> Refusal:
        """Return what the recipient has refused.

        Args:
            now: What every task reads.
            before: The state of the task a control step before; None at the beginning of an episode.
            face: Where the face looks, a unit vector, shape [3].
            way: From the mouth to what is offered [m], shape [3].
        """
        distance, jaw = math.sqrt(float(way @ way)), self.recipient.angle("jaw_opening")
        return (Refusal() if before is None else before.refusal).after(
            says_no=self.recipient.says_no,
            turns_away=turns_away(self.recipient, face, way, jaw),
            is_offered=distance < OFFERED,
            is_away=distance > TAKEN_AWAY,
            force=float(now.force),
        )

    def camera(self) -> Camera:
        far = 1.0 if self.chair.carries_robot else 1.25  # others stand beside, and are larger
        side = 1.0 if self.robot.body.base_pose().position[1] < -0.5 else -1.0
        return Camera(eye=(1.75 * far, 1.45 * far * side, 1.6), target=(0.17, 0, 0.78), fov_deg=42)
