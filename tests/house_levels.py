"""All houses at all levels, built and audited once for all tests that walk through them."""

from __future__ import annotations

from functools import cache

import pytest
from variants import few

from rcare_marl.envs.homes.audit import Audit, audit
from rcare_marl.envs.homes.care_home import CareHome, home_names

# A house takes half a second to build, and the middle level finds what the others find.
QUICK = home_names()[2::4]
ALL = [
    pytest.param(name, level, marks=() if name in QUICK and level != 2 else pytest.mark.slow)
    for name in home_names()
    for level in (1, 2, 3)
]
EACH = pytest.mark.parametrize("name", few(home_names(), *QUICK))
TOGETHER = pytest.mark.parametrize(
    "names",
    [
        pytest.param(QUICK, id="some"),
        pytest.param(home_names(), id="all", marks=pytest.mark.slow),
    ],
)


@cache
def built(name: str, level: int) -> CareHome:
    """Return a home; the same one to all tests."""
    return CareHome.load(name, level=level)


@cache
def audited(name: str, level: int, against: int) -> Audit:
    """Return the audit of a home against the rules of a level."""
    return audit(built(name, level), against)
