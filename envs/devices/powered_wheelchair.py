"""A powered wheelchair that drives on a flat floor, with a person and a robot arm on it."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

from rcare_marl.agents.agent import Agent
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.control import BaseVelocity
from rcare_marl.agents.robots.mobile_base import MobileBase, with_base
from rcare_marl.agents.robots.robot_config import BaseConfig, Mount
from rcare_marl.agents.robots.robot_part import Part
from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape
from rcare_marl.pose import Pose, Vector
from rcare_marl.world import World

from .device_model import DeviceModel, load_device
from .wheelchair import LOWEST_POST, SIDES, Wheelchair, plates_under

CHAIR = "wheelchair"  # the link of all that rolls
# [N] of the bonds between the chair and who is on it; our own choice.
HOLD = 20000.0


class PoweredWheelchair(Wheelchair):
    """A wheelchair that drives: x forward, y left, origin on the floor under the seat.

    It turns about the origin, near its drive wheels. Wheels are not simulated: as for a robot's base,
    motors with their force drive three joints in the plane of the floor. Who sits on it and the robot
    arm on its post are bonded to it, so that what stops one of them stops the chair. Frames are those
    of `Wheelchair`; they go with it.

    Attributes:
        drive: Speed, and force of the wheels.
        base: Its drive, once spawned.
    """

    base: MobileBase

    def __init__(
        self, *, mount: Mount | None = None, side: Literal["left", "right"] = "right"
    ) -> None:
        """Make a wheelchair.

        Args:
            mount: Where a robot arm is mounted, in the chair's frame; none is if None. It goes no
                farther from the middle than the figure `mount_side`.
            side: On which side.

        Raises:
            ConfigError: If the mount is on the floor or on a stand.
        """
        chair = load_device("powered_wheelchair")
        f = chair.figure
        place = None
        if mount is not None:
            x, y, z = mount.position
            if mount.stand or z < LOWEST_POST:
                raise ConfigError("a chair that drives carries robots that are mounted on it only")
            place = (x, min(abs(y), f("mount_side")), z)
        super().__init__(
            "powered_wheelchair",
            mounts="none" if mount is None else side,
            mount=place,
        )
        self._mount, self._side = mount, side
        self.drive = BaseConfig(
            "differential", f("speed"), f("turn"), f("force"), f("torque"), chair.source
        )
        based = with_base(self.model, self.drive, is_driven=True)
        self.model = DeviceModel(**vars(based))
        self._place_feet()

    def fit_footplates(self, left: Vector, right: Vector) -> None:
        ahead, aside, up = plates_under(left, right)
        places = {f"footplate_{side}": (ahead, sign * aside, up) for side, sign in SIDES.items()}
        self.model = self.model.with_frames(places)
        self._place_feet()

    def _place_feet(self) -> None:
        """Put footplate, longer than shoes, its hanger, and the guard before the toes under the feet."""
        f, frame = self.model.figure, self.model.frames["footplate_left"]
        ahead, aside, height = frame.position
        tilt, width = math.radians(-frame.rpy_deg[1]), 2 * aside + 0.16
        long, tall = f("footplate_length"), f("guard")

        def board(along: float, thick: float, length: float, up: float) -> Shape:
            """A board across both feet, in the plane of the soles."""
            x = ahead + along * math.cos(tilt) - up * math.sin(tilt)
            z = height + along * math.sin(tilt) + up * math.cos(tilt)
            at, rpy, size = (x, 0.0, z), (0.0, -tilt, 0.0), (length, width, thick)
            return Shape(kind="box", material="pad", at=at, rpy=rpy, size=size, bevel=0.005)

        low, high = height - 0.04, f("seat_height") - f("cushion")
        hanger = (0.3, 0.0, 0.5 * (low + high))
        feet = [
            board(0.02, 0.015, long, -0.0075),
            board(0.02 + 0.5 * long, tall, 0.03, 0.5 * tall - 0.015),
            Shape("box", "frame", hanger, size=(0.05, 0.1, high - low)),
        ]
        self.model = self.model.with_shapes("feet", feet, feet)

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        self.base = MobileBase(body, self.drive)
        self.base.drive((0.0, 0.0, 0.0))
        return body

    @property
    def pose(self) -> Pose:
        """The present pose of the chair in the world."""
        return self.body.link_pose(self.body.link_index(CHAIR))

    def robot_place(self) -> Pose:
        """Return where the root of the robot goes, in the world; ConfigError if it carries none."""
        if self._mount is None:
            raise ConfigError("this wheelchair has no place for a robot")
        x, y, z = self.frame(f"mount_{self._side}").position
        return self.pose @ dataclasses.replace(self._mount, position=(x, y, z)).pose

    def drive_part(self) -> Part:
        """Return the drive as a part of whoever commands it: forward and turning speed."""
        return Part(CHAIR, BaseVelocity(self.base, CHAIR), base=self.base)

    def carry(self, person: Agent, frame: str = "") -> Attachment:
        """Bond who sits or stands on it already to it, as by a belt or by bolts, and return the bond.

        Args:
            person: A person or robot that was spawned with `rides`. They pass through the chair.
            frame: All of the chair is one link: it does not matter.

        Raises:
            ConfigError: If it is held in place.
        """
        if not person.body.is_movable:
            raise ConfigError(f"{person.name!r} is held in place: set `rides` before it is spawned")
        if isinstance(person, Human):
            person.ignore(self.body)
            person.supports.append(self.body)
        else:
            self._world.set_collision(person.body, self.body, False)
        return self._world.attach(self.body, CHAIR, person.body, force=HOLD)
