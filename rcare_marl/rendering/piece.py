"""Pieces of one colour, and skins in rigid pieces, for backends that know no other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..pose import Array, matrix_from_quaternion
from ..world import Skin, World
from .mesh import Bytes, Floats, Ints, SmoothNormals

_BIN = 24  # [sRGB steps]; colours that fall into one bin are one to begin with


@dataclass(frozen=True)
class Piece:
    """Faces of one colour.

    Attributes:
        source: Which vertices of the whole it uses, shape [n].
        faces: Indices into `source`, shape [m, 3].
        rgb: sRGB colour.
    """

    source: npt.NDArray[np.intp]
    faces: Ints
    rgb: tuple[int, int, int]


def split_by_color(faces: Ints, colors: Bytes, *, at_most: int = 6) -> Iterator[Piece]:
    """Yield the faces of a mesh in pieces of one colour each.

    Args:
        faces: Vertex indices, shape [m, 3].
        colors: sRGB colours of the vertices, shape [n, 3].
        at_most: Greatest number of colours kept; the rest go to the nearest of these.
    """
    of_face = colors[faces].astype(np.float32).mean(axis=1)
    kept = _dominant(of_face, at_most)
    nearest = np.argmin(((of_face[:, None] - kept[None]) ** 2).sum(axis=2), axis=1)
    for index in range(len(kept)):
        chosen = np.flatnonzero(nearest == index)
        if not len(chosen):
            continue
        source, inverse = np.unique(faces[chosen], return_inverse=True)
        mean = of_face[chosen].mean(axis=0)
        rgb = (int(mean[0]), int(mean[1]), int(mean[2]))
        yield Piece(source.astype(np.intp), inverse.reshape(-1, 3).astype(np.int32), rgb)


def _dominant(colors: npt.NDArray[Any], at_most: int) -> Floats:
    bins = (colors / _BIN).astype(np.int64)
    key = (bins[:, 0] * 64 + bins[:, 1]) * 64 + bins[:, 2]
    _, inverse, counts = np.unique(key, return_inverse=True, return_counts=True)
    order = np.argsort(-counts, kind="stable")[:at_most]
    means = [colors[inverse.reshape(-1) == place].mean(axis=0) for place in order]
    return np.array(means, np.float32)


Cut = tuple[int, Floats, Floats, Piece]  # link, vertices and normals in its frame, faces


@dataclass(frozen=True, eq=False)
class _Fitting:
    """Where a skin lay when it was measured for the knife."""

    skin: Skin
    faces: npt.NDArray[np.int32]
    vertices: Floats
    positions: Array
    quaternions: Array


class SkinCuts:
    """The rigid pieces of all skins of a world, cut where each skin lay when it was first met.

    To measure a skin costs a millisecond and draws nothing; to cut it is left until somebody wants the
    pieces.
    """

    def __init__(self, world: World) -> None:
        """Measure the skins that `world` has now."""
        self._fittings: dict[int, _Fitting] = {}
        self._cuts: dict[int, list[Cut]] = {}
        for skin in world.skins:
            self._measure(skin)

    def forget(self) -> None:
        """Measure and cut every skin anew when it is next met."""
        self._fittings, self._cuts = {}, {}

    def of(self, skin: Skin) -> list[Cut]:
        """Return link, vertices and normals in its frame, and faces of one colour, of rigid pieces."""
        known = self._fittings.get(id(skin))
        if known is None or known.skin is not skin or known.faces is not skin.faces:
            known = self._measure(skin)
        if id(skin) not in self._cuts:
            self._cuts[id(skin)] = _cut(known)
        return self._cuts[id(skin)]

    def _measure(self, skin: Skin) -> _Fitting:
        vertices = skin.vertices().copy()
        fitting = _Fitting(skin, skin.faces, vertices, *skin.body.link_poses())
        self._fittings[id(skin)] = fitting
        self._cuts.pop(id(skin), None)
        return fitting


def _cut(fitting: _Fitting) -> list[Cut]:
    skin, vertices, out = fitting.skin, fitting.vertices, list[Cut]()
    normals = SmoothNormals(skin.faces, len(vertices)).compute(vertices)
    for link, _, chosen in skin.rest_pieces():
        # Neighbouring pieces overlap by a row of faces, so that no gap opens where they bend.
        inside = np.zeros(len(vertices), np.bool_)
        inside[skin.faces[chosen]] = True
        faces = skin.faces[inside[skin.faces].any(axis=1)]
        turn = matrix_from_quaternion(fitting.quaternions[link + 1])
        for piece in split_by_color(faces, skin.colors[:, :3]):
            local = (vertices[piece.source] - fitting.positions[link + 1]) @ turn
            tilted = normals[piece.source] @ turn
            out.append((link, local.astype(np.float32), tilted.astype(np.float32), piece))
    return out
