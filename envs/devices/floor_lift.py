"""A patient lift on wheels: a boom raises a person in a sling, legs spread, and it is pushed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rcare_marl import assets, inertia
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ActionError, ConfigError
from rcare_marl.pose import Pose
from rcare_marl.urdf import Joint, Link, Model, Shape, Triple
from rcare_marl.world import GRAVITY, World

from .device import DeviceControl, Frame
from .dry_friction import DryFriction
from .lift import Lift
from .spreader_bar import YOKE, BarConfig, SpreaderBar
from .telescope import Telescope

if TYPE_CHECKING:
    from rcare_marl.agents.human import Human

CHASSIS = "chassis"
ROLLING = ("roll_x", "roll_y", "roll_turn")
# Sections of the tubes [m], masses as shares of the whole, and where parts sit; our own choice.
_LEG, _MAST, _BOOM = 0.05, (0.06, 0.07), 0.05
_LEG_SHARE, _BOOM_SHARE = 0.1, 0.13
_FRONT_WHEEL, _REAR_WHEEL = 0.075, 0.1  # diameters
_WALK = 1.5  # greatest speed of who pushes [m/s or rad/s]
_ROOM = 100.0  # [m] that it may roll each way; any house is smaller
_LEG_FORCE, _BOOM_MARGIN = 150.0, 1.6  # [N·m]; of the torque that the safe load needs
_TURN_ARM = 0.4  # [m]: brakes and rolling resistance hold against turning on this arm


@dataclass(frozen=True)
class FloorLiftConfig:
    """Figures of a floor lift [m]; see `assets/devices/hoyer_lift_sling.yaml`."""

    source: str
    base_length: float
    width_closed: float
    width_open: float
    leg_height: float
    mast_height: float
    mast_back: float
    boom_length: float
    boom_low_deg: float
    boom_high_deg: float
    handle_height: float
    handle_width: float
    mass: float
    load: float
    boom_speed: float
    leg_speed: float
    push_force: float
    push_torque: float
    rolling_resistance: float
    brake_force: float
    bar: BarConfig
    sling: str
    materials: dict[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        if not self.width_closed < self.width_open < self.width_closed + self.base_length:
            raise ConfigError(
                f"legs spread from {self.width_closed} m to more than that, got {self.width_open} m"
            )
        if not -80 < self.boom_low_deg < 0 < self.boom_high_deg < 80:
            raise ConfigError("the boom must move from below to above the level, by 80 deg at most")


class FloorLift(Lift):
    """A floor lift: x forward along its legs, y left, origin on the floor in the middle of the base.

    Controls: `boom` (angle above the level; at 0 the bar hangs level with the mast's top) and `legs`
    (how far each leg is spread). It rolls where it is pushed, and stands when the brakes are on. A
    person who hangs in it faces the mast.

    Frames: those of the bar (`sling`, `bar`, `hook_left_front`, ...), which move with it, and
    `handle_left`, `handle_right` (of who pushes), `mast`.
    """

    _raises = "boom"
    _casters: DryFriction | None = None

    def __init__(
        self, name: str = "hoyer_lift_sling", *, config: FloorLiftConfig | None = None
    ) -> None:
        """Make a lift.

        Args:
            name: Its data file: `hoyer_lift_sling` or `hoyer_lift_transfer`.
            config: Its figures; those of the data file if None.

        Raises:
            UnknownNameError: If there is no such file.
        """
        self.config = config or load(FloorLiftConfig, assets.find("devices", name))
        self.name = name
        super().__init__(SpreaderBar(self.config.bar, self.config.sling))
        self._is_braked = self._is_pushed = False

    @property
    def safe_load(self) -> float:
        return self.config.load

    @property
    def controls(self) -> Mapping[str, DeviceControl]:
        c = self.config
        torque = _BOOM_MARGIN * GRAVITY * (c.load + c.mass) * c.boom_length
        return {
            "boom": DeviceControl("boom", c.boom_speed, torque, "raises and lowers the bar"),
            "legs": DeviceControl("leg_left", c.leg_speed, _LEG_FORCE, "spreads both legs"),
        }

    @property
    def frames(self) -> Mapping[str, Frame]:
        c = self.config
        x, _, z = self._hooks_at()
        out = {
            name: Frame((x - f.position[0], -f.position[1], z + f.position[2]), (0.0, 0.0, 180.0), f.note)
            for name, f in self.bar.frames.items()
        }  # fmt: skip
        for side, sign in (("left", 1), ("right", -1)):
            out[f"handle_{side}"] = Frame(
                (-c.mast_back - 0.14, sign * 0.4 * c.handle_width, c.handle_height),
                (0.0, 0.0, 180.0),
                "middle of the grip of who pushes, x towards them",
            )
        out["mast"] = Frame((-c.mast_back, 0.0, c.mast_height), note="pivot of the boom")
        return out

    @property
    def pose(self) -> Pose:
        """The present pose of the chassis in the world."""
        return self.body.link_pose(self.body.link_index(CHASSIS))

    @property
    def is_braked(self) -> bool:
        """Whether the casters are locked."""
        return self._is_braked

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        joints = body.joints
        # The right leg mirrors the left one: one pedal or motor spreads both.
        body.gear(joints["leg_left"].index, joints["leg_right"].index, 1.0, 10 * _LEG_FORCE)
        world.lines.append(self._actuator(body))
        self._rolling, self._casters = body.indices(ROLLING), DryFriction(world, body)
        self.brake(False)
        return body

    def reset(self) -> None:
        """Hold boom and legs, take off the brakes, and let go of who is gone after a rewind."""
        super().reset()
        if self._casters is not None:
            self.brake(False)

    def set_position(self, name: str, position: float) -> None:
        """Put a control at `position` [rad] at once and hold it there; the bar hangs level."""
        super().set_position(name, position)
        if name == "boom":
            self.bar.set_pitch(self.position("boom"))

    def push(self, forward: float, left: float = 0.0, turn: float = 0.0) -> None:
        """Push it at these speeds in its own frame [m/s, m/s, rad/s], until told otherwise.

        Its axes are those at the time of the call: call it each control step while it turns. With
        all at zero it is let go, and stands by the resistance of its casters. Braked, it stays.

        Raises:
            ActionError: If a speed is not finite.
            WorldError: If the lift is in no world.
        """
        body = self.body
        speeds = (float(forward), float(left), float(turn))
        if not all(map(math.isfinite, speeds)):
            raise ActionError(f"{body.name!r} needs finite speeds, got {speeds}")
        if self._is_braked or self._casters is None:
            return
        self._is_pushed = any(speeds)
        if not self._is_pushed:
            self._hold()
            return
        self._casters.let_go(self._rolling)
        heading = body.joint_states([self._rolling[2]])[0][0]
        c, s = math.cos(heading), math.sin(heading)
        wanted = [c * forward - s * left, s * forward + c * left, turn]
        force, torque = self.config.push_force, self.config.push_torque
        body.drive_velocities(self._rolling, wanted, [force, force, torque])

    def brake(self, on: bool) -> None:
        """Lock the casters, or unlock them; WorldError if the lift is in no world."""
        self._need_body()
        self._is_braked, self._is_pushed = on, False
        self._hold()

    def carry(self, person: Human) -> None:
        super().carry(person)
        if not self._is_pushed:
            self._hold()

    def release(self) -> None:
        super().release()
        if not self._is_pushed:
            self._hold()

    def model(self) -> Model:
        c = self.config
        leg_mass, boom_mass = _LEG_SHARE * c.mass, _BOOM_SHARE * c.mass
        chassis_mass = c.mass - 2 * leg_mass - boom_mass - c.bar.mass - 2 * YOKE
        links = {
            "floor": Link(),
            "roll_x": Link(),
            "roll_y": Link(),
            CHASSIS: Link(
                chassis_mass,
                (-c.mast_back + 0.05, 0.0, 0.35),
                inertia.of_box(chassis_mass, (0.2, 0.4, 1.1)),
                tuple(self._frame()),
                tuple(self._solids()),
            ),
            "leg_left": self._leg(leg_mass),
            "leg_right": self._leg(leg_mass),
            "boom": self._boom(boom_mass),
            **self.bar.links(),
        }
        return Model(
            name=self.name,
            source=c.source,
            links=links,
            materials=c.materials,
            joints=self._joints(),
        )

    def _joints(self) -> dict[str, Joint]:
        c = self.config
        rear, side = self._leg_at()
        spread = math.asin(0.5 * (c.width_open - c.width_closed) / self._leg_length())
        low, high = math.radians(c.boom_low_deg), math.radians(c.boom_high_deg)
        slide = Joint(
            "prismatic", "floor", "roll_x", axis=(1.0, 0.0, 0.0), lower=-_ROOM, upper=_ROOM,
            effort=c.push_force, velocity=_WALK,
        )  # fmt: skip
        out = {
            "roll_x": slide,
            "roll_y": replace(slide, parent="roll_x", child="roll_y", axis=(0.0, 1.0, 0.0)),
            "roll_turn": Joint(
                "continuous", "roll_y", CHASSIS, effort=c.push_torque, velocity=_WALK
            ),
        }
        for name, sign in (("leg_left", 1.0), ("leg_right", -1.0)):
            out[name] = Joint(
                "revolute", CHASSIS, name, (rear, sign * side, 0.0), axis=(0.0, 0.0, sign),
                upper=spread, effort=_LEG_FORCE, velocity=c.leg_speed,
            )  # fmt: skip
        out["boom"] = Joint(
            "revolute", CHASSIS, "boom", (-c.mast_back, 0.0, c.mast_height), axis=(0.0, -1.0, 0.0),
            lower=low, upper=high, effort=self.controls["boom"].force, velocity=c.boom_speed,
        )  # fmt: skip
        return out | self.bar.joints("boom", (c.boom_length, 0.0, 0.0), math.pi)

    def _hooks_at(self) -> Triple:
        """Return where the bar hangs at rest, in the frame of the lift."""
        c = self.config
        return (c.boom_length - c.mast_back, 0.0, c.mast_height - c.bar.drop)

    def _leg_at(self) -> tuple[float, float]:
        """Return x and y of the pivot of a leg: the leg is straight when closed."""
        c = self.config
        return -0.5 * c.base_length + 0.1, 0.5 * c.width_closed - 0.5 * _LEG

    def _leg_length(self) -> float:
        return 0.5 * self.config.base_length - self._leg_at()[0]

    def _hold(self) -> None:
        """Let the casters resist, by their brakes or by what they roll over."""
        c, person = self.config, self.bar.person
        weight = GRAVITY * (c.mass + (person.avatar.mass_kg if person is not None else 0.0))
        force = c.brake_force if self._is_braked else c.rolling_resistance * weight
        if self._casters is not None:
            forces = (force, force, _TURN_ARM * force)
            self._casters.hold(dict(zip(self._rolling, forces, strict=True)))

    def _actuator(self, body: Body) -> Telescope:
        c = self.config
        foot = (-c.mast_back + 0.07, 0.0, 0.45 * c.mast_height)
        return Telescope(
            body, (CHASSIS, foot), ("boom", (0.34 * c.boom_length, 0.0, -0.04)),
            length=0.36 * c.mast_height,
        )  # fmt: skip

    def _leg(self, mass: float) -> Link:
        length, tall = self._leg_length(), self.config.leg_height
        wheel = 0.5 * _FRONT_WHEEL
        tube = (length - 0.05, _LEG, 0.04)
        at = (0.5 * tube[0] - 0.02, 0.0, tall - 0.5 * tube[2])
        x = length - 0.06
        visual = (
            Shape(kind="box", material="frame", at=at, size=tube, bevel=0.012),
            Shape(kind="cylinder", material="rubber", radius=wheel,
                  points=((x, -0.022, wheel), (x, 0.022, wheel))),
            Shape(kind="cylinder", material="steel", radius=0.014,
                  points=((x, 0.0, wheel), (x, 0.0, tall - 0.02))),
            Shape(kind="box", material="dark", at=(length - 0.06, 0.0, tall - 0.02),
                  size=(0.07, _LEG + 0.006, 0.046), bevel=0.014),
        )  # fmt: skip
        solid = (
            Shape(kind="box", at=at, size=tube),
            Shape(kind="box", at=(x, 0.0, 0.5 * tall + 0.002), size=(0.07, _LEG, tall - 0.004)),
        )
        return Link(mass, at, inertia.of_box(mass, tube), visual, solid)

    def _boom(self, mass: float) -> Link:
        length = self.config.boom_length
        size = (length, _BOOM, _BOOM)
        visual = (
            Shape(kind="tube", material="frame", radius=0.5 * _BOOM, bend=0.12,
                  points=((-0.02, 0, 0), (0.7 * length, 0, 0.03), (length, 0, 0.03))),
            Shape(kind="box", material="dark", at=(0.0, 0.0, 0.0), size=(0.1, 0.08, 0.09), bevel=0.02),
            Shape(kind="cylinder", material="steel", radius=0.016,
                  points=((length, -0.035, 0), (length, 0.035, 0))),
            Shape(kind="box", material="dark", at=(length, 0, 0.02), size=(0.06, 0.065, 0.07),
                  bevel=0.015),
            Shape(kind="box", material="dark", at=(0.34 * length, 0, -0.025),
                  size=(0.06, 0.045, 0.05), bevel=0.01),
        )  # fmt: skip
        solid = Shape(kind="box", at=(0.5 * length, 0.0, 0.015), size=(length, _BOOM, _BOOM + 0.03))
        return Link(mass, (0.45 * length, 0.0, 0.0), inertia.of_box(mass, size), visual, (solid,))

    def _frame(self) -> list[Shape]:
        """Return what is drawn of base, mast, battery and push handles."""
        c = self.config
        rear, side = self._leg_at()
        x, tall = -c.mast_back, c.leg_height
        wheel = 0.5 * _REAR_WHEEL
        grip = (x - 0.14, 0.5 * c.handle_width, c.handle_height)
        shapes = [
            Shape(kind="box", material="frame", at=(rear, 0, tall - 0.025),
                  size=(0.07, 2 * side + 0.07, 0.05), bevel=0.015),
            Shape(kind="box", material="frame", at=(0.5 * (rear + x), 0, tall - 0.005),
                  size=(abs(rear - x) + 0.12, 0.12, 0.05), bevel=0.015),
            Shape(kind="box", material="frame", at=(x, 0, 0.5 * (c.mast_height - 0.05 + tall)),
                  size=(*_MAST, c.mast_height - 0.05 - tall), bevel=0.014),
            Shape(kind="box", material="dark", at=(x, 0, c.mast_height - 0.03),
                  size=(0.1, 0.09, 0.11), bevel=0.02),
            Shape(kind="box", material="accent", at=(x - 0.075, 0, 0.62 * c.mast_height),
                  size=(0.09, 0.17, 0.28), bevel=0.02),  # battery and control box
            Shape(kind="box", material="dark", at=(x - 0.123, 0, 0.65 * c.mast_height),
                  size=(0.012, 0.1, 0.08), bevel=0.004),
            Shape(kind="box", material="dark", at=(x + 0.06, 0, 0.45 * c.mast_height),
                  size=(0.07, 0.05, 0.07), bevel=0.012),  # foot of the actuator
            Shape(kind="tube", material="dark", radius=0.0145, bend=0.05,
                  points=((x - 0.02, 0.03, grip[2] - 0.08), (grip[0], 0.05, grip[2]),
                          (grip[0], grip[1], grip[2]), (x - 0.02, grip[1], grip[2] + 0.03))),
            Shape(kind="tube", material="dark", radius=0.0145, bend=0.05,
                  points=((x - 0.02, -0.03, grip[2] - 0.08), (grip[0], -0.05, grip[2]),
                          (grip[0], -grip[1], grip[2]), (x - 0.02, -grip[1], grip[2] + 0.03))),
        ]  # fmt: skip
        for sign in (1, -1):
            y = sign * side
            shapes += [
                Shape(kind="cylinder", material="rubber", radius=wheel,
                      points=((rear - 0.04, y - 0.016, wheel), (rear - 0.04, y + 0.016, wheel))),
                Shape(kind="cylinder", material="dark", radius=0.045,
                      points=((rear, y, tall - 0.05), (rear, y, tall + 0.006))),
                Shape(kind="box", material="accent", at=(rear - 0.085, y, wheel + 0.035),
                      size=(0.05, 0.03, 0.012), bevel=0.004),  # pedal of the brake
            ]  # fmt: skip
        return shapes

    def _solids(self) -> list[Shape]:
        c = self.config
        rear, side = self._leg_at()
        x, tall = -c.mast_back, c.leg_height
        return [
            Shape(kind="box", at=(rear - 0.02, 0, 0.5 * tall + 0.002),
                  size=(0.13, 2 * side + 0.07, tall - 0.004)),
            Shape(kind="box", at=(0.5 * (rear + x), 0, tall - 0.005),
                  size=(abs(rear - x) + 0.12, 0.12, 0.05)),
            Shape(kind="box", at=(x, 0, 0.5 * (c.mast_height + tall)),
                  size=(*_MAST, c.mast_height - tall)),
            Shape(kind="box", at=(x - 0.075, 0, 0.62 * c.mast_height), size=(0.09, 0.17, 0.28)),
            Shape(kind="box", at=(x - 0.14, 0, c.handle_height),
                  size=(0.03, c.handle_width + 0.03, 0.03)),
        ]  # fmt: skip


__all__ = ["CHASSIS", "ROLLING", "FloorLift", "FloorLiftConfig"]
