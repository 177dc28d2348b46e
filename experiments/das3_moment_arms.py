"""Add DAS3's moment arms to the rows of MyoArm: how far do two published models agree with each other?

DAS3 (Blana, van den Bogert et al.) descends from specimens measured in Delft, not from Holzbaur as MyoArm
does; attachments of our shoulder are from the same specimen. Its humerus is placed as ours, its shoulder
blade by our regression (de Groot & Brand, as its own), its clavicle stays as ours does, and the blade is
held in the difference. Wrist and hand have no muscles there.

The column that ships was made from the model's figures as they were read in its file, not from the file.

Run: pip install opensim==4.6; python experiments/das3_moment_arms.py das3_original.osim
(the model: github.com/mprib/FMC_projects, FMC_OpenSim/models/DAS3_release2/OpenSim_model)
"""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from rcare_marl import assets
from rcare_marl.agents.people.actuation.musculature import load_musculature
from rcare_marl.agents.people.actuation.published_band import posture
from rcare_marl.agents.people.body.scapula import scapula_angles
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, JOINT_INDEX, forward_kinematics
from rcare_marl.config import read_yaml
from rcare_marl.pose import Array, axis_rotation

FILE = assets.ROOT / "muscles" / "held_out_moment_arms.csv"
PLAN = read_yaml(Path(__file__).parent / "configs" / "das3_moment_arms.yaml")
STEP = 2e-3  # [rad]
TURN = np.array(
    (-1.0, 1.0, -1.0)
)  # from our axes (left, up, forward) to the model's (right, up, back)


def _upright(along: Array, forwards: Array) -> Array:
    """Return axes of an upper arm: to its right, up along it, back; by columns, shape [3, 3]."""
    up = along / np.linalg.norm(along)
    back = -(forwards - up * (forwards @ up))
    back /= np.linalg.norm(back)
    return np.stack((np.cross(up, back), up, back), axis=1)


def humerus(q: Array) -> Array:
    """Return how our right upper arm is turned, in the model's axes, for DoF angles [112]: shape [3, 3]."""
    bent = q.copy()
    bent[DOF_INDEX["right_elbow_flexion"]], bent[DOF_INDEX["right_elbow_pronation"]] = np.pi / 2, 0
    places = forward_kinematics(load_musculature().joints, bent)[1]
    shoulder, elbow, wrist = (
        places[JOINT_INDEX[f"right_{joint}"]] for joint in ("shoulder", "elbow", "wrist")
    )
    own = _upright(-np.array(PLAN["elbow"]), np.cross(PLAN["axis"], PLAN["elbow"]))
    return np.asarray(_upright(TURN * (shoulder - elbow), TURN * (wrist - elbow)) @ own.T)


def turned(first: float, second: float, third: float) -> Array:
    """Return the rotation about y, then its own z, then its own x [rad]."""
    x, y, z = np.eye(3)
    return axis_rotation(y, first) @ axis_rotation(z, second) @ axis_rotation(x, third)


class Das3:
    """The model, whose muscles' lengths can be asked for in our postures."""

    def __init__(self, file: Path) -> None:
        """Read an .osim."""
        import opensim  # type: ignore[import-not-found, unused-ignore]

        self.model: Any = opensim.Model(str(file))
        self.state = self.model.initSystem()
        muscles = self.model.getMuscles()
        self.groups = {
            f"{name}_r": [muscles.get(element) for element in elements.split()]
            for name, elements in PLAN["elements"].items()
        }

    def lengths(self, q: Array, held: Array) -> dict[str, float]:
        """Return our muscles' mean lengths [m] at DoF angles, the blade where it is at `held`."""
        arm, at = humerus(q), humerus(held)
        right, up, back = -at[:, 1]
        blade = turned(*scapula_angles(np.array((right, up, -back))))
        angles = {name: np.radians(value) for name, value in PLAN["clavicle"].items()}
        carried = turned(*angles.values()).T @ blade
        angles["AC_y"] = np.arctan2(-carried[2, 0], carried[0, 0])
        angles["AC_z"] = np.arcsin(carried[1, 0])
        angles["AC_x"] = np.arctan2(-carried[1, 2], carried[1, 1])
        joint = blade.T @ arm
        angles["GH_y"] = np.arctan2(joint[2, 1], -joint[0, 1])
        angles["GH_z"] = np.arccos(joint[1, 1])
        angles["GH_yy"] = np.arctan2(joint[1, 2], joint[1, 0])
        for dof, zero in (
            ("right_elbow_flexion", "elbow_zero"),
            ("right_elbow_pronation", "forearm_zero"),
        ):
            angles[PLAN["joints"][dof]] = q[DOF_INDEX[dof]] + np.radians(PLAN[zero])
        for name, value in angles.items():
            self.model.getCoordinateSet().get(name).setValue(self.state, float(value), False)
        self.model.realizePosition(self.state)
        return {name: self._mean(elements) for name, elements in self.groups.items()}

    def _mean(self, elements: list[Any]) -> float:
        force = [element.getMaxIsometricForce() for element in elements]
        length = [element.getGeometryPath().getLength(self.state) for element in elements]
        return float(np.average(length, weights=force))


def main(file: Annotated[Path, typer.Argument(help="The model, an .osim.")]) -> None:
    """Write the column `das3_mm`."""
    model = Das3(file)

    @cache
    def arms(text: str, dof: str) -> dict[str, float]:
        q = posture(text, text)
        ends = []
        for sign in (1, -1):
            moved = q.copy()
            moved[DOF_INDEX[dof]] += sign * STEP
            ends.append(model.lengths(moved, q))
        return {name: (ends[1][name] - ends[0][name]) / (2 * STEP) * 1e3 for name in ends[0]}

    with FILE.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    for row in rows:
        is_there = row["region"] in ("shoulder", "elbow") and row["muscle"] in model.groups
        found = arms(row["posture_deg"], row["dof"])[row["muscle"]] if is_there else None
        row["das3_mm"] = "" if found is None else f"{found:.1f}"
    with FILE.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    print(f"{sum(bool(row['das3_mm']) for row in rows)} of {len(rows)} rows")


if __name__ == "__main__":
    typer.run(main)
