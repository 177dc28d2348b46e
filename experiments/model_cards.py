"""Write a card of every policy that ships, and the list of them in docs/models.md.

python experiments/model_cards.py [--folder FOLDER] [--page FILE]

Beside each `<name>.npz` it writes `<name>.yaml`, with the numbers of the record `<name>.json` if it is
there.
"""

from __future__ import annotations

import argparse
from pathlib import Path

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
        record = file.with_suffix(".json")
        out.append(ModelCard.of(file, read_record(record) if record.is_file() else None))
    return out


def page(text: str, found: list[ModelCard]) -> str:
    """Return the text of a page with the cards in their place.

    Raises:
        ValueError: If the page does not mark that place.
    """
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"the page needs the lines {BEGIN!r} and {END!r}")
    limits = ["Limits of all of them:", "", *(f"- {limit}" for limit in LIMITS), ""]
    body = "\n".join([*limits, *(card.markdown() for card in found)]) if found else NONE
    return f"{before}{begin}\n\n{body}\n{end}{after}"


def main() -> None:
    """Write the cards."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--folder", type=Path, default=trained.FOLDER)
    parser.add_argument("--page", type=Path, default=PAGE)
    chosen = parser.parse_args()
    found = cards(chosen.folder)
    for card in found:
        (chosen.folder / f"{card.name}.yaml").write_text(card.to_yaml(), "utf-8")
    chosen.page.write_text(page(chosen.page.read_text("utf-8"), found), "utf-8")
    print(f"{len(found)} cards")


if __name__ == "__main__":
    main()
