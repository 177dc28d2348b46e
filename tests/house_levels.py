"""All houses at all levels, built and audited once for all tests that walk through them."""

from __future__ import annotations

from functools import cache

import pytest

from rcare_marl.envs.homes.audit import Audit, audit
from rcare_marl.envs.homes.care_home import CareHome, home_names

ALL = [  # the middle level takes a third of the time and finds what the others find
    pytest.param(name, level, marks=[pytest.mark.slow] if level == 2 else [])
    for name in home_names()
    for level in (1, 2, 3)
]


@cache
def built(name: str, level: int) -> CareHome:
    """Return a home; the same one to all tests."""
    return CareHome.load(name, level=level)


@cache
def audited(name: str, level: int, against: int) -> Audit:
    """Return the audit of a home against the rules of a level."""
    return audit(built(name, level), against)
