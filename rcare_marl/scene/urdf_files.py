"""A scene as URDF files, one a body, and what URDF cannot say as `scene.yaml`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from rcare_marl.model.shape import MeshFile
from rcare_marl.model.urdf import files
from rcare_marl.pose import Pose

from .drawing import Drawn
from .scene import Place, Scene, SceneBody


def urdf_files(
    scene: Scene, drawings: Mapping[Place, Sequence[Drawn]] | None = None
) -> dict[str, str]:
    """Return the files of a scene by name: `scene.yaml`, and a folder a body with its URDF and meshes.

    Args:
        scene: The scene.
        drawings: What to draw of each link; what the models draw if None.
    """
    out = {"scene.yaml": yaml.safe_dump(_about(scene), sort_keys=False)}
    for body in scene.bodies.values():
        visuals: dict[str, tuple[MeshFile, ...]] = {}
        for link in body.model.links if drawings is not None else ():
            drawn = (drawings or {}).get((body.name, link), ())
            named = {f"{link}_{i}.obj": piece for i, piece in enumerate(drawn)}
            out |= {f"{body.name}/{file}": piece.obj() for file, piece in named.items()}
            visuals[link] = tuple(MeshFile(file, _rgba(piece)) for file, piece in named.items())
        made = files(body.model, visuals=visuals)
        name = next(file for file in made if file.endswith(".urdf"))
        out |= {f"{body.name}/{file}": text for file, text in made.items() if file != name}
        out[f"{body.name}/{body.name}.urdf"] = made[name]
    return out


def _about(scene: Scene) -> dict[str, Any]:
    return {
        "physics_dt": scene.physics_dt,
        "solver_iterations": scene.iterations,
        "gravity": scene.gravity,
        "bodies": {name: _body(body) for name, body in scene.bodies.items()},
        "bonds": [
            {
                "parent": list(bond.parent),
                "child": list(bond.child),
                "at": _pose(bond.at),
                "force": bond.force,
                "pivot": None if bond.pivot is None else list(bond.pivot),
                "is_active": bond.is_active,
            }
            for bond in scene.bonds
        ],
        "pass_through_each_other": _pairs(scene.passing),
        "meet_within_a_body": _pairs(scene.meeting),
    }


def _body(body: SceneBody) -> dict[str, Any]:
    return {
        "urdf": f"{body.name}/{body.name}.urdf",
        "pose": _pose(body.pose),
        "is_movable": body.is_movable,
        "positions": dict(body.positions),
        "motors": dict(body.efforts),
        "dry_friction": dict(body.friction),
        "gears": {name: list(gear) for name, gear in body.gears.items()},
        "surfaces": {link: touch._asdict() for link, touch in body.touching.items()},
    }


def _pose(pose: Pose) -> dict[str, list[float]]:
    return {
        "position": [float(value) for value in pose.position],
        "quaternion": [float(value) for value in pose.quaternion],
    }


def _pairs(pairs: frozenset[frozenset[Place]]) -> list[list[list[str]]]:
    return sorted([list(place) for place in sorted(pair)] for pair in pairs)


def _rgba(piece: Drawn) -> tuple[float, float, float, float]:
    red, green, blue, alpha = piece.rgba
    return red, green, blue, alpha
