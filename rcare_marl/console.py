"""What people read goes through here; JSON does not."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

PIPE_WIDTH = 120  # [characters] where there is no terminal to ask


def console(*, stderr: bool = False) -> Console:
    """Return a console on standard output or standard error."""
    stream = sys.stderr if stderr else sys.stdout
    return Console(stderr=stderr, highlight=False, width=None if stream.isatty() else PIPE_WIDTH)


def print_error(message: str) -> None:
    """Print one red line on standard error."""
    text = Text(f"error: {' '.join(message.split())}", style="red")
    console(stderr=True).print(text, soft_wrap=True)


def print_line(message: str) -> None:
    """Print one plain line on standard error, out of the way of results."""
    console(stderr=True).print(Text(message), soft_wrap=True)


def progress(label: str) -> Progress:
    """Return a bar on standard error that leaves no trace; none where there is no terminal."""
    screen = console(stderr=True)
    return Progress(
        TextColumn(label),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}", style="dim"),
        console=screen,
        transient=True,
        disable=not screen.is_terminal,
    )


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of texts in Markdown, without a newline at its end."""
    lines = (columns, ["---"] * len(columns), *rows)
    cells = ([f" {cell} " if cell else " " for cell in line] for line in lines)
    return "\n".join(f"|{'|'.join(line)}|" for line in cells)


def table(
    title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], **right: bool
) -> Table:
    """Return a table of texts; a column is aligned right where `right` names it so.

    A row without cells begins a group.
    """
    out = Table(
        title=Text(title, style="bold"), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False
    )
    for column in columns:
        out.add_column(Text(column), justify="right" if right.get(column) else "left")
    for row in rows:
        if row:
            out.add_row(*(Text(cell) for cell in row))
        else:
            out.add_section()
    return out
