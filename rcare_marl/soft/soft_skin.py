"""What renderers draw of a soft body that is no flesh beneath a person's skin."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..body import Body
from .soft_body import SoftBody


class SoftSkin:
    """The surface of a soft body, for renderers: implements `rcare_marl.world.Skin`.

    Attributes:
        soft: The soft body.
        body: A body that stands for it; its own shapes are not drawn.
        faces: Shape [m, 3].
        colors: RGB of each vertex, shape [n, 3].
    """

    def __init__(
        self, soft: SoftBody, body: Body, client: int, *, rgb: tuple[int, int, int]
    ) -> None:
        self.soft, self.body, self._client = soft, body, client
        self._outside, faces = np.unique(soft.faces, return_inverse=True)
        self.faces = faces.reshape(-1, 3).astype(np.int32)
        self.colors = np.tile(np.array(rgb, np.uint8), (len(self._outside), 1))

    def vertices(self) -> npt.NDArray[np.float32]:
        """Return the present vertices in the world [m], shape [n, 3]."""
        points = self.soft.in_world(self.soft.frame(self._client))
        return points[self._outside].astype(np.float32)

    def rest_pieces(self) -> list[tuple[int, npt.NDArray[np.float32], npt.NDArray[np.int32]]]:
        """Return it as one rigid piece, for fallbacks."""
        faces = np.arange(len(self.faces), dtype=np.int32)
        return [(-1, self.soft.rest[self._outside].astype(np.float32), faces)]


__all__ = ["SoftSkin"]
