"""What renderers draw of a cloth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..body import Body

if TYPE_CHECKING:
    from .cloth import Cloth


class ClothSkin:
    """The surface of a cloth, for renderers: implements `rcare_marl.world.Skin`.

    Attributes:
        cloth: The cloth.
        body: A body that stands for it where something must.
        faces: Shape [m, 3]; new ones when the cloth has torn.
        colors: RGB of each vertex, shape [n, 3].
    """

    def __init__(self, cloth: Cloth, body: Body, rgb: tuple[int, int, int]) -> None:
        self.cloth, self.body = cloth, body
        self._rgb = np.array(rgb, np.uint8)
        self.faces = cloth.faces
        self.colors = np.tile(self._rgb, (len(cloth.rest), 1))

    def vertices(self) -> npt.NDArray[np.float32]:
        """Return the present vertices in the world [m], shape [n, 3]."""
        if self.faces is not self.cloth.faces:
            self.faces = self.cloth.faces
            self.colors = np.tile(self._rgb, (len(self.cloth.rest), 1))
        return self.cloth.positions.astype(np.float32)

    def rest_pieces(self) -> list[tuple[int, npt.NDArray[np.float32], npt.NDArray[np.int32]]]:
        """Return the cloth as one rigid piece, for fallbacks."""
        faces = np.arange(len(self.cloth.faces), dtype=np.int32)
        return [(-1, self.cloth.rest.astype(np.float32), faces)]


__all__ = ["ClothSkin"]
