"""How far muscles bring each motion: agonists fully active, everything else at rest, without gravity."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rcare_marl.pose import Array

from ..actuation.hill import RESTING_ACTIVATION
from ..actuation.muscle_model import MuscleModel
from ..body.skeleton import DOF_INDEX, DOFS, EYES, SIDES
from ..profile import ClinicalProfile, clinical_norms
from .check import Basis, Check
from .reference_muscles import muscle_model

STEPS = 25  # in which a motion is followed through its range
SHARE = 0.9  # of the normal active range that a motion must reach, our own choice


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


def checks() -> list[Check]:
    """Return how far each motion of the reference skeleton comes; muscles were calibrated for it."""
    model, norms = muscle_model(), clinical_norms().motions
    out = []
    for motion in active_motions():
        norm = norms[motion.name]
        way = float(np.degrees(abs(motion.end - motion.start)))
        source = f"range: {norm.range_source}"
        basis: Basis = "read" if norm.range_source == "aaos" else "memory"
        ours = reached(model, motion) * way
        case = f"{motion.name} ({motion.dof})"
        low = SHARE * way
        out.append(Check("active range", case, ours, low, way, "deg", source, basis, True))
    return out
