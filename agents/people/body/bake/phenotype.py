"""Phenotypes: what a rest shape is a multilinear function of, as MakeHuman and Anny have them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .mesh import Floats

ANCESTRIES = ("african", "asian", "caucasian")
# In the order of their factors, which follow those of the three ancestries.
PHENOTYPES = ("gender", "age", "muscle", "weight", "height", "proportions", "cupsize", "firmness")
HEAVIEST = 3.0  # the last piece of `weight` goes on straight up to here; 1 is where Anny ends

# Years by Anny's age. To 11 as the package's own growth calibration has it, to 18 our own choice,
# from 25 (2/3) to 90 (1) the line that the shipped bodies were baked with.
_YEARS = (0.0, 1.0, 4.0, 11.0, 16.0, 18.0, 25.0, 90.0)
_AGES = (0.0, 0.05, 0.215, 0.415, 0.61, 0.64, 2 / 3, 1.0)


def phenotype_age(years: float) -> float:
    """Return Anny's age for an age in years."""
    return float(np.interp(years, _YEARS, _AGES))


def factors(
    phenotype: Mapping[str, float | Floats], anchors: Mapping[str, Floats]
) -> NDArray[np.float64]:
    """Return the factors of phenotypes, shape [n, f]: ancestry shares, then a hat for each anchor.

    Args:
        phenotype: Values by name, each a number or of shape [n]; 0.5 where absent.
        anchors: Where each phenotype's hats peak.
    """
    count = max((np.size(v) for v in phenotype.values()), default=1)

    def values(name: str) -> Floats:
        return np.broadcast_to(np.asarray(phenotype.get(name, 0.5), dtype=float), (count,))

    shares = np.stack([values(name) for name in ANCESTRIES], axis=1)
    out = [shares / shares.sum(axis=1, keepdims=True)]
    for name in PHENOTYPES:
        high = HEAVIEST if name == "weight" else float(anchors[name][-1])
        out.append(_hats(values(name), anchors[name], high))
    return np.concatenate(out, axis=1)


def products(rows: Floats, mask: NDArray[np.bool_]) -> Floats:
    """Return the weights of shapes, [n, k]: the products of those of the factors [n, f] in a mask [k, f]."""
    out = np.ones((len(rows), len(mask)))
    for column in range(mask.shape[1]):
        chosen = mask[:, column]
        out[:, chosen] *= rows[:, column : column + 1]
    return out


def _hats(values: Floats, anchors: Floats, high: float) -> Floats:
    """Return piecewise linear weights of the anchors, shape [n, a]; past the last they go on straight."""
    x = np.clip(values, anchors[0], high)
    left = np.clip(np.searchsorted(anchors, x, side="right") - 1, 0, len(anchors) - 2)
    share = (x - anchors[left]) / (anchors[left + 1] - anchors[left])
    out = np.zeros((len(x), len(anchors)))
    rows = np.arange(len(x))
    out[rows, left], out[rows, left + 1] = 1 - share, share
    return out
