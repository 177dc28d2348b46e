"""Girths of a naked body: a tape's measure of them, and fields that make them greater or smaller."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import ConvexHull  # type: ignore[import-untyped]

from ..skeleton import JOINT_INDEX
from .mesh import Floats, Mask, WeightedMesh, smoothstep

TRUNK_GIRTHS = ("hips", "waist", "chest")
# The segment of a limb by girth, and how far along it the tape lies.
_LIMB_GIRTHS = {
    "thigh": ("hip", "knee", 0.3),
    "calf": ("knee", "ankle", 0.3),
    "ankle": ("knee", "ankle", 0.88),
    "upper_arm": ("shoulder", "elbow", 0.55),
    "forearm": ("elbow", "wrist", 0.22),
    "wrist": ("elbow", "wrist", 0.95),
}
GIRTHS = (*TRUNK_GIRTHS, "neck", *_LIMB_GIRTHS)
_TRUNK = ("pelvis", "spine1", "spine2", "spine3", "left_collar", "right_collar")
_LEVELS = {"hips": ("pelvis", -0.04), "waist": ("pelvis", 0.125), "chest": ("spine3", 0.03)}


def girths(mesh: WeightedMesh, joints: Floats, skin: int) -> dict[str, float]:
    """Return the girths [m] of a naked body in the T-pose, the left limbs' for limbs.

    Args:
        mesh: The body.
        joints: Joint centres [m], shape [55, 3].
        skin: How many of its faces are skin, first.
    """
    faces = mesh.faces[:skin]
    trunk = _of(mesh, (*_TRUNK, "left_hip", "right_hip"))[faces].all(axis=1)
    out = {}
    for name, height in _levels(joints).items():
        out[name] = _tape(mesh.vertices[faces[trunk]], 1, height)
    neck = _of(mesh, ("neck", "spine3", "head"))[faces].all(axis=1)
    out["neck"] = _tape(mesh.vertices[faces[neck]], 1, _neck(joints))
    for name, (first, last, share) in _LIMB_GIRTHS.items():
        a, b = (joints[JOINT_INDEX[f"left_{j}"]] for j in (first, last))
        axis = 1 if first in ("hip", "knee") else 0
        near = _of(mesh, (f"left_{first}", f"left_{last}", "pelvis"))[faces].all(axis=1)
        near &= (mesh.vertices[faces][:, :, 0] > 0).all(axis=1)
        out[name] = _tape(mesh.vertices[faces[near]], axis, float((a + share * (b - a))[axis]))
    return out


def swollen(mesh: WeightedMesh, joints: Floats, factors: Mapping[str, float]) -> Floats:
    """Return vertices [m], shape [n, 3], with girths multiplied by factors, smoothly between them."""
    out = mesh.vertices.copy()
    levels = _levels(joints)
    heights = [levels["hips"] - 0.16, *levels.values(), joints[JOINT_INDEX["neck"]][1] - 0.02]
    values = [1.0, *(factors.get(name, 1.0) for name in TRUNK_GIRTHS), 1.0]
    share = mesh.weights[:, [JOINT_INDEX[j] for j in _TRUNK]].sum(axis=1)
    legs = mesh.weights[:, [JOINT_INDEX[f"{s}_hip"] for s in ("left", "right")]].sum(axis=1)
    share = share + legs * smoothstep(heights[0], heights[1], out[:, 1])
    grow = (_between(out[:, 1], heights, values) - 1) * np.clip(share, 0.0, 1.0)
    middle = joints[JOINT_INDEX["pelvis"]], joints[JOINT_INDEX["spine3"]]
    depth = np.interp(out[:, 1], [m[1] for m in middle], [m[2] for m in middle])
    out[:, 0] += grow * out[:, 0]
    out[:, 2] += grow * (out[:, 2] - depth)
    neck = joints[JOINT_INDEX["neck"]]
    height = _neck(joints)
    share = mesh.weights[:, JOINT_INDEX["neck"]] + mesh.weights[:, JOINT_INDEX["head"]]
    grow = (factors.get("neck", 1.0) - 1) * share * smoothstep(0.06, 0.01, abs(out[:, 1] - height))
    out[:, 0] += grow * out[:, 0]
    out[:, 2] += grow * (out[:, 2] - neck[2])
    for side in ("left", "right"):
        for first, last in (
            ("hip", "knee"),
            ("knee", "ankle"),
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
        ):
            mine = {
                n: (p, factors.get(n, 1.0)) for n, (a, _, p) in _LIMB_GIRTHS.items() if a == first
            }
            a, b = (joints[JOINT_INDEX[f"{side}_{j}"]] for j in (first, last))
            length = float(np.linalg.norm(b - a))
            along = (b - a) / length
            t = (out - a) @ along / length
            places = sorted(mine.values())
            profile = _between(
                t, [-0.05, *(p for p, _ in places), 1.1], [1.0, *(f for _, f in places), 1.0]
            )
            weight = mesh.weights[:, JOINT_INDEX[f"{side}_{first}"]]
            if last in ("wrist", "ankle"):
                weight = weight + mesh.weights[:, JOINT_INDEX[f"{side}_{last}"]]
            away = out - a - ((out - a) @ along)[:, None] * along
            out += ((profile - 1) * weight)[:, None] * away
    return out


def _levels(joints: Floats) -> dict[str, float]:
    """Return the heights of the trunk's tapes [m], lowest first; offsets are of a trunk of 0.5 m."""
    pelvis, neck = (float(joints[JOINT_INDEX[j]][1]) for j in ("pelvis", "neck"))
    scale = (neck - pelvis) / 0.5
    return {
        name: float(joints[JOINT_INDEX[joint]][1]) + offset * scale
        for name, (joint, offset) in _LEVELS.items()
    }


def _neck(joints: Floats) -> float:
    """Return the height of the neck's tape [m]."""
    low, high = (joints[JOINT_INDEX[j]][1] for j in ("neck", "head"))
    return float(low + 0.5 * (high - low))


def _between(at: Floats, places: list[float], values: list[float]) -> Floats:
    """Return values between places without kinks; the ends' beyond them."""
    out = np.full(len(at), values[0])
    for k in range(len(places) - 1):
        out += (values[k + 1] - values[k]) * smoothstep(places[k], places[k + 1], at)
    return out


def _of(mesh: WeightedMesh, joints: tuple[str, ...]) -> Mask:
    """Return which vertices mostly follow some joints."""
    return mesh.weights[:, [JOINT_INDEX[j] for j in joints]].sum(axis=1) > 0.5


def _tape(triangles: Floats, axis: int, at: float) -> float:
    """Return the convex girth [m] of triangles [m, 3, 3] cut across an axis; 0 where none is."""
    height = triangles[:, :, axis] - at
    points = []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        through = height[:, i] * height[:, j] < 0
        share = height[through, i] / (height[through, i] - height[through, j])
        a, b = triangles[through, i], triangles[through, j]
        points.append(np.delete(a + share[:, None] * (b - a), axis, axis=1))
    section = np.concatenate(points)
    return float(ConvexHull(section).area) if len(section) > 2 else 0.0
