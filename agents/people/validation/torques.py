"""Torques of the reference skeleton's muscles against publications: over angles, at speed, and at rest.

Torques are those of the agonists alone at full activation, tendons in balance. The bands are of adult men;
the reference skeleton is a man of 1.75 m, and torques published per mass are for 75 kg. Shares, of a
torque in another posture or at another speed, are of men and women.
"""

from __future__ import annotations

from ..actuation.published_band import Quantity, load_bands, measured
from .check import Check
from .published import published_check
from .reference_muscles import muscle_model

FAMILIES: dict[Quantity, tuple[str, str]] = {  # family and unit
    "torque": ("torque", "N·m"),
    "torque_share": ("torque by angle and speed", "1"),
    "passive_torque": ("passive torque", "N·m"),
}


def checks() -> list[Check]:
    """Return every torque with its published band."""
    model = muscle_model()
    out = []
    for band in load_bands():
        if band.quantity in FAMILIES:
            family, unit = FAMILIES[band.quantity]
            out.append(published_check(family, band, measured(model, band), unit))
    return out
