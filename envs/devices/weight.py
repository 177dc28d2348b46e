"""What things made of shapes weigh."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence

import numpy as np

from rcare_marl.model.inertia import Inertia, values
from rcare_marl.model.shape import Shape, Triple
from rcare_marl.model.urdf import Link
from rcare_marl.pose import Array


def weigh(mass: float, shapes: Sequence[Shape]) -> tuple[Triple, Inertia]:
    """Return the centre of mass [m] and the inertia about it [kg·m²] of shapes of one density.

    Boxes, spheres, cylinders, capsules (as cylinders of their full length) and tubes, which are full
    rods.
    """
    lumps = [lump for shape in shapes for lump in _lumps(shape)]
    volume = sum(size for size, _, _ in lumps)
    centre = sum((size * at for size, at, _ in lumps), np.zeros(3)) / volume
    total = np.zeros((3, 3))
    for size, at, own in lumps:
        arm = at - centre
        total += size * (own + arm @ arm * np.eye(3) - np.outer(arm, arm))
    total *= mass / volume
    x, y, z = centre.tolist()
    return (x, y, z), values(total)


def volume(shapes: Iterable[Shape]) -> float:
    """Return the volume of shapes, those that overlap counted twice [m³]."""
    return sum(size for shape in shapes for size, _, _ in _lumps(shape))


def _lumps(shape: Shape) -> list[tuple[float, Array, Array]]:
    """Return volume [m³], centre [m] and inertia for each unit of mass [m²] of a shape's pieces."""
    if shape.kind == "tube":
        rods = zip(shape.points, shape.points[1:], strict=False)
        rod = [Shape(kind="cylinder", radius=shape.radius, points=ends) for ends in rods]
        return [lump for part in rod for lump in _lumps(part.moved(shape.pose()))]
    pose = shape.pose()
    turn = pose.matrix()[:3, :3]
    if shape.kind == "box":
        size = np.asarray(shape.size)
        volume, own = float(size.prod()), (size @ size - size**2) / 12
    elif shape.kind == "sphere":
        volume, own = 4 / 3 * math.pi * shape.radius**3, np.full(3, 0.4 * shape.radius**2)
    elif shape.kind in ("cylinder", "capsule"):
        long = shape.span() + (2 * shape.radius if shape.kind == "capsule" else 0.0)
        across = (3 * shape.radius**2 + long**2) / 12
        volume = math.pi * shape.radius**2 * long
        own = np.array((across, across, 0.5 * shape.radius**2))
    else:
        raise ValueError(f"a {shape.kind} has no known weight")
    return [(volume, np.asarray(pose.position), turn @ np.diag(own) @ turn.T)]


def weighed(link: Link) -> Link:
    """Return a link that weighs as if its solids and its drawn tubes were of one density."""
    tubes = [shape for shape in link.visual if shape.kind == "tube"]
    com, inertia = weigh(link.mass, [*link.collision, *tubes])
    return dataclasses.replace(link, com=com, inertia=inertia)
