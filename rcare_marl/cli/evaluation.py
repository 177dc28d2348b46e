"""The command `evaluate`: a bar while it runs, a table in the end."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rcare_marl.agents.people.physiology_model import REGIONS
from rcare_marl.baselines.evaluation import evaluate as baseline
from rcare_marl.console import console, table
from rcare_marl.envs.safety import NOBODY

COLUMNS = ("measure", "mean", "95 % interval", "most")
LAST_STEP = (
    "force_n",
    "cost",
)  # of a control step; an episode has peak_force_n, and its sum of costs
BY_REGION = tuple(f"peak_force_{region}_n" for region in REGIONS)


def show(result: baseline.Evaluation) -> None:
    """Print an evaluation as a table: what came of it, what the task reports, and safety."""
    who = ", ".join(
        f"{role} {result.cast[role]} ({name})" for role, name in result.policies.items()
    )
    last = result.seed + len(result.episodes) - 1
    title = f"{result.task}: {who}; seeds {result.seed} to {last}"
    numbers = result.to_dict()
    own = [name for name in result.episodes[0].metrics if name not in NOBODY]
    groups = [_outcome(result, numbers), [_row(name, numbers) for name in own], _safety(numbers)]
    rows: list[tuple[str, ...]] = []
    for group in groups:
        rows += [(), *group] if rows and group else group
    out = table(title, COLUMNS, rows, **dict.fromkeys(COLUMNS[1:], True))
    console().print(out)


def _outcome(result: baseline.Evaluation, numbers: Mapping[str, Any]) -> list[tuple[str, ...]]:
    low, high = result.success_interval
    label = f"success ({numbers['successes']} of {numbers['episodes']})"
    rows: list[tuple[str, ...]] = [
        (label, percent(result.success_rate), f"{percent(low)} to {percent(high)}", "")
    ]
    rows += _of_roles("return", numbers)
    return [*rows, ("control steps", f"{numbers['steps_mean']:.4g}", "", "")]


def _safety(numbers: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the rows of `envs.safety`, without the regions of the body that nothing pressed."""
    if "peak_force_n_mean" not in numbers:
        return []
    names = [name for name in NOBODY if name not in LAST_STEP]
    names = [name for name in names if name not in BY_REGION or numbers[f"{name}_max"]]
    return [*_of_roles("cost", numbers), *(_row(name, numbers) for name in names)]


def _of_roles(what: str, numbers: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return a row for each role, or one for all where they are alike."""
    means, intervals = numbers[f"mean_{what}"], numbers[f"mean_{what}_interval_95"]
    rows = [(figure(means[role]), interval(intervals[role]), "") for role in means]
    if len(rows) > 1 and len(set(rows)) == 1:
        return [(f"{what} of each", *rows[0])]
    return [(f"{what} of {role}", *row) for role, row in zip(means, rows, strict=True)]


def _row(name: str, numbers: Mapping[str, Any]) -> tuple[str, ...]:
    mean, most = numbers[f"{name}_mean"], numbers[f"{name}_max"]
    if mean is None:
        return (name, "never", "", "")
    return (name, figure(mean), interval(numbers[f"{name}_interval_95"]), figure(most))


def figure(value: float) -> str:
    """Return a number as a text of three digits, never as a power of ten where it is large."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def interval(bounds: Iterable[float] | None) -> str:
    """Return the ends of an interval as a text, empty where there is none."""
    return "" if bounds is None else " to ".join(figure(bound) for bound in bounds)


def successes(result: baseline.Evaluation) -> str:
    """Return how many episodes ended in success, as a text."""
    count = sum(episode.success for episode in result.episodes)
    return f"{count} of {len(result.episodes)}, {percent(result.success_rate)}"


def percent(share: float) -> str:
    """Return a share as a text in percent."""
    return f"{100 * share:.1f} %"
