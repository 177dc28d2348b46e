"""Statistics over a handful of training runs: interquartile means, and intervals by resampling.

Runs of different seeds are few and uneven, so that a mean and its standard error mislead. Source: Agarwal,
Schwarzer, Castro, Courville and Bellemare (2021), "Deep reinforcement learning at the edge of the
statistical precipice", NeurIPS 34.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats  # type: ignore[import-untyped]

from rcare_marl.errors import ConfigError

CUT = 0.25  # of the values at either end
CONFIDENCE = 0.95
RESAMPLES = (
    10_000  # [1]; an end of an interval then moves by less than 0.1 % of its width; own choice
)

Numbers = npt.NDArray[np.float64]
Statistic = Callable[..., Any]


def interquartile_mean(values: npt.ArrayLike, axis: int | None = None) -> Any:
    """Return the mean of the middle half: a quarter of the values is left out at either end.

    Where a quarter is no whole number of values it is rounded down, as in `scipy.stats.trim_mean`.

    Args:
        values: The values.
        axis: Along which; all of them if None, which gives a number.
    """
    return stats.trim_mean(np.asarray(values, np.float64), CUT, axis=axis)


def stratified_interval(
    strata: Sequence[Sequence[float]],
    *,
    statistic: Statistic = interquartile_mean,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
    seed: int = 0,
) -> tuple[float, float] | None:
    """Return the interval of a statistic of all values by the stratified bootstrap, percentile method.

    Each stratum is resampled by itself, as often as it has values, so that none gains weight by chance.
    The strata of Agarwal et al. (2021) are tasks, the values in them one score a training run.

    Args:
        strata: Values by stratum.
        statistic: Takes an array and an `axis`.
        resamples: How often.
        confidence: Share of the resamples within the interval.
        seed: Of the resampling: the same seed gives the same interval.

    Returns:
        Low and high end; None where no stratum has two values, since nothing varies then.

    Raises:
        ConfigError: If there is no stratum, or one is empty.
    """
    samples = _samples(strata)
    if all(len(sample) < 2 for sample in samples):
        return None

    # SciPy resamples each sample by itself, which is what a stratum wants, but refuses one of a single
    # value; that one never changes.
    fixed = [sample for sample in samples if len(sample) < 2]

    def pooled(*parts: Numbers, axis: int = -1) -> Any:
        shape = np.shape(parts[0])[:-1]
        held = [np.broadcast_to(sample, (*shape, len(sample))) for sample in fixed]
        return statistic(np.concatenate([*parts, *held], axis=axis), axis=axis)

    found = stats.bootstrap(
        [sample for sample in samples if len(sample) > 1],
        pooled,
        n_resamples=resamples,
        batch=1000,
        vectorized=True,
        axis=-1,
        confidence_level=confidence,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return float(found.low), float(found.high)


def hierarchical_interval(
    runs: Sequence[Sequence[float]],
    *,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
    seed: int = 0,
) -> tuple[float, float]:
    """Return the interval of the mean over runs, by resampling runs and then episodes in each.

    It holds for training again with other seeds and for meeting other episodes. Of one run it holds for
    other episodes alone. Source: Saravanan, Berman and Sober (2020), "Application of the hierarchical
    bootstrap to multi-level data in neuroscience", Neurons, Behavior, Data analysis and Theory 3(5),
    from memory.

    Args:
        runs: The values of the episodes of each run, such as 1 for a success and 0 for none.
        resamples: How often.
        confidence: Share of the resamples within the interval.
        seed: Of the resampling.

    Raises:
        ConfigError: If there is no run, or one is empty.
    """
    samples = _samples(runs)
    rng = np.random.default_rng(seed)
    sizes = np.array([len(sample) for sample in samples])
    table = np.zeros((len(samples), sizes.max()))
    for row, sample in zip(table, samples, strict=True):
        row[: len(sample)] = sample
    total = np.zeros(resamples)
    for _ in samples:  # one run drawn after the other, in all resamples at once
        run = rng.integers(len(samples), size=resamples)
        size = sizes[run][:, None]
        episode = (rng.random((resamples, table.shape[1])) * size).astype(np.intp)
        drawn = table[run[:, None], episode]
        counted = np.arange(table.shape[1]) < size  # a shorter run fills its row in part
        total += (drawn * counted).sum(axis=1) / size[:, 0]
    tail = (1 - confidence) / 2
    low, high = np.quantile(total / len(samples), (tail, 1 - tail))
    return float(low), float(high)


def _samples(groups: Sequence[Sequence[float]]) -> list[Numbers]:
    samples = [np.asarray(group, np.float64).ravel() for group in groups]
    if not samples or not all(len(sample) for sample in samples):
        raise ConfigError("a statistic needs at least one group, and a value in each")
    return samples
