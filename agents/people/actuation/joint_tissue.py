"""How a relaxed joint resists movement: damping, and tissue that tightens towards the ends of the range.

Both are given per inertia of what hangs on the joint, so that limbs of all bodies swing alike; figures and
sources are in `assets/clinical/passive_joints.yaml`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array

from ..body.skeleton import DOF_INDEX, DOFS
from ..profile import clinical_norms
from . import muscle_kernel as kernel
from .hill import DAMPING
from .muscle_model import MuscleModel

# Columns of `end_tissue`: torque at either end [N·m] and where it has fallen to 1/e [rad].
LOW_TORQUE, LOW_WIDTH, HIGH_TORQUE, HIGH_WIDTH = 0, 1, 2, 3
LEAST_WIDTH = 0.01  # [rad]
LEAST_DAMPING = 0.1  # of the joint's: what is left where fibres already damp by more


@dataclass(frozen=True)
class PassiveJoint:
    """How a joint resists, per inertia about it.

    Attributes:
        damping: [1/s].
        at_most: Torque at the upper end of the passive range [1/s²], and where it fades [deg].
        at_least: Likewise at the lower end.
    """

    damping: float
    at_most: tuple[float, float]
    at_least: tuple[float, float]

    def __post_init__(self) -> None:
        if min(self.damping, *self.at_most, *self.at_least) < 0:
            raise ConfigError(f"a passive joint has no figure below 0, got {self}")


@dataclass(frozen=True)
class PassiveJoints:
    """What is known of relaxed joints (`assets/clinical/passive_joints.yaml`).

    Attributes:
        other_damping: Of the rest [s/rad], by normal torque.
        joints: By the positive motion of the DoF.
    """

    other_damping: float
    joints: dict[str, PassiveJoint]

    def __post_init__(self) -> None:
        for motion in self.joints:
            check_name("motion of a passive joint", motion, clinical_norms().motions)


@lru_cache(maxsize=1)
def passive_joints() -> PassiveJoints:
    """Return what is known of relaxed joints."""
    return load(PassiveJoints, assets.find("clinical", "passive_joints"))


def joint_damping(dofs: Sequence[str], normal_strength: Array, inertia: Array) -> Array:
    """Return the damping of relaxed joints [N·m·s/rad], shape [n].

    Args:
        dofs: Names of the n DoFs.
        normal_strength: Torque of a healthy person [N·m], shape [n].
        inertia: Of what hangs on each DoF [kg·m²], shape [n].
    """
    known = passive_joints()
    out = known.other_damping * normal_strength
    for i, name in enumerate(dofs):
        row = known.joints.get(DOFS[DOF_INDEX[name]].positive)
        if row is not None:
            out[i] = row.damping * inertia[i]
    return out


def damping_beside_muscles(model: MuscleModel, posture: Array, damping: Array) -> Array:
    """Return what is left of the joints' damping beside that of resting fibres [N·m·s/rad], shape [n].

    Fibres damp while they lengthen, so of an antagonistic pair one at a time: half of all of them.

    Args:
        model: The muscles.
        posture: Angles [rad], shape [n].
        damping: What the joints should have in all [N·m·s/rad], shape [n].
    """
    table, arms = model.table, model.moment_arms(posture)
    each = DAMPING * table[:, kernel.FORCE] / table[:, kernel.FIBRE]
    fibres = 0.5 * each @ (arms * arms)
    return np.maximum(damping - fibres, LEAST_DAMPING * damping)


def end_tissue(dofs: Sequence[str], inertia: Array) -> Array:
    """Return how tissue tightens towards the ends of each DoF's passive range, shape [n, 4].

    The columns are named above; rows of DoFs of which nothing is known have no torque.
    """
    out = np.zeros((len(dofs), 4))
    out[:, LOW_WIDTH] = out[:, HIGH_WIDTH] = 1.0
    for i, name in enumerate(dofs):
        row = passive_joints().joints.get(DOFS[DOF_INDEX[name]].positive)
        if row is None:
            continue
        for (torque, width), column in ((row.at_least, LOW_TORQUE), (row.at_most, HIGH_TORQUE)):
            out[i, column] = torque * inertia[i]
            out[i, column + 1] = max(math.radians(width), LEAST_WIDTH)
    return out
