"""All checks of people, by family, and what came of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rcare_marl.errors import check_name

from . import active_range, body, grades, moment_arms, pressure, swing, torques
from .check import Check

FAMILIES: Mapping[str, Callable[[], Sequence[Check]]] = {
    "body": body.checks,
    "moment_arm": moment_arms.checks,
    "torque": torques.checks,
    "active_range": active_range.checks,
    "grade": grades.checks,
    "swing": swing.checks,
    "pressure": pressure.checks,
}
SPLITS = ("fitted", "held out", "memory")


@dataclass(frozen=True)
class Tally:
    """How many checks of a family lie in their bands.

    Attributes:
        family: The family.
        split: `fitted`, `held out` or `memory`.
        inside: How many lie in their band.
        count: How many there are.
    """

    family: str
    split: str
    inside: int
    count: int


def validate(families: Iterable[str] = ()) -> list[Check]:
    """Return the checks of some families, of all if none is named.

    Raises:
        UnknownNameError: If there is no such family.
    """
    chosen = list(families) or list(FAMILIES)
    for name in chosen:
        check_name("family of checks", name, FAMILIES)
    return [check for name in chosen for check in FAMILIES[name]()]


def tallies(checks: Sequence[Check]) -> list[Tally]:
    """Return how many lie in band, by family and split; what is from memory counts in neither."""
    found: dict[tuple[str, str], list[bool]] = {}
    for check in checks:
        found.setdefault((check.family, check.split), []).append(check.is_in_band)
    families = list(dict.fromkeys(check.family for check in checks))
    order = sorted(found, key=lambda key: (families.index(key[0]), SPLITS.index(key[1])))
    return [Tally(*key, sum(found[key]), len(found[key])) for key in order]


def as_rows(checks: Sequence[Check]) -> list[dict[str, Any]]:
    """Return plain values of checks, their verdicts too; None is the end of a band that has none."""
    out = []
    for check in checks:
        row = {k: None if v in (math.inf, -math.inf) else v for k, v in asdict(check).items()}
        out.append({**row, "split": check.split, "in_band": check.is_in_band})
    return out
