"""What renderers draw of a cloth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree  # type: ignore[import-untyped]

from ..body import Body
from ..rendering.mesh import SmoothNormals
from ..world import Skin

if TYPE_CHECKING:
    from .cloth import Cloth


_CLEAR = 0.008  # [m] off the skin beneath, so that it does not show between particles
_DEEP = 0.08  # [m] beneath a skin, from where cloth is not meant to be outside
_NEIGHBOURS = 4  # vertices of the skin that say where outside is


class ClothSkin:
    """The surface of a cloth, for renderers: implements `rcare_marl.world.Skin`.

    Attributes:
        cloth: The cloth.
        body: A body that stands for it where something must.
        faces: Shape [m, 3]; new ones when the cloth has torn.
        colors: RGB of each vertex, shape [n, 3].
        beneath: Skins that it is drawn outside of. Cloth lies on the simple shapes of the physics, and a
            shoulder is no capsule: what is drawn is moved out of the skin by the few centimetres.
    """

    def __init__(
        self, cloth: Cloth, body: Body, rgb: tuple[int, int, int], beneath: Sequence[Skin] = ()
    ) -> None:
        self.cloth, self.body, self.beneath = cloth, body, tuple(beneath)
        self._rgb = np.array(rgb, np.uint8)
        self._mesh()

    def _mesh(self) -> None:
        """Cut each face of the cloth into four."""
        self._coarse = faces = self.cloth.faces
        self._normals = SmoothNormals(faces, len(self.cloth.rest))
        sides = np.concatenate([faces[:, k] for k in ((0, 1), (1, 2), (2, 0))])
        self._edges, where = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
        ab, bc, ca = len(self.cloth.rest) + where.reshape(3, -1)
        a, b, c = faces.T
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        self.faces = np.concatenate([np.stack(p, axis=1) for p in parts]).astype(np.int32)
        self.colors = np.tile(self._rgb, (len(self.cloth.rest) + len(self._edges), 1))

    def vertices(self) -> npt.NDArray[np.float32]:
        """Return the present vertices in the world [m], shape [n, 3]."""
        if self._coarse is not self.cloth.faces:
            self._mesh()
        out = self._rounded(self.cloth.positions.astype(np.float32))
        for skin in self.beneath:
            _move_out(out, skin.vertices(), skin.faces)
        return out

    def _rounded(self, points: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Return the particles and the middles of edges, on a curve that is square to both normals.

        A. Vlachos, J. Peters, C. Boyd and J. Mitchell, "Curved PN Triangles" (I3D 2001).
        """
        normals = self._normals.compute(points)
        p, q = (points[self._edges[:, k]] for k in range(2))
        n, m = (normals[self._edges[:, k]] for k in range(2))
        at_p, at_q = (np.einsum("ea,ea->e", q - p, k)[:, None] for k in (n, m))
        return np.concatenate((points, (p + q) / 2 - (at_p * n - at_q * m) / 8))

    def rest_pieces(self) -> list[tuple[int, npt.NDArray[np.float32], npt.NDArray[np.int32]]]:
        """Return the cloth at rest as one rigid piece, for fallbacks."""
        rest = self._rounded(self.cloth.rest.astype(np.float32))
        return [(-1, rest, np.arange(len(self.faces), dtype=np.int32))]


def _move_out(
    points: npt.NDArray[np.float32],
    skin: npt.NDArray[np.float32],
    faces: npt.NDArray[np.int32],
) -> None:
    """Move points out of a skin where they are in it, in place."""
    normals = SmoothNormals(faces, len(skin)).compute(skin)
    low, high = points.min(axis=0) - _DEEP, points.max(axis=0) + _DEEP
    chosen = np.flatnonzero(((skin > low) & (skin < high)).all(axis=1))
    if len(chosen) < _NEIGHBOURS:
        return
    distance, near = cKDTree(skin[chosen]).query(points, k=_NEIGHBOURS)
    near = chosen[near]
    away = np.einsum("nka,nka->nk", points[:, None] - skin[near], normals[near]).mean(axis=1)
    way = normals[near].mean(axis=1)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    is_near = (distance[:, 0] < _DEEP) & (away < _CLEAR)
    points += np.where(is_near, _CLEAR - away, 0.0)[:, None].astype(np.float32) * way


__all__ = ["ClothSkin"]
