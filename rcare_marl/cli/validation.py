"""The command `validate`: simulated people beside published figures, as tables, JSON or a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rcare_marl.agents.people.validation.check import Check
from rcare_marl.agents.people.validation.people import FAMILIES, as_rows, tallies, validate
from rcare_marl.atomic_file import write_whole
from rcare_marl.console import console, markdown_table, table

from .parameter import print_json

TALLY = ("family", "split", "in band", "of", "share")
ROW = ("case", "ours", "band", "unit", "in band", "split", "source")
LONG = 200  # rows of a family that a page does not list
PAGE = """# Validation of people

Made by `rcare-marl validate people --page docs/validation.md`. Each row has a figure of ours, the band that
it should lie in and where the band comes from. **Fitted**: something of ours was chosen by it.
**Held out**: nothing was. What is quoted from **memory** counts in neither.

{tally}
"""


def run(
    families: Sequence[str], *, every: bool, as_json: bool, record: Path | None, page: Path | None
) -> None:
    """Make the checks and show them; see the command."""
    checks = validate(families)
    rows = as_rows(checks)
    if record is not None:
        import json

        write_whole(
            record,
            (json.dumps(rows, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode(),
        )
    if page is not None:
        write_whole(page, page_text(checks, families).encode())
    if as_json:
        print_json(rows)
        return
    screen = console()
    for family in dict.fromkeys(check.family for check in checks):
        shown = [c for c in checks if c.family == family and (every or not c.is_in_band)]
        if shown:
            title = family if every else f"{family}: out of band"
            screen.print(table(title, ROW, [cells(check) for check in shown]))
    screen.print(table("Checks of people", TALLY, tally_cells(checks)))


def cells(check: Check) -> tuple[str, ...]:
    """Return the texts of a row."""
    band = f"{check.low:.4g} to {check.high:.4g}"
    verdict = "yes" if check.is_in_band else "NO"
    return (
        *(check.case, f"{check.ours:.4g}", band, check.unit, verdict, check.split, check.source),
    )


def tally_cells(checks: Sequence[Check]) -> list[tuple[str, ...]]:
    """Return the texts of the table of shares in band."""
    return [
        (t.family, t.split, str(t.inside), str(t.count), f"{100 * t.inside / t.count:.0f} %")
        for t in tallies(checks)
    ]


def page_text(checks: Sequence[Check], asked: Sequence[str] = ()) -> str:
    """Return the page of the docs: shares in band, then all rows by family; of some families if asked."""
    parts = [PAGE.format(tally=markdown_table(TALLY, tally_cells(checks)))]
    if missing := [family for family in FAMILIES if asked and family not in asked]:
        parts.append(f"\nNot on this page, but in the command: {', '.join(missing)}.\n")
    for family in dict.fromkeys(check.family for check in checks):
        own = [check for check in checks if check.family == family]
        parts.append(f"\n## {family}\n")
        if len(own) > LONG:
            parts.append(
                f"\n{len(own)} rows, too many for a page: `--output FILE` leaves them as JSON.\n"
            )
        else:
            parts.append(f"\n{markdown_table(ROW, [cells(check) for check in own])}\n")
    return "".join(parts)
