"""A published band as a check."""

from __future__ import annotations

from ..actuation.published_band import PublishedBand
from .check import Basis, Check

# A band of which only a part was read counts as quoted from memory.
_BASES: dict[str, Basis] = {"read": "read", "part": "memory", "memory": "memory"}


def published_check(family: str, band: PublishedBand, ours: float, unit: str) -> Check:
    """Return what a model gives beside a published band."""
    return Check(
        family=family,
        case=band.name,
        ours=ours,
        low=band.low,
        high=band.high,
        unit=unit,
        source=band.source,
        basis=_BASES[band.checked],
        is_fitted=band.is_fitted,
    )
