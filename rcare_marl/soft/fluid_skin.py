"""What renderers draw of a fluid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..body import Body
from .surface import enclose

if TYPE_CHECKING:
    from .fluid import Fluid


class FluidSkin:
    """The surface of a fluid, for renderers: implements `rcare_marl.world.Skin`.

    Attributes:
        fluid: The fluid.
        body: A body that stands for it where something must.
        faces: Shape [m, 3]; new ones whenever the vertices are asked for and it has moved.
        colors: RGB and opacity of each vertex, shape [n, 4].
    """

    def __init__(self, fluid: Fluid, body: Body, rgba: tuple[int, int, int, int]) -> None:
        self.fluid, self.body = fluid, body
        self._rgba = np.array(rgba, np.uint8)
        self._seen: npt.NDArray[np.float64] = np.zeros((0, 3))
        self._mesh()

    def _mesh(self) -> None:
        points = self.fluid.positions[self.fluid.is_active]
        if len(points) == len(self._seen) and (points == self._seen).all() and len(points):
            return
        self._seen = points
        vertices, faces = enclose(points, self.fluid.spacing)
        if not len(faces):  # none is left: renderers want something
            vertices, faces = np.tile(self.fluid.positions[:1], (3, 1)), np.array([[0, 1, 2]])
        self._vertices, self.faces = vertices.astype(np.float32), faces.astype(np.int32)
        self.colors = np.tile(self._rgba, (len(vertices), 1))

    def vertices(self) -> npt.NDArray[np.float32]:
        """Return the present vertices in the world [m], shape [n, 3]."""
        self._mesh()
        return self._vertices

    def rest_pieces(self) -> list[tuple[int, npt.NDArray[np.float32], npt.NDArray[np.int32]]]:
        """Return it as one rigid piece, for fallbacks."""
        return [(-1, self._vertices, np.arange(len(self.faces), dtype=np.int32))]


__all__ = ["FluidSkin"]
