"""A whole body: naked shape, head, clothes, shoes and hair as the arrays of one npz."""

from __future__ import annotations

import dataclasses
import json

import numpy as np

from ..skeleton import JOINTS, PARENTS
from .clothes import SOLE, cloth_colors, cut_clothes, put_on_shoes, wear
from .hair import hair_piece
from .head import add_sources, find_landmarks, head_colors, head_offset, lip_edges, shape_head
from .mesh import Floats, Ints, WeightedMesh, join
from .recipe import BodyRecipe
from .shape import NakedBody
from .source import ShapeSource

_GRID = 2.0**14  # positions are kept to 1 / 16384 m, which compresses well


def dress(
    source: ShapeSource, name: str, recipe: BodyRecipe, naked: NakedBody
) -> dict[str, np.ndarray]:
    """Return the arrays of one body's npz (their meaning: docs of `agents/people/body/skin.py`)."""
    mesh = add_sources(source, naked)
    marks = find_landmarks(mesh, naked.joints)
    mesh = shape_head(mesh, marks, recipe)
    mesh = cut_clothes(mesh, naked.joints, recipe.clothes)
    colors = cloth_colors(mesh, recipe.clothes, head_colors(mesh, marks, recipe))
    worn = wear(mesh, naked.joints, recipe, head_offset(mesh, marks, recipe))
    worn, colors = put_on_shoes(worn, colors, naked.mesh, recipe.clothes)
    piece = hair_piece(worn, marks, recipe)
    if piece is not None:
        worn, colors = join([worn, piece[0]]), np.concatenate([colors, piece[1]])
    joints = naked.joints
    lift = np.array([0.0, SOLE, 0.0])  # the soles of the shoes stand on the floor
    worn.vertices, joints = worn.vertices + lift, joints + lift
    marks = dataclasses.replace(marks, mouth=marks.mouth + lift)
    upper, lower = lip_edges(worn, marks)
    middle = [e[np.argmin(abs(worn.vertices[e, 0]))] for e in (upper, lower)]
    mouth = worn.vertices[middle].mean(axis=0) * [0.0, 1.0, 1.0]
    strongest, weights = _four_strongest(worn)
    meta = {
        "name": name,
        "source": f"{source.version} (PyPI), data of MakeHuman/MPFB2",
        "licence": "CC0-1.0",
        "height_m": round(naked.height, 4),
        "mass_kg": round(naked.mass, 3),
        "sole_m": SOLE,
        "phenotype": {k: round(float(v), 5) for k, v in naked.parameters.items()},
        "recipe": dataclasses.asdict(recipe),
    }
    return {
        "vertices": (np.rint(worn.vertices * _GRID) / _GRID).astype(np.float32),
        "faces": worn.faces.astype(np.int32),
        "joints": joints.astype(np.float32),
        "weight_joints": strongest.astype(np.uint8),
        "weights": weights.astype(np.float32),
        "colors": np.clip(np.rint(colors), 0, 255).astype(np.uint8),
        "parents": np.array(PARENTS, dtype=np.int8),
        "names": np.array(JOINTS),
        "mouth": mouth.astype(np.float32),
        "lips_upper": upper.astype(np.int32),
        "lips_lower": lower.astype(np.int32),
        "meta_json": np.array(json.dumps(meta)),
    }


def _four_strongest(mesh: WeightedMesh) -> tuple[Ints, Floats]:
    """Return the joints and weights of the four greatest influences, in steps of 1/256."""
    order = np.argsort(-mesh.weights, axis=1, kind="stable")[:, :4]
    kept = np.take_along_axis(mesh.weights, order, axis=1)
    steps = np.rint(kept / kept.sum(axis=1, keepdims=True) * 256)
    steps[:, 0] += 256 - steps.sum(axis=1)
    return np.where(steps > 0, order, 0), steps / 256
