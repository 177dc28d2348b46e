"""The command `rcare-marl people` and its options; what it does is in `populating.py`, loaded on use."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer


class Sex(str, Enum):
    """For `--sex`."""

    female = "female"
    male = "male"


def people(
    who: Annotated[
        str,
        typer.Argument(
            metavar="WHO",
            help="A population (train, test, six), one of its people (test:17), or a condition, of "
            "which people are drawn.",
        ),
    ] = "test",
    condition: Annotated[
        str | None, typer.Option(help="Only people whose condition's words hold this.")
    ] = None,
    sex: Annotated[Sex | None, typer.Option(help="Only women or only men.")] = None,
    age: Annotated[
        str | None, typer.Option(metavar="LOW:HIGH", help="Only people of these ages [years].")
    ] = None,
    severity: Annotated[
        str | None, typer.Option(help="Of a condition: a band, or a score of its scale.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the first person of a condition.")] = 0,
    limit: Annotated[int | None, typer.Option(min=1, help="At most so many people.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Write them to a .json or .yaml file; several YAML people make a folder."
        ),
    ] = None,
    sheet: Annotated[
        Path | None, typer.Option(help="Draw them, dressed and seated, into this PNG or JPEG.")
    ] = None,
) -> None:
    """Show, filter, export and draw synthetic people."""
    from .populating import Wanted, show_people

    wanted = Wanted(condition, None if sex is None else sex.value, age, limit)
    show_people(who, severity, seed, wanted, out, sheet)
