"""A finer skin where it shall be seen to yield: faces are cut, and the new vertices follow the curve."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from rcare_marl.pose import Array

from .skin import BodyModel

Ints = npt.NDArray[np.int64]

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
        edges = face_edges(model.faces[chosen[model.faces].all(axis=1)])
        faces = cut_faces(model.faces.astype(np.int64), edges, len(model.vertices))
        model = _with_middles(model, edges, faces)
        chosen = np.append(chosen, chosen[edges].all(axis=1))
    return model


def face_edges(faces: npt.NDArray[np.integer]) -> Ints:
    """Return the undirected edges of faces [m, 3], smaller index first, sorted, shape [e, 2]."""
    pairs = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64), axis=1)
    count = int(pairs.max(initial=0)) + 1
    keys = np.sort(pairs @ (count, 1))  # one whole number a pair sorts far faster than rows do
    is_first = np.append(True, keys[1:] != keys[:-1])[: len(keys)]
    return np.stack(np.divmod(keys[is_first], count), axis=1)


def cut_faces(faces: Ints, edges: Ints, first: int) -> Ints:
    """Return faces cut into two, three or four by the edges that get a vertex, so that no gap opens.

    Args:
        faces: Vertex indices, shape [m, 3].
        edges: The edges to cut, in the order of `face_edges`, shape [e, 2].
        first: Number of vertices, and so the index of the new one on the first edge.
    """
    if not len(edges):
        return faces
    keys = edges @ (first, 1)
    is_end = np.zeros(first, dtype=bool)
    is_end[edges] = True
    near = is_end[faces].sum(axis=1) > 1
    sides = np.stack((faces[near], np.roll(faces[near], -1, axis=1)), axis=2)
    wanted = np.sort(sides, axis=2) @ (first, 1)
    place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    middles = np.full(faces.shape, -1)
    middles[near] = np.where(keys[place] == wanted, first + place, -1)
    count = (middles >= 0).sum(axis=1)
    pieces = [faces[count == 0]]
    for k in range(3):  # turn each face so that its pattern starts at corner k
        turn = [(k + j) % 3 for j in range(3)]
        corner, mid = faces[:, turn], middles[:, turn]
        one = (count == 1) & (mid[:, 0] >= 0)
        (a, b, c), m = corner[one].T, mid[one, 0]
        pieces += [np.stack([a, m, c], 1), np.stack([m, b, c], 1)]
        two = (count == 2) & (mid[:, 2] < 0)
        (a, b, c), m, o = corner[two].T, mid[two, 0], mid[two, 1]
        pieces += [np.stack([m, b, o], 1), np.stack([a, m, o], 1), np.stack([a, o, c], 1)]
    three = count == 3
    (a, b, c), (p, q, r) = faces[three].T, middles[three].T
    pieces += [np.stack(t, 1) for t in ((a, p, r), (p, b, q), (r, q, c), (p, q, r))]
    return np.concatenate(pieces)


def _with_middles(model: BodyModel, edges: Ints, faces: Ints) -> BodyModel:
    """Return the body with a vertex in the middle of each edge."""
    at = model.vertices.astype(np.float64)
    normals = vertex_normals(at, model.faces)
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
        faces=np.ascontiguousarray(faces, np.int32),
        weight_joints=np.concatenate(
            (model.weight_joints, np.take_along_axis(joints, strongest, axis=1))
        ),
        weights=np.concatenate(
            (model.weights, (kept / kept.sum(axis=1, keepdims=True)).astype(np.float32))
        ),
        colors=np.concatenate((model.colors, np.round(colors).astype(np.uint8))),
    )


def vertex_normals(at: Array, faces: npt.NDArray[np.integer]) -> Array:
    """Return the area-weighted unit normals of vertices [m], shape [n, 3], with faces [m, 3]."""
    a, b, c = (at[faces[:, k]] for k in range(3))
    out = np.zeros_like(at)
    np.add.at(out, faces.T, np.cross(b - a, c - a))
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)
