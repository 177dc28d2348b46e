"""Conditions as data: what each severity does to grades, tone, ranges, sensation and the rest."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name

from ..body.posture import PostureKind
from ..manner import Speech
from ..profile import ASHWORTH, SPINAL_LEVELS, clinical_norms

Pair = tuple[float, float]
Sensation = Literal["normal", "reduced", "absent"]
JOINT_REGIONS: dict[str, tuple[str, ...]] = {
    "neck": ("neck_flexors", "neck_extensors"),
    "trunk": ("trunk",),
    "jaw": ("jaw",),
    "shoulder": (
        "upper_trapezius",
        "shoulder_abductors",
        "shoulder_flexors",
        "shoulder_adductors",
        "shoulder_external_rotators",
    ),
    "elbow": ("elbow_flexors", "elbow_extensors", "pronators", "supinators"),
    "wrist": ("wrist_flexors", "wrist_extensors"),
    "hand": ("finger_flexors", "finger_extensors"),
    "hip": ("hip_flexors", "hip_extensors", "hip_abductors", "hip_adductors"),
    "knee": ("knee_flexors", "knee_extensors"),
    "ankle": ("ankle_dorsiflexors", "ankle_plantarflexors", "toes"),
}


def _together(*regions: str) -> tuple[str, ...]:
    return tuple(group for region in regions for group in JOINT_REGIONS[region])


REGIONS = JOINT_REGIONS | {
    "arm": _together("shoulder", "elbow", "wrist", "hand"),
    "leg": _together("hip", "knee", "ankle"),
}
STIFF = tuple("neck trunk jaw shoulder elbow wrist finger thumb hip knee ankle".split())


def groups_of(key: str) -> tuple[str, ...]:
    """Return the muscle groups that a region or a group's own name stands for."""
    return REGIONS.get(key, (key,))


@dataclass(frozen=True)
class Pattern:
    """What a side of the body, or its middle, has at the mild and at the severe end of a band.

    Attributes:
        mmt: Grades by region or muscle group; a later entry counts.
        spasticity: Modified Ashworth grades likewise.
        stiffness: Share of the passive range that is lost, by joint; a joint that straightens to 0°
            is kept bent by that share of 60°.
        sensation: Probability of each.
    """

    mmt: dict[str, Pair] = field(default_factory=dict)
    spasticity: dict[str, tuple[str, str]] = field(default_factory=dict)
    stiffness: dict[str, Pair] = field(default_factory=dict)
    sensation: dict[Sensation, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        known = [*REGIONS, *clinical_norms().groups]
        for key in ("mmt", "spasticity"):
            for name in getattr(self, key):
                check_name(f"region or muscle group in {key}", name, known)
        for name, grades in self.mmt.items():
            if not all(0 <= grade <= 5 for grade in grades):
                raise ConfigError(f"mmt.{name} must lie in 0..5, got {grades}")
        for name, pair in self.spasticity.items():
            for grade in pair:
                check_name(f"Modified Ashworth grade of {name}", grade, ASHWORTH)
        for name, lost in self.stiffness.items():
            check_name("joint in stiffness", name, STIFF)
            if not all(0 <= share <= 0.9 for share in lost):
                raise ConfigError(f"stiffness.{name} must lie in 0..0.9, got {lost}")


@dataclass(frozen=True)
class MannerPattern:
    """Communication and temperament at the mild and at the severe end; probabilities of speech."""

    speech: dict[Speech, float]
    understanding: Pair
    patience: Pair


@dataclass(frozen=True)
class BearingPattern:
    """A bearing; `weak_` before a name is the weak side, `_weak` after it is towards that side."""

    reason: str
    angles_deg: dict[str, float]
    postures: tuple[PostureKind, ...] = ("sitting", "lying", "standing", "hanging")


@dataclass(frozen=True)
class Severity:
    """One band of a condition; pairs are its mild and its severe end.

    Attributes:
        share: Of the people with the condition.
        weak: The weak side, or both.
        manner: Communication and temperament.
        strong: The other side of who has one weak side.
        axial: Trunk, neck and jaw.
        score: On the condition's scale.
        tremor: Amplitudes by region or group.
        dyskinesia: The same of slow irregular movement.
        vitals: Of those that depart from everybody's.
        eating: Fields of `Eating` likewise.
        bearing: How they hold themselves.
        smaller: Share of stature lost.
        leaner: Share of mass lost.
        heavier: Share of mass gained.
        ventilated_below: Grade of the neck's flexors below which a machine breathes.
        below: Grades below the level of an injury of the spinal cord.
    """

    share: float
    weak: Pattern
    manner: MannerPattern
    strong: Pattern = Pattern()
    axial: Pattern = Pattern()
    score: Pair | None = None
    tremor: dict[str, Pair] = field(default_factory=dict)
    dyskinesia: dict[str, Pair] = field(default_factory=dict)
    vitals: dict[str, Pair] = field(default_factory=dict)
    eating: dict[str, Pair] = field(default_factory=dict)
    bearing: tuple[BearingPattern, ...] = ()
    smaller: Pair = (0.0, 0.0)
    leaner: Pair = (0.0, 0.0)
    heavier: Pair = (0.0, 0.0)
    ventilated_below: float | None = None
    below: Pair | None = None


@dataclass(frozen=True)
class Scale:
    """A clinical scale, and what it reads at its mild and at its severe end."""

    name: str
    mild: float
    severe: float


@dataclass(frozen=True)
class ArmScale:
    """A second scale that the arms follow, and how many bands it is off with which probability."""

    name: str
    shift: dict[int, float]


@dataclass(frozen=True)
class Condition:
    """A condition (`assets/conditions/<name>.yaml`).

    Attributes:
        description: For texts.
        age_years: Youngest, most common and oldest age.
        female: Share of women.
        asymmetry: Both sides alike, one less weak, or one alone weak.
        severities: Bands from mild to severe.
        scale: What the bands are bands of.
        arms_follow: A scale of their own for the arms.
        levels: Probability of each level of an injury of the spinal cord.
        ventilated: Probability of a ventilator by level.
        segments: First and last segment of the cord that each muscle group needs.
        key_muscles: The groups that define the level.
        high_to: Lowest level at which the autonomic functions are lost as `high_vitals` says.
        high_vitals: Vital signs there.
    """

    description: str
    age_years: tuple[float, float, float]
    female: float
    asymmetry: Literal["even", "uneven", "one"]
    severities: dict[str, Severity]
    scale: Scale | None = None
    arms_follow: ArmScale | None = None
    levels: dict[str, float] = field(default_factory=dict)
    ventilated: dict[str, float] = field(default_factory=dict)
    segments: dict[str, tuple[str, str]] = field(default_factory=dict)
    key_muscles: tuple[str, ...] = ()
    high_to: str | None = None
    high_vitals: dict[str, Pair] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.severities:
            raise ConfigError("a condition needs a severity at least")
        if not self.age_years[0] <= self.age_years[1] <= self.age_years[2]:
            raise ConfigError(f"age_years must rise, got {self.age_years}")
        for level in (
            *self.levels,
            *self.ventilated,
            *(s for p in self.segments.values() for s in p),
        ):
            check_name("spinal level", level, SPINAL_LEVELS)
        for group in (*self.segments, *self.key_muscles):
            check_name("muscle group", group, clinical_norms().groups)

    def placed(self, severity: str | float | None, rng: Any) -> tuple[str, float, str | None]:
        """Return the band, the place in it from 0 (mild) to 1 (severe), and the level of the cord.

        Args:
            severity: A band, a score of the scale, `C6`, `A` or `C6-A` of an injury of the cord;
                drawn if None.
            rng: Draws what is left open.

        Raises:
            UnknownNameError: If there is no such band or level.
            ConfigError: If a score is given where there is no scale, or lies outside it.
        """
        bands = list(self.severities)
        shares = [self.severities[name].share for name in bands]
        band = bands[int(rng.choice(len(bands), p=_normal(shares)))]
        level = None
        if self.levels:
            level = list(self.levels)[
                int(rng.choice(len(self.levels), p=_normal(self.levels.values())))
            ]
        place = float(rng.uniform())
        if severity is None:
            return band, place, level
        if isinstance(severity, str):
            parts = severity.split("-") if self.levels else [severity]
            for part in parts:
                if part in self.levels:
                    level = part
                else:
                    check_name("severity", part, [*bands, *self.levels])
                    band = part
            return band, place, level
        return (*self._scored(float(severity)), level)

    def _scored(self, score: float) -> tuple[str, float]:
        if self.scale is None:
            raise ConfigError(
                f"{self.description} has no scale to read {score:g} on; severities: "
                f"{', '.join(self.severities)}"
            )
        low, high = sorted((self.scale.mild, self.scale.severe))
        if not low <= score <= high:
            raise ConfigError(f"{self.scale.name} runs from {low:g} to {high:g}, got {score:g}")

        def apart(name: str) -> float:
            ends = self.severities[name].score
            assert ends is not None
            return max(min(ends) - score, score - max(ends), 0.0)

        band = min(self.severities, key=apart)
        first, last = self.severities[band].score or (0.0, 0.0)
        place = (score - first) / (last - first) if last != first else 0.5
        return band, min(max(place, 0.0), 1.0)


def _normal(shares: Any) -> list[float]:
    values = [float(share) for share in shares]
    return [value / sum(values) for value in values]


@lru_cache(maxsize=32)
def load_condition(name: str) -> Condition:
    """Return the condition of that name.

    Raises:
        UnknownNameError: If there is none.
        ConfigError: If its file does not fit.
    """
    return load(Condition, assets.find("conditions", name))


def condition_names() -> tuple[str, ...]:
    """Return the names of all conditions, sorted."""
    return tuple(sorted(assets.names("conditions")))
