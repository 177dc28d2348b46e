"""Whole-body inverse kinematics: how often random wrist goals are met, and how fast.

Run: python experiments/ik_accuracy.py
"""

from __future__ import annotations

import time

import numpy as np

from rcare_marl.agents.people.avatar import body_model, body_segments, load_avatar, load_posture
from rcare_marl.agents.people.body.goal import Goal, Orientation, Position
from rcare_marl.agents.people.body.ik import WholeBodyIk
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, JOINT_INDEX, forward_kinematics
from rcare_marl.console import console, table
from rcare_marl.pose import quaternion_from_matrix

GOALS = 200
ARM = ("collar", "shoulder", "elbow", "wrist")


def measure() -> None:
    """Print how many random reachable wrist goals are met, and how fast."""
    columns = ("avatar", "joints", "met", "memetic", "median [ms]", "95 % [ms]", "median [mm]")
    rows = []
    for name in ("caregiver", "karan"):
        for side in ("left", "right"):
            for trunk in ((), ("spine1", "spine2", "spine3")):
                joints = (*trunk, *(f"{side}_{joint}" for joint in ARM))
                arm = f"{side} arm" + (" and trunk" if trunk else "")
                rows.append((name, arm, *_measured(name, side, joints)))
    title = f"{GOALS} random wrist poses within the active range, from standing"
    console().print(table(title, columns, rows))


def _measured(name: str, side: str, movable: tuple[str, ...]) -> list[str]:
    avatar = load_avatar(name)
    model = body_model(avatar.body_path(), avatar.height_m)
    segments = body_segments(avatar.body_path(), avatar.height_m, avatar.mass_kg, avatar.sex)
    limits = avatar.profile.limits("active")
    ik = WholeBodyIk(model.joints, segments, limits, movable=movable)
    start = load_posture("standing").angles(limits)
    rng, wrist = np.random.default_rng(1), f"{side}_wrist"
    chosen = [DOF_INDEX[dof] for dof in ik.dofs]
    found, times = [], []
    for k in range(GOALS + 1):
        angles = start.copy()
        low, high = ik.lower[chosen], ik.upper[chosen]
        angles[chosen] = low + rng.random(len(chosen)) * (high - low)
        rotations, positions = forward_kinematics(model.joints, angles)
        j = JOINT_INDEX[wrist]
        goals: list[Goal] = [
            Position(wrist, positions[j]),
            Orientation(wrist, quaternion_from_matrix(rotations[j])),
        ]
        since = time.perf_counter()
        solution = ik.solve(goals, start)
        if k:  # the first one compiles
            times.append(1e3 * (time.perf_counter() - since))
            found.append(solution)
    met, memetic = (np.mean([getattr(s, key) for s in found]) for key in ("success", "is_memetic"))
    return [
        f"{met:.1%}",
        f"{memetic:.1%}",
        f"{np.median(times):.2f}",
        f"{np.percentile(times, 95):.2f}",
        f"{1e3 * np.median([s.errors[0] for s in found]):.3f}",
    ]


if __name__ == "__main__":
    measure()
