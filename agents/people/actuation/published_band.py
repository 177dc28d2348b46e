"""Published moment arms and torques, and what a musculature gives in the same posture.

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

Quantity = Literal["moment_arm", "torque", "torque_share", "passive_torque"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
_COLUMNS = (
    "name quantity dof direction posture_deg units low high unit source checked fitted note"
).split()
_MAY = ("speed_deg_s", "reference_deg", "reference_speed_deg_s")
_WORDS = {"direction": ("+", "-"), "checked": ("read", "part", "memory"), "fitted": ("yes", "no")}
_LEAST_ARM = 1e-5  # [m] by which a muscle counts as an agonist
_MILLIMETRE = 1e-3


@dataclass(frozen=True)
class PublishedBand:
    """What was measured on people.

    Attributes:
        name: Of the joint and posture.
        quantity: `moment_arm` [mm], mean of the units weighted by their strength; `torque` [N·m], the
            greatest one; `torque_share` [1], a torque as a share of that in the posture of reference;
            or `passive_torque` [N·m] of relaxed muscles.
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
        speed: At which the motion goes on [rad/s].
        reference: Of a share: angles and speed of the posture of reference.
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
    speed: float
    reference: tuple[Array, float]


def load_bands(path: str | Path | None = None) -> tuple[PublishedBand, ...]:
    """Return the published bands, from ours or from a file in the same format.

    Raises:
        ConfigError: If the file cannot be read or a value is wrong.
        UnknownNameError: If a column, quantity or DoF is unknown.
    """
    file = assets.ROOT / "muscles" / "published_bands.csv" if path is None else Path(path)
    return tuple(
        _band(row, f"{file}, row {i}")
        for i, row in enumerate(read_csv(file, _COLUMNS, _MAY), start=2)
    )


def measured(model: MuscleModel, band: PublishedBand) -> float:
    """Return what a model gives where a band was measured, in the band's unit.

    Moment arms were measured on specimens whose scapula is held, so ours are with it held too.
    A torque is that of the agonists at full activation with their tendons in balance; antagonists
    are slack. People activate less than fully and antagonists hold a little against it.

    Args:
        model: Muscles over all 112 DoFs.
        band: What to measure.

    Raises:
        UnknownNameError: If the band names a muscle that the model does not have.
    """
    if band.quantity == "torque_share":
        angles, speed = band.reference
        return _torque(model, band, band.angles, band.speed) / _torque(model, band, angles, speed)
    if band.quantity != "moment_arm":
        return _torque(model, band, band.angles, band.speed)
    chosen, _, q = _chosen(model, band, band.angles)
    arms = band.sign * model.glenohumeral_arms(q)[chosen, model.dofs.index(band.dof)]
    strength = np.array([model.units[m].max_isometric_force for m in chosen])
    return float(arms @ strength / strength.sum()) / _MILLIMETRE


def _chosen(model: MuscleModel, band: PublishedBand, angles: Array) -> tuple[Array, Array, Array]:
    """Return the places of a band's muscles, their arms in its direction [m], and the angles [rad]."""
    q = angles[[DOF_INDEX[name] for name in model.dofs]]
    chosen = np.array([model.index(name) for name in band.units] or range(len(model.names)))
    return chosen, band.sign * model.moment_arms(q)[chosen, model.dofs.index(band.dof)], q


def _torque(model: MuscleModel, band: PublishedBand, angles: Array, speed: float) -> float:
    is_active = band.quantity != "passive_torque"
    chosen, arms, q = _chosen(model, band, angles)
    rates = np.zeros(len(q))
    rates[model.dofs.index(band.dof)] = band.sign * speed
    forces = model.steady_forces(q, rates, 1.0 if is_active else 0.0)[chosen]
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
    speeds = [
        math.radians(number(row, key, where, 0.0, 1000.0)) if row.get(key) else 0.0
        for key in ("speed_deg_s", "reference_speed_deg_s")
    ]
    return PublishedBand(
        name=row["name"],
        quantity=cast(Quantity, row["quantity"]),
        dof=row["dof"],
        sign=1 if row["direction"] == "+" else -1,
        angles=posture(row["posture_deg"], where),
        units=tuple(row["units"].split()),
        low=low,
        high=high,
        source=row["source"],
        checked=row["checked"],
        is_fitted=row["fitted"] == "yes",
        speed=speeds[0],
        reference=(posture(row.get("reference_deg") or row["posture_deg"], where), speeds[1]),
    )


def posture(text: str, where: str) -> Array:
    """Return the angle of every DoF of a written posture, zero in the T-pose [rad], shape [112].

    It names DoFs with their clinical angles [deg], as `left_knee_flexion:60; left_hip_flexion:85`; all others
    are as in the anatomical position, arms at the side.

    Raises:
        ConfigError: If an angle is no number, or out of range.
        UnknownNameError: If a DoF is unknown.
    """
    angles = np.zeros(len(DOFS))
    for side in SIDES:
        angles[DOF_INDEX[f"{side}_shoulder_abduction"]] = -math.pi / 2
    for part in filter(None, (part.strip() for part in text.split(";"))):
        name, _, degrees = part.partition(":")
        check_name(f"degree of freedom ({where})", name, DOF_INDEX)
        value = number({"posture_deg": degrees}, "posture_deg", where, -200.0, 200.0)
        angles[DOF_INDEX[name]] = math.radians(value) - DOFS[DOF_INDEX[name]].clinical_zero
    return angles
