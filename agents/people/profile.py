"""What a person can do: ranges of motion, strength, spasticity, sensation and vital signs.

Angles in files are clinical degrees, each side separately; here they become radians of the DoFs of
`agents/people/body/skeleton.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, UnknownNameError, check_name
from rcare_marl.pose import Array

from .body.anthropometry import Sex
from .body.skeleton import DOFS, Dof

Range = Literal["active", "passive"]
if TYPE_CHECKING:
    MmtGrade = float
    AshworthGrade = str
else:  # whatever a file holds reaches the checks below, which say more than a type does: 3+, 2
    MmtGrade = AshworthGrade = Any
ASHWORTH = ("0", "1", "1+", "2", "3", "4")
SPINAL_LEVELS = tuple(
    f"{part}{i + 1}"
    for part, count in (("C", 8), ("T", 12), ("L", 5), ("S", 5))
    for i in range(count)
)


@dataclass(frozen=True)
class Motion:
    """What a healthy adult man can do in one motion.

    Attributes:
        range_deg: Normal range [deg].
        torque: Greatest isometric torque at MMT grade 5 [N·m].
        group: Muscle group that makes the motion.
        range_source: Where the range comes from; the file explains the keys.
        torque_source: Where the torque comes from.
    """

    range_deg: float
    torque: float
    group: str
    range_source: str
    torque_source: str


@dataclass(frozen=True)
class ClinicalNorms:
    """The healthy norms that a profile departs from (`assets/clinical/motions.yaml`)."""

    female_strength: float
    motions: dict[str, Motion]

    @cached_property
    def groups(self) -> tuple[str, ...]:
        """All muscle groups, sorted."""
        return tuple(sorted({motion.group for motion in self.motions.values()}))


@lru_cache(maxsize=1)
def clinical_norms() -> ClinicalNorms:
    """Return the healthy norms."""
    return load(ClinicalNorms, assets.find("clinical", "motions"))


@cache
def motions_of(side: str) -> tuple[str, ...]:
    """Return the motions of `left`, `right` or `axial`, sorted."""
    return tuple(sorted({m for d in DOFS if d.side == side for m in (d.positive, d.negative)}))


@cache
def muscle_groups_of(side: str) -> frozenset[str]:
    """Return the muscle groups of `left`, `right` or `axial`."""
    return frozenset(clinical_norms().motions[motion].group for motion in motions_of(side))


@dataclass(frozen=True)
class SideProfile:
    """What departs from the norm on one side of the body, or in its middle.

    Attributes:
        prom_deg: Passive range of motion by motion [deg]; the norm where absent.
        arom_deg: Active range of motion [deg]; the passive one where absent.
        mmt: Manual muscle testing grade by muscle group, 0 (none) to 5 (normal); 5 where absent.
        spasticity: Modified Ashworth grade by muscle group: 0, 1, 1+, 2, 3 or 4; 0 where absent.
        tremor: Amplitude of a tremor by muscle group, a share of its strength; 0 where absent.
        dyskinesia: Amplitude of slow irregular movement likewise.
        sensation: How much is felt.
    """

    prom_deg: dict[str, float] = field(default_factory=dict)
    arom_deg: dict[str, float] = field(default_factory=dict)
    mmt: dict[str, MmtGrade] = field(default_factory=dict)
    spasticity: dict[str, AshworthGrade] = field(default_factory=dict)
    tremor: dict[str, float] = field(default_factory=dict)
    dyskinesia: dict[str, float] = field(default_factory=dict)
    sensation: Literal["normal", "reduced", "absent"] = "normal"

    def __post_init__(self) -> None:
        norms = clinical_norms()
        for key in ("prom_deg", "arom_deg"):
            for motion, angle in getattr(self, key).items():
                check_name(f"motion in {key}", motion, norms.motions)
                if not is_number(angle, -90, 190):
                    raise ConfigError(f"{key}.{motion} must lie in -90..190 deg, got {angle!r}")
        for motion, angle in self.arom_deg.items():
            passive = self.prom_deg.get(motion, norms.motions[motion].range_deg)
            if angle > passive:
                raise ConfigError(
                    f"arom_deg.{motion} is {angle} deg, beyond the passive range of {passive} deg"
                )
        for key in ("mmt", "tremor", "dyskinesia", "spasticity"):
            for group in getattr(self, key):
                check_name(f"muscle group in {key}", group, norms.groups)
        for group, grade in self.mmt.items():
            if not is_number(grade, 0, 5):
                raise ConfigError(
                    f"mmt.{group} is a grade from 0 to 5, a number (3+ is 3.33), got {grade!r}"
                )
        for key in ("tremor", "dyskinesia"):
            for group, amplitude in getattr(self, key).items():
                if not is_number(amplitude, 0, 1):
                    raise ConfigError(f"{key}.{group} is a share from 0 to 1, got {amplitude!r}")
        for group, mas in self.spasticity.items():
            if not isinstance(mas, str) or mas not in ASHWORTH:
                allowed = ", ".join(f'"{known}"' for known in ASHWORTH)
                raise ConfigError(
                    f"spasticity.{group} is a Modified Ashworth grade in quotes, one of {allowed}, "
                    f"got {mas!r}"
                )


def is_number(value: object, low: float, high: float) -> bool:
    """Return whether a value is a number in a range, and neither a truth value nor a text."""
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    return is_number and low <= value <= high  # type: ignore[operator]


@dataclass(frozen=True)
class Vitals:
    """Vital signs at rest.

    Attributes:
        heart_rate: [1/min].
        systolic: Blood pressure [mmHg].
        diastolic: Blood pressure [mmHg].
        temperature: Body temperature [°C].
        respiration_rate: [1/min].
    """

    heart_rate: float = 72.0
    systolic: float = 120.0
    diastolic: float = 78.0
    temperature: float = 36.8
    respiration_rate: float = 14.0

    def __post_init__(self) -> None:
        for name, low, high, unit in (
            ("heart_rate", 30, 200, "per minute"),
            ("temperature", 30, 43, "°C"),
            ("respiration_rate", 4, 60, "per minute"),
        ):
            if not low <= getattr(self, name) <= high:
                got = getattr(self, name)
                raise ConfigError(f"{name} must lie in {low}..{high} {unit}, got {got}")
        if not 30 <= self.diastolic < self.systolic <= 260:
            raise ConfigError(
                f"blood pressure must satisfy 30 <= diastolic < systolic <= 260 mmHg, got "
                f"{self.systolic}/{self.diastolic}"
            )


@dataclass(frozen=True)
class ClinicalProfile:
    """The abilities of one person.

    Attributes:
        axial: Trunk, neck and jaw.
        left: Left limbs.
        right: Right limbs.
        vitals: Vital signs at rest.
        injury_level: Lowest segment of the spinal cord that still works, such as `C6`; None without
            an injury of the cord. What lies above it feels normally, whatever `sensation` says.
        ventilator_rate: Breaths a minute that a ventilator is set to, which breathes for them; None
            for who breathes alone.
    """

    axial: SideProfile = field(default_factory=SideProfile)
    left: SideProfile = field(default_factory=SideProfile)
    right: SideProfile = field(default_factory=SideProfile)
    vitals: Vitals = field(default_factory=Vitals)
    injury_level: str | None = None
    ventilator_rate: float | None = None

    def __post_init__(self) -> None:
        if self.ventilator_rate is not None and not is_number(self.ventilator_rate, 4, 40):
            raise ConfigError(
                f"ventilator_rate must lie in 4..40 per minute, got {self.ventilator_rate!r}"
            )
        if self.injury_level is not None and self.injury_level not in SPINAL_LEVELS:
            raise UnknownNameError("spinal level", self.injury_level, SPINAL_LEVELS)
        for side in ("axial", "left", "right"):
            profile = self.side(side)
            for key in ("prom_deg", "arom_deg", "mmt", "spasticity", "tremor", "dyskinesia"):
                known = motions_of(side) if key.endswith("_deg") else muscle_groups_of(side)
                for name in getattr(profile, key):
                    check_name(f"entry of {key} that belongs to {side}", name, known)

    def side(self, name: str) -> SideProfile:
        """Return the profile of `left`, `right` or `axial`."""
        return {"left": self.left, "right": self.right, "axial": self.axial}[name]

    def limits(self, kind: Range) -> dict[str, tuple[float, float]]:
        """Return lower and upper limit of each of the 112 DoFs [rad], by name.

        An eye has no clinical range; it gets the norm of the eye muscles for both kinds.
        """
        return {dof.name: self._limit(dof, kind) for dof in DOFS}

    def _limit(self, dof: Dof, kind: Range) -> tuple[float, float]:
        side = self.side(dof.side)
        high = _angle(side, dof.positive, kind) * dof.share - dof.clinical_zero
        low = -_angle(side, dof.negative, kind) * dof.share - dof.clinical_zero
        if low > high:  # deficits at both ends leave a point, for active movement a possible one
            low = high = 0.5 * (low + high)
            if kind == "active":
                least, most = self._limit(dof, "passive")
                low = high = min(max(low, least), most)
        return low, high

    def grade(self, dof: Dof, *, positive: bool) -> float:
        """Return the MMT grade of the muscles that move `dof` in one direction."""
        motion = clinical_norms().motions[dof.positive if positive else dof.negative]
        return self.side(dof.side).mmt.get(motion.group, 5.0)

    def strength(
        self, sex: Sex, share: Callable[[Dof, str, float], float] | None = None
    ) -> tuple[Array, Array]:
        """Return the greatest torques of each DoF, negative and positive [N·m], each [112].

        Args:
            sex: Whose norms.
            share: Share of the normal torque by DoF, motion and grade; the paper's uniform map, grade / 5,
                if None.
        """
        norms = clinical_norms()
        factor = norms.female_strength if sex == "female" else 1.0
        both = np.zeros((len(DOFS), 2))
        for row, dof in zip(both, DOFS, strict=True):
            for k, name in enumerate((dof.negative, dof.positive)):
                motion, grade = norms.motions[name], self.grade(dof, positive=k == 1)
                found = grade / 5 if share is None else share(dof, name, grade)
                row[k] = motion.torque * factor * found
        return both[:, 0], both[:, 1]


def _angle(side: SideProfile, motion: str, kind: Range) -> float:
    norm = clinical_norms().motions[motion].range_deg
    degrees = side.prom_deg.get(motion, norm)
    if kind == "active":
        degrees = side.arom_deg.get(motion, degrees)
    return math.radians(degrees)


def normal_strength(sex: Sex) -> Array:
    """Return the greatest torque of each DoF in its stronger direction at grade 5 [N·m], [112]."""
    norms = clinical_norms()
    factor = norms.female_strength if sex == "female" else 1.0
    pairs = [[norms.motions[motion].torque for motion in (d.positive, d.negative)] for d in DOFS]
    return factor * np.array(pairs).max(axis=1)
