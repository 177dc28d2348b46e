"""Kneeling down on one knee, from standing.

Our own: one foot stays where it stands, the other leg goes back until its knee is on the floor, and the
pelvis comes down between them. Its figures are our own choices.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose, matrix_from_quaternion, quaternion_from_matrix

from ..body.goal import Goal, Orientation, Position
from ..body.ik import WholeBodyIk, present_angles
from ..body.skeleton import DOF_INDEX, JOINT_INDEX, SIDES, forward_kinematics
from ..human import Human
from .clip import Motion
from .trajectory import minimum_jerk
from .walk import NEEDED

Array = npt.NDArray[np.float64]

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


class Kneel:
    """The plan of a person who stands and kneels down.

    Attributes:
        motion: All DoFs and the pelvis over time.
    """

    def __init__(self, person: Human, *, knee: str = "left", duration: float = DURATION) -> None:
        """Plan for a spawned person who stands.

        Args:
            person: Who kneels; the DoFs in `walk.NEEDED` must be movable.
            knee: The side whose knee goes to the floor.
            duration: How long it takes [s].

        Raises:
            UnknownNameError: If there is no such side.
            ConfigError: If the legs cannot move, or the duration is not positive.
        """
        if knee not in SIDES:
            raise UnknownNameError("side", knee, SIDES)
        missing = [dof for dof in NEEDED if dof not in person.movable]
        if missing:
            raise ConfigError(
                f"to kneel, {person.name!r} needs {', '.join(missing)} among the movable DoFs"
            )
        if not (math.isfinite(duration) and duration > 0):
            raise ConfigError(f"the time to kneel must be positive, got {duration} s")
        self._person, self._knee = person, knee
        self._front = "right" if knee == "left" else "left"
        self._angles, self._joints = present_angles(person), person.model.joints
        self._start = person.body.base_pose()
        self.motion = self._solve(duration)

    def _goal(self) -> tuple[Array, Array]:
        """Return the angles of the kneeling leg [rad] and where the pelvis ends [m]."""
        angles = self._angles.copy()
        limits = self._person.avatar.profile.limits("passive")
        for name, degrees in KNEELING_DEG.items():
            dof = f"{self._knee}_{name}"
            if dof in self._person.movable:
                angles[DOF_INDEX[dof]] = np.clip(math.radians(degrees), *limits[dof])
        turn = matrix_from_quaternion(self._start.quaternion)
        rotations, positions = forward_kinematics(self._joints, self._angles)
        surface = self._person.model.posed(rotations, positions)
        floor = self._start.position[2] + float((surface @ turn.T)[:, 2].min())
        _, positions = forward_kinematics(self._joints, angles)
        knee = turn @ positions[JOINT_INDEX[f"{self._knee}_knee"]]
        radius = self._person.segments[f"{self._knee}_knee"].shapes[0].size[1]
        ahead = turn[:, 2] * (1.0, 1.0, 0.0)  # where the person looks
        thigh = np.linalg.norm(
            self._joints[JOINT_INDEX[f"{self._knee}_knee"]]
            - self._joints[JOINT_INDEX[f"{self._knee}_hip"]]
        )
        end = np.array(self._start.position) - THIGH_BACK * thigh * ahead
        end[2] = floor + radius - knee[2]
        return angles, end

    def _solve(self, duration: float) -> Motion:
        """Find the posture of every frame."""
        person, front = self._person, self._front
        legs = [
            dof
            for dof in person.movable
            if dof.startswith(front) and dof.split("_")[1] in ("hip", "knee", "ankle")
        ]
        ik = WholeBodyIk.of(person, kind="passive", movable=legs)
        kneeling, end = self._goal()
        base = self._start.matrix()
        rotations, positions = forward_kinematics(self._joints, self._angles)
        ankle = JOINT_INDEX[f"{front}_ankle"]
        place = base[:3, :3] @ positions[ankle] + base[:3, 3]
        foot = quaternion_from_matrix(base[:3, :3] @ rotations[ankle])
        goals: list[Goal] = [Position(f"{front}_ankle", place), Orientation(f"{front}_ankle", foot)]
        count = max(math.ceil(duration * RATE), 1) + 1
        angles, places, now = [], [], self._angles
        for share in (minimum_jerk(k / (count - 1)) for k in range(count)):
            pelvis = (1 - share) * np.array(self._start.position) + share * end
            now = now.copy()
            for name in KNEELING_DEG:
                i = DOF_INDEX[f"{self._knee}_{name}"]
                now[i] = (1 - share) * self._angles[i] + share * kneeling[i]
            for name, angle in BENT.items():
                now[DOF_INDEX[f"{front}_{name}"]] = share * angle
            pose = Pose(tuple(pelvis.tolist()), self._start.quaternion)
            now = ik.solve(goals, now, pose, rest=now, fallback=False).angles
            angles.append(now)
            places.append(pelvis)
        return Motion(
            rate=(count - 1) / duration,
            angles=np.array(angles),
            pelvis=np.array(places),
            quaternions=np.tile(self._start.quaternion, (count, 1)),
        )


__all__ = ["DURATION", "Kneel"]
