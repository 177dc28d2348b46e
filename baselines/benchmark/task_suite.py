"""The command `bench all`: every task, at every level that it has of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rcare_marl.console import console, progress, table
from rcare_marl.envs import task_names
from rcare_marl.envs.registry import task_class
from rcare_marl.errors import RcareError

from . import environment as benchmark

LEVELS = (1, 2, 3)


def scenes() -> list[tuple[str, int | None]]:
    """Return each task with each level of what it builds by itself, or None where that has none."""
    out: list[tuple[str, int | None]] = []
    for name in task_names():
        levels = LEVELS if task_class(name).site else (None,)
        out += [(name, level) for level in levels]
    return out


def bench(steps: int = benchmark.STEPS, seed: int = 0) -> dict[str, Any]:
    """Return measured speeds of every task, as plain values for JSON.

    A task that cannot be built has `error` in place of figures. Ctrl-C ends it with what there is.

    Args:
        steps: Control steps to time in each.
        seed: Seed of resets and actions.
    """
    rows: list[dict[str, Any]] = []
    interrupted = False
    with progress("bench all") as bar:
        job = bar.add_task("", total=len(scenes()))
        try:
            for name, level in scenes():
                bar.update(job, description=name if level is None else f"{name}, level {level}")
                rows.append(_row(name, level, steps, seed))
                bar.advance(job)
        except KeyboardInterrupt:
            interrupted = True
    return {
        "tasks": rows,
        "complete": not interrupted and not any("error" in row for row in rows),
        "interrupted": interrupted,
        **benchmark.surroundings(),
    }


def _row(name: str, level: int | None, steps: int, seed: int) -> dict[str, Any]:
    place = {} if level is None else {"level": level}
    try:
        return benchmark.bench(name, steps, seed, place)
    except RcareError as error:
        return {"task": name, "level": level or 1, "error": str(error)}


def show(result: Mapping[str, Any]) -> None:
    """Print what `bench` returned as a table."""
    columns = ("task, level", "real time", "", "overhead", "", "same commands", "reset [ms]", "")
    rows: list[tuple[str, ...]] = []
    leveled = {name for name, level in scenes() if level is not None}
    for row in result["tasks"]:
        name = row["task"]
        label = f"{name}, {row['level']}" if name in leveled else name
        if "error" in row:
            rows.append((label, "error: " + " ".join(row["error"].split())))
            continue
        wanted, met = row["wanted"], row["met"]
        cells = [label]
        for key, text, sign in (
            ("real_time_factor", f"{row['real_time_factor']:.1f}", "≥"),
            ("overhead_ratio", f"{row['overhead_ratio']:.2f}", "≤"),
            ("overhead_ratio_same_commands", f"{row['overhead_ratio_same_commands']:.2f}", ""),
            ("reset_ms", f"{row['reset_ms']:.1f}", "≤"),
        ):
            cells.append(text)
            if sign:
                bound = f"{sign} {wanted[key]:g}" if key in wanted else ""
                cells.append(bound if met.get(key, True) else f"{bound} missed")
        rows.append(tuple(cells))
    title = "all tasks" if not result["interrupted"] else "tasks until it was interrupted"
    right = dict.fromkeys(("real time", "overhead", "same commands", "reset [ms]"), True)
    console().print(table(title, columns, rows, **right))
