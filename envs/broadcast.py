"""Functions of numbers, of NumPy arrays and of torch tensors alike, each where its arguments are.

Tensors are computed with by torch, on their device; nobody who has none loads it. A number beside tensors
takes their kind, and among numbers alone torch's default kind.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import torch

Values = Any  # a number, or an array or tensor of numbers with the leading axes of the states
FALL = math.log(0.1)  # of the logarithm over the margin, of `tolerance`


def torch_of(*values: Values) -> Any:
    """Return the module torch where one of the values is a tensor, else None."""
    torch = sys.modules.get("torch")  # where it was never loaded there are no tensors
    if torch is None:
        return None
    return torch if any(isinstance(value, torch.Tensor) for value in values) else None


def where(condition: Values, yes: Values, no: Values) -> Values:
    """Return `yes` where a condition holds, else `no`; a number for a number."""
    if isinstance(condition, bool | np.bool_):
        return yes if condition else no
    return (torch_of(condition) or np).where(condition, yes, no)


def negate(condition: Values) -> Values:
    """Return whether a condition does not hold."""
    if isinstance(condition, bool):
        return not condition
    return (torch_of(condition) or np).logical_not(condition)


def clip(value: Values, low: float, high: float) -> Values:
    """Return values limited to a range."""
    if isinstance(value, float):
        return min(max(value, low), high)
    return (torch_of(value) or np).clip(value, low, high)


def degrees(angle: Values) -> Values:
    """Return angles [rad] in degrees."""
    return angle * (180.0 / math.pi)


def norm(vectors: Values) -> Values:
    """Return the lengths of vectors, shape [...] from [..., n]."""
    return (torch_of(vectors) or np).linalg.norm(vectors, axis=-1)


def tolerance(x: Values, bounds: tuple[Values, Values] = (0.0, 0.0), margin: float = 0.0) -> Values:
    """Return 1 inside `bounds`, falling to 0.1 at `margin` outside of them: a term of a reward."""
    low, high = bounds
    is_fixed = isinstance(low, int | float) and isinstance(high, int | float)
    torch = None if is_fixed and isinstance(x, float) else torch_of(x, low, high)
    if margin < 0 or (low > high if is_fixed else torch is None and np.any(low > high)):
        raise ValueError(f"need low <= high and margin >= 0, got bounds {bounds}, margin {margin}")
    if is_fixed and isinstance(x, float):  # numpy takes ten times as long for a single number
        beyond = max(low - x, x - high, 0.0)
    elif torch is None:
        beyond = np.maximum(np.maximum(low - x, x - high), 0.0)
    else:
        beyond = greatest([low - x, x - high, 0.0])
    if margin == 0:
        return where(beyond > 0, 0.0, 1.0)
    distance = beyond / margin
    return (torch or np).exp(FALL * (distance * distance))


def greatest(values: Sequence[Values]) -> Values:
    """Return the greatest of values, one by one; 0 if there are none."""
    if len(values) < 2:
        return values[0] if values else 0.0
    if (torch := torch_of(*values)) is not None:
        return _greatest(torch, values)
    return np.maximum.reduce([np.asarray(value) for value in values])[()]


def _greatest(torch: Any, values: Sequence[Values]) -> torch.Tensor:
    like = next(value for value in values if isinstance(value, torch.Tensor))
    most, *others = (torch.as_tensor(v, dtype=like.dtype, device=like.device) for v in values)
    for other in others:
        most = torch.maximum(most, other)
    return most


def flat(rows: Values) -> Values:
    """Return the rows of matrices one after the other: shape [..., n * m] from [..., n, m]."""
    return rows.reshape(*rows.shape[:-2], -1)
