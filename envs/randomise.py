"""Perturbations as data: what of robots, bodies and observations is another in each episode.

Example:
    >>> env = rcare_marl.make("feeding", randomise={"robot_mass": {"factor": [0.7, 1.3]}})
    >>> env = rcare_marl.make("feeding", randomise="delay_1")  # one that ships
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rcare_marl import assets
from rcare_marl.config import read_yaml
from rcare_marl.errors import ConfigError, check_name

FOLDER = "randomisations"  # of the package's assets
STREAM = 0x72616E64  # that this chance is drawn from, beside the seed of the episode
ABOUT = ("description", "source")  # keys of a file that are no perturbations
SPARED = "spared"  # chance that an episode has none of the other perturbations
SEEN = ("m", "rad", "N", "m/s", "rad/s", "s", "1")  # units of what is observed
PLACED = ("m", "rad")  # units of where something stands
OWN = ("rad", "m", "rad/s", "m/s", "N", "1")


@dataclass(frozen=True)
class Kind:
    """What can be perturbed.

    Attributes:
        units: Units in which it is given; where there are several, each may have a spread of its own.
        low: Least value.
        high: Greatest value.
        usual: The value of an episode without it.
        is_whole: Whether it is a whole number.
        by_unit: Whether there is a number for each unit.
    """

    units: tuple[str, ...]
    low: float
    high: float
    usual: float
    is_whole: bool = False
    by_unit: bool = False


_FACTOR, _SD = Kind(("factor",), 0.1, 10.0, 1.0), Kind(SEEN, 0.0, 10.0, 0.0, by_unit=True)
KINDS: Mapping[str, Kind] = {
    "robot_mass": _FACTOR,
    "person_mass": _FACTOR,
    "object_mass": _FACTOR,
    "friction": _FACTOR,
    "robot_place": Kind(PLACED, 0.0, 0.5, 0.0, by_unit=True),
    "motor_gain": Kind(("factor",), 0.05, 1.5, 1.0),
    "motor_strength": Kind(("factor",), 0.1, 3.0, 1.0),
    "motor_lag": Kind(("s",), 0.0, 2.0, 0.0),
    "action_delay": Kind(("steps",), 0.0, 20.0, 0.0, is_whole=True),
    "observation_noise": _SD,
    "observation_bias": _SD,
    "joint_noise": Kind(OWN, 0.0, 10.0, 0.0, by_unit=True),
    "drop_out": Kind(("share",), 0.0, 0.95, 0.0),
    "camera_place": Kind(PLACED, 0.0, 0.5, 0.0, by_unit=True),
    "light": _FACTOR,
    "light_turn": Kind(("rad",), 0.0, 0.5, 0.0),
    "led_astray": Kind(("share",), 0.0, 1.0, 0.0),
    SPARED: Kind(("share",), 0.0, 1.0, 0.0),
}


@dataclass(frozen=True)
class Spread:
    """A distribution: fixed where `low` and `high` are the same, else uniform; normal with an `sd`.

    Attributes:
        low: Least value.
        high: Greatest value.
        sd: Standard deviation about the middle; None if uniform.
    """

    low: float
    high: float
    sd: float | None = None

    @classmethod
    def of(cls, value: Any, kind: Kind, where: str) -> Spread:
        """Return the distribution that a number, a range or a mapping of `mean` and `sd` stands for.

        Raises:
            ConfigError: If it is none of them, or reaches out of what is possible.
            UnknownNameError: If a mapping has another key.
        """
        if isinstance(value, Mapping):
            for key in value:
                check_name(f"field of {where}", str(key), ("mean", "sd"))
            if set(value) != {"mean", "sd"}:
                raise ConfigError(f"{where}: a normal distribution has mean and sd, got {value}")
            mean, sd = (_number(value[key], f"{where}.{key}") for key in ("mean", "sd"))
            if sd < 0:
                raise ConfigError(f"{where}.sd must not be negative, got {sd:g}")
            found = cls(mean, mean, sd)
        elif isinstance(value, list | tuple):
            if len(value) != 2:
                raise ConfigError(f"{where}: a range is [low, high], got {list(value)}")
            found = cls(*(_number(end, where) for end in value))
        else:
            fixed = _number(value, where)
            found = cls(fixed, fixed)
        if found.low > found.high:
            raise ConfigError(f"{where}: a range is [low, high], got {list(value)}")
        for end in (found.low, found.high):
            if not kind.low <= end <= kind.high:
                raise ConfigError(f"{where} must lie in [{kind.low:g}, {kind.high:g}], got {end:g}")
            if kind.is_whole and (end != int(end) or found.sd is not None):
                raise ConfigError(f"{where} must be a whole number or a range of them, got {value}")
        return found

    def draw(self, kind: Kind, spread: float, rng: np.random.Generator) -> float:
        """Return a value, the whole way from the usual one with a `spread` of 1, none of it with 0."""
        if self.sd is not None:
            value = float(np.clip(rng.normal(self.low, self.sd), kind.low, kind.high))
        elif kind.is_whole:
            value = float(rng.integers(int(self.low), int(self.high) + 1))
        else:
            value = float(rng.uniform(self.low, self.high)) if self.low < self.high else self.low
        if spread != 1.0:
            value = kind.usual + spread * (value - kind.usual)
        return float(round(value)) if kind.is_whole else value

    def plain(self) -> Any:
        """Return it as `of` takes it."""
        if self.sd is not None:
            return {"mean": self.low, "sd": self.sd}
        return self.low if self.low == self.high else [self.low, self.high]


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise ConfigError(
            f"{where}: expected a number, [low, high], or mean and sd, got {type(value).__name__} "
            f"{value!r}"
        )
    if not math.isfinite(value):
        raise ConfigError(f"{where}: expected a finite number, got {value}")
    return float(value)


@dataclass(frozen=True)
class Randomisation:
    """Perturbations with their units and distributions; see docs/randomisation.md.

    Attributes:
        spreads: The distribution of each perturbation and unit.
    """

    spreads: Mapping[tuple[str, str], Spread]

    @classmethod
    def of(cls, given: Any) -> Randomisation:
        """Return what a name, a file, a mapping, or nothing stands for.

        Args:
            given: The name of one that ships, a YAML file, `{perturbation: {unit: distribution}}`, or
                None. A distribution is a number, [low, high], or `{mean: ..., sd: ...}`.

        Raises:
            UnknownNameError: If a perturbation, unit or name does not exist.
            ConfigError: If a value is impossible.
        """
        if isinstance(given, Randomisation):
            return given
        where = "randomise"
        if isinstance(given, str | Path):
            where = str(given)
            if Path(given).suffix not in (".yaml", ".yml"):
                check_name("randomisation", str(given), assets.names(FOLDER))
            given = read_yaml(assets.find(FOLDER, given))
            given = {name: value for name, value in given.items() if name not in ABOUT}
        if not isinstance(given or {}, Mapping):
            raise ConfigError(
                f"{where} must be a name, a file or a mapping, got {type(given).__name__} {given!r}"
            )
        spreads = {}
        for name, units in (given or {}).items():
            check_name("perturbation", str(name), KINDS)
            kind, at = KINDS[name], f"{where}.{name}"
            if not isinstance(units, Mapping) or not units:
                raise ConfigError(
                    f"{at} needs a unit, such as {{{kind.units[0]}: ...}}, got {units!r}"
                )
            for unit, value in units.items():
                check_name(f"unit of {at}", str(unit), kind.units)
                spreads[name, str(unit)] = Spread.of(value, kind, f"{at}.{unit}")
        order = list(KINDS)
        return cls(dict(sorted(spreads.items(), key=lambda item: order.index(item[0][0]))))

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Return it as `of` takes it, for JSON and YAML."""
        out: dict[str, dict[str, Any]] = {}
        for (name, unit), spread in self.spreads.items():
            out.setdefault(name, {})[unit] = spread.plain()
        return out

    def draw(self, seed: int, spread: float = 1.0) -> dict[tuple[str, str], float]:
        """Return the values of an episode; each has chance of its own, whatever else is perturbed.

        Args:
            seed: Of the episode.
            spread: Share of each way from the usual value that is left, 0 to 1; for a curriculum.
        """
        drawn = {
            key: found.draw(KINDS[key[0]], spread, stream(seed, "/".join(key)))
            for key, found in self.spreads.items()
        }
        share = drawn.pop((SPARED, "share"), 0.0)
        if share > 0.0 and stream(seed, SPARED).random() < share:
            return {key: KINDS[key[0]].usual for key in drawn}
        return drawn


def stream(seed: int, name: str) -> np.random.Generator:
    """Return chance of its own for a seed and a name."""
    return np.random.default_rng([seed, STREAM, zlib.crc32(name.encode())])


def randomisation_names() -> tuple[str, ...]:
    """Return the names of the randomisations that ship."""
    return assets.names(FOLDER)


def label(name: str, unit: str) -> str:
    """Return under which name a value stands in infos, such as `randomise_observation_noise_m`."""
    said = f"_{unit.replace('/', '_')}" if KINDS[name].by_unit else ""
    return f"randomise_{name}{said}"
