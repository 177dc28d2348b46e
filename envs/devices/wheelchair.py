"""A manual wheelchair, made from its dimensions."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rcare_marl import assets
from rcare_marl.agents.robot_config import Mount
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Vector
from rcare_marl.urdf import Link, Model, Shape, Triple

from .device import Device, Frame

_TUBE = 0.0125  # radius of the frame's tubes [m]
_SPOKES = 24
LOWEST_POST = 0.1  # [m]; what is mounted lower stands on the floor
_SIDEWAYS = (-math.pi / 2, 0.0, 0.0)  # turns z to +y, the axle of wheels


_Tube = tuple[str, float, list[Triple]]  # material, rounding of the corners [m], path


def _tube(material: str, bend: float, points: list[Triple]) -> Shape:
    return Shape(
        kind="tube",
        material=material,
        radius=_TUBE if material == "frame" else 0.009,
        bend=bend,
        points=tuple(points),
    )


@dataclass(frozen=True)
class WheelchairConfig:
    """Dimensions of a wheelchair [m]; see `assets/devices/wheelchair.yaml`."""

    source: str
    seat_height: float
    seat_width: float
    seat_depth: float
    cushion: float
    armrest_height: float
    armrest_length: float
    width: float
    handle_height: float
    backrest_height: float
    recline_deg: float
    headrest_height: float
    headrest_forward: float
    wheel_diameter: float
    wheel_axle: float
    caster_diameter: float
    caster_axle: float
    footplate_height: float
    footplate_forward: float
    footplate_side: float
    footplate_tilt_deg: float
    mount: Triple
    materials: dict[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        if self.seat_width + 0.1 > self.width:
            raise ConfigError(
                f"a seat {self.seat_width} m wide leaves no room for wheels in a width of "
                f"{self.width} m"
            )


class Wheelchair(Device):
    """A wheelchair that stands still: x forward, y left, origin on the floor under the seat.

    Frames: `seat` (middle of the surface), `seat_back` (where it meets the backrest), `backrest`
    (middle of its face, x out of it), `headrest`, `armrest_left`, `armrest_right` (middle of the
    pad's top), `footplate_left`, `footplate_right`, `mount_left`, `mount_right` (base of a robot
    arm).

    Attributes:
        carries_robot: Whether it has a post for a robot arm.
    """

    def __init__(self, config: WheelchairConfig | None = None, *, mounts: str = "both") -> None:
        """Make a wheelchair.

        Args:
            config: Its dimensions; those of the data file if None.
            mounts: Where a post for a robot arm stands: `both`, `left`, `right` or `none`.

        Raises:
            ConfigError: If `mounts` is none of these.
        """
        if mounts not in ("both", "left", "right", "none"):
            raise ConfigError(f"mounts must be one of both, left, right, none, got {mounts!r}")
        self.config = config or load(WheelchairConfig, assets.find("devices", "wheelchair"))
        self.carries_robot = mounts != "none"
        self._posts = {"both": (1, -1), "left": (1,), "right": (-1,), "none": ()}[mounts]
        self._tan = math.tan(math.radians(self.config.recline_deg))

    def fit_footplates(self, left: Vector, right: Vector) -> None:
        """Move the footplates under a person's soles, given in the chair's frame [m], before `spawn`.

        Both plates stand at one height and distance: under the lower foot.
        """
        low = left if left[2] < right[2] else right
        self.config = dataclasses.replace(
            self.config,
            footplate_forward=float(low[0]),
            footplate_side=0.5 * float(left[1] - right[1]),
            footplate_height=max(float(low[2]), 0.05),
        )

    @property
    def frames(self) -> Mapping[str, Frame]:
        c = self.config
        lean = -c.recline_deg
        armrest = self._armrest_y()
        middle = c.seat_height + 0.5 * c.backrest_height
        head = c.seat_height + c.headrest_height
        out = {
            "seat": Frame((0.0, 0.0, c.seat_height), note="middle of the seat's surface"),
            "seat_back": Frame(
                (self._back(c.seat_height), 0.0, c.seat_height), note="where seat and back meet"
            ),
            "backrest": Frame((self._back(middle), 0.0, middle), (0.0, lean, 0.0), "its face"),
            "headrest": Frame(
                (self._back(head) + c.headrest_forward, 0.0, head), (0.0, lean, 0.0), "its face"
            ),
        }
        for side, sign in (("left", 1), ("right", -1)):
            x, y, z = c.mount
            out[f"armrest_{side}"] = Frame(
                (0.02, sign * armrest, c.armrest_height), note="top of the pad"
            )
            out[f"footplate_{side}"] = Frame(
                (c.footplate_forward, sign * c.footplate_side, c.footplate_height),
                (0.0, -c.footplate_tilt_deg, 0.0),
                "top of the plate",
            )
            out[f"mount_{side}"] = Frame((x, sign * y, z), note="base of a robot arm")
        return out

    def model(self) -> Model:
        c = self.config
        visual = [*self._upholstery(), *self._footrests(), *self._tubes()]
        for sign in (1, -1):
            visual += [*self._wheel(sign), *self._caster(sign)]
        visual += [shape for sign in self._posts for shape in self._post(sign)]
        link = Link(mass=18.0, visual=tuple(visual), collision=tuple(self._solids()))
        return Model(
            name="wheelchair", source=c.source, links={"wheelchair": link}, materials=c.materials
        )

    def _back(self, height: float) -> float:
        """Return x of the backrest's face at a height above the floor [m]."""
        c = self.config
        return 0.02 - 0.5 * c.seat_depth - (height - c.seat_height) * self._tan

    def _armrest_y(self) -> float:
        return 0.5 * self.config.seat_width + 0.03

    def _upholstery(self) -> list[Shape]:
        c = self.config
        lean = (0.0, -math.radians(c.recline_deg), 0.0)
        pads = []
        for shape in self._cushions():
            pads.append(Shape(kind="box", material="fabric", at=shape.at, rpy=shape.rpy,
                              size=shape.size, bevel=0.022))  # fmt: skip
        for shape in self._armrests():
            pads.append(Shape(kind="box", material="pad", at=shape.at, size=shape.size,
                              bevel=0.012))  # fmt: skip
        seams = [
            Shape(kind="box", material="pad", size=(0.004, 0.86 * c.seat_width, 0.006), bevel=0.002,
                  at=(self._back(z) + 0.0005, 0.0, z), rpy=lean)
            for z in (c.seat_height + 0.24 * c.backrest_height,
                      c.seat_height + 0.62 * c.backrest_height)
        ]  # fmt: skip
        return pads + seams

    def _cushions(self) -> list[Shape]:
        c = self.config
        lean = (0.0, -math.radians(c.recline_deg), 0.0)

        def behind(height: float, thickness: float, forward: float = 0.0) -> Triple:
            tilt = math.radians(c.recline_deg)
            x = self._back(height) + forward - 0.5 * thickness * math.cos(tilt)
            return (x, 0.0, height - 0.5 * thickness * math.sin(tilt))

        seat = Shape(
            kind="box",
            at=(0.0, 0.0, c.seat_height - 0.5 * c.cushion),
            size=(c.seat_depth, c.seat_width - 0.02, c.cushion),
        )
        back = Shape(
            kind="box",
            at=behind(c.seat_height + 0.5 * c.backrest_height + 0.01, 0.05),
            rpy=lean,
            size=(0.05, c.seat_width - 0.04, c.backrest_height - 0.02),
        )
        head = Shape(
            kind="box",
            at=behind(c.seat_height + c.headrest_height, 0.07, c.headrest_forward),
            rpy=lean,
            size=(0.07, 0.26, 0.14),
        )
        return [seat, back, head]

    def _armrests(self) -> list[Shape]:
        c = self.config
        size = (c.armrest_length, 0.055, 0.035)
        return [
            Shape(
                kind="box",
                at=(0.02, sign * self._armrest_y(), c.armrest_height - 0.5 * size[2]),
                size=size,
            )
            for sign in (1, -1)
        ]

    def _footrests(self) -> list[Shape]:
        return [
            Shape(kind="box", material="pad", at=plate.at, rpy=plate.rpy, size=plate.size,
                  bevel=0.006)
            for plate in self._plates()
        ]  # fmt: skip

    def _plates(self) -> list[Shape]:
        c = self.config
        tilt = math.radians(c.footplate_tilt_deg)
        x = c.footplate_forward + 0.0075 * math.sin(tilt)
        return [
            Shape(
                kind="box",
                at=(x, sign * c.footplate_side, c.footplate_height - 0.0075 * math.cos(tilt)),
                rpy=(0.0, -tilt, 0.0),
                size=(0.2, 0.16, 0.015),
            )
            for sign in (1, -1)
        ]

    def _tubes(self) -> list[Shape]:
        side = 0.5 * self.config.seat_width
        paths = [*self._side_tubes(1), *self._side_tubes(-1), *self._headrest_tubes(side)]
        shapes = [_tube(*each) for each in paths]
        top = self.config.handle_height
        for sign in (1, -1):  # rubber grips on the push handles
            x = self._back(top) - 0.055
            shapes.append(
                Shape(
                    kind="tube",
                    material="pad",
                    radius=0.017,
                    points=(
                        (x - 0.05, sign * side, top - 0.004),
                        (x - 0.14, sign * side, top - 0.013),
                    ),
                )
            )
        return shapes

    def _side_tubes(self, sign: int) -> list[_Tube]:
        """Return the tubes of the left (1) or right (-1) half of the frame."""
        c = self.config
        rail, side = c.seat_height - c.cushion - 0.015, 0.5 * c.seat_width
        front, rear = 0.5 * c.seat_depth + 0.02, self._back(c.seat_height) - 0.04
        top = c.handle_height
        low = 0.5 * c.wheel_diameter - 0.04
        out: list[_Tube] = []
        y, arm = sign * side, sign * self._armrest_y()
        cane = self._back(top) - 0.055
        # Backrest cane that bends into the push handle, and the side frame.
        out.append(
            (
                "frame",
                0.06,
                [
                    (rear, y, low),
                    (rear, y, c.seat_height),
                    (cane, y, top),
                    (cane - 0.13, y, top - 0.012),
                ],
            )
        )
        out.append(
            (
                "frame",
                0.05,
                [
                    (rear, y, rail),
                    (front, y, rail),
                    (front + 0.1, y, rail - 0.06),
                    (c.footplate_forward - 0.14, y, c.footplate_height + 0.03),
                    (
                        c.footplate_forward - 0.06,
                        sign * c.footplate_side,
                        c.footplate_height - 0.035,
                    ),
                ],
            )
        )
        out.append(
            ("frame", 0.04, [(rear, y, low), (front - 0.02, y, low), (front - 0.02, y, rail)])
        )
        # Armrest hoop.
        under = c.armrest_height - 0.04
        out.append(
            (
                "frame",
                0.05,
                [
                    (-0.13, arm, rail - 0.01),
                    (-0.13, arm, under),
                    (0.17, arm, under),
                    (0.17, arm, rail - 0.01),
                ],
            )
        )
        # Cross brace below the seat and the fork of the caster.
        brace = 0.05 + 0.02 * sign
        out.append(("frame", 0.0, [(brace, y, rail), (brace, -y, low)]))
        fork = c.caster_axle - 0.03
        out.append(
            (
                "frame",
                0.02,
                [(front - 0.02, y, low), (fork, y, low), (fork, y, c.caster_diameter + 0.02)],
            )
        )
        out.append(
            (
                "frame",
                0.0,
                [
                    (c.wheel_axle, sign * (side - 0.01), 0.5 * c.wheel_diameter),
                    (c.wheel_axle, y, rail),
                ],
            )
        )
        return out

    def _headrest_tubes(self, side: float) -> list[_Tube]:
        """Return the bar behind the backrest and the stalk of the headrest."""
        c = self.config
        head = c.seat_height + c.headrest_height
        low_bar = c.seat_height + c.backrest_height - 0.1
        return [
            (
                "steel",
                0.0,
                [
                    (self._back(low_bar) - 0.06, -side, low_bar),
                    (self._back(low_bar) - 0.06, side, low_bar),
                ],
            ),
            (
                "steel",
                0.04,
                [
                    (self._back(low_bar) - 0.06, 0.0, low_bar),
                    (self._back(head) - 0.09, 0.0, head - 0.05),
                    (self._back(head) + c.headrest_forward - 0.05, 0.0, head),
                ],
            ),
        ]

    def _wheel(self, sign: int) -> list[Shape]:
        c = self.config
        radius = 0.5 * c.wheel_diameter
        outer = sign * (0.5 * c.width - 0.008)
        y = outer - sign * 0.042
        hub = (c.wheel_axle, y, radius)

        def ring(mid: float, thick: float, at_y: float, material: str, flat: float = 1.0) -> Shape:
            points = [
                (mid + thick * math.cos(t), flat * thick * math.sin(t))
                for t in (2 * math.pi * k / 12 for k in range(13))
            ]
            points[-1] = points[0]
            return Shape(
                kind="lathe", material=material, at=(c.wheel_axle, at_y, radius), rpy=_SIDEWAYS,
                profile=tuple(points),
            )  # fmt: skip

        shapes = [
            ring(radius - 0.015, 0.015, y, "tyre"),
            ring(radius - 0.035, 0.007, y, "steel", 1.5),
            ring(radius - 0.055, 0.008, outer, "steel"),
            Shape(kind="cylinder", material="steel", radius=0.024,
                  points=((c.wheel_axle, y - 0.026, radius), (c.wheel_axle, y + 0.026, radius))),
        ]  # fmt: skip
        for k in range(_SPOKES):
            angle = 2 * math.pi * k / _SPOKES
            skew = angle + (0.35 if k % 2 else -0.35)
            flange = y + (0.02 if k // 2 % 2 else -0.02)
            start = (hub[0] + 0.02 * math.cos(skew), flange, hub[2] + 0.02 * math.sin(skew))
            reach = radius - 0.037
            end = (hub[0] + reach * math.cos(angle), y, hub[2] + reach * math.sin(angle))
            shapes.append(Shape(kind="tube", material="steel", radius=0.0014, points=(start, end)))
        for k in range(6):  # what holds the handrim
            angle = 2 * math.pi * (k + 0.5) / 6
            a, b = radius - 0.037, radius - 0.055
            shapes.append(
                Shape(
                    kind="tube",
                    material="steel",
                    radius=0.004,
                    points=(
                        (hub[0] + a * math.cos(angle), y, hub[2] + a * math.sin(angle)),
                        (hub[0] + b * math.cos(angle), outer, hub[2] + b * math.sin(angle)),
                    ),
                )
            )
        return shapes  # fmt: skip

    def _caster(self, sign: int) -> list[Shape]:
        c = self.config
        radius, x, y = 0.5 * c.caster_diameter, c.caster_axle - 0.06, sign * 0.5 * c.seat_width
        bead = radius - 0.012
        tyre = ((bead, -0.014), (radius, -0.008), (radius, 0.008), (bead, 0.014))
        fork = c.caster_axle - 0.03
        shapes = [
            Shape(kind="lathe", material="tyre", at=(x, y, radius), rpy=_SIDEWAYS, profile=tyre),
            Shape(
                kind="cylinder",
                material="steel",
                radius=radius - 0.03,
                points=((x, y - 0.0155, radius), (x, y + 0.0155, radius)),
            ),
        ]
        for side in (-0.022, 0.022):
            shapes.append(
                Shape(
                    kind="tube",
                    material="steel",
                    radius=0.006,
                    bend=0.02,
                    points=(
                        (x, y + side, radius),
                        (fork - 0.01, y + side, c.caster_diameter + 0.015),
                        (fork, y, c.caster_diameter + 0.022),
                    ),
                )
            )
        return shapes  # fmt: skip

    def _post(self, sign: int) -> list[Shape]:
        """A bracket from the frame to the base of a robot arm."""
        x, y, z = self.config.mount
        y *= sign
        rail = self.config.seat_height - self.config.cushion - 0.015
        inner, hold = sign * 0.5 * self.config.seat_width, 0.5 * self.config.seat_depth - 0.03
        return [
            Shape(kind="cylinder", material="steel", radius=0.06,
                  points=((x, y, z - 0.012), (x, y, z))),
            Shape(kind="cylinder", material="frame", radius=0.025,
                  points=((x, y, z - 0.11), (x, y, z - 0.012))),
            Shape(kind="tube", material="frame", radius=0.019, bend=0.06,
                  points=((hold, inner, rail), (hold + 0.08, inner + sign * 0.1, rail - 0.03),
                          (x, y, z - 0.07))),
            Shape(kind="box", material="steel", at=(hold, inner, rail), size=(0.06, 0.045, 0.05),
                  bevel=0.008),
        ]  # fmt: skip

    def _solids(self) -> list[Shape]:
        c = self.config
        radius = 0.5 * c.wheel_diameter
        outer = 0.5 * c.width
        solids = [*self._cushions(), *self._armrests(), *self._plates()]
        for sign in (1, -1):
            wheel = (
                (c.wheel_axle, sign * (outer - 0.065), radius),
                (c.wheel_axle, sign * outer, radius),
            )
            solids.append(Shape(kind="cylinder", radius=radius, points=wheel))
        for sign in self._posts:
            x, y, z = c.mount
            solids.append(
                Shape(kind="cylinder", radius=0.06,
                      points=((x, sign * y, z - 0.15), (x, sign * y, z - 0.002)))
            )  # fmt: skip
        return solids


def chair_for(mount: Mount, side: Literal["left", "right"]) -> Wheelchair:
    """Return a wheelchair whose post carries a robot at `mount`, if the chair is to carry it.

    A robot that drives, or has a stand of its own, needs no post.
    """
    x, y, z = mount.position
    if mount.stand or z < LOWEST_POST:
        return Wheelchair(mounts="none")
    config = load(WheelchairConfig, assets.find("devices", "wheelchair"))
    return Wheelchair(dataclasses.replace(config, mount=(x, abs(y), z)), mounts=side)
