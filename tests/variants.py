"""Parameters of tests: a few variants of a promise are quick, the others run in `make test-all`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

# An arm that stands, one on a telescope, two arms, and light hands on a body that leans.
KINDS_OF_ROBOTS = ("kinova_gen3", "stretch_re1", "pr2", "pepper")


def few(values: Iterable[Any], *quick: Any) -> list[Any]:
    """Return values as parameters; all but `quick` are slow."""
    return [pytest.param(v, marks=() if v in quick else pytest.mark.slow) for v in values]


def every(step: int, values: Iterable[Any]) -> list[Any]:
    """Return values as parameters; all but the first of each `step` are slow."""
    return [
        pytest.param(value, marks=pytest.mark.slow if i % step else ())
        for i, value in enumerate(values)
    ]
