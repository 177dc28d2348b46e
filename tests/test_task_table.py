"""The tables of docs/tasks.md say what the classes say."""

from pathlib import Path

from rcare_marl.cli.task_table import filled
from rcare_marl.envs.registry import task_names

PAGE = Path(__file__).resolve().parents[1] / "docs" / "tasks.md"


def test_the_tables_are_up_to_date_and_name_every_task() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert filled(page) == page, "run: python -m rcare_marl.cli.task_table docs/tasks.md"
    assert all(f"| `{name}` |" in page for name in task_names())
