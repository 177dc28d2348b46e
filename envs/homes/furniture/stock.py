"""What furniture is made of: boxes and bars, given by where they begin and end."""

from __future__ import annotations

import math

from rcare_marl.model.shape import Shape, Triple


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
