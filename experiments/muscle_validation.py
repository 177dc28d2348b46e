"""Print moment arms and greatest isometric torques against published bands, and the share in band.

Torques are those of the agonists alone at full activation. The bands are of adult men; the reference
skeleton is a man of 1.75 m, and torques published per mass are for 75 kg. A woman's torques are compared
with our norm's share of the men's (`female_strength` in assets/clinical/motions.yaml).

Run: python experiments/muscle_validation.py [--avatar NAME] [--json]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter

import numpy as np
from rich.console import Console
from rich.table import Table

from rcare_marl import assets
from rcare_marl.agents.actuation.chain import make_chain
from rcare_marl.agents.actuation.drive import fitted_musculature
from rcare_marl.agents.actuation.muscle_model import MuscleModel
from rcare_marl.agents.actuation.musculature import load_musculature
from rcare_marl.agents.actuation.published_band import QUANTITIES, load_bands, measured
from rcare_marl.agents.avatar import body_segments, load_avatar
from rcare_marl.agents.body.skeleton import DOFS
from rcare_marl.agents.profile import clinical_norms

WANTED = {"moment_arm": 0.90, "torque": 0.85}
UNITS = {"moment_arm": "mm", "torque": "N·m", "passive_torque": "N·m"}


def make_model(avatar: str | None) -> MuscleModel:
    """Return the muscles of an avatar, or those of the reference skeleton, over all DoFs."""
    person = load_avatar(avatar or "caregiver")
    muscles = fitted_musculature(person, None) if avatar else load_musculature()
    # Masses do not matter to a muscle that is held still, so the reference may borrow anybody's.
    segments = body_segments(person.body_path(), person.height_m, person.mass_kg, person.sex)
    chain = make_chain(segments, muscles.joints, np.zeros(len(DOFS)), [dof.name for dof in DOFS])
    return MuscleModel(muscles.units, muscles.joints, chain)


def validate(avatar: str | None) -> list[dict[str, str | float | bool]]:
    """Return a row for each band: what was published, and what the model gives."""
    model, rows = make_model(avatar), []
    is_woman = avatar is not None and load_avatar(avatar).sex == "female"
    for band in load_bands():
        value = measured(model, band)
        share = clinical_norms().female_strength if is_woman and band.quantity == "torque" else 1.0
        low, high = share * band.low, share * band.high
        row: dict[str, str | float | bool] = {
            "name": band.name, "quantity": band.quantity, "value": value, "low": low,
            "high": high, "unit": UNITS[band.quantity],
            "in_band": low <= value <= high, "checked": band.checked, "fitted": band.is_fitted,
            "source": band.source,
        }  # fmt: skip
        rows.append(row)
    return rows


def show(rows: list[dict[str, str | float | bool]], who: str) -> None:
    """Print the rows and the shares in band."""
    table = Table(title=f"Muscles of {who} against published bands")
    for column in (
        "joint and posture",
        "ours",
        "published",
        "unit",
        "in band",
        "figures",
        "source",
    ):
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(
            str(row["name"]), f"{row['value']:.1f}", f"{row['low']:g} to {row['high']:g}",
            str(row["unit"]), "yes" if row["in_band"] else "[bold red]NO[/]", str(row["checked"]),
            str(row["source"]),
        )  # fmt: skip
    console = Console(width=None if sys.stdout.isatty() else 160)
    console.print(table)
    for quantity in QUANTITIES:
        own = [row for row in rows if row["quantity"] == quantity]
        inside = sum(bool(row["in_band"]) for row in own)
        wanted = f", wanted {WANTED[quantity]:.0%}" if quantity in WANTED else ""
        checked = ", ".join(
            f"{n} {kind}" for kind, n in sorted(Counter(str(r["checked"]) for r in own).items())
        )
        fresh = [bool(row["in_band"]) for row in own if not row["fitted"]]
        apart = f"; {sum(fresh)} of {len(fresh)} not calibrated to" if fresh else ""
        console.print(
            f"{quantity}: {inside} of {len(own)} in band, {inside / len(own):.0%}{wanted}{apart}; "
            f"figures: {checked}"
        )


def main() -> None:
    """Validate the reference skeleton's muscles, or an avatar's."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument(
        "--avatar", choices=assets.names("avatars"), help="instead of the reference"
    )
    parser.add_argument("--json", action="store_true", help="print the rows as JSON")
    chosen = parser.parse_args()
    rows = validate(chosen.avatar)
    if chosen.json:
        print(json.dumps(rows, indent=2, ensure_ascii=False))
    else:
        show(rows, chosen.avatar or "the reference skeleton")


if __name__ == "__main__":
    main()
