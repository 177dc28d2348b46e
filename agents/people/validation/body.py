"""Lengths and masses of the segments of the people that ship, beside published ones."""

from __future__ import annotations

import numpy as np

from rcare_marl import assets

from ..avatar import AvatarConfig, body_model, body_segments, load_avatar
from ..body.anthropometry import SEGMENT_LENGTHS, SEGMENT_MASS_PERCENT, SHARES
from ..body.skeleton import JOINT_INDEX, SIDES
from ..body.skin import BodyModel
from .check import Check

TOLERANCE = 0.05  # of a published length or mass
SOURCE = "de Leva 1996, J Biomech 29:1223, table 4"
ENDS = {
    "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
    "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"),
}


def checks() -> list[Check]:
    """Return the checks of all avatars; both sides are alike. Masses are made from the table."""
    return [check for name in assets.names("avatars") for check in _person(load_avatar(name))]


def _person(avatar: AvatarConfig) -> list[Check]:
    sex = 0 if avatar.sex == "male" else 1
    path, height = avatar.body_path(), avatar.height_m
    lengths = _lengths(body_model(path, height))
    segments = body_segments(path, height, avatar.mass_kg, avatar.sex)
    masses = dict.fromkeys(SEGMENT_MASS_PERCENT, 0.0)
    for joint, (segment, _) in SHARES.items():
        sides = 1 if segment == "head_and_neck" or "trunk" in segment else len(SIDES)
        masses[segment] += segments[joint].mass / sides
    rows = [
        (f"length of {segment}", 100 * ours, 100 * height * SEGMENT_LENGTHS[segment][sex], "cm")
        for segment, ours in lengths.items()
    ]
    rows += [
        (
            f"mass of {segment}",
            mass,
            avatar.mass_kg * SEGMENT_MASS_PERCENT[segment][sex] / 100,
            "kg",
        )
        for segment, mass in masses.items()
    ]
    return [
        Check(
            "body",
            f"{avatar.name}: {case}",
            ours,
            (1 - TOLERANCE) * published,
            (1 + TOLERANCE) * published,
            unit,
            SOURCE,
            "read",
            is_fitted=unit == "kg",
        )
        for case, ours, published, unit in rows
    ]


def _lengths(model: BodyModel) -> dict[str, float]:
    """Return the length of each segment between its joint centres [m]; a hand's to its tip."""
    joint = {name: model.joints[i] for name, i in JOINT_INDEX.items()}
    out = {
        segment: float(np.linalg.norm(joint[f"left_{end}"] - joint[f"left_{start}"]))
        for segment, (start, end) in ENDS.items()
    }
    out["hand"] = float(model.vertices[:, 0].max() - joint["left_wrist"][0])
    shoulders, hips = (
        sum(joint[f"{side}_{name}"] for side in SIDES) / len(SIDES) for name in ("shoulder", "hip")
    )
    out["trunk"] = float(np.linalg.norm(shoulders - hips))
    return out
