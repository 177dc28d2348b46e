"""Cuts coloured meshes into pieces of one colour, for backends that know no colours of vertices."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .mesh import Bytes, Floats, Ints

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
