"""Kneeling down on one knee, from standing.

Our own: one foot stays where it stands, the other leg goes back until its knee is on the floor, and the
pelvis comes down between them. Its figures are our own choices.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rcare_marl.pose import Array, Pose, matrix_from_quaternion, quaternion_from_matrix

from ..body.goal import Goal, Orientation, Position
from ..body.ik import WholeBodyIk
from ..body.skeleton import DOF_INDEX, JOINT_INDEX, SIDES, forward_kinematics
from .clip import Motion
from .trajectory import minimum_jerk

if TYPE_CHECKING:
    from ..human import Human

RATE = 30.0  # frames a second
DURATION = 1.8  # [s]
# Where the kneeling leg ends: thigh upright, toes tucked under.
KNEELING_DEG = {
    "hip_flexion": 0.0,
    "hip_abduction": 3.0,
    "hip_external_rotation": 0.0,
    "knee_flexion": 104.0,
    "ankle_dorsiflexion": 8.0,
    "foot_extension": 50.0,
}
# Where the search for the front leg begins: from straight, least squares would not know which way to bend.
BENT = {"hip_flexion": math.radians(80), "knee_flexion": math.radians(90)}
THIGH_BACK = 0.92  # of the front thigh's length that the pelvis goes back


def plan_kneel(person: Human, knee: str, standing: Array) -> Motion:
    """Return how a person goes down on one knee, from where they stand: legs and pelvis.

    Args:
        person: Who kneels, spawned.
        knee: The side whose knee goes to the floor.
        standing: The posture in which the person stands [rad], shape [112].
    """
    front = SIDES[1 - SIDES.index(knee)]
    legs = [
        dof
        for dof in person.movable
        if dof.startswith(front) and dof.split("_")[1] in ("hip", "knee", "ankle")
    ]
    ik = WholeBodyIk.of(person, kind="passive", movable=legs)
    start = person.pelvis
    kneeling, end = _end(person, knee, standing)
    base = start.matrix()
    rotations, positions = forward_kinematics(person.model.joints, standing)
    ankle = JOINT_INDEX[f"{front}_ankle"]
    place = base[:3, :3] @ positions[ankle] + base[:3, 3]
    foot = quaternion_from_matrix(base[:3, :3] @ rotations[ankle])
    goals: list[Goal] = [Position(f"{front}_ankle", place), Orientation(f"{front}_ankle", foot)]
    count = math.ceil(DURATION * RATE) + 1
    angles, places, now = [standing], [np.array(start.position)], standing
    for share in (minimum_jerk(k / (count - 1)) for k in range(1, count)):
        pelvis = (1 - share) * np.array(start.position) + share * end
        now = now.copy()
        for name in KNEELING_DEG:
            i = DOF_INDEX[f"{knee}_{name}"]
            now[i] = (1 - share) * standing[i] + share * kneeling[i]
        for name, angle in BENT.items():
            now[DOF_INDEX[f"{front}_{name}"]] = share * angle
        pose = Pose(tuple(pelvis.tolist()), start.quaternion)
        now = ik.solve(goals, now, pose, rest=now, fallback=False).angles
        angles.append(now)
        places.append(pelvis)
    return Motion(
        rate=(count - 1) / DURATION,
        angles=np.array(angles),
        pelvis=np.array(places),
        quaternions=np.tile(start.quaternion, (count, 1)),
    )


def _end(person: Human, knee: str, standing: Array) -> tuple[Array, Array]:
    """Return the angles of the kneeling leg [rad] and where the pelvis ends [m]."""
    angles, joints, start = standing.copy(), person.model.joints, person.pelvis
    limits = person.avatar.profile.limits("passive")
    for name, degrees in KNEELING_DEG.items():
        dof = f"{knee}_{name}"
        if dof in person.movable:
            angles[DOF_INDEX[dof]] = np.clip(math.radians(degrees), *limits[dof])
    turn = matrix_from_quaternion(start.quaternion)
    rotations, positions = forward_kinematics(joints, standing)
    surface = person.model.posed(rotations, positions)
    floor = start.position[2] + float((surface @ turn.T)[:, 2].min())
    hip, bent = (JOINT_INDEX[f"{knee}_{part}"] for part in ("hip", "knee"))
    _, positions = forward_kinematics(joints, angles)
    radius = person.segments[f"{knee}_knee"].shapes[0].size[1]
    ahead = turn[:, 2] * (1.0, 1.0, 0.0)  # where the person looks
    end = np.array(start.position) - THIGH_BACK * np.linalg.norm(joints[bent] - joints[hip]) * ahead
    end[2] = floor + radius - (turn @ positions[bent])[2]
    return angles, end
