"""A transfer bench that spans the rim of a bathtub, with a seat that slides across it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from rcare_marl import assets
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose, Vector
from rcare_marl.urdf import Model, Shape
from rcare_marl.world import World

from .assembly import Assembly
from .device import DeviceControl, Frame
from .dry_friction import DryFriction, grip
from .jointed_device import JointedDevice

LEGS = {
    "leg_front_outside": (1, -1),
    "leg_rear_outside": (-1, -1),
    "leg_front_inside": (1, 1),
    "leg_rear_inside": (-1, 1),
}
_RAIL = 0.0125  # radius of the tubes [m]
_PAD = 0.03  # thickness of seat and backrest [m]
_FOOT = 0.02  # radius of the rubber feet [m]
_UNDER = _PAD + 2 * _RAIL  # from the top of the seat to the underside of the rails [m]
_CLEAR = 0.02  # [m], of soles over the floor
_GRIP = 1.0  # friction of rubber feet
PIN = 2000.0  # [N], what the pin of a leg bears; own choice


@dataclass(frozen=True)
class TransferBenchConfig:
    """Dimensions of a bench [m, kg]; see `assets/devices/transfer_bench.yaml`."""

    source: str
    length: float
    depth: float
    seat_low: float
    leg_travel: float
    seat_width: float
    slide: float
    slide_friction: float
    backrest_height: float
    recline_deg: float
    masses: dict[str, float]
    materials: dict[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        if self.seat_width + self.slide > self.length:
            raise ConfigError(
                f"a seat {self.seat_width} m wide cannot slide {self.slide} m on {self.length} m"
            )


class TransferBench(JointedDevice):
    """A bench that stands by itself: x where the sitter looks, y into the tub, origin on the floor.

    Frames: `seat_back` (where seat and backrest meet), `seat` (middle of its surface), `handle_slide`.
    Controls: one for each leg [m over its shortest]. The seat slides freely, joint `slide`, from
    outside (0) over the tub.
    """

    postures = {"seated": ("bench", "seat_back")}
    # A person weighs two hundred times as much as a leg: with fewer the legs slip under 82 kg.
    least_iterations = 150
    _fixed = False
    _on = {"seat_back": "slide", "seat": "slide", "handle_slide": "slide"}

    def __init__(
        self, config: TransferBenchConfig | None = None, *, seat_height: float = 0.48
    ) -> None:
        """Make a bench.

        Args:
            config: Its dimensions; those of the data file if None.
            seat_height: Height of the seat over the floor on which it is put [m].

        Raises:
            ConfigError: If the legs cannot reach `seat_height`.
        """
        self.config = config or load(TransferBenchConfig, assets.find("devices", "transfer_bench"))
        self.seat_height = seat_height
        self._leg(seat_height)

    def fit_legs(self, left: Vector, right: Vector) -> None:
        """Choose the height of the seat, before `spawn`, so that a person's soles come to the floor.

        As near to it as the legs reach; never under it.

        Args:
            left: Middle of the left sole in the bench's frame [m], for the person on `seat_back`.
            right: That of the right sole.
        """
        c = self.config
        below = c.seat_low - min(float(left[2]), float(right[2])) + _CLEAR
        self.seat_height = min(max(below, c.seat_low), c.seat_low + c.leg_travel)

    def _leg(self, length: float) -> float:
        """Return how far a leg is out under a seat `length` above its foot [m]."""
        out = length - self.config.seat_low
        if not -1e-9 <= out <= self.config.leg_travel + 1e-9:
            low, high = self.config.seat_low, self.config.seat_low + self.config.leg_travel
            raise ConfigError(f"the legs reach from {low} to {high:.2f} m, not {length} m")
        return out

    @property
    def frames(self) -> Mapping[str, Frame]:
        c, side = self.config, -0.5 * self.config.slide
        return {
            "seat_back": Frame(
                (-0.5 * c.depth, side, c.seat_low), note="where seat and backrest meet"
            ),
            "seat": Frame((0.0, side, c.seat_low), note="middle of the surface"),
            "handle_slide": Frame((0.05, side - 0.5 * c.seat_width, c.seat_low + 0.16)),
        }

    @property
    def controls(self) -> Mapping[str, DeviceControl]:
        return {name: DeviceControl(name, 0.02, PIN, "pin") for name in LEGS}

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        # The base hangs above the feet, whose floor is that of `pose`: legs first, then down.
        lifted = pose @ Pose((0.0, 0.0, self._leg(self.seat_height)))
        body = super().spawn(world, lifted, name=name)
        self.stand(self.seat_height)
        grip(world, body, [body.links[leg] for leg in LEGS], friction=_GRIP)
        body.set_damping()
        slide = body.joint("slide").index
        DryFriction(world, body).hold({slide: self.config.slide_friction})
        return body

    def stand(self, seat_height: float, *, tub_floor: float = 0.0) -> None:
        """Set the legs at once so that the seat is level on a floor and on that of a bathtub.

        Args:
            seat_height: Over the floor [m].
            tub_floor: Height of the floor of the tub over the other [m].

        Raises:
            ConfigError: If the legs cannot reach.
        """
        for leg, (_, inside) in LEGS.items():
            below = tub_floor if inside > 0 else 0.0
            self.set_position(leg, self._leg(seat_height - below))

    def model(self) -> Model:
        c = self.config
        made = Assembly("bench", c.masses["frame"])
        root = made.parts["bench"]
        rail, half, x = c.seat_low - _PAD - _RAIL, 0.5 * c.length, 0.5 * c.depth - 0.03
        for sign in (1, -1):
            ends = ((sign * x, -half, rail), (sign * x, half, rail))
            root.visual.append(Shape(kind="tube", material="frame", radius=_RAIL, points=ends))
            root.collision.append(Shape(kind="capsule", radius=_RAIL, points=ends))
            across = ((-x, sign * (half - 0.03), rail), (x, sign * (half - 0.03), rail))
            root.visual.append(Shape(kind="tube", material="frame", radius=_RAIL, points=across))
            root.collision.append(Shape(kind="capsule", radius=_RAIL, points=across))
        for name, (front, inside) in LEGS.items():
            self._hang_leg(made, name, (front * x, inside * (half - 0.03)))
        self._hang_seat(made)
        return made.model("transfer_bench", c.source, c.materials)

    def _hang_leg(self, made: Assembly, name: str, at: tuple[float, float]) -> None:
        c, (x, y) = self.config, at
        rail = c.seat_low - _PAD - _RAIL
        sleeve = ((x, y, rail), (x, y, rail - 0.2))
        made.parts["bench"].visual.append(
            Shape(kind="tube", material="frame", radius=_RAIL, points=sleeve)
        )
        leg = made.hang(
            name, "bench", c.masses["leg"], kind="prismatic", at=(x, y, rail), axis=(0.0, 0.0, -1.0),
            upper=c.leg_travel, effort=PIN, velocity=0.02,
        )  # fmt: skip
        rod = ((x, y, rail - 0.02), (x, y, 0.03))
        leg.visual += [
            Shape(kind="tube", material="steel", radius=0.0095, points=rod),
            Shape(kind="lathe", material="rubber", at=(x, y, 0.0),
                  profile=((0.022, 0.0), (0.02, 0.03), (0.014, 0.05))),
        ]  # fmt: skip
        leg.collision += [
            Shape(kind="sphere", radius=_FOOT, at=(x, y, _FOOT)),
            Shape(kind="capsule", radius=_RAIL, points=((x, y, 0.2), (x, y, 0.04))),
        ]

    def _hang_seat(self, made: Assembly) -> None:
        c, z = self.config, self.config.seat_low
        y, lean = -0.5 * c.slide, math.radians(c.recline_deg)
        seat = made.hang(
            "slide", "bench", c.masses["seat"], kind="prismatic", at=(0.0, y, z),
            axis=(0.0, 1.0, 0.0), upper=c.slide, effort=22.0, friction=c.slide_friction,
        )  # fmt: skip
        rear, middle = -0.5 * c.depth, 0.5 * c.backrest_height + 0.1
        back = (rear - middle * math.tan(lean) - 0.5 * _PAD, y, z + middle)
        boards = (
            ((0.0, y, z - 0.5 * _PAD), (c.depth, c.seat_width, _PAD), 0.0, "seat"),
            (back, (_PAD, c.seat_width - 0.04, c.backrest_height - 0.1), -lean, "pad"),
        )
        for at, size, turn, material in boards:
            rpy = (0.0, turn, 0.0)
            seat.visual.append(
                Shape(kind="box", material=material, at=at, rpy=rpy, size=size, bevel=0.012)
            )
            seat.collision.append(Shape(kind="box", at=at, rpy=rpy, size=size))
        for sign in (1, -1):
            stem, out = y + sign * 0.15, y + sign * (0.5 * c.seat_width + 0.015)
            top = z + c.backrest_height + 0.05
            lower, upper = (rear - 0.02, stem, z - 0.02), (back[0] - 0.02, stem, z + middle)
            tip = (rear - (top - z) * math.tan(lean) - 0.02, stem, top - 0.06)
            grip = [(-0.1, out, z - 0.015), (-0.1, out, z + 0.15), (0.1, out, z + 0.15),
                    (0.1, out, z - 0.015)]  # fmt: skip
            seat.visual += [
                Shape(kind="tube", material="frame", radius=0.011, points=(lower, upper, tip)),
                Shape(kind="tube", material="frame", radius=0.011, bend=0.04, points=tuple(grip)),
            ]
            seat.collision.append(Shape(kind="capsule", radius=0.011, points=(grip[1], grip[2])))


__all__ = ["LEGS", "TransferBench", "TransferBenchConfig"]
