"""The command `evaluate --over`: a row for each cell, sums by each axis, and a file that is always whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich.text import Text

from rcare_marl.atomic_file import write_whole
from rcare_marl.baselines.evaluation.axes import parse_over
from rcare_marl.baselines.evaluation.matrix import (
    Matrix,
    MatrixPlan,
    Outcome,
    run_matrix,
)
from rcare_marl.baselines.evaluation.protocol import record_text
from rcare_marl.console import console, print_line, progress, table

from .assessment import figure
from .parameter import print_json

__all__ = ["MatrixPlan", "parse_over", "run", "show"]
ONE = {"people": "person", "robots": "robot", "partners": "partner", "homes": "home"}
NUMBERS = ("success", "95 % interval", "mean peak", "greatest force")
IN_ROOM = "room"  # how often touched, how often nearly, least clearance
FAULTS = ("refused", "infeasible", "crashed")


def run(plan: MatrixPlan, *, processes: int, output: Path | None, as_json: bool) -> bool:
    """Run a plan and print what came of it; the file holds whatever is finished, from the first cell on.

    Returns:
        Whether no cell crashed.

    Raises:
        KeyboardInterrupt: After what was finished is printed.
    """
    cells = plan.cells()
    finished = Matrix(plan, ())

    def keep(so_far: Matrix, last: Outcome) -> None:
        nonlocal finished
        finished = so_far
        if last.state == "crashed":
            print_line(f"{last.cell.name}: crashed: {last.reason}")
        if output is not None:
            write_whole(output, record_text(so_far.to_dict()).encode())

    try:
        with progress(f"{plan.task}, {len(cells)} {'cell' if len(cells) == 1 else 'cells'}") as bar:
            job = bar.add_task("", total=len(cells) * plan.episodes)
            tell = partial(bar.advance, job)
            run_matrix(plan, processes=processes, on_progress=tell, on_cell=keep)
    finally:
        if finished.outcomes:
            _report(finished, output, as_json)
    return not any(each.state == "crashed" for each in finished.outcomes)


def _report(matrix: Matrix, output: Path | None, as_json: bool) -> None:
    if as_json:
        brief = matrix.to_dict()
        for cell in brief["cells"]:
            cell.pop("episodes_by_column", None)
        print_json(brief)
        return
    show(matrix)
    if output is not None:
        print_line(f"wrote {output}")


def show(matrix: Matrix) -> None:
    """Print a table of all cells, and one of the sums."""
    plan, screen = matrix.plan, console()
    seeds = [each.seed for each in plan.cells()]
    last = seeds[-1] + plan.episodes - 1
    of = " of each" if seeds[-1] == plan.seed else f", {plan.episodes} for each person"
    fixed = {"policy": plan.policy, **plan.others, **plan.options, **plan.cast}
    fixed |= {"perturbed": "+".join(plan.randomise)} if plan.randomise else {}
    beside = ", ".join(f"{name} {value}" for name, value in fixed.items())
    title = f"{plan.task}: {beside}; seeds {plan.seed} to {last}{of}"
    axes = [ONE[axis] for axis in plan.cells()[0].values()]
    total, sums = matrix.total(), list[tuple[str, ...]]()
    shown = NUMBERS if total["room_clearance_m"] is None else (*NUMBERS, IN_ROOM)
    right = dict.fromkeys(shown, True)
    notes: list[str] = []
    rows = [_row(each, shown, notes) for each in matrix.outcomes]
    screen.print(table(title, (*axes, *shown, "note"), rows, **right))
    counts = ["cells", *(name for name in FAULTS if total[name])]
    several = matrix.sums() if len(plan.over) > 1 else {}  # else they are the rows above
    for axis, values in several.items():
        sums += [
            *(
                (ONE[axis], name, *_summed(numbers, shown, counts))
                for name, numbers in values.items()
            ),
            (),
        ]
    sums += [("all", "", *_summed(total, shown, counts))]
    columns = ("over", "", *shown, *counts)
    right |= dict.fromkeys(counts, True)
    screen.print(table("sums: of the feasible", columns, sums, **right))
    for number, note in enumerate(notes, 1):
        screen.print(Text(f"[{number}] {note}"), soft_wrap=True)
    if not matrix.is_complete:
        left = len(plan.cells()) - len(matrix.outcomes)
        screen.print(Text(f"{left} cells were not finished", style="yellow"))


def _row(outcome: Outcome, shown: Sequence[str], notes: list[str]) -> tuple[str, ...]:
    """Return the row of a cell; what is to be said of it is added to the notes, each once."""
    numbers = outcome.to_dict()
    reason, short = outcome.reason, str(outcome.state)
    if outcome.result is not None:
        reason, short = outcome.result.infeasible, "cannot be done"
    if not reason:
        return (*outcome.cell.values().values(), *_numbers(numbers, shown), "")
    if reason not in notes:
        notes.append(reason)
    mark = f"{short} [{notes.index(reason) + 1}]"
    return (*outcome.cell.values().values(), *_numbers(numbers, shown), mark)


def _summed(
    numbers: Mapping[str, Any], shown: Sequence[str], counts: Sequence[str]
) -> tuple[str, ...]:
    return (*_numbers(numbers, shown), *(str(numbers[name] or "") for name in counts))


def _numbers(numbers: Mapping[str, Any], shown: Sequence[str]) -> tuple[str, ...]:
    room: tuple[str, ...] = ()
    if IN_ROOM in shown:
        clear = numbers["room_clearance_m"]
        met = (numbers["room_contacts"], numbers["room_near_misses"])
        room = ("",) if clear is None else (f"{met[0]:.0f}, {met[1]:.0f}, {100 * clear:.0f} cm",)
    mean, most = numbers["peak_force_n_mean"], numbers["peak_force_n_greatest"]
    forces = ("", "") if mean is None else (f"{figure(mean)} N", f"{figure(most)} N")
    if not numbers["feasible_episodes"]:
        return ("", "", *forces, *room)
    done, count = numbers["successes"], numbers["feasible_episodes"]
    low, high = numbers["success_interval_95"]
    return (f"{done} of {count}", f"{100 * low:.0f} to {100 * high:.0f} %", *forces, *room)
