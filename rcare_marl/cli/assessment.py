"""The command `evaluate`: a bar while it runs, a table in the end; a record, and running it once more."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rich.table import Table
from rich.text import Text

from rcare_marl.agents.people.physiology_model import REGIONS
from rcare_marl.atomic_file import write_whole
from rcare_marl.baselines.evaluation import evaluate as baseline
from rcare_marl.baselines.evaluation.protocol import (
    Plan,
    Record,
    Repetition,
    assess,
    find_policies,
    read_record,
    record_text,
    repeat,
    saved_files,
)
from rcare_marl.baselines.policy_file import SUFFIX
from rcare_marl.console import console, print_line, progress, table
from rcare_marl.envs.datasets import Dataset
from rcare_marl.envs.episode import RecordedEpisode
from rcare_marl.envs.safety import NOBODY

from .parameter import print_json

RUN_COLUMNS = ("policy", "success", "95 % interval", "return", "peak force")
COLUMNS = ("measure", "mean", "95 % interval", "IQM", "95 % interval of it", "most")
SHOWN = 12  # differences of a repetition
LAST_STEP = ("force_n", "cost")  # an episode has peak_force_n, and its sum of costs
BY_REGION = tuple(f"peak_force_{region}_n" for region in REGIONS)


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


def run(
    task: str,
    policies: Sequence[str],
    others: Mapping[str, str],
    *,
    episodes: int,
    seed: int,
    processes: int,
    options: Mapping[str, Any],
    cast: Mapping[str, Any],
    randomise: Any = None,
    save: Path | None = None,
    dataset: Path | None = None,
) -> Record:
    """Return the record of an evaluation; `policies` are names, files or patterns of files.

    Episodes go one by one to the folder `save`, and all of them to the dataset.
    """
    plan = Plan(
        task,
        find_policies(policies),
        others=dict(others),
        episodes=episodes,
        seed=seed,
        options=dict(options),
        cast=dict(cast),
        randomise=randomise,
    )
    count = len(plan.policies)
    with progress(f"{task}, {count} {'policy' if count == 1 else 'policies'}") as bar:
        job = bar.add_task("", total=count * episodes)
        tell = partial(bar.advance, job)
        with ExitStack() as stack:
            if dataset is not None:  # what cannot be written is told before anything runs
                made = stack.enter_context(closing(Dataset(dataset)))
                save = save or Path(stack.enter_context(TemporaryDirectory()))
            record = assess(plan, processes=processes, on_progress=tell, save=save)
            if dataset is not None and save is not None:
                for file in saved_files(plan, save):
                    made.add(RecordedEpisode.read(file))
        return record


def report(
    record: Record, *, output: Path | None, plot: Path | None, as_json: bool, of_one: bool
) -> None:
    """Print a record, and write it and its figure to files where they are named.

    Args:
        record: The record.
        output: Where to write all of it.
        plot: Where to draw it.
        as_json: Whether to print JSON.
        of_one: Whether the JSON is of the evaluation of its one policy.
    """
    if output is not None:
        write_whole(output, record_text(record.to_dict()).encode())
    if plot is not None:
        from rcare_marl.baselines.evaluation import episode_figure

        write_whole(plot, episode_figure.draw_record(record))
    if as_json:
        brief = record.runs[0].to_dict() if of_one else record.to_dict()
        for entry in () if of_one else brief["policies"]:
            del entry["episodes"]
        print_json(brief)
        return
    show(record)
    for file in (output, plot):
        if file is not None:
            print_line(f"wrote {file}")


def show(record: Record) -> None:
    """Print a record: a row a policy, then what holds over all of them."""
    plan, models = record.plan, record.runs[0].cast
    who = ", ".join(f"{role} {model}" for role, model in models.items())
    last = plan.seed + plan.episodes - 1
    title = f"{plan.task}: {who}; seeds {plan.seed} to {last} each"
    right = dict.fromkeys(RUN_COLUMNS[1:], True)
    screen = console()
    screen.print(table(title, RUN_COLUMNS, _run_rows(record), **right))
    numbers = record.summary()
    names = [name for name in numbers if name != "success"]
    lead = [name for name in names if name.startswith("return_")]
    safety = [name for name in names if name in NOBODY or name.startswith("cost_")]
    own = [name for name in names if name not in (*lead, *safety)]
    kept = [name for name in safety if name not in LAST_STEP]
    kept = [name for name in kept if name not in BY_REGION or numbers[name]["max"]]
    sections = (lead, own, kept)
    told = _pooled if record.is_one_training else _side_by_side
    screen.print(told(record, numbers, sections))
    for name, result in zip(plan.policies, record.runs, strict=True):
        done, count = sum(each.success for each in result.feasible), len(result.feasible)
        notes = [f"{len(result.refused)} people refused"] if result.refused else []
        if result.infeasible:
            notes.append(f"cannot be done: {result.infeasible}")
        elif count < len(result.episodes):
            notes.append(f"success in {done} of {count} feasible episodes")
        for note in notes:
            screen.print(Text(f"{name}: {note}", style="yellow"), soft_wrap=True)
    for name, reward in record.other_rewards().items():
        note = f"{name} was trained on the reward {reward!r}: for those returns add --option reward={reward}"
        screen.print(Text(note, style="yellow"), soft_wrap=True)


def _pooled(record: Record, numbers: Mapping[str, Any], sections: Sequence[Sequence[str]]) -> Table:
    """Return the table of what holds over the seeds of one training."""
    lead, *rest = sections
    rows = [_success_row(numbers["success"]), *(_row(name, numbers[name]) for name in lead)]
    for names in rest:
        rows += [(), *(_row(name, numbers[name]) for name in names)]
    count = len(record.runs)
    note = f"over {count} policies" if count > 1 else "of one policy"
    return table(note, COLUMNS, rows, **dict.fromkeys(COLUMNS[1:], True))


def _side_by_side(
    record: Record, numbers: Mapping[str, Any], sections: Sequence[Sequence[str]]
) -> Table:
    """Return the table of each policy's means, where a mean over them would say nothing."""
    policies = record.plan.policies
    short = [Path(name).parent.name if Path(name).suffix == SUFFIX else name for name in policies]
    columns = short if len(set(short)) == len(short) and "" not in short else list(policies)
    rows: list[tuple[str, ...]] = []
    for names in sections:
        rows += [(), *((_title(n), *(figure(one) for one in numbers[n]["runs"])) for n in names)]
    return table("mean of each", ("measure", *columns), rows[1:], **dict.fromkeys(columns, True))


def _run_rows(record: Record) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name, result in zip(record.plan.policies, record.runs, strict=True):
        numbers = result.to_dict()
        low, high = result.success_interval
        returned = next(iter(numbers["mean_return"].values()))
        peak = result.peak_force
        rows.append(
            (
                name,
                successes(result),
                f"{percent(low)} to {percent(high)}",
                figure(returned),
                "-" if peak is None else f"{peak:.1f} N",
            )
        )
    return rows


def _success_row(numbers: Mapping[str, Any]) -> tuple[str, ...]:
    def share(ends: Sequence[float] | None) -> str:
        return "" if ends is None else " to ".join(percent(end) for end in ends)

    return (
        "success",
        percent(numbers["mean"]),
        share(numbers["interval_95"]),
        percent(numbers["iqm"]),
        share(numbers["iqm_interval_95"]),
        "",
    )


def _title(name: str) -> str:
    return name.replace("_", " of ", 1) if name.startswith(("return_", "cost_")) else name


def _row(name: str, numbers: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        _title(name),
        figure(numbers["mean"]),
        interval(numbers["interval_95"]),
        figure(numbers["iqm"]),
        interval(numbers["iqm_interval_95"]),
        figure(numbers["max"]),
    )


def run_again(path: Path, *, processes: int) -> Repetition:
    """Return what came of running a record once more."""
    record = read_record(path)
    plan = record["plan"]
    with progress(f"{plan['task']}, once more") as bar:
        job = bar.add_task("", total=len(plan["policies"]) * plan["episodes"])
        return repeat(record, processes=processes, on_progress=partial(bar.advance, job))


def show_again(result: Repetition) -> None:
    """Print whether a record came out the same, and where not."""
    screen = console()
    for name in result.missing:
        screen.print(Text(f"not repeated: {name}", style="yellow"), soft_wrap=True)
    if not result.differences:
        text = f"the same numbers in {result.episodes} episodes of {', '.join(result.repeated)}"
        screen.print(Text(text, style="green"), soft_wrap=True)
        return
    count = len(result.differences)
    screen.print(Text(f"{count} columns of numbers came out otherwise", style="red"))
    for text in result.differences[:SHOWN]:
        screen.print(Text(f"  {text}"), soft_wrap=True)
    if count > SHOWN:
        screen.print(Text(f"  and {count - SHOWN} more"))
    for text in result.elsewhere:
        screen.print(Text(f"{text}", style="dim"), soft_wrap=True)
