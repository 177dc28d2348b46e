"""Write a card of every policy that ships, and the list of them in docs/models.md.

python experiments/model_cards.py [--folder FOLDER] [--page FILE]

Beside each `<name>.npz` it writes `<name>.yaml`, with the numbers of the records `<name>.json`, of all
seeds of its training, and `<name>_shipped.json`, of it alone, where they are there.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rcare_marl.baselines import trained
from rcare_marl.baselines.evaluation.model_card import LIMITS, ModelCard
from rcare_marl.baselines.evaluation.protocol import read_record
from rcare_marl.baselines.policy_file import SUFFIX

BEGIN, END = "<!-- cards: made by experiments/model_cards.py -->", "<!-- end of cards -->"
PAGE = Path(__file__).resolve().parents[1] / "docs" / "models.md"
NONE = "No trained policy ships yet.\n"


def cards(folder: Path) -> list[ModelCard]:
    """Return the card of each policy in a folder."""
    out = []
    for file in sorted(folder.glob(f"*{SUFFIX}")):
        records = (file.with_suffix(".json"), file.with_name(f"{file.stem}_shipped.json"))
        out.append(ModelCard.of(file, *(read_record(r) if r.is_file() else None for r in records)))
    return out


def placed(text: str, body: str, begin: str, end: str) -> str:
    """Return the text of a page with a body between two of its lines.

    Raises:
        ValueError: If the page does not mark that place.
    """
    before, found, rest = text.partition(begin)
    _, ended, after = rest.partition(end)
    if not (found and ended):
        raise ValueError(f"the page needs the lines {begin!r} and {end!r}")
    return f"{before}{begin}\n\n{body}\n{end}{after}"


def page(text: str, found: list[ModelCard]) -> str:
    """Return the text of a page with the cards in their place; errors as of `placed`."""
    limits = ["Limits of all of them:", "", *(f"- {limit}" for limit in LIMITS), ""]
    body = "\n".join([*limits, *(card.markdown() for card in found)]) if found else NONE
    return placed(text, body, BEGIN, END)


def main(
    folder: Path = trained.FOLDER, into: Annotated[Path, typer.Option("--page")] = PAGE
) -> None:
    """Write the cards of a folder's policies, and their list into a page."""
    found = cards(folder)
    for card in found:
        (folder / f"{card.name}.yaml").write_text(card.to_yaml(), "utf-8")
    into.write_text(page(into.read_text("utf-8"), found), "utf-8")
    print(f"{len(found)} cards")


if __name__ == "__main__":
    typer.run(main)
