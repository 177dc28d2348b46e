"""Many models as one still body, and its solids by where they are: so a house costs little."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Link, Model, joint_pose
from rcare_marl.pose import Array, Pose

from ..rectangle import Rectangle

Part = tuple[Model, Pose, Mapping[str, float]]  # model, its place, positions of joints [rad or m]
LOW, HIGH = 0.03, 2.1  # [m] of height in which people and robots are; own choice
SIDES = ("left", "right", "before", "behind", "above", "below")
NEAR = "near"  # what reaches into the busy space itself


def link_poses(
    model: Model, pose: Pose = Pose(), positions: Mapping[str, float] | None = None
) -> dict[str, Pose]:
    """Return where the links of a model at `pose` are; joints at zero, but for `positions` [rad or m]."""
    places = {model.root: pose}
    for name, joint in model.joints.items():
        there = joint_pose(joint, (positions or {}).get(name, 0.0))
        places[joint.child] = places[joint.parent] @ there
    return places


def merged(name: str, parts: Iterable[Part]) -> Model:
    """Return one link with the shapes of all models, each at its pose with its joints as given."""
    visual: list[Shape] = []
    collision: list[Shape] = []
    materials: dict[str, tuple[float, ...]] = {}
    for model, pose, positions in parts:
        names = {m: _named(m, rgba, materials) for m, rgba in model.materials.items()}
        used = {s.material for link in model.links.values() for s in link.visual}
        materials |= {names[m]: rgba for m, rgba in model.materials.items() if m in used}
        places = link_poses(model, pose, positions)
        for link_name, link in model.links.items():
            at = places[link_name]
            visual += [s.moved(at, material=names[s.material]) for s in link.visual]
            collision += [s.moved(at) for s in link.collision]
    link = Link(visual=tuple(visual), collision=tuple(collision))
    return Model(name=name, source="own choice", links={"home": link}, materials=materials)


def _named(material: str, rgba: tuple[float, ...], known: Mapping[str, tuple[float, ...]]) -> str:
    """Return a name for a colour under which no other colour is known."""
    name, number = material, 1
    while name in known and known[name] != rgba:
        number += 1
        name = f"{material}_{number}"
    return name


def partition(solids: Iterable[Shape], busy: Rectangle) -> dict[str, tuple[Shape, ...]]:
    """Return solids by the side of the busy space they are on: one of `SIDES`, or `NEAR`.

    Bullet looks into a still body, box by box, for each link inside the body's own extent. A house in
    one body holds every link: for a person in a chair that doubled the time of a step. Sorted into what
    is left, right, before, behind, above and below of the place where people and robots are, no body's
    extent holds them, and nothing is looked into before something comes near it.

    Args:
        solids: Shapes to collide with.
        busy: The busy floor, in the frame of the solids [m].
    """
    low = np.array((busy.x0, busy.y0, LOW))
    high = np.array((busy.x1, busy.y1, HIGH))
    sides: dict[str, list[Shape]] = {}
    for shape in solids:
        lowest, highest = extent(shape)
        gaps = np.array((low - highest, lowest - high)).T.ravel()  # each axis: lower, upper side
        side = SIDES[int(gaps.argmax())] if gaps.max() >= 0 else NEAR
        sides.setdefault(side, []).append(shape)
    return {side: tuple(shapes) for side, shapes in sides.items()}


def extent(shape: Shape) -> tuple[Array, Array]:
    """Return the lowest and highest corner of the box along the axes that holds a solid [m].

    Raises:
        ValueError: If the shape is one for the eye only.
    """
    if shape.points and shape.kind in ("cylinder", "capsule"):
        points = np.array(shape.points)
        return points.min(axis=0) - shape.radius, points.max(axis=0) + shape.radius
    radius = shape.radius
    halves = {
        "box": (0.5 * shape.size[0], 0.5 * shape.size[1], 0.5 * shape.size[2]),
        "sphere": (radius, radius, radius),
        "cylinder": (radius, radius, 0.5 * shape.length),
        "capsule": (radius, radius, 0.5 * shape.length + radius),
    }
    if shape.kind not in halves:
        raise ValueError(f"a {shape.kind} is for the eye only")
    matrix = shape.pose().matrix()
    half = np.abs(matrix[:3, :3]) @ np.array(halves[shape.kind])
    return matrix[:3, 3] - half, matrix[:3, 3] + half
