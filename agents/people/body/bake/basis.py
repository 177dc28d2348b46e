"""The compact shape basis: rest shapes of anybody with NumPy alone (`assets/avatars/shape_basis.npz`).

Rest vertices and bone heads are linear in products of phenotype factors. The file keeps their principal
components as rounded steps, and the exact map from products to scores; `make_basis` writes it.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rcare_marl import assets
from rcare_marl.errors import check_name
from rcare_marl.reading import ArrayFile

from .mesh import Floats, Ints, Mask
from .phenotype import PHENOTYPES, factors, products
from .source import MASKS, MaskName, ShapeSource

BASIS_FILE = assets.ROOT / "avatars" / "shape_basis.npz"
MEAN_STEP = 1e-5  # [m]
Steps = NDArray[np.int16]


class BasisSource(ShapeSource):
    """The shape basis that ships.

    Args:
        file: An npz that `make_basis` made.
    """

    def __init__(self, file: Path = BASIS_FILE) -> None:
        data = ArrayFile(file, "a shape basis")
        a = dict(zip(data.names, data.take(*data.names), strict=True))
        self.version = str(a["version"])
        self.bones = [str(name) for name in a["bones"]]
        self.parents = a["parents"].tolist()
        self.index = a["index"].astype(np.int64)
        self.faces, self.teeth = (a[k].astype(np.int64) for k in ("faces", "teeth"))
        self.weights = np.zeros((len(self.index), len(self.bones)))
        shares = a["bone_weights"].astype(float)
        np.put_along_axis(
            self.weights,
            a["weight_bones"].astype(np.int64),
            shares / shares.sum(axis=1, keepdims=True),
            axis=1,
        )
        self.changes = tuple(str(name) for name in a["change_names"])
        self._place = {name: i for i, name in enumerate(self.changes)}
        self._step = float(a["step"])
        self._mean = a["mean"].astype(np.float32) * np.float32(MEAN_STEP)
        shape = (-1, self._mean.size)
        self._components = unpack(a["components"]).astype(np.float32).reshape(shape)
        self._change_steps = unpack(a["change_steps"]).reshape(shape)
        self._map, self._mean_weights = a["map"], a["mean_weights"]
        self._factors = a["factor_mask"] > 0
        self._anchors = {name: a[f"anchors_{name}"] for name in PHENOTYPES}
        self._masks = {name: a[f"mask_{name}"] / 255.0 for name in MASKS}
        self._cavity = a["cavity"] > 0

    def rest(self, phenotype: dict[str, float], changes: dict[str, float]) -> tuple[Floats, Floats]:
        """Return the A-pose vertices [m] [n, 3] and bone heads [m] [b, 3] in SMPL-X axes."""
        weights = products(factors(phenotype, self._anchors), self._factors)[0]
        scores = (weights - self._mean_weights) @ self._map
        out = self._mean.reshape(-1) + (scores * self._step).astype(np.float32) @ self._components
        for name, value in changes.items():
            check_name("local change of shape", name, self._place)
            if value:
                row = self._change_steps[2 * self._place[name] + (value < 0)]
                out += np.float32(abs(value) * self._step) * row
        points = out.reshape(-1, 3).astype(np.float64)
        return points[: len(self.index)], points[len(self.index) :]

    def mask(self, name: MaskName) -> Floats:
        """Return how much each vertex belongs to a part, 0 to 1, shape [n]."""
        return self._masks[name]

    def cavity(self) -> Mask:
        """Return which vertices line the mouth, shape [n]."""
        return self._cavity


@lru_cache(maxsize=1)
def shape_basis() -> BasisSource:
    """Return the basis that ships, loaded once."""
    return BasisSource()


def pack(steps: Ints) -> NDArray[np.uint8]:
    """Return shapes in whole steps [r, n, 3] as two planes of bytes that deflate well [2, r, 3, n]."""
    by_axis = steps.transpose(0, 2, 1)
    change = np.diff(by_axis, axis=2, prepend=0)
    zigzag = np.where(change < 0, -2 * change - 1, 2 * change)
    return np.stack([zigzag & 255, zigzag >> 8]).astype(np.uint8)


def unpack(planes: NDArray[np.uint8]) -> Steps:
    """Return the shapes that `pack` took, shape [r, n, 3]."""
    zigzag = planes[0].astype(np.int32) | (planes[1].astype(np.int32) << 8)
    change = np.where(zigzag & 1, -(zigzag >> 1) - 1, zigzag >> 1)
    whole = np.cumsum(change, axis=2, dtype=np.int32).astype(np.int16)
    return np.ascontiguousarray(whole.transpose(0, 2, 1))
