"""Many models as one still body: what stands in a room costs what one thing costs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Link, Model, joint_pose
from rcare_marl.pose import Pose

Part = tuple[Model, Pose, Mapping[str, float]]  # model, its place, positions of joints [rad or m]


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
