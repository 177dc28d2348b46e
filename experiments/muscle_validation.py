"""Print moment arms and greatest isometric torques against published bands, and the share in band.

Torques are those of the agonists alone at full activation. The bands are of adult men; the reference
skeleton is a man of 1.75 m, and torques published per mass are for 75 kg. A woman's torques are compared
with our norm's share of the men's (`female_strength` in assets/clinical/motions.yaml).

With `--rom` it prints how far each motion comes instead: agonists at full activation, everything else at
rest, without gravity, against the passive force of the antagonists.

Run: python experiments/muscle_validation.py [--avatar NAME] [--rom] [--json]
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer

from rcare_marl.agents.people.actuation.drive import fitted_musculature
from rcare_marl.agents.people.actuation.hill import RESTING_ACTIVATION
from rcare_marl.agents.people.actuation.muscle_model import MuscleModel
from rcare_marl.agents.people.actuation.musculature import load_musculature
from rcare_marl.agents.people.actuation.published_band import QUANTITIES, load_bands, measured
from rcare_marl.agents.people.avatar import body_segments, load_avatar
from rcare_marl.agents.people.body.person_tree import person_tree
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS, EYES, SIDES
from rcare_marl.agents.people.profile import ClinicalProfile, clinical_norms
from rcare_marl.console import console, table
from rcare_marl.pose import Array

WANTED = {"moment_arm": 0.90, "torque": 0.85}
STEPS = 25  # in which a motion is followed through its range
UNITS = {"moment_arm": "mm", "torque": "N·m", "passive_torque": "N·m"}


@dataclass(frozen=True)
class ActiveMotion:
    """A motion of one DoF, from neutral to the end of the normal active range.

    Attributes:
        dof: Its DoF.
        name: Clinical name of the motion.
        sign: +1 if it is in the positive direction of the DoF, else -1.
        start: Angle where it starts, the neutral one if that is within the range [rad].
        end: Angle where the normal active range ends [rad].
    """

    dof: str
    name: str
    sign: int
    start: float
    end: float

    def posture(self, share: float) -> Array:
        """Return the angle of every DoF at a share of the way [rad], shape [112].

        Arms hang at the side; hips are flexed with bent knees, as they are tested.
        """
        angles = np.zeros(len(DOFS))
        for side in SIDES:
            angles[DOF_INDEX[f"{side}_shoulder_abduction"]] = -np.pi / 2
            if self.name == "hip_flexion":
                angles[DOF_INDEX[f"{side}_knee_flexion"]] = np.pi / 2
        angles[DOF_INDEX[self.dof]] = self.start + share * (self.end - self.start)
        return angles


def active_motions() -> Iterator[ActiveMotion]:
    """Yield the motions of trunk, head and right side that muscles make; the left is alike."""
    limits = ClinicalProfile().limits("active")
    for dof in DOFS:
        if dof.side == "left" or dof.joint in EYES:
            continue
        low, high = limits[dof.name]
        start = float(np.clip(0.0, low, high))
        yield ActiveMotion(dof.name, dof.positive, 1, start, high)
        yield ActiveMotion(dof.name, dof.negative, -1, start, low)


def outward_torque(model: MuscleModel, motion: ActiveMotion, share: float) -> float:
    """Return the torque in the direction of a motion at a share of its way [N·m].

    Agonists are fully active, everything else is as active as at rest, and nothing has weight.
    """
    q = motion.posture(share)
    arms = motion.sign * model.moment_arms(q)[:, DOF_INDEX[motion.dof]]
    return float(arms @ model.isometric_forces(q, np.where(arms > 0, 1.0, RESTING_ACTIVATION)))


def reached(model: MuscleModel, motion: ActiveMotion) -> float:
    """Return the share of a motion's way up to which its muscles overcome the others, in [0, 1]."""
    way = 0.0
    for share in np.linspace(0.0, 1.0, STEPS + 1):
        if outward_torque(model, motion, float(share)) <= 0.0:
            break
        way = float(share)
    return way


def ranges(avatar: str | None) -> list[dict[str, str | float]]:
    """Return a row for each motion: the angle where it ends, and the one that is reached [deg]."""
    model, rows = make_model(avatar), []
    for motion in active_motions():
        share = reached(model, motion)
        stop = motion.start + share * (motion.end - motion.start)
        row: dict[str, str | float] = {
            "dof": motion.dof,
            "motion": motion.name,
            "end_deg": float(np.degrees(motion.end)),
            "reached_deg": float(np.degrees(stop)),
            "share": share,
        }
        rows.append(row)
    return rows


def show_ranges(rows: list[dict[str, str | float]], who: str) -> None:
    """Print the motions that stop short."""
    short = sorted((r for r in rows if float(r["share"]) < 1.0), key=lambda r: float(r["share"]))
    cells = [
        (str(r["dof"]), str(r["motion"]), f"{r['end_deg']:.0f}", f"{r['reached_deg']:.0f}")
        for r in short
    ]
    title = f"Motions of {who} that stop short of the normal active range"
    columns = ("degree of freedom", "motion", "normal [deg]", "reached [deg]")
    screen = console()
    screen.print(table(title, columns, cells))
    screen.print(f"{len(rows) - len(short)} of {len(rows)} motions come to their end")


def make_model(avatar: str | None) -> MuscleModel:
    """Return the muscles of an avatar, or those of the reference skeleton, over all DoFs."""
    person = load_avatar(avatar or "caregiver")
    muscles = fitted_musculature(person, None) if avatar else load_musculature()
    # Masses do not matter to a muscle that is held still, so the reference may borrow anybody's.
    segments = body_segments(person.body_path(), person.height_m, person.mass_kg, person.sex)
    chain = person_tree(segments, muscles.joints, np.zeros(len(DOFS)), [dof.name for dof in DOFS])
    return MuscleModel(muscles.units, muscles.joints, chain)


def validate(avatar: str | None) -> list[dict[str, str | float | bool]]:
    """Return a row for each band: what was published, and what the model gives."""
    model, rows = make_model(avatar), []
    is_woman = avatar is not None and load_avatar(avatar).sex == "female"
    for band in load_bands():
        value = measured(model, band)
        share = (
            clinical_norms().female_strength if is_woman and band.quantity != "moment_arm" else 1.0
        )
        low, high = share * band.low, share * band.high
        row: dict[str, str | float | bool] = {
            "name": band.name,
            "quantity": band.quantity,
            "value": value,
            "low": low,
            "high": high,
            "unit": UNITS[band.quantity],
            "in_band": low <= value <= high,
            "checked": band.checked,
            "fitted": band.is_fitted,
            "source": band.source,
        }
        rows.append(row)
    return rows


def show(rows: list[dict[str, str | float | bool]], who: str) -> None:
    """Print the rows and the shares in band."""
    cells = []
    for row in rows:
        figures = (f"{row['value']:.1f}", f"{row['low']:g} to {row['high']:g}", str(row["unit"]))
        verdict = "yes" if row["in_band"] else "NO"
        cells.append((str(row["name"]), *figures, verdict, str(row["checked"]), str(row["source"])))
    columns = ("joint and posture", "ours", "published", "unit", "in band", "figures", "source")
    screen = console()
    screen.print(table(f"Muscles of {who} against published bands", columns, cells))
    for quantity in QUANTITIES:
        own = [row for row in rows if row["quantity"] == quantity]
        inside = sum(bool(row["in_band"]) for row in own)
        wanted = f", wanted {WANTED[quantity]:.0%}" if quantity in WANTED else ""
        checked = ", ".join(
            f"{n} {kind}" for kind, n in sorted(Counter(str(r["checked"]) for r in own).items())
        )
        fresh = [bool(row["in_band"]) for row in own if not row["fitted"]]
        apart = f"; {sum(fresh)} of {len(fresh)} not calibrated to" if fresh else ""
        screen.print(
            f"{quantity}: {inside} of {len(own)} in band, {inside / len(own):.0%}{wanted}{apart}; "
            f"figures: {checked}"
        )


def main(
    avatar: str | None = None,
    rom: bool = False,
    as_json: Annotated[bool, typer.Option("--json")] = False,
) -> None:
    """Validate the reference skeleton's muscles or an avatar's; or, with --rom, how far motions come."""
    who = avatar or "the reference skeleton"
    if as_json:
        found = ranges(avatar) if rom else validate(avatar)
        print(json.dumps(found, indent=2, ensure_ascii=False))
    elif rom:
        show_ranges(ranges(avatar), who)
    else:
        show(validate(avatar), who)


if __name__ == "__main__":
    typer.run(main)
