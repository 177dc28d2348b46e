"""Statistics over training runs, against cases worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from rcare_marl.baselines.evaluation.statistic import (
    hierarchical_interval,
    interquartile_mean,
    stratified_interval,
)
from rcare_marl.errors import ConfigError


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        ([1, 2, 3, 4], 2.5),  # a quarter of four is one
        ([0, 10, 11, 100], 10.5),
        ([5, 1, 3, 2, 4], 3),  # a quarter of five is one, rounded down
        ([0, 0, 0, 1, 1, 1, 1, 100], 0.75),
        ([7], 7),
        ([1, 2, 3], 2),  # nothing to leave out
    ],
)
def test_interquartile_mean_is_that_of_the_middle_half(values: list[float], wanted: float) -> None:
    assert interquartile_mean(values) == wanted


def test_interquartile_mean_goes_along_an_axis() -> None:
    rows = np.array([[1, 2, 3, 40], [0, 10, 20, 30]])
    np.testing.assert_array_equal(interquartile_mean(rows, axis=1), [2.5, 15])


def test_stratified_interval_is_that_of_all_resamples_counted_out() -> None:
    # Two strata of two values each: four resamples of either, sixteen of both, all equally likely.
    # Four times their means: 8, 9 twice, 10, 12 twice, 13 four times, 14 twice, 16, 17 twice, 18.
    for confidence, low, high in ((0.4, 12, 14), (0.8, 9, 17), (0.95, 8, 18)):
        strata = [[0.0, 1.0], [4.0, 8.0]]
        got = stratified_interval(strata, statistic=np.mean, confidence=confidence)
        assert got == pytest.approx((low / 4, high / 4))


def test_strata_are_resampled_by_themselves() -> None:
    # Without strata a resample could take its values from one of them and the mean leave 4.5 to 5.5.
    low, high = stratified_interval([[0, 1], [9, 10]] * 10, statistic=np.mean) or (0, 0)
    assert 4.5 < low < 5 < high < 5.5


def test_stratified_interval_of_one_task_is_close_to_the_normal_one_of_many_runs() -> None:
    values = np.random.default_rng(3).normal(10, 2, 400)
    low, high = stratified_interval([list(values)], statistic=np.mean) or (0, 0)
    half = 1.96 * values.std() / 20
    assert (low, high) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.02)


def test_a_stratum_of_one_value_stays_as_it_is() -> None:
    low, high = stratified_interval([[0, 1], [5]], statistic=np.mean) or (0, 0)
    assert (low, high) == pytest.approx((5 / 3, 7 / 3))
    assert stratified_interval([[1], [2]]) is None


def test_the_same_values_have_no_width() -> None:
    assert stratified_interval([[0.9] * 5]) == pytest.approx((0.9, 0.9))
    assert hierarchical_interval([[1.0] * 10] * 5) == (1.0, 1.0)


def test_the_same_seed_gives_the_same_interval() -> None:
    runs = [[0, 1, 1, 0, 1], [1, 1, 1, 0, 1], [0, 0, 1, 0, 0]]
    for interval in (stratified_interval, hierarchical_interval):
        assert interval(runs, seed=4) == interval(runs, seed=4)
    few = {hierarchical_interval(runs, seed=seed, resamples=20) for seed in range(5)}
    assert len(few) > 1


def test_hierarchical_interval_of_one_run_is_that_of_its_episodes() -> None:
    # 80 of 100: the resampled count is binomial, with the quantiles 72 and 87 in any table.
    assert hierarchical_interval([[1] * 80 + [0] * 20]) == pytest.approx((0.72, 0.87), abs=0.0051)


def test_hierarchical_interval_of_even_runs_is_that_of_drawing_runs() -> None:
    # Runs of 0 and 1 throughout: two draws give 0, 1/2, 1 with probabilities 1/4, 1/2, 1/4.
    runs = [[0.0] * 50, [1.0] * 50]
    assert hierarchical_interval(runs) == (0.0, 1.0)
    assert hierarchical_interval(runs, confidence=0.4) == (0.5, 0.5)


def test_hierarchical_interval_is_wider_than_that_of_pooled_episodes_where_runs_differ() -> None:
    rng = np.random.default_rng(0)
    runs = [list((rng.random(100) < rate).astype(float)) for rate in (0.5, 0.7, 0.9, 0.95, 1.0)]
    low, high = hierarchical_interval(runs)
    least, most = hierarchical_interval([[v for run in runs for v in run]])
    assert low < least and high > most
    assert high - low > 2 * (most - least)


def test_hierarchical_interval_takes_runs_of_different_lengths() -> None:
    # A run of one value and one of many: the mean is of runs, so each counts half.
    low, high = hierarchical_interval([[1.0], [0.0] * 99], confidence=0.4)
    assert (low, high) == (0.5, 0.5)


@pytest.mark.parametrize("groups", [[], [[]], [[1.0], []]])
def test_nothing_to_sum_up_is_refused(groups: list[list[float]]) -> None:
    for interval in (stratified_interval, hierarchical_interval):
        with pytest.raises(ConfigError, match="at least one group"):
            interval(groups)


def test_the_interquartile_mean_is_that_of_rliable() -> None:
    metrics = pytest.importorskip("rliable.metrics", reason="the authors' own library")
    for runs in (3, 5, 8):
        scores = np.random.default_rng(1).beta(4, 2, (runs, 6))
        assert interquartile_mean(scores) == pytest.approx(metrics.aggregate_iqm(scores))
