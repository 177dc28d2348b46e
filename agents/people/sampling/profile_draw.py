"""A clinical profile drawn from a band of a condition: everything follows one severity, with some scatter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..profile import (
    ASHWORTH,
    SPINAL_LEVELS,
    ClinicalProfile,
    SideProfile,
    Vitals,
    clinical_norms,
    motions_of,
    muscle_groups_of,
)
from .condition import REGIONS, Condition, Pair, Pattern, Severity, groups_of

SCATTER = 0.18  # of a group about the person's own severity, as a share of the band; our own choice
_BENT = 60.0  # [deg] that a wholly stiff hinge is kept bent
_FULL, _WEAK, _NONE = (
    1.0,
    0.8,
    0.0,
)  # active share of the passive range at grades from 3, 2 and below
_BREATHES_WITH_A_REST = (
    0.3  # of the chance of a ventilator, where some motion is left; our own choice
)
_SMALL = ("valgus", "varus", "tilt_left", "tilt_right")  # motions too small to lose a share of
_ARM_JOINTS = ("shoulder", "elbow", "wrist", "finger", "thumb")


@dataclass
class Draw:
    """One person's place in a condition, and the chance that scatters about it.

    Attributes:
        rng: The person's own chance.
        place: 0 at the mild end of the band, 1 at the severe end.
    """

    rng: np.random.Generator
    place: float

    def at(self, pair: Pair, *, eased: float = 0.0, scatter: float = SCATTER) -> float:
        """Return a value between the two ends of a band, `eased` of it towards the mild one."""
        share = self.place * (1 - eased) + scatter * self.rng.normal()
        return float(pair[0] + (pair[1] - pair[0]) * min(max(share, 0.0), 1.0))

    def one(self, shares: Mapping[Any, float]) -> Any:
        """Return a key by its probability."""
        values = np.array(list(shares.values()), dtype=float)
        return list(shares)[int(self.rng.choice(len(values), p=values / values.sum()))]


@dataclass
class SideDraw:
    """Grades of one side as they are gathered: each by muscle group or joint."""

    mmt: dict[str, float] = field(default_factory=dict)
    spasticity: dict[str, str] = field(default_factory=dict)
    stiffness: dict[str, float] = field(default_factory=dict)
    tremor: dict[str, float] = field(default_factory=dict)
    dyskinesia: dict[str, float] = field(default_factory=dict)
    sensation: str = "normal"


def draw_profile(
    condition: Condition, band: str, level: str | None, weak: str, draw: Draw
) -> ClinicalProfile:
    """Return a profile in which active ranges lie within passive ones and grades fit the injury.

    Args:
        condition: The condition.
        band: Its severity.
        level: Of an injury of the spinal cord.
        weak: The weaker side, `left` or `right`.
        draw: The person's place and chance.
    """
    severity = condition.severities[band]
    arms = _arm_severity(condition, band, draw)
    sides = {"axial": _drawn(severity.axial, draw), "left": SideDraw(), "right": SideDraw()}
    ease = float(draw.rng.uniform(0.1, 0.6)) if condition.asymmetry == "uneven" else 0.0
    for side in ("left", "right"):
        if condition.asymmetry == "one" and side != weak:
            sides[side] = _drawn(severity.strong, draw)
            continue
        eased = 0.0 if side == weak else ease
        sides[side] = _joined(_drawn(arms.weak, draw, eased), _drawn(severity.weak, draw, eased))
    for key in ("tremor", "dyskinesia"):
        _shake(sides, key, getattr(severity, key), weak, draw, even=condition.asymmetry == "even")
    if level is not None:
        _injure(sides, condition, severity, level, draw)
        sides["axial"].sensation = sides["left"].sensation
    vitals = dict(severity.vitals)
    if (
        level is not None
        and condition.high_to is not None
        and _index(level) <= _index(condition.high_to)
    ):
        vitals |= condition.high_vitals
    machine = _needs_machine(condition, severity, sides["axial"], level, draw)
    return ClinicalProfile(
        axial=_side(sides["axial"], "axial"),
        left=_side(sides["left"], "left"),
        right=_side(sides["right"], "right"),
        vitals=Vitals(**{name: round(draw.at(pair), 1) for name, pair in vitals.items()}),
        injury_level=level,
        ventilator_rate=float(draw.rng.integers(12, 17)) if machine else None,
    )


def _arm_severity(condition: Condition, band: str, draw: Draw) -> Severity:
    """Return the band that the arms follow."""
    if condition.arms_follow is None:
        return condition.severities[band]
    bands = list(condition.severities)
    at = bands.index(band) + int(draw.one(condition.arms_follow.shift))
    return condition.severities[bands[min(max(at, 0), len(bands) - 1)]]


def _drawn(pattern: Pattern, draw: Draw, eased: float = 0.0) -> SideDraw:
    out = SideDraw()
    for key, pair in pattern.mmt.items():
        for group in groups_of(key):
            out.mmt[group] = round(2 * draw.at(pair, eased=eased)) / 2
    for key, grades in pattern.spasticity.items():
        ends = ASHWORTH.index(grades[0]), ASHWORTH.index(grades[1])
        for group in groups_of(key):
            out.spasticity[group] = ASHWORTH[round(draw.at(ends, eased=eased, scatter=0.3))]
    for joint, pair in pattern.stiffness.items():
        out.stiffness[joint] = draw.at(pair, eased=eased, scatter=0.3)
    if pattern.sensation:
        out.sensation = draw.one(pattern.sensation)
    return out


def _joined(arms: SideDraw, rest: SideDraw) -> SideDraw:
    """Return the arms of one draw with the rest of another."""
    of_arm = REGIONS["arm"]

    def take(key: str, is_arm: Any) -> dict[str, Any]:
        mine, other = getattr(arms, key), getattr(rest, key)
        kept = {name: value for name, value in other.items() if not is_arm(name)}
        return {name: value for name, value in mine.items() if is_arm(name)} | kept

    return SideDraw(
        mmt=take("mmt", of_arm.__contains__),
        spasticity=take("spasticity", of_arm.__contains__),
        stiffness=take("stiffness", _ARM_JOINTS.__contains__),
        sensation=rest.sensation,
    )


def _shake(
    sides: dict[str, SideDraw],
    key: str,
    pairs: Mapping[str, Pair],
    weak: str,
    draw: Draw,
    *,
    even: bool,
) -> None:
    """Add the amplitudes of a tremor or of dyskinesia, on the weaker side the more."""
    middle = {*groups_of("neck"), *groups_of("trunk"), *groups_of("jaw")}
    for region, pair in pairs.items():
        for side in ("left", "right"):
            amount = draw.at(pair) * (1.0 if even or side == weak else 0.5)
            for group in groups_of(region):
                place = sides["axial" if group in middle else side]
                if amount >= 0.005:
                    getattr(place, key)[group] = round(amount, 3)


def _injure(
    sides: dict[str, SideDraw], condition: Condition, severity: Severity, level: str, draw: Draw
) -> None:
    """Give each group the grade that its segments of the cord leave it."""
    at = _index(level)
    below = severity.below or (0.0, 0.0)
    is_complete = below == (0.0, 0.0)
    arm_or_leg = {*REGIONS["arm"], *REGIONS["leg"]}
    for group, (first, last) in condition.segments.items():
        low, high = _index(first), _index(last)
        for side in ("left", "right") if group in arm_or_leg else ("axial",):
            if high < at:
                grade = 5.0
            elif high == at:
                grade = draw.at((5.0, 3.0))
            elif low > at:
                grade = draw.at(below)
                if is_complete and low == at + 1:  # the zone of partial preservation
                    grade = float(draw.rng.choice([0.0, 1.0, 2.0], p=[0.6, 0.25, 0.15]))
            else:
                share = (at - low + 1) / (high - low + 1)
                grade = 4.5 * share + draw.at(below) * (1 - share)
            sides[side].mmt[group] = round(2 * grade) / 2
            if high <= at:
                sides[side].spasticity.pop(group, None)


def _needs_machine(
    condition: Condition, severity: Severity, axial: SideDraw, level: str | None, draw: Draw
) -> bool:
    """Return whether a machine breathes."""
    if level is not None:
        chance = condition.ventilated.get(level, 0.0)
        is_complete = (severity.below or (0.0, 0.0)) == (0.0, 0.0)
        return bool(draw.rng.uniform() < chance * (1.0 if is_complete else _BREATHES_WITH_A_REST))
    grade = axial.mmt.get("neck_flexors", 5.0)
    return severity.ventilated_below is not None and grade < severity.ventilated_below


def _side(drawn: SideDraw, side: str) -> SideProfile:
    """Return a side's profile: ranges from stiffness and grades."""
    norms = clinical_norms().motions
    groups = muscle_groups_of(side)
    passive: dict[str, float] = {}
    active: dict[str, float] = {}
    for motion in motions_of(side):
        norm = norms[motion].range_deg
        lost = drawn.stiffness.get(motion.split("_", 1)[0], 0.0)
        angle = norm
        if lost > 0.02 and motion.split("_", 1)[1] not in _SMALL:
            is_hinge = norm == 0 and motion.endswith("extension")
            angle = -round(_BENT * lost) if is_hinge else round(norm * (1 - lost))
            if angle != norm:
                passive[motion] = float(angle)
        grade = drawn.mmt.get(norms[motion].group, 5.0)
        share = _FULL if grade >= 3 else _WEAK if grade >= 2 else _NONE
        if share < 1 and angle > 0:
            active[motion] = round(angle * share, 1)
    return SideProfile(
        prom_deg=passive,
        arom_deg=active,
        mmt={g: v for g, v in sorted(drawn.mmt.items()) if v < 5 and g in groups},
        spasticity={g: v for g, v in sorted(drawn.spasticity.items()) if v != "0" and g in groups},
        tremor={g: v for g, v in sorted(drawn.tremor.items()) if g in groups},
        dyskinesia={g: v for g, v in sorted(drawn.dyskinesia.items()) if g in groups},
        sensation=drawn.sensation,  # type: ignore[arg-type]
    )


def _index(level: str) -> int:
    return SPINAL_LEVELS.index(level)
