"""A powered wheelchair that drives on a flat floor, with a person and a robot arm on it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Literal

from rcare_marl import assets
from rcare_marl.agents.agent import Agent
from rcare_marl.agents.control import BaseVelocity
from rcare_marl.agents.human import Human
from rcare_marl.agents.mobile_base import MobileBase, with_base
from rcare_marl.agents.robot_config import BaseConfig, Mount
from rcare_marl.agents.robot_part import Part
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.urdf import Link, Model, Shape
from rcare_marl.world import World

from .wheelchair import LOWEST_POST, Wheelchair, WheelchairConfig
from .wheelchair_frame import WheelchairFrame, tube

CHAIR = "wheelchair"  # the link of all that rolls
# [N] of the bonds between the chair and who is on it; our own choice.
HOLD = 20000.0
STEP = (
    0.025  # [m] high that wheels roll over, as thresholds are: there they touch nothing; own choice
)
BATTERY = (0.46, 0.4, 0.2)  # [m] of the box under the seat; our own choice
HULL = (0.9, 0.6, 0.5)  # [m] of the box that is as hard to turn; our own choice


@dataclass(frozen=True)
class PoweredWheelchairConfig:
    """What a chair that drives has beyond one that stands; see `assets/devices/powered_wheelchair.yaml`.

    Attributes:
        width: Over the drive wheels [m].
        rear_caster: Where the rear casters are along the chair [m].
        foot_length: Of the footplates [m].
        guard: Height of the bar before the toes [m].
        mount_side: How far a robot arm is from the middle of the chair at most [m].
        mass: Without who is on it [kg].
        drive: Speed, and force of the wheels.
        contact_stiffness: Of contact with the chair [N/m].
        contact_damping: Of contact with the chair [N·s/m].
    """

    source: str
    width: float
    wheel_diameter: float
    wheel_axle: float
    caster_diameter: float
    caster_axle: float
    rear_caster: float
    foot_length: float
    guard: float
    mount_side: float
    mass: float
    drive: BaseConfig
    contact_stiffness: float
    contact_damping: float

    def __post_init__(self) -> None:
        for name in ("foot_length", "guard", "mount_side", "mass", "contact_stiffness"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} of a wheelchair must be positive")

    def chair(self) -> WheelchairConfig:
        """Return the dimensions of all that the kinds of chair share."""
        return dataclasses.replace(
            load(WheelchairConfig, assets.find("devices", "wheelchair")),
            width=self.width,
            wheel_diameter=self.wheel_diameter,
            wheel_axle=self.wheel_axle,
            caster_diameter=self.caster_diameter,
            caster_axle=self.caster_axle,
        )


class PoweredWheelchair(Wheelchair):
    """A wheelchair that drives: x forward, y left, origin on the floor under the seat.

    It turns about the origin, near its drive wheels. Wheels are not simulated: as for a robot's base,
    motors with their force drive three joints in the plane of the floor. Who sits on it and the robot
    arm on its post are bonded to it, so that what stops one of them stops the chair. Frames are those
    of `Wheelchair`; they go with it.

    Attributes:
        powered: What it has beyond a chair that stands.
        base: Its drive, once spawned.
    """

    base: MobileBase

    def __init__(
        self,
        config: PoweredWheelchairConfig | None = None,
        *,
        mount: Mount | None = None,
        side: Literal["left", "right"] = "right",
    ) -> None:
        """Make a wheelchair.

        Args:
            config: What it has; that of the data file if None.
            mount: Where a robot arm is mounted, in the chair's frame; none is if None. It goes no
                farther from the middle than `mount_side`.
            side: On which side.

        Raises:
            ConfigError: If the mount is on the floor or on a stand.
        """
        self.powered = config or load(
            PoweredWheelchairConfig, assets.find("devices", "powered_wheelchair")
        )
        chair = self.powered.chair()
        if mount is not None:
            x, y, z = mount.position
            if mount.stand or z < LOWEST_POST:
                raise ConfigError("a chair that drives carries robots that are mounted on it only")
            chair = dataclasses.replace(chair, mount=(x, min(abs(y), self.powered.mount_side), z))
        super().__init__(chair, mounts="none" if mount is None else side)
        self._mount, self._sign = mount, 1 if side == "left" else -1

    def model(self) -> Model:
        c, frame = self.config, WheelchairFrame(self.config)
        visual = [*frame.upholstery(), *frame.headrest_tubes(), *self._battery()]
        solids = [*frame.cushions(), *self._battery()]
        for sign in (1, -1):
            visual += [frame.armrest_pad(sign, bevel=0.012), frame.armrest_hoop(sign)]
            visual += [*frame.fork(sign), *frame.caster(sign), *self._wheels(sign)]
            visual += [self._back_tube(frame, sign)]
            solids += [frame.armrest_pad(sign), *self._wheels(sign, less=STEP)]
        visual += self._feet()
        solids += self._feet()
        for sign in self._posts:
            visual += frame.post(sign)
            x, y, z = c.mount
            ends = ((x, sign * y, z - 0.15), (x, sign * y, z - 0.002))
            solids.append(Shape(kind="cylinder", radius=0.06, points=ends))
        mass = self.powered.mass
        xx, yy, zz = (mass * edge * edge / 12 for edge in HULL)
        inertia = (yy + zz, 0.0, 0.0, xx + zz, 0.0, xx + yy)
        link = Link(mass, (0.0, 0.0, 0.3), inertia, visual=tuple(visual), collision=tuple(solids))
        plain = Model(
            name="powered_wheelchair", source=self.powered.source, links={CHAIR: link},
            materials=c.materials,
        )  # fmt: skip
        return with_base(plain, self.powered.drive, is_driven=True)

    def _battery(self) -> list[Shape]:
        """The box of batteries and motors under the seat, between the wheels."""
        low = 0.5 * self.config.caster_diameter
        at = (-0.04, 0.0, low + 0.5 * BATTERY[2])
        post = (0.1, 0.12, self.config.seat_height - self.config.cushion - low - BATTERY[2])
        above = (-0.04, 0.0, low + BATTERY[2] + 0.5 * post[2])
        return [
            Shape(kind="box", material="frame", at=at, size=BATTERY),
            Shape(kind="box", material="frame", at=above, size=post),
        ]

    def _wheels(self, sign: int, *, less: float = 0.0) -> list[Shape]:
        """A drive wheel and a rear caster on one side, their radii by `less` too small [m]."""
        c, p = self.config, self.powered
        radius, small, y = 0.5 * c.wheel_diameter, 0.5 * c.caster_diameter, 0.17 * sign
        outer, inner = sign * 0.5 * c.width, sign * (0.5 * c.width - 0.07)
        drive = ((c.wheel_axle, inner, radius), (c.wheel_axle, outer, radius))
        rear = ((p.rear_caster, y - 0.02, small), (p.rear_caster, y + 0.02, small))
        return [
            Shape(kind="cylinder", material="tyre", radius=r - less, points=points)
            for r, points in ((radius, drive), (small, rear))
        ]

    def _back_tube(self, frame: WheelchairFrame, sign: int) -> Shape:
        """The tube that carries one side of the backrest, from the box up."""
        c = self.config
        y, top = sign * 0.4 * c.seat_width, c.seat_height + c.backrest_height - 0.05
        low = (frame.back(c.seat_height) - 0.04, y, frame.rail())
        return tube("frame", 0.0, [low, (frame.back(top) - 0.045, y, top)])

    def _feet(self) -> list[Shape]:
        """The footplate, longer than shoes, its hanger, and the guard before the toes."""
        c, p = self.config, self.powered
        tilt, width = math.radians(c.footplate_tilt_deg), 2 * c.footplate_side + 0.16

        def board(along: float, thick: float, length: float, up: float) -> Shape:
            """A board across both feet, in the plane of the soles."""
            x = c.footplate_forward + along * math.cos(tilt) - up * math.sin(tilt)
            z = c.footplate_height + along * math.sin(tilt) + up * math.cos(tilt)
            return Shape(kind="box", material="pad", at=(x, 0.0, z), rpy=(0.0, -tilt, 0.0),
                         size=(length, width, thick), bevel=0.005)  # fmt: skip

        plate = board(0.02, 0.015, p.foot_length, -0.0075)
        guard = board(0.02 + 0.5 * p.foot_length, p.guard, 0.03, 0.5 * p.guard - 0.015)
        low, high = c.footplate_height - 0.04, c.seat_height - c.cushion
        back = Shape(kind="box", material="frame", at=(0.3, 0.0, 0.5 * (low + high)),
                     size=(0.05, 0.1, high - low))  # fmt: skip
        return [plate, guard, back]

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        self._world = world
        body = super().spawn(world, pose, name=name)
        body.set_softness(
            stiffness=self.powered.contact_stiffness, damping=self.powered.contact_damping
        )
        self.base = MobileBase(body, self.powered.drive)
        self.base.drive((0.0, 0.0, 0.0))
        return body

    @property
    def pose(self) -> Pose:
        """The present pose of the chair in the world."""
        return self.body.link_pose(self.body.link_index(CHAIR))

    @property
    def rear(self) -> float:
        """Where the chair ends behind, along x of its frame [m]."""
        c, frame = self.config, WheelchairFrame(self.config)
        backs = (
            frame.back(c.seat_height + c.backrest_height),
            frame.back(c.seat_height + c.headrest_height),
        )
        return min(self.powered.rear_caster - 0.5 * c.caster_diameter, *(b - 0.07 for b in backs))

    def robot_place(self) -> Pose:
        """Return where the root of the robot goes, in the world; ConfigError if it carries none."""
        if self._mount is None:
            raise ConfigError("this wheelchair has no place for a robot")
        x, y, z = self.config.mount
        return self.pose @ dataclasses.replace(self._mount, position=(x, self._sign * y, z)).pose

    def drive_part(self) -> Part:
        """Return the drive as a part of whoever commands it: forward and turning speed."""
        return Part(CHAIR, BaseVelocity(self.base, CHAIR), base=self.base)

    def carry(self, rider: Agent) -> None:
        """Bond who sits or stands on it already to it, as by a belt or by bolts.

        Args:
            rider: A person or robot that was spawned with `rides`. They pass through the chair.

        Raises:
            ConfigError: If it is held in place.
        """
        if not rider.body.is_movable:
            raise ConfigError(f"{rider.name!r} is held in place: set `rides` before it is spawned")
        if isinstance(rider, Human):
            rider.ignore(self.body)
            rider.supports.append(self.body)
        else:
            self._world.set_collision(rider.body, self.body, False)
        self._world.attach(self.body, CHAIR, rider.body, force=HOLD)


__all__ = ["PoweredWheelchair", "PoweredWheelchairConfig"]
