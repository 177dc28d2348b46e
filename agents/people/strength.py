"""From grades of manual muscle testing to shares of normal strength.

`mmt`, the default, takes the grades at their word, for the limbs that a person has. A grade is one of a
motion. Grade 3 takes the limb through the range of its test once against gravity: its torque is a little more
than the greatest weight on the way. It is a net torque, together with what the tissue of the joint gives, as
a dynamometer measures it. Grade 2 has a quarter of it: with gravity eliminated it goes the whole way, against
gravity it fails. Grade 1 is a flicker that moves nothing. Grade 4 has 0.43 of what lies between grade 3 and
normal. Between two grades strength is interpolated on a log scale (3+ is a third of the way). Figures and
their sources are in `assets/clinical/mmt_tests.yaml`.

So grade 3 of an elbow or a knee is a few percent of normal, as people had who were measured (knee 4.8 +-
1.2 %, H. Sato et al. 1999; elbow 8 to 10, knee 5 to 8, shoulder 7 to 21, hip 4 to 44 %, Z. Dvir 1997).

`linear` is the uniform map of the RCareWorld paper: share = grade / 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, NamedTuple, get_args

import numpy as np

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array
from rcare_marl.tree.dynamics import holding_torques
from rcare_marl.tree.joint_tree import JointTree
from rcare_marl.world import GRAVITY

from .body.skeleton import DOF_INDEX, DOFS, Dof
from .profile import clinical_norms

StrengthMap = Literal["mmt", "linear"]
STRENGTH_MAPS: tuple[StrengthMap, ...] = get_args(StrengthMap)
Resistance = Literal["slight", "moderate", "strong"]
Lying = Literal["upright", "supine", "prone", "tested_side_up", "tested_side_down"]
LEAST_HOLDING, MOST_HOLDING = 0.01, 0.9  # share of grade 3; our own choice
SAMPLES = 10  # angles of a range that are looked at
FULL = 4.0  # grade from which a motion's limit gives way to what its muscles can


@dataclass(frozen=True)
class MmtTest:
    """How a muscle group is tested.

    Attributes:
        motion: The motion that is graded.
        range_deg: From where to where, in clinical degrees of it.
        body: How the person sits or lies, so that gravity resists.
        with_deg: Clinical degrees of other motions; the joints not named are straight.
        back: Action group of muscles that are graded by the way back, such as what opens a jaw.
    """

    motion: str
    range_deg: tuple[float, float]
    body: Lying
    with_deg: dict[str, float] = field(default_factory=dict)
    back: str = ""

    def __post_init__(self) -> None:
        if not self.range_deg[0] < self.range_deg[1]:
            raise ConfigError(f"range_deg of {self.motion!r} must grow, got {self.range_deg}")


@dataclass(frozen=True)
class GradeShares:
    """What the grades are worth.

    Attributes:
        grade_2: Of the torque of grade 3.
        holding: Torque of grade 3, of the greatest weight in the range.
        grade_4: Of what lies between grade 3 and normal.
    """

    grade_2: float
    holding: float
    grade_4: float

    def __post_init__(self) -> None:
        if not (0 < self.grade_2 < 1 < self.holding and 0 < self.grade_4 < 1):
            raise ConfigError(
                f"shares of grades need 0 < grade_2 < 1 < holding and 0 < grade_4 < 1, got {self}"
            )


@dataclass(frozen=True)
class Resistances:
    """What an examiner presses with, besides the limb's weight.

    Attributes:
        slight: A share of the geometric mean of weight and normal strength.
        moderate: A share of normal strength.
        strong: A share of normal strength.
    """

    slight: float
    moderate: float
    strong: float

    def torque(self, name: Resistance, weight: float, normal: float) -> float:
        """Return the resistance of that name for a limb's weight and normal strength [N·m]."""
        check_name("resistance", name, get_args(Resistance))
        scale = math.sqrt(weight * normal) if name == "slight" else normal
        return float(getattr(self, name)) * scale


@dataclass(frozen=True)
class MmtTests:
    """Manual muscle testing (`assets/clinical/mmt_tests.yaml`).

    Attributes:
        tests: The test of each muscle group.
        shares: What the grades are worth.
        resistance: What an examiner presses with.
    """

    tests: dict[str, MmtTest]
    shares: GradeShares
    resistance: Resistances

    def __post_init__(self) -> None:
        norms = clinical_norms()
        for group, test in self.tests.items():
            check_name("muscle group", group, norms.groups)
            for motion in (test.motion, *test.with_deg):
                check_name(f"motion in the test of {group!r}", motion, norms.motions)


@lru_cache(maxsize=1)
def mmt_tests() -> MmtTests:
    """Return the tests."""
    return load(MmtTests, assets.find("clinical", "mmt_tests"))


def down(lying: Lying, side: str) -> Array:
    """Return the direction of gravity in the frame of the pelvis (x left, y up, z forward), shape [3]."""
    across = -1.0 if side == "left" else 1.0
    return {
        "upright": np.array((0.0, -1.0, 0.0)),
        "supine": np.array((0.0, 0.0, -1.0)),
        "prone": np.array((0.0, 0.0, 1.0)),
        "tested_side_up": np.array((across, 0.0, 0.0)),
        "tested_side_down": np.array((-across, 0.0, 0.0)),
    }[lying]


class RangeTest(NamedTuple):
    """The test of a motion on one person.

    Attributes:
        dof: Index of the DoF that is graded.
        sign: +1 if the graded motion is its positive one, else -1.
        angles: Angle of every DoF [rad], shape [112]; that of `dof` is where the range starts.
        path: Angles of the DoF through the range [rad], shape [SAMPLES].
        down: Direction of gravity in the frame of the pelvis, shape [3].
        weight: What it takes to hold the limb at each of them [N·m], positive where gravity resists the
            motion, shape [SAMPLES].
    """

    dof: int
    sign: float
    angles: Array
    path: Array
    down: Array
    weight: Array

    @property
    def heaviest(self) -> float:
        """The greatest weight on the way [N·m], not below zero."""
        return max(float(self.weight.max()), 0.0)


def range_test(limb: Callable[[Array, str], JointTree], side: str, group: str) -> RangeTest | None:
    """Return the test of a muscle group on a person; None if it is never graded against gravity.

    Where several joints share the motion it is that of the most proximal one, which carries the most.

    Args:
        limb: Returns the tree of one DoF, by name, the others being held at angles [rad], shape [112].
        side: `left`, `right` or `axial`.
        group: Muscle group.
    """
    test = mmt_tests().tests.get(group)
    graded = [] if test is None else [d for d in _dofs_of(test.motion) if d.side == side]
    if test is None or not graded:
        return None
    dof, angles = graded[0], np.array([-d.clinical_zero for d in DOFS])
    for motion, degrees in test.with_deg.items():
        for other in _dofs_of(motion):
            if other.side == side:
                angles[DOF_INDEX[other.name]] = _angle(other, motion, degrees)
    i, sign = DOF_INDEX[dof.name], 1.0 if test.motion == dof.positive else -1.0
    start, end = (_angle(dof, test.motion, degrees) for degrees in test.range_deg)
    angles[i] = start
    tree, direction = limb(angles, dof.name).arrays, down(test.body, side)
    path = np.linspace(start, end, SAMPLES)
    held = [holding_torques(tree, path[k : k + 1], GRAVITY * direction)[0] for k in range(SAMPLES)]
    return RangeTest(i, sign, angles, path, direction, sign * np.array(held))


def _angle(dof: Dof, motion: str, degrees: float) -> float:
    sign = 1.0 if motion == dof.positive else -1.0
    return sign * math.radians(degrees) * dof.share - dof.clinical_zero


def _dofs_of(motion: str) -> list[Dof]:
    return [dof for dof in DOFS if motion in (dof.positive, dof.negative)]


def holding_share(needed: float, normal: float) -> float:
    """Return the share of grade 3 for the torque that it needs and the normal one [N·m]."""
    return min(max(needed / normal, LEAST_HOLDING), MOST_HOLDING) if normal > 0 else MOST_HOLDING


def strength_share(
    grade: float,
    strength_map: StrengthMap,
    holding: float = LEAST_HOLDING,
    *,
    poor: float = 0.0,
) -> float:
    """Return the share of normal strength of an MMT grade.

    Args:
        grade: From 0 to 5; 3.33 is 3+.
        strength_map: `mmt` or `linear`.
        holding: Share of grade 3, for `mmt`.
        poor: What grade 2 has at least, for `mmt`; no more than grade 3.

    Raises:
        ValueError: If the grade lies outside 0..5.
        UnknownNameError: If there is no such map.
    """
    check_name("map of strength", strength_map, STRENGTH_MAPS)
    if not 0 <= grade <= 5:
        raise ValueError(f"an MMT grade lies in 0..5, got {grade}")
    if strength_map == "linear":
        return grade / 5
    worth = mmt_tests().shares
    second = min(max(worth.grade_2 * holding, poor), holding)
    if grade < 2:  # a flicker moves nothing
        return second * max(grade - 1.0, 0.0) ** 2
    fourth = holding + worth.grade_4 * (1.0 - holding)
    shares = (second, holding, fourth, 1.0)
    below = min(int(grade), 4)
    step = grade - below
    return float(shares[below - 2] ** (1 - step) * shares[below - 1] ** step)


def tissue_share(grade: float) -> float:
    """Return how much of what the joint's tissue resists with a grade overcomes beside its torque.

    A flicker moves nothing, so none of it up to grade 1; from grade 2 on, which goes through the whole
    range, all of it.
    """
    return min(max(grade - 1.0, 0.0), 1.0)


def full_share(grade: float) -> float:
    """Return what a motion's torque is divided by to limit muscles: 1 up to grade 4, 0 at grade 5.

    Whoever is of grade 5 has what the muscles give.
    """
    return min(max((5.0 - grade) / (5.0 - FULL), 0.0), 1.0)


def bisected(increasing: Callable[[float], float], wanted: float) -> float:
    """Return the x in [0, 1] where an increasing function reaches `wanted`; an end if it does not."""
    low, high = 0.0, 1.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        if increasing(middle) < wanted:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
