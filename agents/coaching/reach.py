"""What a person can do of an exercise: their active range as a `Reach`.

An arm is raised against gravity. That takes muscles of grade 3 or better (the meaning of that grade in
manual muscle testing); an arm whose abductors and flexors are both weaker has no part in an exercise and
stays where it lies.
"""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.pose import Array

from ..people.body.skeleton import DOF_INDEX, DOFS, SIDES
from ..people.profile import ClinicalProfile
from .exercise import Reach
from .imitation import AXIAL
from .upper_body import ARM, MOTION_INDEX, MOTIONS

AGAINST_GRAVITY = 3.0  # grade from which a muscle moves a limb against its weight
ACROSS = math.radians(45.0)  # how far an arm goes past the front, over the body; AAOS, from memory


def reach_of(profile: ClinicalProfile, seated: Array | None = None) -> Reach:
    """Return what a person reaches by themselves.

    Args:
        profile: Their abilities.
        seated: Where their upper body rests [rad], shape [16]: what cannot be raised stays there. Hanging
            arms if None.
    """
    limits = profile.limits("active")
    rest = np.zeros(len(MOTIONS)) if seated is None else np.nan_to_num(seated)
    low, high = rest.copy(), rest.copy()
    for motion, dofs in AXIAL.items():
        i = MOTION_INDEX[motion]
        low[i], high[i] = np.sum([limits[dof] for dof in dofs], axis=0)
    front = []
    for side in SIDES:
        arm = ARM[side]
        front.append(float(rest[arm.start]))
        if side not in raised_sides(profile):
            continue
        clinical = {
            dof: np.array(limits[f"{side}_{dof}"]) + DOFS[DOF_INDEX[f"{side}_{dof}"]].clinical_zero
            for dof in (
                "shoulder_abduction",
                "shoulder_flexion",
                "shoulder_external_rotation",
                "elbow_flexion",
                "elbow_pronation",
            )
        }
        out, ahead, turn = (
            clinical[f"shoulder_{name}"] for name in ("abduction", "flexion", "external_rotation")
        )
        can = {name: can_raise(profile, side, name) for name in ("abduction", "flexion")}
        most = (
            out[1] if can["abduction"] else rest[arm.start],
            float(ahead[1]) if can["flexion"] else float(rest[arm.start]),
        )
        low[arm] = (
            0.0,
            ahead[0],
            -turn[1],
            *(clinical[f"elbow_{n}"][0] for n in ("flexion", "pronation")),
        )
        high[arm] = (
            most[0],
            math.pi / 2 + ACROSS,
            -turn[0],
            *(clinical[f"elbow_{n}"][1] for n in ("flexion", "pronation")),
        )
        front[-1] = most[1]
    return Reach(np.minimum(low, high), np.maximum(low, high), (front[0], front[1]))


def can_raise(profile: ClinicalProfile, side: str, motion: str) -> bool:
    """Return whether a shoulder's `abduction` or `flexion` raises the arm against its weight."""
    dof = DOFS[DOF_INDEX[f"{side}_shoulder_{motion}"]]
    low, high = profile.limits("active")[dof.name]
    return high > low and profile.grade(dof, positive=True) >= AGAINST_GRAVITY


def raised_sides(profile: ClinicalProfile) -> tuple[str, ...]:
    """Return the sides whose arm the person can raise, to the side or to the front."""
    return tuple(
        side
        for side in SIDES
        if can_raise(profile, side, "abduction") or can_raise(profile, side, "flexion")
    )
