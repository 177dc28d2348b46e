"""Networks of several seeds as one that does their mean (L. Breiman, Bagging predictors, 1996).

Where one seed errs to this side and another to that, their mean errs less. It is a network like others,
with the layers side by side: whoever plays it needs nothing new.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rcare_marl.errors import ConfigError

from .policy_file import PolicyFile, Weights

ALIKE = tuple(
    "task group roles observed action_size action_low residual hold actions recipe view memory flags".split()
)


def mean_of(policies: Sequence[PolicyFile]) -> PolicyFile:
    """Return one network whose last layer gives the mean of what those of several give, before the tanh.

    It is so of observations that none of them clips. What they keep in mind is a mean, too, so that all go
    by the same. `training` is that of the first, with the seeds and the minutes of all.

    Raises:
        ConfigError: If there are less than two, or they differ in what they read or do, or in their layers.
    """
    if len(policies) < 2:
        raise ConfigError(f"a mean takes two policies or more, got {len(policies)}")
    first = policies[0]
    for number, policy in enumerate(policies[1:], 2):
        faults = [name for name in ALIKE if getattr(policy, name) != getattr(first, name)]
        if len(policy.layers) != len(first.layers):
            faults.append("number of layers")
        if faults:
            raise ConfigError(f"policy {number} differs from the first: {', '.join(faults)}")
    begin = [_reading_as(first, policy) for policy in policies]
    layers = [(np.concatenate([w for w, _ in begin]), np.concatenate([b for _, b in begin]))]
    layers += [_side_by_side([p.layers[k] for p in policies]) for k in range(1, len(first.layers))]
    count = len(first.layers[-1][1])
    weights, biases = (part.reshape(len(policies), count, -1) for part in layers.pop())
    layers.append((weights.mean(0), biases.mean(0).reshape(count)))
    seeds = [policy.training.get("seed") for policy in policies]
    minutes = sum(policy.training.get("minutes", 0.0) for policy in policies)
    return replace(
        first,
        layers=tuple(layers),
        training={**first.training, "seed": seeds, "minutes": round(minutes, 3)},
    )


def _reading_as(first: PolicyFile, policy: PolicyFile) -> tuple[Weights, Weights]:
    """Return a policy's first layer for observations that another one normalises."""
    weights, biases = (part.astype(np.float64) for part in policy.layers[0])
    shift = (first.mean.astype(np.float64) - policy.mean) / policy.scale
    part = weights * (first.scale.astype(np.float64) / policy.scale)
    return part.astype(np.float32), (biases + weights @ shift).astype(np.float32)


def _side_by_side(layers: Sequence[tuple[Weights, Weights]]) -> tuple[Weights, Weights]:
    """Return one layer of which each block reads what its own one before gives."""
    widths = [weights.shape for weights, _ in layers]
    joined = np.zeros(np.sum(widths, axis=0), np.float32)
    row = column = 0
    for weights, _ in layers:
        joined[row : row + len(weights), column : column + weights.shape[1]] = weights
        row, column = row + weights.shape[0], column + weights.shape[1]
    return joined, np.concatenate([biases for _, biases in layers])
