"""Moment arms of the reference skeleton's muscles, against publications and against open models.

MyoSuite's MyoArm was fitted by nobody here, so its rows are held out; docs/muscles.md says what of it was
looked at.
MyoLegs descends from Rajagopal 2016, to which our leg paths were once fitted: agreement with it proves
little, and its rows count as fitted. `experiments/held_out_moment_arms.py` wrote the rows and says how.

DAS3, an arm model of another descent than MyoArm's, stands beside it where it has the muscle
(`experiments/das3_moment_arms.py`): how far two published models agree says what can be asked of a third.
It is kin of ours: attachments of our shoulder are from its specimen, and the biceps was fitted to it.

About the shoulder there are two ways to compare: with the girdle held where its rhythm puts it, as specimens
are measured, by which each row is judged; and with the girdle following, of which only the sums are given, as
MyoArm's clavicle carries the shoulder's centre along and ours does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from rcare_marl import assets
from rcare_marl.pose import Array

from ..actuation.muscle_table import number, read_csv
from ..actuation.published_band import load_bands, measured, posture
from ..body.skeleton import DOF_INDEX
from .check import Check
from .published import published_check
from .reference_muscles import muscle_model

LARGE = 5.0  # [mm] from which the sign of a moment arm matters
TOLERANCE = (
    10.0  # [mm] of a single row, our own choice; models of the same muscle differ by as much
)
MOST_WRONG = 2.0  # [%] of large moment arms with the wrong sign
MOST_ERROR = {"myoarm": 6.0, "myolegs": 5.0}  # [mm] root mean square
KIN = ("myolegs", "das3")  # of models that paths of ours were fitted to
_FILE = assets.ROOT / "muscles" / "held_out_moment_arms.csv"
_ARMS = ("arm_mm", "coupled_mm")
_COLUMNS = ("model", "version", "region", "muscle", "dof", "posture_deg", *_ARMS, "das3_mm")


@dataclass(frozen=True)
class ModelArm:
    """A moment arm in an open model and ours in the same posture.

    Attributes:
        model: Name of the model.
        version: Version of the package that it came from.
        region: Part of the limb.
        case: Muscle, DoF and posture.
        theirs: The model's moment arm [mm].
        ours: Ours [mm].
        coupled: Both with the shoulder girdle following, theirs first [mm].
        das3: DAS3's [mm], if it has the muscle.
    """

    model: str
    version: str
    region: str
    case: str
    theirs: float
    ours: float
    coupled: tuple[float, float]
    das3: float | None

    def following(self) -> ModelArm:
        """Return the row as it is with the shoulder girdle following."""
        return replace(self, theirs=self.coupled[0], ours=self.coupled[1])


@lru_cache(maxsize=1)
def model_arms() -> tuple[ModelArm, ...]:
    """Return every row of the open models beside ours.

    Raises:
        ConfigError: If the file is missing or wrong.
        UnknownNameError: If it names a muscle or a DoF that we do not have.
    """
    model, arms = muscle_model(), dict[str, tuple[Array, Array]]()
    out = []
    for i, row in enumerate(read_csv(_FILE, _COLUMNS), start=2):
        where = f"{_FILE}, row {i}"
        text = row["posture_deg"]
        if text not in arms:
            q = posture(text, where)[[DOF_INDEX[name] for name in model.dofs]]
            arms[text] = model.glenohumeral_arms(q), model.moment_arms(q)
        at = model.index(row["muscle"]), model.dofs.index(row["dof"])
        held, following = (1e3 * float(found[at]) for found in arms[text])
        case = f"{row['muscle']} {row['dof']} at {text}"
        theirs, coupled = (number(row, key, where, -300.0, 300.0) for key in _ARMS)
        das3 = number(row, "das3_mm", where, -300.0, 300.0) if row["das3_mm"] else None
        named = (row["model"], row["version"], row["region"], case)
        out.append(ModelArm(*named, theirs, held, (coupled, following), das3))
    return tuple(out)


def wrong_signs(rows: tuple[ModelArm, ...]) -> float:
    """Return the share of large moment arms whose sign is not the model's [%]."""
    wrong = [row.theirs * row.ours <= 0 for row in rows if abs(row.theirs) > LARGE]
    return 100.0 * float(np.mean(wrong))


def rms_error(rows: tuple[ModelArm, ...]) -> float:
    """Return the root of the mean squared difference [mm]."""
    return math.sqrt(float(np.mean([(row.ours - row.theirs) ** 2 for row in rows])))


def beside_das3(rows: tuple[ModelArm, ...]) -> tuple[tuple[ModelArm, ...], tuple[ModelArm, ...]]:
    """Return the rows that DAS3 has too, against DAS3: ours, and those of the rows' model."""
    shared = [(row, row.das3) for row in rows if row.das3 is not None]
    return (
        tuple(replace(row, theirs=das3) for row, das3 in shared),
        tuple(replace(row, theirs=das3, ours=row.theirs) for row, das3 in shared),
    )


def checks() -> list[Check]:
    """Return every moment arm with its band, and how each open model agrees as a whole."""
    model = muscle_model()
    out = [
        published_check("moment arm", band, measured(model, band), "mm")
        for band in load_bands()
        if band.quantity == "moment_arm"
    ]
    rows = model_arms()
    for name, most in MOST_ERROR.items():
        own = tuple(row for row in rows if row.model == name)
        is_kin, source = name in KIN, f"myo-sim {own[0].version}, {name}"
        out += _sums(name, "", own, most, source)
        if not is_kin:
            following = tuple(row.following() for row in own)
            out += _sums(name, ", girdle following", following, most, source)
        for row in own:
            low, high = row.theirs - TOLERANCE, row.theirs + TOLERANCE
            family = f"moment arm, {name}"
            out.append(Check(family, row.case, row.ours, low, high, "mm", source, "model", is_kin))
    ours, theirs = beside_das3(rows)
    source = f"DAS3 release 2; MyoArm against it: {wrong_signs(theirs):.1f} %, {rms_error(theirs):.1f} mm"
    out += _sums("das3", "", ours, MOST_ERROR["myoarm"], source)
    return out


def _sums(
    name: str, way: str, rows: tuple[ModelArm, ...], most: float, source: str
) -> tuple[Check, Check]:
    """Return how rows agree as a whole: wrong signs, and root mean square."""
    family, is_kin = "moment arms of a model", name in KIN
    case, high = f"{name}: wrong signs above {LARGE:g} mm{way}", MOST_WRONG
    signs = Check(family, case, wrong_signs(rows), 0.0, high, "%", source, "model", is_kin)
    case = f"{name}: root mean square{way}"
    return signs, Check(family, case, rms_error(rows), 0.0, most, "mm", source, "model", is_kin)
