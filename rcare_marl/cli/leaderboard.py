"""The command `evaluate --protocol`: a bar while it runs, a table in the end, a file that is always whole."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich.text import Text

from rcare_marl.atomic_file import write_whole
from rcare_marl.baselines.evaluation.leaderboard import Protocol, judge, rows_of
from rcare_marl.baselines.evaluation.matrix import Outcome
from rcare_marl.baselines.evaluation.protocol import find_policies, record_text
from rcare_marl.console import console, print_line, progress, table

from .parameter import print_json


def run(
    task: str,
    name: str,
    patterns: Sequence[str],
    *,
    processes: int,
    output: Path | None,
    as_json: bool,
) -> bool:
    """Judge policies by a protocol and print what came of it, also after Ctrl-C.

    Returns:
        Whether no cell crashed.

    Raises:
        KeyboardInterrupt: After what was finished is printed.
    """
    so_far: dict[str, Any] = {}

    def keep(record: dict[str, Any], last: Outcome) -> None:
        so_far.update(record)
        if last.state == "crashed":
            print_line(f"{last.cell.name}: crashed: {last.reason}")
        if output is not None:
            write_whole(output, record_text(record).encode())

    protocol, policies = Protocol.find(name), find_policies(patterns)
    try:
        with progress(f"{task}, protocol {protocol.name}") as bar:
            job = bar.add_task("", total=None)
            judge(
                protocol,
                task,
                policies,
                processes=processes,
                on_start=lambda total: bar.update(job, total=total),
                on_progress=partial(bar.advance, job),
                on_cell=keep,
            )
    finally:
        if so_far and as_json:
            print_json(so_far)
        elif so_far:
            _show(so_far, output)
    rows = [row for found in so_far["policies"].values() for row in found["rows"].values()]
    return not any(row["crashed"] for row in rows)


def _show(record: dict[str, Any], output: Path | None) -> None:
    heads, rows = rows_of([record])
    title = f"{record['task']}: protocol {record['protocol']}, version {record['version']}"
    console().print(table(title, heads, rows))
    missing = next(iter(record["policies"].values()))["not_in_this_task"]
    for row, reason in missing.items():
        console().print(Text(f"no row {row!r}: {reason}"), soft_wrap=True)
    if not record["complete"]:
        console().print(Text("some cells were not finished", style="yellow"))
    if output is not None:
        print_line(f"wrote {output}")
