"""Wheelchairs that move: a manual one that rolls, and a powered one that drives, with an arm on it."""

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
from rcare_marl.cache import cached
from rcare_marl.errors import ActionError, ConfigError
from rcare_marl.model.shape import MeshFile, Shape
from rcare_marl.pose import Pose, Vector
from rcare_marl.world import GRAVITY, World

from .device import Device, DryFriction
from .device_model import DeviceModel, load_device
from .wheelchair import LOWEST_POST, SIDES, Wheelchair, plates_under, with_plates

MARGIN = 0.001  # [m], by which Bullet thickens hulls that it reads from a file
# Bullet rolls a cylinder of a URDF on 32 corners: it would stand still on a slope of 5.6 degrees. Four
# quarters of 47 sides each stand still below 1 degree only.
QUARTERS, STEPS = 4, 47
TREADS = {"wheel": 0.026, "caster": 0.018}  # [m] width of tyres
CHAIR = "wheelchair"  # the link of all that rolls
# [N] of the bonds between the chair and who is on it; our own choice.
HOLD = 20000.0


class ManualWheelchair(Device):
    """A wheelchair that rolls: x forward, y left, origin on the floor under the seat.

    Frames are those of `Wheelchair` without mounts, and `grip_left`, `grip_right` of the push
    handles, x forward. Controls: `footrest_left`, `footrest_right` (0 in front, swung out at the
    upper limit), `armrest_left`, `armrest_right` (0 down, flipped up at the upper limit).

    A rim of a wheel is pushed by `push` or driven by `roll`; otherwise the chair coasts.
    """

    def __init__(self, *, headrest: bool = True) -> None:
        """Make a wheelchair, with a headrest or without."""
        super().__init__("manual_wheelchair")
        model = self.model
        if not headrest:
            model = model.without(["headrest"])
            model = model.with_shapes("frame", collision=model.links["frame"].collision)
        self._radii = {kind: model.figure(f"{kind}_radius") for kind in TREADS}
        for kind, tread in TREADS.items():
            for side in SIDES:
                round_tyre = _round(self._radii[kind], tread)
                model = model.with_shapes(f"{kind}_{side}", hulls=[round_tyre])
        self.model = model
        self._load = 0.0
        self._is_braked = False
        self._friction: DryFriction | None = None

    def fit_footplates(self, left: Vector, right: Vector) -> None:
        """Move the footplates under a person's soles, given in the chair's frame [m], before `spawn`."""
        self.model = with_plates(self.model, plates_under(left, right))

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        body.set_damping()
        self._friction = DryFriction(world, body)
        fork = self.model.figure("fork")
        self._friction.hold({joint: fork for joint in self._joints("fork")})
        self.reset()
        return body

    def command(self, name: str, target: float) -> None:
        """Drive a rest to `target` [rad] and hold it there until `stop`; raises as any device."""
        super().command(name, target)
        if self._friction is not None:
            self._friction.let_go([self.body.joint(name).index])

    def stop(self, name: str) -> None:
        """Leave a rest where it stands: it stays there, and where a hand pushes it."""
        control = self._control(name)
        if self._friction is None:
            super().stop(name)
        else:
            self._friction.hold({self.body.joint(control.joint).index: control.force})

    def reset(self) -> None:
        """Hold footrests and armrests where they stand, and let go of brakes and rims."""
        super().reset()
        if self._friction is not None:
            self.coast()

    def carry(self, person: Human, frame: str = "") -> Attachment:
        bond = super().carry(person, frame)
        self._load = person.body.mass()
        self._resist()
        return bond

    def release(self) -> None:
        super().release()
        self._load = 0.0
        self._resist()

    @property
    def is_braked(self) -> bool:
        """Whether the brakes are on."""
        return self._is_braked

    def brake(self, on: bool) -> None:
        """Lock both drive wheels where they stand, or let go of them; WorldError before `spawn`."""
        self._need_body()
        self._is_braked = on
        self._resist()

    def push(self, left: float, right: float) -> None:
        """Push the rims for one physics step with torques [N·m], forward if positive.

        Raises:
            ActionError: If a torque is not finite.
        """
        _check(left, right)
        self.body.drive_torques(self._wheels(), [float(left), float(right)])

    def roll(self, left: float, right: float) -> None:
        """Turn the wheels at `left` and `right` [rad/s] by `rim_torque` at most, until told otherwise.

        Nothing happens while the brakes are on.

        Raises:
            ActionError: If a speed is not finite.
            WorldError: If the chair is in no world.
        """
        _check(left, right)
        self._need_body()
        if self._is_braked or self._friction is None:
            return
        self._friction.let_go(self._wheels())
        self.body.drive_velocities(
            self._wheels(), [left, right], [self.model.figure("rim_torque")] * 2
        )

    def coast(self) -> None:
        """Let the wheels turn freely, but for their rolling resistance, brakes off."""
        self.brake(False)

    def _resist(self) -> None:
        """Let wheels and casters resist, by brakes or by what they roll over."""
        if self._friction is not None:
            drags = self._drags()
            if self._is_braked:
                drags["wheel"] = self.model.figure("brake_torque")
            for kind, drag in drags.items():
                self._friction.hold({joint: drag for joint in self._joints(kind)})

    def _drags(self) -> dict[str, float]:
        """Return the torque of rolling resistance on each wheel [N·m]."""
        f = self.model.figure
        each = 0.5 * f("rolling_resistance") * GRAVITY * (self.model.mass + self._load)
        rear = f("rear_share")
        return {
            "wheel": rear * each * self._radii["wheel"],
            "caster": (1 - rear) * each * self._radii["caster"],
        }

    def _wheels(self) -> list[int]:
        return self._joints("wheel")

    def _joints(self, kind: str) -> list[int]:
        return self.body.indices(f"{kind}_{side}" for side in SIDES)

    def travelled(self) -> tuple[float, float]:
        """Return how far the left and the right wheel have rolled [m], forward positive."""
        left, right = self.body.joint_states(self._wheels())[0]
        return self._radii["wheel"] * left, self._radii["wheel"] * right


def _check(left: float, right: float) -> None:
    if not (math.isfinite(left) and math.isfinite(right)):
        raise ActionError(f"rims need finite numbers, got {left} and {right}")


def _round(radius: float, width: float) -> MeshFile:
    """Return a wheel about y to collide with, rounder than a cylinder: quarters of many sides each."""
    radius, half, rows, count = radius - MARGIN, 0.5 * width - MARGIN, [], 0
    for quarter in range(QUARTERS):
        rows.append(f"o quarter_{quarter}")
        for step in range(STEPS + 1):
            angle = 2 * math.pi * (quarter + step / STEPS) / QUARTERS
            for y in (-half, half):
                x, z = radius * math.cos(angle), radius * math.sin(angle)
                rows.append(f"v {x:.8g} {y:.8g} {z:.8g}")
        corners = range(count + 1, count + 2 * STEPS + 3)
        rows += [
            f"f {a} {b} {c}" for a, b, c in zip(corners, corners[1:], corners[2:], strict=False)
        ]
        count += 2 * STEPS + 2
    return MeshFile(str(cached("wheel", ".obj", "\n".join(rows) + "\n")))


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
        places = plates_under(left, right)
        ahead, _, up = min(places.values(), key=lambda place: place[2])  # one board bears both
        places = {side: (ahead, aside, up) for side, (_, aside, _) in places.items()}
        self.model = self.model.with_frames({f"footplate_{s}": p for s, p in places.items()})
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
