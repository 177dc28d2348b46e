"""Segment masses and inertias from published shares of body weight.

Source of lengths, masses, centres and radii of gyration: P. de Leva, "Adjustments to
Zatsiorsky-Seluyanov's segment inertia parameters", J. Biomechanics 29(9), 1996, table 4, as two
transcriptions have it that agree (the mass columns sum to 100 %). How a published segment is divided
among the SMPL-X joints that lie inside it (a trunk third among two vertebrae, a hand among palm and
phalanges) is our own choice, and says so below.
"""

from __future__ import annotations

from typing import Literal

from .skeleton import FINGERS, JOINTS, SIDES

Sex = Literal["female", "male"]

# Share of body weight [%], one side for limbs: (male, female).
SEGMENT_MASS_PERCENT: dict[str, tuple[float, float]] = {
    "head_and_neck": (6.94, 6.68),
    "upper_trunk": (15.96, 15.45),
    "middle_trunk": (16.33, 14.65),
    "lower_trunk": (11.17, 12.47),
    "upper_arm": (2.71, 2.55),
    "forearm": (1.62, 1.38),
    "hand": (0.61, 0.56),
    "thigh": (14.16, 14.78),
    "shank": (4.33, 4.81),
    "foot": (1.37, 1.29),
}

# Centre of mass from the proximal joint as a share of segment length: (male, female).
CENTRE_OF_MASS: dict[str, tuple[float, float]] = {
    "upper_arm": (0.577, 0.575),
    "forearm": (0.457, 0.456),
    "thigh": (0.410, 0.361),
    "shank": (0.446, 0.442),
}

# Length between joint centres as a share of stature, the hand's to its tip: (male, female).
SEGMENT_LENGTHS: dict[str, tuple[float, float]] = {  # cm of men of 174.1 and women of 173.5 cm
    "upper_arm": (28.17 / 174.1, 27.51 / 173.5),
    "forearm": (26.89 / 174.1, 26.43 / 173.5),
    "thigh": (42.22 / 174.1, 36.85 / 173.5),
    "shank": (43.40 / 174.1, 43.23 / 173.5),
    "hand": (18.79 / 174.1, 17.01 / 173.5),
    "trunk": (51.55 / 174.1, 49.79 / 173.5),  # between the middles of shoulder and hip joints
}

# Radii of gyration about the centre of mass as a share of segment length: sagittal, transverse,
# longitudinal axis; male, then female.
RADII_OF_GYRATION: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "upper_arm": ((0.285, 0.269, 0.158), (0.278, 0.260, 0.148)),
    "forearm": ((0.276, 0.265, 0.121), (0.261, 0.257, 0.094)),
    "thigh": ((0.329, 0.329, 0.149), (0.369, 0.364, 0.162)),
    "shank": ((0.255, 0.249, 0.103), (0.271, 0.267, 0.093)),
}

# SMPL-X joint of a limb -> published segment that hangs on it whole.
WHOLE_SEGMENT = {"shoulder": "upper_arm", "elbow": "forearm", "hip": "thigh", "knee": "shank"}


def _shares() -> dict[str, tuple[str, float]]:
    """Return SMPL-X joint -> (published segment, share of it); the division is our own choice."""
    finger = {"index": 0.085, "middle": 0.090, "ring": 0.080, "pinky": 0.055, "thumb": 0.090}
    phalanx = (0.5, 0.3, 0.2)
    shares = {
        "pelvis": ("lower_trunk", 1.0),
        "spine1": ("middle_trunk", 0.5),
        "spine2": ("middle_trunk", 0.5),
        "spine3": ("upper_trunk", 0.8),
        "neck": ("head_and_neck", 0.14),
        "head": ("head_and_neck", 0.777),
        "jaw": ("head_and_neck", 0.08),
    }
    for side in SIDES:
        shares[f"{side}_collar"] = ("upper_trunk", 0.1)
        shares[f"{side}_eye_smplhf"] = ("head_and_neck", 0.0015)
        for joint, segment in WHOLE_SEGMENT.items():
            shares[f"{side}_{joint}"] = (segment, 1.0)
        shares[f"{side}_ankle"], shares[f"{side}_foot"] = ("foot", 0.85), ("foot", 0.15)
        shares[f"{side}_wrist"] = ("hand", 1 - sum(finger.values()))
        for name in FINGERS:
            for k, part in enumerate(phalanx):
                shares[f"{side}_{name}{k + 1}"] = ("hand", finger[name] * part)
    return shares


SHARES = _shares()


def segment_masses(weight: float, sex: Sex) -> dict[str, float]:
    """Return the mass of the segment on each SMPL-X joint [kg]; they sum to `weight` [kg]."""
    column = 0 if sex == "male" else 1
    raw = {
        joint: SEGMENT_MASS_PERCENT[segment][column] * share
        for joint, (segment, share) in SHARES.items()
    }
    total = sum(raw.values())  # 100 but for rounding in the published table
    return {joint: raw[joint] * weight / total for joint in JOINTS}


def limb_inertia(joint: str, mass: float, length: float, sex: Sex) -> tuple[float, float]:
    """Return inertia across and along a whole limb segment about its centre of mass [kg·m²]."""
    segment = WHOLE_SEGMENT[joint.split("_", 1)[1]]
    sagittal, transverse, longitudinal = RADII_OF_GYRATION[segment][0 if sex == "male" else 1]
    across = 0.5 * (sagittal**2 + transverse**2)
    return mass * length**2 * across, mass * length**2 * longitudinal**2


def limb_centre(joint: str, sex: Sex) -> float:
    """Return the centre of mass of a whole limb segment as a share of its length."""
    return CENTRE_OF_MASS[WHOLE_SEGMENT[joint.split("_", 1)[1]]][0 if sex == "male" else 1]
