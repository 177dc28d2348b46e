"""A person drawn at random: condition, severity, body, abilities, bearing and manner, all synthetic."""

from __future__ import annotations

import dataclasses
import zlib
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError

from ..avatar import AvatarConfig
from ..body.anthropometry import LENGTHS, Sex
from ..body.body_spec import OLDEST, YOUNGEST, BodySpec
from ..body.posture import Bearing
from ..eating import Eating
from ..manner import Manner
from ..profile import ClinicalProfile
from .condition import Condition, Severity, load_condition
from .profile_draw import Draw, draw_profile

_PROPORTION_SPREAD = 0.025  # of a limb segment's length at a given stature; from memory of ANSUR II
_ADULT = 18.0  # [years]


@dataclass(frozen=True)
class People:
    """Stature, mass and names of people at large (`assets/clinical/people.yaml`)."""

    ages: tuple[float, ...]
    stature_m: dict[Sex, tuple[float, ...]]
    stature_spread: float
    adult_m: dict[Sex, float]
    shrinks: tuple[tuple[float, float], ...]
    index_ages: tuple[float, ...]
    index: tuple[float, ...]
    index_spread: float
    index_range: tuple[float, float]
    heart_rate: tuple[float, float]
    systolic: tuple[float, float]
    systolic_per_year: float
    pulse_pressure: tuple[float, float]
    names: dict[Sex, tuple[str, ...]]


@lru_cache(maxsize=1)
def people_at_large() -> People:
    """Return the figures of people at large."""
    return load(People, assets.find("clinical", "people"))


def sample_person(
    condition: str = "none",
    severity: str | float | None = None,
    seed: int = 0,
    *,
    sex: Sex | None = None,
    age: float | None = None,
) -> AvatarConfig:
    """Return a synthetic person with a condition, as a YAML file would give one.

    Args:
        condition: One of `condition_names()`.
        severity: A band of the condition, or a score of its scale; of an injury of the spinal cord
            the level, the grade or both (`C6-A`). Drawn if None.
        seed: The same seed gives the same person.
        sex: Drawn if None.
        age: Age [years]; drawn if None.

    Raises:
        UnknownNameError: If there is no such condition or severity.
        ConfigError: If the severity is no score of the condition's scale, or the age is not 6 to 95.
    """
    found = load_condition(condition)
    if age is not None and not YOUNGEST <= age <= OLDEST:
        raise ConfigError(f"age must lie in {YOUNGEST:g}..{OLDEST:g} years, got {age:g}")
    if seed < 0:
        raise ConfigError(f"seed must not be negative, got {seed}")
    rng = np.random.default_rng([seed, zlib.crc32(condition.encode())])
    band, place, level = found.placed(severity, rng)
    chance: Sex = "female" if rng.uniform() < found.female else "male"
    drawn_age = float(rng.triangular(*found.age_years)) if len(set(found.age_years)) > 1 else 0.0
    sex, age = sex or chance, float(round(drawn_age if age is None else age))
    weak = str(rng.choice(["left", "right"]))
    draw = Draw(rng, place)
    stature, mass, body = _body(found.severities[band], sex, age, draw)
    profile = _with_vitals(
        draw_profile(found, band, level, weak, draw), found, band, level, age, rng
    )
    name = str(rng.choice(people_at_large().names[sex]))
    return AvatarConfig(
        name=name,
        condition=_words(found, band, level, weak, place),
        sex=sex,
        height_m=stature,
        mass_kg=mass,
        body=body,
        pronoun="she" if sex == "female" else "he",
        age_years=age,
        profile=profile,
        bearing=_bearing(found.severities[band], weak, draw),
        eating=_eating(found.severities[band], draw),
        manner=_manner(found.severities[band], draw),
    )


def _words(condition: Condition, band: str, level: str | None, weak: str, place: float) -> str:
    if level is not None:
        return f"{condition.description} {level}, AIS {band} (synthetic)"
    words = condition.description
    score = condition.severities[band].score
    if condition.scale is not None and score is not None:
        at = score[0] + place * (score[1] - score[0])
        words += f", {band} ({condition.scale.name} {round(2 * at) / 2:g})"
    if condition.asymmetry != "even":
        words += f", {weak} side {'weak' if condition.asymmetry == 'one' else 'weaker'}"
    return f"{words} (synthetic)"


def _body(severity: Severity, sex: Sex, age: float, draw: Draw) -> tuple[float, float, BodySpec]:
    """Return stature [m], mass [kg] and what the body is like."""
    at_large, rng = people_at_large(), draw.rng

    def normal(most: float = 2.5) -> float:
        return float(np.clip(rng.normal(), -most, most))

    middle = float(np.interp(age, at_large.ages, at_large.stature_m[sex]))
    if age > at_large.ages[-1]:
        middle = at_large.adult_m[sex]
    middle -= sum(max(age - start, 0.0) * rate for start, rate in at_large.shrinks)
    stature = middle * (1 + at_large.stature_spread * normal())
    stature *= 1 - draw.at(severity.smaller)
    index = float(np.interp(age, at_large.index_ages, at_large.index))
    index *= float(np.exp(at_large.index_spread * normal()))
    index *= (1 - draw.at(severity.leaner)) * (1 + draw.at(severity.heavier))
    index = float(np.clip(index, *at_large.index_range))
    if age < _ADULT:
        index = min(index, 1.7 * float(np.interp(age, at_large.index_ages, at_large.index)))
    stature = round(stature, 3)
    spec = BodySpec(
        muscle=round(float(np.clip(0.5 + 0.12 * normal(), 0.2, 0.8)), 2),
        proportions={name: round(1 + _PROPORTION_SPREAD * normal(), 3) for name in LENGTHS},
        seed=int(rng.integers(2**31)),
    )
    return stature, round(index * stature**2, 1), spec


def _with_vitals(
    profile: ClinicalProfile, condition: Condition, band: str, level: str | None, age: float,
    rng: np.random.Generator,
) -> ClinicalProfile:  # fmt: skip
    """Return the profile with the vital signs of people at large where the condition sets none."""
    at_large = people_at_large()
    ours = set(condition.severities[band].vitals)
    if level is not None and profile.vitals.systolic < 115:
        ours |= set(condition.high_vitals)
    vitals = profile.vitals
    rate = round(float(rng.uniform(*at_large.heart_rate)))
    systolic = float(rng.uniform(*at_large.systolic))
    systolic += at_large.systolic_per_year * max(age - 40, 0)
    if age < _ADULT:  # children: faster, lower (from memory)
        rate, systolic = round(rate + 1.6 * (_ADULT - age)), systolic - 1.2 * (_ADULT - age)
    if "heart_rate" not in ours:
        vitals = dataclasses.replace(vitals, heart_rate=float(rate))
    if "systolic" not in ours:
        pulse = float(rng.uniform(*at_large.pulse_pressure))
        low = round(systolic - pulse)
        vitals = dataclasses.replace(vitals, systolic=float(round(systolic)), diastolic=float(low))
    elif vitals.diastolic >= vitals.systolic - 20:
        vitals = dataclasses.replace(vitals, diastolic=vitals.systolic - 25)
    return dataclasses.replace(profile, vitals=vitals)


def _bearing(severity: Severity, weak: str, draw: Draw) -> tuple[Bearing, ...]:
    """Return how the person holds themselves, by their own weak side."""
    out = []
    for pattern in severity.bearing:
        angles, amount = {}, draw.at((0.6, 1.1))
        for name, angle in pattern.angles_deg.items():
            sign = 1.0
            if name.startswith("weak_"):
                name = f"{weak}_{name.removeprefix('weak_')}"
            elif name.endswith("_weak"):
                sign = 1.0 if weak == "left" else -1.0
                name = f"{name.removesuffix('_weak')}_left"
            angles[name] = round(sign * amount * angle, 1)
        out.append(Bearing(pattern.reason, angles, pattern.postures))
    return tuple(out)


def _eating(severity: Severity, draw: Draw) -> Eating:
    if not severity.eating:
        return Eating()
    drawn: dict[str, Any] = {k: round(draw.at(pair), 2) for k, pair in severity.eating.items()}
    return Eating(**drawn, source="drawn from the condition's file (synthetic)")


def _manner(severity: Severity, draw: Draw) -> Manner:
    manner = severity.manner
    return Manner(
        speech=draw.one(manner.speech),
        understanding=round(draw.at(manner.understanding), 2),
        patience=round(draw.at(manner.patience, scatter=0.4), 2),
    )
