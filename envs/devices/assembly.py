"""Devices put together from parts: every shape is given where it stands, links find themselves."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rcare_marl.model.shape import ZERO, MeshFile, Shape, Triple
from rcare_marl.model.urdf import Joint, Link, Model
from rcare_marl.pose import Array, Pose

Inertia = tuple[float, float, float, float, float, float]


@dataclass
class Part:
    """A link while it is put together, all shapes in the frame of the device.

    Attributes:
        mass: Mass [kg]; that of the solids if None.
        density: Of the solids where they tell the mass [kg/m³].
        origin: Where the link's frame is in the device, not turned [m].
        visual: What to draw.
        collision: What to collide with.
        hulls: Mesh files by whose hulls it collides as well, in the frame of the link.
        inertia: Centre and inertia of the mass where the shapes do not tell it.
    """

    mass: float | None
    origin: Triple = ZERO
    density: float = 0.0
    visual: list[Shape] = field(default_factory=list)
    collision: list[Shape] = field(default_factory=list)
    hulls: list[MeshFile] = field(default_factory=list)
    inertia: tuple[Triple, Inertia] | None = None


class Assembly:
    """Collects the links and joints of a model; frames of links are parallel to the device's.

    Attributes:
        parts: The links by name, the root first.
        joints: The joints by name.
    """

    def __init__(self, root: str, mass: float) -> None:
        """Start with the link that carries all others, of `mass` [kg], at the device's origin."""
        self.parts = {root: Part(mass)}
        self.joints: dict[str, Joint] = {}

    def hang(
        self,
        name: str,
        parent: str,
        mass: float,
        *,
        kind: Literal["revolute", "continuous", "prismatic"] = "revolute",
        at: Triple,
        axis: Triple,
        upper: float = 0.0,
        lower: float = 0.0,
        effort: float = 0.0,
        velocity: float = 1.0,
        damping: float = 0.0,
        friction: float = 0.0,
        joint: str = "",
    ) -> Part:
        """Hang a link on a joint, both called `name`, and return it.

        Args:
            name: Of link and joint.
            parent: Link that carries it.
            mass: Mass [kg].
            kind: Kind of joint.
            at: A point on the axis of the joint, in the device [m].
            axis: Axis of motion in the device.
            upper: Upper limit [rad or m].
            lower: Lower limit [rad or m].
            effort: Greatest torque or force [N·m or N].
            velocity: Greatest speed [rad/s or m/s].
            damping: As in `urdf.Joint`.
            friction: As in `urdf.Joint`.
            joint: Name of the joint, if it is another.
        """
        base = self.parts[parent].origin
        self.parts[name] = Part(mass, origin=at)
        self.joints[joint or name] = Joint(
            kind=kind,
            parent=parent,
            child=name,
            axis=axis,
            lower=lower,
            upper=upper,
            at=(at[0] - base[0], at[1] - base[1], at[2] - base[2]),
            effort=effort,
            velocity=velocity,
            damping=damping,
            friction=friction,
        )
        return self.parts[name]

    def model(self, name: str, source: str, materials: Mapping[str, tuple[float, ...]]) -> Model:
        """Return the model; links weigh where their solids and tubes are."""
        links = {key: _link(part) for key, part in self.parts.items()}
        return Model(
            name=name, source=source, links=links, joints=self.joints, materials=dict(materials)
        )


def shifted(shape: Shape, by: Triple) -> Shape:
    """Return a shape moved by `by` [m]."""
    return shape if by == ZERO else shape.moved(Pose(by))


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
    rows = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    xx, xy, xz, yy, yz, zz = (float(total[row]) for row in rows)
    return (x, y, z), (xx, xy, xz, yy, yz, zz)


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
    com, inertia = weigh(link.mass, [*link.collision, *_tubes(link)])
    return dataclasses.replace(link, com=com, inertia=inertia)


def _tubes(link: Link) -> list[Shape]:
    return [shape for shape in link.visual if shape.kind == "tube"]


def _link(part: Part) -> Link:
    back = (-part.origin[0], -part.origin[1], -part.origin[2])
    visual = tuple(shifted(shape, back).coarse() for shape in part.visual)
    collision = tuple(shifted(shape, back) for shape in part.collision)
    link = Link(visual=visual, collision=collision, hulls=tuple(part.hulls))
    heavy, mass = list(collision), part.mass
    if mass is None:
        mass = part.density * sum(size for shape in heavy for size, _, _ in _lumps(shape))
    else:
        heavy += _tubes(link)
    if mass == 0:
        return link
    com, inertia = part.inertia or weigh(mass, heavy)
    return dataclasses.replace(link, mass=mass, com=com, inertia=inertia)
