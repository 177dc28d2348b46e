"""Published moment arms and isometric torques, and what a musculature gives in the same posture.

`assets/muscles/published_bands.csv` holds a band for each: mean and standard deviation, or the range
that was reported. Its column `checked` says whether the figures were read in the source (`read`), some
of them (`part`), or quoted from memory (`memory`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np

from rcare_marl import assets
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array

from ..body.skeleton import DOF_INDEX, DOFS, SIDES
from .muscle_model import MuscleModel
from .muscle_table import number, read_csv

Quantity = Literal["moment_arm", "torque", "passive_torque"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
_COLUMNS = (
    "name quantity dof direction posture_deg units low high unit source checked fitted note"
).split()
_WORDS = {"direction": ("+", "-"), "checked": ("read", "part", "memory"), "fitted": ("yes", "no")}
_LEAST_ARM = 1e-5  # [m] by which a muscle counts as an agonist
_MILLIMETRE = 1e-3


@dataclass(frozen=True)
class PublishedBand:
    """What was measured on people.

    Attributes:
        name: Of the joint and posture.
        quantity: `moment_arm` [mm], mean of the units weighted by their strength; `torque` [N·m], the
            greatest isometric one; or `passive_torque` [N·m] of relaxed muscles.
        dof: About which it is measured.
        sign: +1 if the motion is in the positive direction of the DoF, else -1.
        angles: Posture: angle of every DoF, zero in the T-pose [rad], shape [112]. What the file does
            not name is as in the anatomical position, arms at the side.
        units: The muscles concerned; for torques all agonists if empty.
        low: Least published value.
        high: Greatest one.
        source: Citation, with its figures.
        checked: `read`, `part` or `memory`.
        is_fitted: Whether our table was fitted to it, so that agreement proves little.
    """

    name: str
    quantity: Quantity
    dof: str
    sign: int
    angles: Array
    units: tuple[str, ...]
    low: float
    high: float
    source: str
    checked: str
    is_fitted: bool


def load_bands(path: str | Path | None = None) -> tuple[PublishedBand, ...]:
    """Return the published bands, from ours or from a file in the same format.

    Raises:
        ConfigError: If the file cannot be read or a value is wrong.
        UnknownNameError: If a column, quantity or DoF is unknown.
    """
    file = assets.ROOT / "muscles" / "published_bands.csv" if path is None else Path(path)
    return tuple(
        _band(row, f"{file}, row {i}") for i, row in enumerate(read_csv(file, _COLUMNS), start=2)
    )


def measured(model: MuscleModel, band: PublishedBand) -> float:
    """Return what a model gives where a band was measured, in the band's unit.

    A torque is that of the agonists at full activation with their tendons in balance; antagonists
    are slack. People activate less than fully and antagonists hold a little against it.

    Args:
        model: Muscles over all 112 DoFs.
        band: What to measure.

    Raises:
        UnknownNameError: If the band names a muscle that the model does not have.
    """
    column = model.dofs.index(band.dof)
    q = band.angles[[DOF_INDEX[name] for name in model.dofs]]
    chosen = np.array([model.index(name) for name in band.units] or range(len(model.names)))
    arms = band.sign * model.moment_arms(q)[chosen, column]
    if band.quantity == "moment_arm":
        strength = np.array([model.units[m].max_isometric_force for m in chosen])
        return float(arms @ strength / strength.sum()) / _MILLIMETRE
    is_active = band.quantity == "torque"
    forces = model.isometric_forces(q, 1.0 if is_active else 0.0)[chosen]
    return float((arms * forces)[(arms > _LEAST_ARM) | (not is_active)].sum())


def _band(row: dict[str, str], where: str) -> PublishedBand:
    check_name(f"quantity ({where})", row["quantity"], QUANTITIES)
    check_name(f"degree of freedom ({where})", row["dof"], DOF_INDEX)
    for key, words in _WORDS.items():
        if row[key] not in words:
            allowed = f"{', '.join(words[:-1])} or {words[-1]}"
            raise ConfigError(f"{where}: {key} is {allowed}, got {row[key]!r}")
    low, high = (number(row, key, where, 0.0, 1000.0) for key in ("low", "high"))
    if low > high:
        raise ConfigError(f"{where}: low {low:g} is above high {high:g}")
    return PublishedBand(
        name=row["name"],
        quantity=cast(Quantity, row["quantity"]),
        dof=row["dof"],
        sign=1 if row["direction"] == "+" else -1,
        angles=_angles(row["posture_deg"], where),
        units=tuple(row["units"].split()),
        low=low,
        high=high,
        source=row["source"],
        checked=row["checked"],
        is_fitted=row["fitted"] == "yes",
    )


def _angles(text: str, where: str) -> Array:
    angles = np.zeros(len(DOFS))
    for side in SIDES:
        angles[DOF_INDEX[f"{side}_shoulder_abduction"]] = -math.pi / 2
    for part in filter(None, (part.strip() for part in text.split(";"))):
        name, _, degrees = part.partition(":")
        check_name(f"degree of freedom ({where})", name, DOF_INDEX)
        value = number({"posture_deg": degrees}, "posture_deg", where, -200.0, 200.0)
        angles[DOF_INDEX[name]] = math.radians(value) - DOFS[DOF_INDEX[name]].clinical_zero
    return angles
