"""What a task read from the engine in a control step: plain numbers and arrays, and functions over them.

`Task.read` makes a `State` once a control step. All that a task then observes, pays and counts is a
function of it and of the options, written so that it broadcasts: where every field has leading axes, of
worlds or of steps, every result has them too, as NumPy arrays or torch tensors as the fields are. Compare
numbers by operators, choose by `where`, limit by `clip`, join conditions by `&`, `|` and `negate`, take
other functions from `broadcast.py`, and index arrays from the last axis.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from rcare_marl.observable import Observable

from .broadcast import Values as Values
from .broadcast import clip as clip
from .broadcast import degrees as degrees
from .broadcast import flat as flat
from .broadcast import greatest as greatest
from .broadcast import negate as negate
from .broadcast import norm as norm
from .broadcast import tolerance as tolerance
from .broadcast import where as where
from .safety import Safety

S = TypeVar("S")


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

    def told_by(self, task: Any) -> Observable:
        """Return it as an agent observes it, read from the latest state of a task."""
        return Observable(self.name, self.unit, self.size, lambda: self.of(task.state))


def stack(states: Sequence[S], join: Callable[[Sequence[Any]], Any] = np.stack) -> S:
    """Return states as one, with a leading axis in front of every number in it.

    Args:
        states: At least one, all of a kind.
        join: Makes one of equal arrays, such as `lambda rows: torch.as_tensor(np.stack(rows))`.
    """
    first: Any = states[0]
    if first is None:
        return states[0]
    if dataclasses.is_dataclass(first):
        parts = {
            f.name: stack([getattr(each, f.name) for each in states], join)
            for f in dataclasses.fields(first)
        }
        kind: Any = type(states[0])
        return kind(**parts)
    if isinstance(first, Mapping):
        return {key: stack([each[key] for each in states], join) for key in first}  # type: ignore
    return join([np.asarray(each) for each in states])
