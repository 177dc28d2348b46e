"""Where wheelchair and robot are before a door that is to be worked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import Mount
from rcare_marl.pose import Pose

from ..place import DoorSite
from ..rectangle import Rectangle

if TYPE_CHECKING:
    from ..place import Door

Choice = Literal["handle", "left", "right"]
Side = Literal["left", "right"]
STANDING = "door_side"  # mount of robots that stand on the floor
WIDE_ENOUGH = 0.7  # [m] that a panel must be open: a wheelchair of 0.66 m and hands; our own choice
OFF = 0.7  # [m] from the wall's middle to where a robot is mounted on the chair; our own choice
ASIDE = 0.04  # [m] from the middle of the gap to where the chair drives through; our own choice
BESIDE, BACK = 0.78, 1.3  # [m] of the chair's middle from a robot that stands, and from the wall
HALF, BEHIND = 0.34, 0.47  # [m] of the chair, elbows included, and 1 cm more; our own choice
ARM, HAND = 0.19, 0.05  # [m] that arm and hand take beside base and handle; our own choice
ROBOT, ROOM = 0.4, 1.3  # [m] that a robot takes that stands: to each side, and from the wall
BEYOND = 1.7  # [m] from the wall's middle that a chair takes that came through; our own choice
FACING = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))  # forward is y: to the door


@dataclass(frozen=True)
class DoorApproach:
    """A door that is worked from y < 0 of its frame, or of that turned half round.

    Attributes:
        handle: Where it is touched while it is shut [m].
        hardware: What opens it: `knob`, `lever` or `slider`.
        mount: Side of the wheelchair that the robot is mounted on; `handle` for that of the handle,
            and the right one before a panel.
        drives: Whether the chair is to drive through.
        stands: Whether the robot stands on the floor by itself.
        touched: The frame of the door where its handle is touched.
    """

    handle: tuple[float, ...]
    hardware: str
    mount: Choice
    drives: bool
    stands: bool
    touched: str = ""

    @staticmethod
    def planned(site: DoorSite, robot: Robot, mount: Choice, drives: bool) -> DoorApproach:
        """Return the approach to a door of a plan, from its own side of y < 0 or the other one."""
        return DoorApproach(site.handle, site.hardware, mount, drives, _stands(robot, drives))

    @staticmethod
    def of(door: Door, robot: Robot, mount: Choice, drives: bool) -> DoorApproach:
        """Return the approach to a door that is in the world, shut."""
        kind = door.hardware
        front = "outside" if door.frame_in_world("handle_outside").position[1] < 0 else "inside"
        touched = f"{'lever' if kind == 'lever' else 'handle'}_{front}"
        at = door.frame_in_world(touched).position
        return DoorApproach(at, kind, mount, drives, _stands(robot, drives), touched)

    @property
    def robot_mount(self) -> str:
        """The name of the mount of the robot."""
        return STANDING if self.stands else f"wheelchair_{self.side}"

    @property
    def slides_along(self) -> float:
        """Which way a panel slides: 1 along x, -1 against it."""
        return math.copysign(1.0, -self.handle[0])

    @property
    def side(self) -> Side:
        """The side of the chair that the robot is on, as one sits in it."""
        if self.mount != "handle":
            return self.mount
        slides = self.hardware == "slider" and not self.drives
        return "left" if self.handle[0] < 0 and not slides else "right"

    @property
    def middle(self) -> float:
        """The middle of the handle's way along x [m]."""
        slides = self.hardware == "slider"
        return self.handle[0] + (0.5 * WIDE_ENOUGH * self.slides_along if slides else 0.0)

    def chair(self, mount: Mount) -> Pose:
        """Return where the chair stands: facing the door, its robot, at `mount`, before the handle."""
        x, y, _ = mount.position
        if self.stands:
            return Pose((self.middle - math.copysign(BESIDE, self.handle[0]), -BACK, 0.0), FACING)
        if self.drives:
            return Pose((math.copysign(ASIDE, self.handle[0]), -OFF - x, 0.0), FACING)
        return Pose((self.middle + y, -OFF - x, 0.0), FACING)

    def stand(self) -> Pose:
        """Return the frame of robots that stand: on the floor under the handle, x out of the door."""
        return Pose((self.middle, self.handle[1], 0.0), (0.0, 0.0, -math.sqrt(0.5), math.sqrt(0.5)))

    def floor(self, mount: Mount) -> Rectangle:
        """Return the floor that chair, person and robot, at `mount`, take before the door [m]."""
        x, y, _ = self.chair(mount).position
        if self.stands:
            robot, low = (self.middle - ROBOT, self.middle + ROBOT), min(y - BEHIND, -ROOM)
        else:
            base, hand, low = x - mount.position[1], self.handle[0], y - BEHIND
            robot = min(base - ARM, hand - HAND), max(base + ARM, hand + HAND)
        return Rectangle(min(x - HALF, robot[0]), low, max(x + HALF, robot[1]), -0.1)


def _stands(robot: Robot, drives: bool) -> bool:
    """Return whether a robot stands before the door by itself: whoever can, if it is not told else."""
    if drives or robot.chosen_mount is not None:
        return robot.chosen_mount == STANDING
    return STANDING in robot.config.mounts


def is_free_beyond(site: DoorSite) -> bool:
    """Return whether a chair that comes through a door of a house has room behind it."""
    return site.is_free(Rectangle(-HALF, 0.5 * site.thickness, HALF, BEYOND))
