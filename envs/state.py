"""What a task read from the engine in a control step: plain numbers and arrays, and functions over them.

`Task.read` makes a `State` once a control step. All that a task then observes, pays and counts is a
function of it and of the options, written so that it broadcasts: where every field has leading axes, of
worlds or of steps, every result has them too. Compare numbers by operators, choose by `where`, limit by
`clip`, join conditions by `&`, `|` and `np.logical_not`, and index arrays from the last axis.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from .safety import Safety

Values = Any  # a number, or an array of numbers with the leading axes of the states
S = TypeVar("S")
FALL = float(np.log(0.1))  # of the logarithm over the margin, of `tolerance`


@dataclass(frozen=True, eq=False)
class State:
    """What every task reads; tasks derive theirs.

    Attributes:
        time: Since the episode began [s].
        safety: What each person goes through, by role.
    """

    time: float
    safety: Mapping[str, Safety]

    @property
    def force(self) -> Values:
        """Greatest force on anybody in the last control step [N]."""
        return greatest([each.force for each in self.safety.values()])

    @property
    def peak_force(self) -> Values:
        """Greatest force on anybody in the episode [N]."""
        return greatest([each.peak_force for each in self.safety.values()])


@dataclass(frozen=True)
class Seen:
    """A quantity that a task lets an agent observe.

    Attributes:
        name: Unique inside one agent's observation, such as `spoon_to_mouth`.
        unit: SI unit, such as `m` or `rad`; `1` for pure numbers.
        size: Number of values.
        of: Returns the value from a state: shape [..., size], or [...] where the size is 1.
    """

    name: str
    unit: str
    size: int
    of: Callable[[Any], Values]


def where(condition: Values, yes: Values, no: Values) -> Values:
    """Return `yes` where a condition holds, else `no`; a number for a number."""
    if isinstance(condition, bool | np.bool_):
        return yes if condition else no
    return np.where(condition, yes, no)


def clip(value: Values, low: float, high: float) -> Values:
    """Return values limited to a range."""
    if isinstance(value, float):
        return min(max(value, low), high)
    return np.clip(value, low, high)


def tolerance(x: Values, bounds: tuple[Values, Values] = (0.0, 0.0), margin: float = 0.0) -> Values:
    """Return 1 inside `bounds`, falling to 0.1 at `margin` outside of them: a term of a reward."""
    low, high = bounds
    is_one = isinstance(x, float) and isinstance(low, int | float) and isinstance(high, int | float)
    if margin < 0 or (low > high if is_one else np.any(low > high)):
        raise ValueError(f"need low <= high and margin >= 0, got bounds {bounds}, margin {margin}")
    if is_one:  # numpy takes ten times as long for a single number
        beyond = max(low - x, x - high, 0.0)
    else:
        beyond = np.maximum(np.maximum(low - x, x - high), 0.0)
    if margin == 0:
        return np.where(beyond > 0, 0.0, 1.0)[()]
    distance = beyond / margin
    return np.exp(FALL * (distance * distance))


def greatest(values: Sequence[Values]) -> Values:
    """Return the greatest of values, one by one; 0 if there are none."""
    if len(values) < 2:
        return values[0] if values else 0.0
    return np.maximum.reduce([np.asarray(value) for value in values])[()]


def flat(rows: Values) -> Values:
    """Return the rows of matrices one after the other: shape [..., n * m] from [..., n, m]."""
    return rows.reshape(*rows.shape[:-2], -1)


def stack(states: Sequence[S]) -> S:
    """Return states as one, with a leading axis in front of every number in it."""
    first: Any = states[0]
    if first is None:
        return states[0]
    if dataclasses.is_dataclass(first):
        parts = {
            f.name: stack([getattr(each, f.name) for each in states])
            for f in dataclasses.fields(first)
        }
        kind: Any = type(states[0])
        return kind(**parts)
    if isinstance(first, Mapping):
        return {key: stack([each[key] for each in states]) for key in first}  # type: ignore
    return np.stack([np.asarray(each) for each in states])  # type: ignore[return-value]
