"""A manual wheelchair that rolls: drive wheels, casters, brakes, footrests and armrests."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

from rcare_marl import assets
from rcare_marl.agents.human import Human
from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.cache import cached
from rcare_marl.config import load
from rcare_marl.errors import ActionError, ConfigError
from rcare_marl.pose import Pose, Vector
from rcare_marl.urdf import MeshFile, Model, Shape, Triple
from rcare_marl.world import GRAVITY, World

from .assembly import Assembly
from .device import DeviceControl, Frame
from .dry_friction import DryFriction, grip
from .jointed_device import JointedDevice
from .wheelchair_frame import TUBE, WheelchairConfig, WheelchairFrame, tube

SIDES = {"left": 1, "right": -1}
MARGIN = 0.001  # [m], by which Bullet thickens hulls that it reads from a file
# Bullet rolls a cylinder of a URDF on 32 corners: it would stand still on a slope of 5.6 degrees. Four
# quarters of 47 sides each stand still below 1 degree only.
QUARTERS, STEPS = 4, 47
FORK = 0.02  # friction of the forks of casters [N·m]; own choice
REAR_SHARE = 0.6  # of the weight on the drive wheels, for rolling resistance; own choice
FOOTREST_TORQUE, ARMREST_TORQUE = 4.0, 5.0  # [N·m], of a hand of 15 to 20 N; own choice


@dataclass(frozen=True)
class ManualWheelchairConfig:
    """What a rolling chair has beyond one that stands; see `assets/devices/manual_wheelchair.yaml`."""

    source: str
    seat_width: float
    armrest_side: float
    caster_diameter: float
    caster_axle: float
    caster_trail: float
    masses: dict[str, float]
    swing_out_deg: float
    flip_up_deg: float
    rolling_resistance: float
    tyre_friction: float
    brake_torque: float
    rim_torque: float

    def __post_init__(self) -> None:
        parts = {"frame", "wheel", "fork", "caster", "footrest", "armrest"}
        if set(self.masses) != parts or min(self.masses.values()) <= 0:
            raise ConfigError(f"masses must be positive, one for each of {sorted(parts)}")
        if self.rolling_resistance < 0 or self.brake_torque <= 0:
            raise ConfigError("a wheelchair needs brakes, and loses speed by itself")

    def chair(self) -> WheelchairConfig:
        """Return the dimensions of all that the two kinds of chair share."""
        return dataclasses.replace(
            load(WheelchairConfig, assets.find("devices", "wheelchair")),
            seat_width=self.seat_width,
            armrest_side=self.armrest_side,
            caster_diameter=self.caster_diameter,
            caster_axle=self.caster_axle,
            caster_trail=self.caster_trail,
        )


class ManualWheelchair(JointedDevice):
    """A wheelchair that rolls: x forward, y left, origin on the floor under the seat.

    Frames are those of `Wheelchair` without mounts, and `grip_left`, `grip_right` of the push
    handles, x forward. Controls: `footrest_left`, `footrest_right` (0 in front, swung out at the
    upper limit), `armrest_left`, `armrest_right` (0 down, flipped up at the upper limit).

    A rim of a wheel is pushed by `push` or driven by `roll`; otherwise the chair coasts.
    """

    postures = {"seated": ("wheelchair", "seat_back")}
    _fixed = False
    _on = {
        f"{frame}_{side}": f"{link}_{side}"
        for frame, link in (("armrest", "armrest"), ("footplate", "footrest"))
        for side in SIDES
    }

    def __init__(
        self, config: ManualWheelchairConfig | None = None, *, headrest: bool = True
    ) -> None:
        """Make a wheelchair; of the data file if `config` is None, with a headrest or without."""
        self.rolling = config or load(
            ManualWheelchairConfig, assets.find("devices", "manual_wheelchair")
        )
        self.config = dataclasses.replace(self.rolling.chair(), has_headrest=headrest)
        self._load = 0.0
        self._is_braked = False
        self._friction: DryFriction | None = None

    def fit_footplates(self, left: Vector, right: Vector) -> None:
        """Move the footplates under a person's soles, given in the chair's frame [m], before `spawn`."""
        self.config = self.config.with_footplates(left, right)

    @property
    def frames(self) -> Mapping[str, Frame]:
        c, shapes = self.config, WheelchairFrame(self.config)
        out = {key: f for key, f in shapes.frames().items() if not key.startswith("mount")}
        for side, sign in SIDES.items():
            at = (shapes.back(c.handle_height) - 0.15, sign * 0.5 * c.seat_width, c.handle_height)
            out[f"grip_{side}"] = Frame(at, note="push handle")
        return out

    @property
    def controls(self) -> Mapping[str, DeviceControl]:
        out = {}
        for side in SIDES:
            name = f"footrest_{side}"
            out[name] = DeviceControl(name, 1.0, FOOTREST_TORQUE, "swings out")
            name = f"armrest_{side}"
            out[name] = DeviceControl(name, 1.0, ARMREST_TORQUE, "flips up")
        return out

    def model(self) -> Model:
        frame, masses = WheelchairFrame(self.config), self.rolling.masses
        made = Assembly("frame", masses["frame"])
        root = made.parts["frame"]
        root.visual += [*frame.upholstery(), *frame.headrest_tubes()]
        root.collision += frame.cushions()
        for side, sign in SIDES.items():
            root.visual += [*frame.side_frame(sign), self._bracket(frame, sign)]
            root.collision += self._bones(frame, sign)
            self._hang_wheels(made, frame, side)
            self._hang_rests(made, frame, side)
        return made.model("manual_wheelchair", self.rolling.source, self.config.materials)

    def _bones(self, frame: WheelchairFrame, sign: int) -> list[Shape]:
        """Return the solids of the push handle and the lower tube of one side."""
        c = self.config
        top, rear, y = c.handle_height, frame.back(c.seat_height) - 0.04, sign * 0.5 * c.seat_width
        cane, low = frame.back(top) - 0.055, 0.5 * c.wheel_diameter - 0.04
        front = 0.5 * c.seat_depth
        paths = (
            ((rear, y, low), (cane, y, top)),
            ((cane, y, top), (cane - 0.13, y, top - 0.012)),
            ((rear, y, low), (front, y, low)),
        )
        return [Shape(kind="capsule", radius=TUBE, points=path) for path in paths]

    def _pivot(self, frame: WheelchairFrame, sign: int) -> Triple:
        """Return where an armrest is hinged to the cane of the backrest."""
        c = self.config
        z = c.armrest_height - 0.095
        rear = frame.back(c.seat_height) - 0.04
        slope = (frame.back(c.handle_height) - 0.055 - rear) / (c.handle_height - c.seat_height)
        return (rear + slope * (z - c.seat_height) + 0.03, sign * frame.armrest_y(), z)

    def _bracket(self, frame: WheelchairFrame, sign: int) -> Shape:
        x, y, z = self._pivot(frame, sign)
        return tube("frame", 0.0, [(x - 0.03, sign * 0.5 * self.config.seat_width, z), (x, y, z)])

    def _hang_wheels(self, made: Assembly, frame: WheelchairFrame, side: str) -> None:
        c, sign, masses = self.config, SIDES[side], self.rolling.masses
        radius = 0.5 * c.wheel_diameter
        y = sign * (0.5 * c.width - 0.05)
        wheel = made.hang(
            f"wheel_{side}", "frame", masses["wheel"], kind="continuous",
            at=(c.wheel_axle, y, radius), axis=(0.0, 1.0, 0.0), velocity=30.0,
            effort=self.rolling.brake_torque, friction=self._drags()["wheel"],
        )  # fmt: skip
        wheel.visual += frame.wheel(sign)
        rim = (
            (c.wheel_axle, y + 0.013 * sign, radius),
            (c.wheel_axle, sign * 0.5 * c.width, radius),
        )
        wheel.collision.append(Shape(kind="cylinder", radius=radius - 0.047, points=rim))
        wheel.hulls.append(_round(radius, 0.026))
        # Tyre, rim and handrim weigh most: three quarters of the mass near the outside; own choice.
        spin = 0.75 * masses["wheel"] * (radius - 0.03) ** 2
        wheel.inertia = ((0.0, 0.0, 0.0), (0.5 * spin, 0.0, 0.0, spin, 0.0, 0.5 * spin))
        fork = made.hang(
            f"fork_{side}", "frame", masses["fork"], kind="continuous", at=frame.stem(sign),
            axis=(0.0, 0.0, 1.0), velocity=30.0, damping=0.01, friction=FORK,
        )  # fmt: skip
        fork.visual += frame.fork(sign)
        caster = made.hang(
            f"caster_{side}", f"fork_{side}", masses["caster"], kind="continuous",
            at=frame.caster_hub(sign), axis=(0.0, 1.0, 0.0), velocity=100.0,
            friction=self._drags()["caster"],
        )  # fmt: skip
        caster.visual += frame.caster(sign)
        small = 0.5 * c.caster_diameter
        caster.hulls.append(_round(small, 0.018))
        spin = 0.5 * masses["caster"] * small**2
        caster.inertia = ((0.0, 0.0, 0.0), (0.6 * spin, 0.0, 0.0, spin, 0.0, 0.6 * spin))

    def _hang_rests(self, made: Assembly, frame: WheelchairFrame, side: str) -> None:
        sign, masses = SIDES[side], self.rolling.masses
        rest = made.hang(
            f"footrest_{side}", "frame", masses["footrest"], at=frame.hinge(sign),
            axis=(0.0, 0.0, float(sign)), upper=math.radians(self.rolling.swing_out_deg),
            effort=FOOTREST_TORQUE,
        )  # fmt: skip
        rest.visual += [frame.plate(sign, bevel=0.006), frame.hanger(sign)]
        rest.collision.append(frame.plate(sign))
        arm = made.hang(
            f"armrest_{side}", "frame", masses["armrest"], at=self._pivot(frame, sign),
            axis=(0.0, -1.0, 0.0), upper=math.radians(self.rolling.flip_up_deg),
            effort=ARMREST_TORQUE,
        )  # fmt: skip
        x, y, z = self._pivot(frame, sign)
        under = self.config.armrest_height - 0.048
        beam = [(x, y, z), (x + 0.1, y, z), (x + 0.14, y, under), (0.16, y, under)]
        arm.visual += [frame.armrest_pad(sign, bevel=0.012), tube("frame", 0.05, beam)]
        arm.collision.append(frame.armrest_pad(sign))

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        rolling = [body.links[f"{kind}_{side}"] for kind in ("wheel", "caster") for side in SIDES]
        grip(world, body, rolling, friction=self.rolling.tyre_friction)
        body.set_damping()
        self._friction = DryFriction(world, body)
        self._friction.hold({joint: FORK for joint in self._joints("fork")})
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
        self.body.drive_velocities(self._wheels(), [left, right], [self.rolling.rim_torque] * 2)

    def coast(self) -> None:
        """Let the wheels turn freely, but for their rolling resistance, brakes off."""
        self.brake(False)

    def _resist(self) -> None:
        """Let wheels and casters resist, by brakes or by what they roll over."""
        if self._friction is not None:
            drags = self._drags()
            if self._is_braked:
                drags["wheel"] = self.rolling.brake_torque
            for kind, drag in drags.items():
                self._friction.hold({joint: drag for joint in self._joints(kind)})

    def _drags(self) -> dict[str, float]:
        """Return the torque of rolling resistance on each wheel [N·m]."""
        masses = self.rolling.masses
        own = masses["frame"] + 2 * sum(value for key, value in masses.items() if key != "frame")
        each = 0.5 * self.rolling.rolling_resistance * GRAVITY * (own + self._load)
        return {
            "wheel": REAR_SHARE * each * 0.5 * self.config.wheel_diameter,
            "caster": (1 - REAR_SHARE) * each * 0.5 * self.config.caster_diameter,
        }

    def _wheels(self) -> list[int]:
        return self._joints("wheel")

    def _joints(self, kind: str) -> list[int]:
        return self.body.indices(f"{kind}_{side}" for side in SIDES)

    def travelled(self) -> tuple[float, float]:
        """Return how far the left and the right wheel have rolled [m], forward positive."""
        left, right = self.body.joint_states(self._wheels())[0]
        return 0.5 * self.config.wheel_diameter * left, 0.5 * self.config.wheel_diameter * right


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


__all__ = ["ManualWheelchair", "ManualWheelchairConfig"]
