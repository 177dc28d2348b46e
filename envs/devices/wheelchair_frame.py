"""The parts of wheelchairs as shapes, made from their dimensions."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Vector
from rcare_marl.urdf import Shape, Triple

from .device import Frame

TUBE = 0.0125  # radius of the frame's tubes [m]
_SPOKES = 24
_SIDEWAYS = (-math.pi / 2, 0.0, 0.0)  # turns z to +y, the axle of wheels


def tube(material: str, bend: float, points: list[Triple]) -> Shape:
    """Return a tube of the frame, its corners rounded by `bend` [m]."""
    return Shape(
        kind="tube",
        material=material,
        radius=TUBE if material == "frame" else 0.009,
        bend=bend,
        points=tuple(points),
    )


@dataclass(frozen=True)
class WheelchairConfig:
    """Dimensions of a wheelchair [m]; see `assets/devices/wheelchair.yaml`.

    Attributes:
        caster_trail: How far the wheel of a caster runs behind the stem that it swivels about.
        armrest_side: How far the middle of an armrest is beside the seat.
        has_headrest: Whether there is one.
    """

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
    caster_trail: float = 0.03
    armrest_side: float = 0.03
    has_headrest: bool = True

    def __post_init__(self) -> None:
        if self.seat_width + 0.1 > self.width:
            raise ConfigError(
                f"a seat {self.seat_width} m wide leaves no room for wheels in a width of "
                f"{self.width} m"
            )

    def with_footplates(self, left: Vector, right: Vector) -> WheelchairConfig:
        """Return the dimensions with the plates under a person's soles, given in the chair [m].

        Both plates stand at one height and distance: under the lower foot.
        """
        low = left if left[2] < right[2] else right
        return dataclasses.replace(
            self,
            footplate_forward=float(low[0]),
            footplate_side=0.5 * float(left[1] - right[1]),
            footplate_height=max(float(low[2]), 0.05),
        )


class WheelchairFrame:
    """The shapes of a wheelchair, in its frame: x forward, y left, origin on the floor under the seat.

    Sides are 1 for the left and -1 for the right.
    """

    def __init__(self, config: WheelchairConfig) -> None:
        """Prepare the shapes of a chair of the dimensions in `config`."""
        self.config = config
        self._tan = math.tan(math.radians(config.recline_deg))

    def frames(self) -> dict[str, Frame]:
        """Return named places on the chair; `mount_left` and `mount_right` are bases of robot arms."""
        c = self.config
        lean = -c.recline_deg
        middle = c.seat_height + 0.5 * c.backrest_height
        head = c.seat_height + c.headrest_height
        ahead = c.headrest_forward
        out = {
            "seat": Frame((0.0, 0.0, c.seat_height), note="middle of the seat's surface"),
            "seat_back": Frame(
                (self.back(c.seat_height), 0.0, c.seat_height), note="where seat and back meet"
            ),
            "backrest": Frame((self.back(middle), 0.0, middle), (0.0, lean, 0.0), "its face"),
            "headrest": Frame((self.back(head) + ahead, 0.0, head), (0.0, lean, 0.0), "its face"),
        }
        for side, sign in (("left", 1), ("right", -1)):
            x, y, z = c.mount
            out[f"armrest_{side}"] = Frame(
                (0.02, sign * self.armrest_y(), c.armrest_height), note="top of the pad"
            )
            out[f"footplate_{side}"] = Frame(
                (c.footplate_forward, sign * c.footplate_side, c.footplate_height),
                (0.0, -c.footplate_tilt_deg, 0.0),
                "top of the plate",
            )
            out[f"mount_{side}"] = Frame((x, sign * y, z), note="base of a robot arm")
        return out

    def back(self, height: float) -> float:
        """Return x of the backrest's face at a height above the floor [m]."""
        c = self.config
        return 0.02 - 0.5 * c.seat_depth - (height - c.seat_height) * self._tan

    def armrest_y(self) -> float:
        """Return how far the middle of an armrest is from that of the chair [m]."""
        return 0.5 * self.config.seat_width + self.config.armrest_side

    def upholstery(self) -> list[Shape]:
        """Return the cushions of seat, back and head as they look."""
        c = self.config
        lean = (0.0, -math.radians(c.recline_deg), 0.0)
        pads = [
            Shape(kind="box", material="fabric", at=shape.at, rpy=shape.rpy, size=shape.size,
                  bevel=0.022)
            for shape in self.cushions()
        ]  # fmt: skip
        seams = [
            Shape(kind="box", material="pad", size=(0.004, 0.86 * c.seat_width, 0.006), bevel=0.002,
                  at=(self.back(z) + 0.0005, 0.0, z), rpy=lean)
            for z in (c.seat_height + 0.24 * c.backrest_height,
                      c.seat_height + 0.62 * c.backrest_height)
        ]  # fmt: skip
        return pads + seams

    def cushions(self) -> list[Shape]:
        """Return the boxes of seat, back and headrest."""
        c = self.config
        lean = (0.0, -math.radians(c.recline_deg), 0.0)

        def behind(height: float, thickness: float, forward: float = 0.0) -> Triple:
            tilt = math.radians(c.recline_deg)
            x = self.back(height) + forward - 0.5 * thickness * math.cos(tilt)
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
        return [seat, back, head] if c.has_headrest else [seat, back]

    def armrest_pad(self, side: int, *, bevel: float = 0.0) -> Shape:
        """Return the pad of an armrest."""
        c = self.config
        size = (c.armrest_length, 0.055, 0.035)
        at = (0.02, side * self.armrest_y(), c.armrest_height - 0.5 * size[2])
        return Shape(kind="box", material="pad", at=at, size=size, bevel=bevel)

    def plate(self, side: int, *, bevel: float = 0.0) -> Shape:
        """Return a footplate."""
        c = self.config
        tilt = math.radians(c.footplate_tilt_deg)
        x = c.footplate_forward + 0.0075 * math.sin(tilt)
        return Shape(
            kind="box",
            material="pad",
            at=(x, side * c.footplate_side, c.footplate_height - 0.0075 * math.cos(tilt)),
            rpy=(0.0, -tilt, 0.0),
            size=(0.2, 0.16, 0.015),
            bevel=bevel,
        )

    def rail(self) -> float:
        """Return the height of the rails that carry the seat [m]."""
        return self.config.seat_height - self.config.cushion - 0.015

    def hinge(self, side: int) -> Triple:
        """Return where the hanger of a footrest meets the rail [m]."""
        c = self.config
        return (0.5 * c.seat_depth + 0.05, side * 0.5 * c.seat_width, self.rail() - 0.018)

    def stem(self, side: int) -> Triple:
        """Return the lower end of the stem that a caster swivels about [m]."""
        c = self.config
        return (c.caster_axle - 0.03, side * 0.5 * c.seat_width, c.caster_diameter + 0.02)

    def side_frame(self, side: int) -> list[Shape]:
        """Return the tubes and the grip of one half of the frame."""
        c = self.config
        rail, front = self.rail(), 0.5 * c.seat_depth + 0.02
        rear, y = self.back(c.seat_height) - 0.04, side * 0.5 * c.seat_width
        top, low = c.handle_height, 0.5 * c.wheel_diameter - 0.04
        cane = self.back(top) - 0.055
        stem, brace = self.stem(side), 0.05 + 0.02 * side
        axle = (c.wheel_axle, y - 0.01 * side, 0.5 * c.wheel_diameter)
        # Backrest cane that bends into the push handle.
        cane_path = [(rear, y, low), (rear, y, c.seat_height), (cane, y, top)]
        return [
            tube("frame", 0.06, [*cane_path, (cane - 0.13, y, top - 0.012)]),
            tube("frame", 0.05, [(rear, y, rail), (front, y, rail), self.hinge(side)]),
            tube("frame", 0.04, [(rear, y, low), (front - 0.02, y, low), (front - 0.02, y, rail)]),
            tube("frame", 0.0, [(brace, y, rail), (brace, -y, low)]),  # crosses its like
            tube("frame", 0.02, [(front - 0.02, y, low), (stem[0], y, low), stem]),
            tube("frame", 0.0, [axle, (c.wheel_axle, y, rail)]),
            Shape(kind="tube", material="pad", radius=0.017,
                  points=((cane - 0.05, y, top - 0.004), (cane - 0.14, y, top - 0.013))),
        ]  # fmt: skip

    def hanger(self, side: int) -> Shape:
        """Return the tube from the rail to a footplate."""
        c = self.config
        x, y, z = self.hinge(side)
        ankle = (c.footplate_forward - 0.14, y, c.footplate_height + 0.03)
        under = (
            c.footplate_forward - 0.06,
            side * c.footplate_side,
            c.footplate_height - 0.035,
        )
        return tube("frame", 0.05, [(x, y, z), (x + 0.07, y, z - 0.042), ankle, under])

    def armrest_hoop(self, side: int) -> Shape:
        """Return the tube that carries an armrest and stands on the rail."""
        y, foot, under = (
            side * self.armrest_y(),
            self.rail() - 0.01,
            self.config.armrest_height - 0.04,
        )
        path = [(-0.13, y, foot), (-0.13, y, under), (0.17, y, under), (0.17, y, foot)]
        return tube("frame", 0.05, path)

    def headrest_tubes(self) -> list[Shape]:
        """Return the bar behind the backrest and the stalk of the headrest."""
        c = self.config
        side, head = 0.5 * c.seat_width, c.seat_height + c.headrest_height
        bar = c.seat_height + c.backrest_height - 0.1
        x = self.back(bar) - 0.06
        shapes = [tube("steel", 0.0, [(x, -side, bar), (x, side, bar)])]
        if c.has_headrest:
            behind = (self.back(head) - 0.09, 0.0, head - 0.05)
            front = (self.back(head) + c.headrest_forward - 0.05, 0.0, head)
            shapes.append(tube("steel", 0.04, [(x, 0.0, bar), behind, front]))
        return shapes

    def wheel(self, sign: int) -> list[Shape]:
        """Return a drive wheel with its handrim, the left (1) or the right (-1)."""
        c = self.config
        radius = 0.5 * c.wheel_diameter
        outer = sign * (0.5 * c.width - 0.008)
        y = outer - sign * 0.042
        hub = (c.wheel_axle, y, radius)

        def ring(
            mid: float, thick: float, at_y: float, material: str, corners: int, flat: float = 1.0
        ) -> Shape:
            points = [
                (mid + thick * math.cos(t), flat * thick * math.sin(t))
                for t in (2 * math.pi * k / corners for k in range(corners + 1))
            ]
            points[-1] = points[0]
            return Shape(
                kind="lathe", material=material, at=(c.wheel_axle, at_y, radius), rpy=_SIDEWAYS,
                profile=tuple(points),
            )  # fmt: skip

        shapes = [
            ring(radius - 0.015, 0.015, y, "tyre", 10),
            ring(radius - 0.035, 0.007, y, "steel", 6, 1.5),
            ring(radius - 0.055, 0.008, outer, "steel", 6),
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

    def caster(self, side: int) -> list[Shape]:
        """Return the wheel of a caster."""
        radius = 0.5 * self.config.caster_diameter
        x, y, _ = self.caster_hub(side)
        bead = radius - 0.012
        tyre = ((bead, -0.014), (radius, -0.008), (radius, 0.008), (bead, 0.014))
        return [
            Shape(kind="lathe", material="tyre", at=(x, y, radius), rpy=_SIDEWAYS, profile=tyre),
            Shape(kind="cylinder", material="steel", radius=radius - 0.03,
                  points=((x, y - 0.0155, radius), (x, y + 0.0155, radius))),
        ]  # fmt: skip

    def caster_hub(self, side: int) -> Triple:
        """Return the middle of the wheel of a caster that trails [m]."""
        c = self.config
        x, y, _ = self.stem(side)
        return (x - c.caster_trail, y, 0.5 * c.caster_diameter)

    def fork(self, side: int) -> list[Shape]:
        """Return the fork of a caster."""
        x, y, radius = self.caster_hub(side)
        stem, top = self.stem(side)[0], self.config.caster_diameter
        return [
            Shape(kind="tube", material="steel", radius=0.006, bend=0.02,
                  points=((x, y + aside, radius), (stem - 0.01, y + aside, top + 0.015),
                          (stem, y, top + 0.022)))
            for aside in (-0.022, 0.022)
        ]  # fmt: skip

    def post(self, sign: int) -> list[Shape]:
        """Return a bracket from the frame to the base of a robot arm."""
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


__all__ = ["TUBE", "WheelchairConfig", "WheelchairFrame", "tube"]
