"""A finer skin where it shall be seen to yield: faces are cut, and the new vertices follow the curve."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from rcare_marl.pose import Array

from .skin import BodyModel

Faces = npt.NDArray[np.int32]

_BULGE = 0.75  # of Phong tessellation, as its authors recommend


def refined(model: BodyModel, chosen: npt.NDArray[np.bool_], *, times: int = 1) -> BodyModel:
    """Return a body whose faces with all corners in `chosen` are cut in four, `times` over.

    New vertices lie off the flat face, by Phong tessellation (T. Boubekeur and M. Alexa, SIGGRAPH Asia
    2008), and neighbours of cut faces are cut to match, so that no gap opens. Old vertices keep their
    numbers.

    Args:
        model: The body.
        chosen: Which vertices are in the part to refine, shape [n].
        times: How often.
    """
    for _ in range(times):
        edges, number = _edges_to_cut(model.faces, chosen)
        model = _with_middles(model, edges, _cut(model.faces, number, len(model.vertices)))
        chosen = np.append(chosen, chosen[edges].all(axis=1))
    return model


def _edges_to_cut(
    faces: Faces, chosen: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the edges to cut [e, 2], and for each edge of each face its number there or -1 [m, 3]."""
    corners = faces.astype(np.int64)
    pairs = np.sort(np.stack([corners[:, k] for k in ((0, 1), (1, 2), (2, 0))], axis=1), axis=2)
    inside = chosen[corners].all(axis=1)
    edges = np.unique(pairs[inside].reshape(-1, 2), axis=0)
    size = int(faces.max()) + 1
    keys = edges @ (size, 1)  # sorted, as the edges are
    wanted = pairs @ (size, 1)
    place = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
    found = keys[place] == wanted if len(keys) else np.zeros(wanted.shape, np.bool_)
    return edges, np.where(found, place, -1)


def _cut(faces: Faces, number: npt.NDArray[np.int64], first: int) -> Faces:
    """Return the faces, cut along the middles of their edges that have a number."""
    out = [faces[(number < 0).all(axis=1)].astype(np.int64)]
    middle = number + first
    for k in range(3):  # each face is turned until the pattern fits
        a, b, c = (faces[:, (k + i) % 3] for i in range(3))
        ab, bc, ca = (middle[:, (k + i) % 3] for i in range(3))
        has = [number[:, (k + i) % 3] >= 0 for i in range(3)]
        one = has[0] & ~has[1] & ~has[2]
        out.extend(_faces(one, (a, ab, c), (ab, b, c)))
        two = has[0] & has[1] & ~has[2]
        out.extend(_faces(two, (ab, b, bc), (a, ab, bc), (a, bc, c)))
        if k == 0:
            all_three = has[0] & has[1] & has[2]
            out.extend(_faces(all_three, (a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)))
    return np.ascontiguousarray(np.concatenate(out), np.int32)


def _faces(
    rows: npt.NDArray[np.bool_], *corners: tuple[npt.NDArray[np.integer], ...]
) -> list[npt.NDArray[np.int64]]:
    return [np.stack([corner[rows] for corner in face], axis=1) for face in corners]


def _with_middles(model: BodyModel, edges: npt.NDArray[np.int64], faces: Faces) -> BodyModel:
    """Return the body with a vertex in the middle of each edge."""
    at = model.vertices.astype(np.float64)
    normals = _normals(at, model.faces)
    a, b = at[edges[:, 0]], at[edges[:, 1]]
    middle = (a + b) / 2
    lifted = np.zeros_like(middle)
    for end, k in ((a, 0), (b, 1)):
        normal = normals[edges[:, k]]
        height = np.einsum("ij,ij->i", middle - end, normal)
        lifted += (middle - height[:, None] * normal) / 2
    middle += _BULGE * (lifted - middle)
    joints = model.weight_joints[edges].reshape(len(edges), -1)
    weights = model.weights[edges].reshape(len(edges), -1) / 2
    for k in range(1, joints.shape[1]):  # a joint that moves both ends counts once
        for i in range(k):
            same = (joints[:, k] == joints[:, i]) & (weights[:, k] > 0)
            weights[same, i] += weights[same, k]
            weights[same, k] = 0
    strongest = np.argsort(-weights, axis=1, kind="stable")[:, : model.weights.shape[1]]
    kept = np.take_along_axis(weights, strongest, axis=1)
    colors = model.colors[edges].astype(np.float64).mean(axis=1)
    return dataclasses.replace(
        model,
        vertices=np.concatenate((model.vertices, middle.astype(np.float32))),
        faces=faces,
        weight_joints=np.concatenate(
            (model.weight_joints, np.take_along_axis(joints, strongest, axis=1))
        ),
        weights=np.concatenate(
            (model.weights, (kept / kept.sum(axis=1, keepdims=True)).astype(np.float32))
        ),
        colors=np.concatenate((model.colors, np.round(colors).astype(np.uint8))),
    )


def _normals(at: Array, faces: Faces) -> Array:
    corners = at[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    out = np.zeros_like(at)
    for k in range(3):
        np.add.at(out, faces[:, k], areas)
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)
