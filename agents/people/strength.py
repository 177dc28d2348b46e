"""From grades of manual muscle testing to shares of normal strength.

`linear` is the uniform map of the RCareWorld paper: share = grade / 5. It makes a grade-3 elbow 6 to 12
times stronger than people are who were measured: their knee extensors of grade 3 had 4.8 +- 1.2 % of
normal strength (H. Sato et al. 1999), elbows 8 to 10 % and hips 4 to 44 % (Z. Dvir 1997).

`gravity` is calibrated to what the grades mean: grade 3 just holds the limb against gravity in its test
position. Its share is the weight's torque there by the normal torque, kept within 0.01 and 0.8 (of hip
and trunk muscles it takes a great share to hold a straight leg or the trunk). The other grades are our
own choice: 1 is 0.01, 2 is half of grade 3, 4 is the geometric mean of 3 and 5,
and what lies between two grades is interpolated on a log scale (3+ is a third of the way).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, get_args

import numpy as np

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import check_name
from rcare_marl.pose import Array
from rcare_marl.tree.joint_tree import JointTree, ancestors
from rcare_marl.world import GRAVITY

from .body.skeleton import DOF_INDEX, DOFS, Dof
from .profile import clinical_norms

StrengthMap = Literal["linear", "gravity"]
STRENGTH_MAPS: tuple[StrengthMap, ...] = get_args(StrengthMap)
LEAST_HOLDING, MOST_HOLDING = 0.01, 0.8  # share of grade 3; our own choice
TRACE = 0.01  # share of grade 1: a contraction that moves nothing


@dataclass(frozen=True)
class MmtTest:
    """Where a muscle group is tested.

    Attributes:
        motion: The motion that is graded.
        angle_deg: Where, in clinical degrees of it.
        with_deg: Clinical degrees of other motions; the joints not named are straight.
    """

    motion: str
    angle_deg: float
    with_deg: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class MmtTests:
    """The test position of each muscle group (`assets/clinical/mmt_tests.yaml`)."""

    tests: dict[str, MmtTest]

    def __post_init__(self) -> None:
        norms = clinical_norms()
        for group, test in self.tests.items():
            check_name("muscle group", group, norms.groups)
            for motion in (test.motion, *test.with_deg):
                check_name(f"motion in the test of {group!r}", motion, norms.motions)


@lru_cache(maxsize=1)
def mmt_tests() -> MmtTests:
    """Return the test positions."""
    return load(MmtTests, assets.find("clinical", "mmt_tests"))


@dataclass(frozen=True, eq=False)
class GravityTest:
    """A test position on one person.

    Attributes:
        dof: Index of the DoF that is graded.
        sign: +1 if the graded motion is its positive one, else -1.
        angles: Angle of every DoF [rad], shape [112].
        torque: What holds the level limb against gravity [N·m].
    """

    dof: int
    sign: float
    angles: Array
    torque: float


def gravity_tests(chain: JointTree) -> dict[tuple[str, str], GravityTest]:
    """Return the test of each (side, muscle group) on a person whose 112 DoFs all move."""
    out = {}
    for group, test in mmt_tests().tests.items():
        for dof in _dofs_of(test.motion):
            if (dof.side, group) not in out:  # the most proximal joint carries the most
                out[dof.side, group] = _gravity_test(chain, dof, test)
    return out


def _dofs_of(motion: str) -> list[Dof]:
    return [dof for dof in DOFS if motion in (dof.positive, dof.negative)]


def _gravity_test(chain: JointTree, graded: Dof, test: MmtTest) -> GravityTest:
    angles = np.zeros(len(DOFS))
    for motion, degrees in {**test.with_deg, test.motion: test.angle_deg}.items():
        for dof in _dofs_of(motion):
            if dof.side == graded.side:
                sign = 1.0 if motion == dof.positive else -1.0
                angles[DOF_INDEX[dof.name]] = (
                    sign * math.radians(degrees) * dof.share - dof.clinical_zero
                )
    i = DOF_INDEX[graded.name]
    sign = 1.0 if test.motion == graded.positive else -1.0
    return GravityTest(i, sign, angles, level_torque(chain, i, angles))


def level_torque(chain: JointTree, dof: int, angles: Array) -> float:
    """Return the torque of gravity about a DoF while all beyond it lies level [N·m].

    Args:
        chain: The moving parts.
        dof: Index of the DoF in the chain.
        angles: Angles of the chain [rad], shape [n].
    """
    tree = chain.arrays
    turns, origins = chain.place(angles)
    mass, moment = 0.0, np.zeros(3)
    for i in range(dof, len(angles)):
        if dof in ancestors(tree.parents, i):
            mass += tree.masses[i]
            moment += tree.masses[i] * (origins[i] + turns[i] @ tree.centres[i])
    arm = moment / mass - origins[dof]
    axis_now = turns[dof] @ tree.axes[dof]
    return float(mass * GRAVITY * np.linalg.norm(arm - (arm @ axis_now) * axis_now))


def holding_share(needed: float, normal: float) -> float:
    """Return the share of grade 3 for the torque that is needed and the normal one [N·m]."""
    return min(max(needed / normal, LEAST_HOLDING), MOST_HOLDING) if normal > 0 else MOST_HOLDING


def strength_share(
    grade: float, strength_map: StrengthMap, holding: float = LEAST_HOLDING
) -> float:
    """Return the share of normal strength of an MMT grade.

    Args:
        grade: From 0 to 5; 3.33 is 3+.
        strength_map: `linear` or `gravity`.
        holding: Share of grade 3, for `gravity`.

    Raises:
        ValueError: If the grade lies outside 0..5.
        UnknownNameError: If there is no such map.
    """
    check_name("map of strength", strength_map, STRENGTH_MAPS)
    if not 0 <= grade <= 5:
        raise ValueError(f"an MMT grade lies in 0..5, got {grade}")
    if strength_map == "linear":
        return grade / 5
    if grade < 1:
        return TRACE * grade
    shares = (TRACE, max(0.5 * holding, TRACE), holding, math.sqrt(holding), 1.0)
    below = min(int(grade), 4)
    step = grade - below
    return float(shares[below - 1] ** (1 - step) * shares[below] ** step)


def bisected(increasing: Callable[[float], float], wanted: float) -> float:
    """Return the x in [0, 1] where an increasing function reaches `wanted`; an end if it does not."""
    low, high = 0.0, 1.0
    for _ in range(16):
        middle = 0.5 * (low + high)
        if increasing(middle) < wanted:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
