"""What furniture is made of: boxes and bars, given by where they begin and end, and links of them."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field

from rcare_marl.model.inertia import Inertia
from rcare_marl.model.shape import ZERO, Shape, Triple
from rcare_marl.model.urdf import Link
from rcare_marl.pose import Pose

from ...devices import volume, weigh, weighed


@dataclass
class Part:
    """A link while it is put together, all shapes in the frame of the piece.

    Attributes:
        mass: Mass [kg]; that of the solids if None.
        origin: Where the link's frame is in the piece, not turned [m].
        density: Of the solids where they tell the mass [kg/m³].
        visual: What to draw.
        collision: What to collide with.
        inertia: Centre and inertia of the mass where the shapes do not tell it.
    """

    mass: float | None
    origin: Triple = ZERO
    density: float = 0.0
    visual: list[Shape] = field(default_factory=list)
    collision: list[Shape] = field(default_factory=list)
    inertia: tuple[Triple, Inertia] | None = None

    def link(self) -> Link:
        """Return the link; without an inertia it weighs where its solids and tubes are."""
        back = Pose((-self.origin[0], -self.origin[1], -self.origin[2]))
        is_moved = self.origin != ZERO
        visual, collision = (
            tuple(shape.moved(back) if is_moved else shape for shape in shapes)
            for shapes in (self.visual, self.collision)
        )
        mass = self.density * volume(collision) if self.mass is None else self.mass
        link = Link(mass, visual=visual, collision=collision)
        if mass == 0 or (self.mass is not None and self.inertia is None):
            return weighed(link) if mass else link
        com, inertia = self.inertia or weigh(mass, collision)
        return dataclasses.replace(link, com=com, inertia=inertia)


def box(material: str, low: Triple, high: Triple, *, bevel: float = 0.0) -> Shape:
    """Return a box between two corners [m]."""
    at = (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2]))
    size = (high[0] - low[0], high[1] - low[1], high[2] - low[2])
    return Shape(kind="box", material=material, at=at, size=size, bevel=bevel)


def solid_rods(radius: float, *points: Triple) -> tuple[Shape, ...]:
    """Return rods along `points` [m], to collide with, that end where the points do.

    They are capsules, which roll and meet at corners better; cylinders where they are short.
    """
    out = []
    for a, b in zip(points, points[1:], strict=False):
        share = radius / math.dist(a, b)
        if share > 0.25:
            out.append(Shape(kind="cylinder", radius=radius, points=(a, b)))
        else:
            ends = (_between(a, b, share), _between(b, a, share))
            out.append(Shape(kind="capsule", radius=radius, points=ends))
    return tuple(out)


def _between(a: Triple, b: Triple, share: float) -> Triple:
    """Return the point a `share` of the way from `a` to `b`."""
    x, y, z = (p + share * (q - p) for p, q in zip(a, b, strict=True))
    return (x, y, z)


def about(at: Triple, *reach: float) -> tuple[Triple, Triple]:
    """Return the corners of the box that reaches so far to each side of its middle along x, y, z [m]."""
    (x, y, z), (a, b, c) = at, reach
    return (x - a, y - b, z - c), (x + a, y + b, z + c)
