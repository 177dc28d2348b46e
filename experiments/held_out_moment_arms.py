"""Write moment arms of MyoSuite's MyoArm and MyoLegs over whole ranges: what our muscles are compared with.

Nothing of ours is fitted to them or chosen by them. MyoArm descends from Saul 2015 and Holzbaur 2005; MyoLegs
from Rajagopal 2016, to which our legs were once fitted. A moment arm is -dL/dq by a difference of the
tendon's length, about the right side's joint. Joints that the model couples to it (the knee's gliding, the
kneecap) move along. The shoulder girdle (`held` in the YAML) is placed by MyoArm's rhythm; in `arm_mm` it is
then held, so that the arm is that about the joint between blade and humerus, as specimens are measured; in
`coupled_mm` it moves along, which carries the joint's centre with the clavicle, as ours does not.

How the joints correspond was checked with muscles whose sign nobody doubts (`sure` in its YAML); the script
stops if one of them is against it.

Run: pip install myo-sim==0.2.4 mujoco; python experiments/held_out_moment_arms.py [--out FILE]
"""

from __future__ import annotations

import csv
import importlib.metadata
import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from rcare_marl.config import read_yaml

FILE = Path(__file__).parents[1] / "assets" / "muscles" / "held_out_moment_arms.csv"
COLUMNS = (
    *("model", "version", "region", "muscle", "dof", "posture_deg", "arm_mm", "coupled_mm"),
    "das3_mm",  # which das3_moment_arms.py fills
)
STEP = 1e-4  # [rad]
TURNED = 5.0  # [mm] by which a muscle would turn a joint the wrong way
LEAST = 0.2  # [mm] below which a muscle does not cross a joint

PLAN = read_yaml(Path(__file__).parent / "configs" / "held_out_moment_arms.yaml")
FINGERS = {"2": "index", "3": "middle"}


class Model:
    """A model of MyoSuite whose joints can be set, those that hang on them following."""

    def __init__(self, name: str) -> None:
        """Load a model of the package `myo-sim`."""
        import mujoco  # type: ignore[import-not-found, unused-ignore]
        import myo_sim  # type: ignore[import-not-found, unused-ignore]

        self._mujoco = mujoco
        self.model: Any
        self.data: Any
        self.model, self.data = myo_sim.load(name)[:2]
        self._couplings = []
        for e in range(self.model.neq):
            if self.model.eq_type[e] != mujoco.mjtEq.mjEQ_JOINT or self.model.eq_obj2id[e] < 0:
                continue
            name = self.model.joint(self.model.eq_obj1id[e]).name
            driver = self.model.joint(self.model.eq_obj2id[e]).name
            self._couplings.append((name, driver, tuple(self.model.eq_data[e][:5])))

    def lengths(self, angles: dict[str, float], held: dict[str, float]) -> dict[str, float]:
        """Return the length of each tendon that an actuator pulls, at joint angles [rad] [m].

        Args:
            angles: Of the joints that are set.
            held: Of the same joints, where the held ones of the girdle are placed.
        """
        self.data.qpos[:] = self.model.qpos0
        for name, value in angles.items():
            self.data.qpos[self.model.joint(name).qposadr[0]] = value
        for name, driver, figures in self._couplings:
            to, of = (self.model.joint(n).qposadr[0] for n in (name, driver))
            is_held = name in PLAN["held"].split() and driver in held
            x = (held[driver] if is_held else self.data.qpos[of]) - self.model.qpos0[of]
            self.data.qpos[to] = self.model.qpos0[to] + sum(c * x**k for k, c in enumerate(figures))
        self._mujoco.mj_forward(self.model, self.data)
        names = [self.model.actuator(i).name for i in range(self.model.nu)]
        tendons = self.model.actuator_trnid[:, 0]
        return {
            name: float(self.data.ten_length[t]) for name, t in zip(names, tendons, strict=True)
        }

    def arms(self, angles: dict[str, float], joint: str, is_held: bool) -> dict[str, float]:
        """Return -dL/dq of each muscle about a joint [mm], the girdle held or following."""
        turned = [{**angles, joint: angles.get(joint, 0.0) + sign * STEP} for sign in (1, -1)]
        ends = [self.lengths(turn, angles if is_held else turn) for turn in turned]
        return {name: (ends[1][name] - ends[0][name]) / (2 * STEP) * 1e3 for name in ends[0]}


def our_name(muscle: str) -> str:
    """Return our name of a muscle of the right side."""
    stem = muscle.removesuffix("_r")
    if stem[-1] in FINGERS and stem[:-1] in ("FDS", "FDP", "EDC"):
        return f"{stem[:-1].lower()}_{FINGERS[stem[-1]]}_r"
    return (stem.lower() if stem.isupper() or stem[:3] in ("TRI", "BIC") else stem) + "_r"


def our_dof(joint: str, in_front: bool) -> tuple[str, int]:
    """Return our DoF of a joint; raising the arm is flexion where it is raised in front."""
    dof, sign = PLAN["joints"][joint]
    if joint == "shoulder_elv_r" and in_front:
        dof = "right_shoulder_flexion"
    return dof, sign


def our_posture(values: dict[str, float]) -> str:
    """Return a posture [deg] as `posture_deg` of our tables has it."""
    in_front = values.get("elv_angle_r") == 90
    parts = []
    for joint, value in values.items():
        if joint != "elv_angle_r":
            dof, sign = our_dof(joint, in_front)
            parts.append(f"{dof}:{sign * value:g}")
    return "; ".join(parts)


def rows() -> Iterator[dict[str, str]]:
    """Yield a row for each muscle, DoF and posture of the grids."""
    version = importlib.metadata.version("myo-sim")
    models: dict[str, Model] = {}
    for grid in PLAN["grids"]:
        name, muscles, values = grid["model"], grid["muscles"].split(), grid["values"]
        model = models.setdefault(name, Model(name))
        own = muscles if name == "myoarm" else [f"{muscle}_r" for muscle in muscles]
        for point in itertools.product(*values.values()):
            posture = dict(zip(values, map(float, point), strict=True))
            if grid["region"] == "hand":
                posture |= {
                    "mcp3_flexion_r": posture["mcp2_flexion_r"],
                    "pm3_flexion_r": posture["pm2_flexion_r"],
                }
            angles = {joint: math.radians(value) for joint, value in posture.items()}
            for joint in grid["joints"].split():
                dof, sign = our_dof(joint, posture.get("elv_angle_r") == 90)
                arms = model.arms(angles, joint, is_held=True)
                coupled = model.arms(angles, joint, is_held=False)
                for muscle in own:
                    sure = PLAN["sure"].get(muscle, {}).get(joint)
                    if sure is not None and sure * coupled[muscle] < -TURNED:
                        raise SystemExit(
                            f"{muscle} turns {joint} the wrong way at {posture}: {coupled[muscle]:.1f} mm"
                        )
                    if max(abs(arms[muscle]), abs(coupled[muscle])) >= LEAST:
                        yield {
                            "model": name,
                            "version": version,
                            "region": grid["region"],
                            "muscle": our_name(muscle),
                            "dof": dof,
                            "posture_deg": our_posture(posture),
                            "arm_mm": f"{sign * arms[muscle]:.1f}",
                            "coupled_mm": f"{sign * coupled[muscle]:.1f}",
                            "das3_mm": "",
                        }


def main(out: Annotated[Path, typer.Option(help="Where to write.")] = FILE) -> None:
    """Write the held-out moment arms."""
    found = list(rows())
    with out.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(found)
    print(f"{len(found)} rows in {out}")


if __name__ == "__main__":
    typer.run(main)
