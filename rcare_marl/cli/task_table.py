"""The tables of `docs/tasks.md`, from the classes: python -m rcare_marl.cli.task_table docs/tasks.md."""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path

from rcare_marl import assets
from rcare_marl.baselines.trained.elsewhere import Figure, is_refused, of_script
from rcare_marl.console import markdown_table
from rcare_marl.envs.registry import task_class, task_names

from .listing import first_line

BEGIN, END = "<!-- from the classes: {} -->", "<!-- end -->"
SUCCESS = re.compile(
    r"\b(?:Success(?: and failure)?|Goal): (.*?)(?:\n\s*\w[\w ]*: |\n\n|$)", re.DOTALL
)


def tables() -> dict[str, str]:
    """Return what stands between the marks of each table: `tasks` and `robots`, in Markdown."""
    return {"tasks": _tasks(), "robots": _robots()}


def filled(page: str) -> str:
    """Return a page with its tables made anew."""
    for name, table in tables().items():
        begin = BEGIN.format(name)
        head, _, rest = page.partition(begin)
        _, _, tail = rest.partition(END)
        page = f"{head}{begin}\n{table}\n{END}{tail}"
    return page


def _tasks() -> str:
    rows = []
    for name in task_names():
        cls = task_class(name)
        cast = "; ".join(part.default for part in cls.roles().values() if part.default)
        text = inspect.getdoc(cls) or ""
        found = SUCCESS.search(text)
        ends = " ".join(found.group(1).split()).rstrip(".") if found else ""
        rows.append((f"`{name}`", cast, first_line(cls), ends))
    return markdown_table(("task", "default cast", "what happens", "success"), rows)


def _robots() -> str:
    tasks = [name for name in task_names() if task_class(name).reachable_by is not None]
    rows = [
        (f"`{robot}`", *(_reach(task, robot) for task in tasks)) for robot in assets.names("robots")
    ]
    return markdown_table(("robot", *(name.replace("_", " ") for name in tasks)), rows)


def _reach(task: str, robot: str) -> str:
    """Return what a robot comes to in a task: that it reaches, or how often its script came off."""
    if robot not in (task_class(task).reachable_by or ()):
        return ""
    told = [_counted(task, row) for row in of_script(task, robot)]
    return "<br>".join(told) or "yes"


def _counted(task: str, row: Figure) -> str:
    level = f"{row.cast['level']}: " if "level" in row.cast else ""
    return f"{level}{row.done} of {row.of}{', **refused**' if is_refused(task, row) else ''}"


if __name__ == "__main__":
    for file in map(Path, sys.argv[1:]):
        file.write_text(filled(file.read_text(encoding="utf-8")), encoding="utf-8")
