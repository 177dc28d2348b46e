"""A gait, step by step: where a foot goes, and the legs and the pelvis that follow it.

A synthetic gait of our own, not a recorded one: it moves the pelvis smoothly between the places of the feet,
and finds the legs by inverse kinematics, so a foot that stands does not slide. Its figures are our own
choices, near an unhurried walk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import (
    Array,
    Pose,
    matrix_from_quaternion,
    quaternion_from_axis_angle,
    quaternion_from_matrix,
)

from ..body.goal import Goal, Orientation, Position
from ..body.ik import WholeBodyIk
from ..body.skeleton import DOF_INDEX, JOINT_INDEX, SIDES, forward_kinematics
from .clip import Motion, heading_of, leg_length
from .trajectory import minimum_jerk

if TYPE_CHECKING:
    from ..human import Human


RATE = 60.0  # frames a second
STEP_TIME = 0.6  # [s]
STEP_LENGTH = 0.45  # [m] that the pelvis gets on in one step
SIDE_STEP = 0.2  # [m] to the side of the foot that steps; the other one only follows
STEP_TURN = math.radians(45), math.radians(15)  # of a foot that turns out, and in
SWING = (0.12, 0.88)  # share of a step in which the foot is in the air
LIFT = 0.06  # [m] that a foot is lifted
HEEL_RISE = math.radians(30)  # of a foot that has been left behind
HEEL_UP = 0.35  # share of the other foot's step in which the heel begins to rise
HEEL_DOWN = 1.0  # share of its own swing in which it is level again
ANKLE_SPARE = math.radians(2)  # of the ankle's range
_EASING = 6  # rounds that find the tip of a foot
STRAIGHT = 0.98  # of the leg's length: a knee is never locked
VAULT = 0.75  # share of a step in which the pelvis goes up over the standing leg and down again
UPRIGHT_WITHIN = math.radians(25)  # of the trunk, for somebody who can begin to walk
# What must be movable.
NEEDED = tuple(
    f"{side}_{dof}"
    for side in SIDES
    for dof in (
        *("hip_flexion", "hip_abduction", "hip_external_rotation"),
        *("knee_flexion", "ankle_dorsiflexion"),
    )
)
_BENDING = {"hip_flexion": 0.5, "knee_flexion": 1.0, "ankle_dorsiflexion": 0.5}
LEGS = tuple(f"{side}_{joint}" for side in SIDES for joint in ("hip", "ankle")) + tuple(
    f"{side}_{dof}" for side in SIDES for dof in ("knee_flexion", "foot_extension")
)


@dataclass(frozen=True)
class Station:
    """A place to stand: position on the floor [m] and heading from the x axis [rad]."""

    x: float
    y: float
    heading: float

    @classmethod
    def below(cls, pelvis: Pose) -> Station:
        """Return where somebody stands whose pelvis is at a pose."""
        x, y, _ = pelvis.position
        return cls(x, y, heading_of(pelvis))

    def at(self, forward: float, left: float) -> tuple[float, float]:
        """Return the point so far ahead and to the left [m]."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        return self.x + c * forward - s * left, self.y + s * forward + c * left

    def seen_from(self, other: Station) -> tuple[float, float]:
        """Return how far ahead and to the left of another station it is [m]."""
        c, s = math.cos(other.heading), math.sin(other.heading)
        dx, dy = self.x - other.x, self.y - other.y
        return c * dx + s * dy, c * dy - s * dx


def sizes(side: str, share: Sequence[float]) -> tuple[float, float, float]:
    """Return how far the greatest step of a foot goes: forward, left [m] and turning left [rad].

    Legs do not cross, and toes do not point far inwards: only the foot on the side that the way bends
    to goes far to that side.

    Args:
        side: The foot.
        share: What is wanted, by its sign: forward, left, turning left.
    """
    own = 1.0 if side == "left" else -1.0
    out, inwards = STEP_TURN
    return (
        STEP_LENGTH,
        SIDE_STEP if share[1] * own > 0 else 0.0,
        out if share[2] * own > 0 else inwards,
    )


@dataclass(frozen=True)
class Step:
    """A step: one foot goes from `before` to `goal`, the other one stands at `here`."""

    side: str
    before: Station
    here: Station
    goal: Station

    @property
    def begins(self) -> bool:
        """Whether it is the first after standing."""
        return self.before == self.here

    @property
    def ends(self) -> bool:
        """Whether both feet stand side by side after it."""
        return self.goal == self.here

    def ground(self, u: float) -> Station:
        """Return the pelvis over the floor at a share: a quadratic B-spline over the stations."""
        p, q, r = self.before, self.here, self.goal
        a, b, c = 0.5 * (1 - u) ** 2, 0.5 * (1 + 2 * u - 2 * u * u), 0.5 * u * u
        return Station(
            a * p.x + b * q.x + c * r.x,
            a * p.y + b * q.y + c * r.y,
            a * p.heading + b * q.heading + c * r.heading,
        )


@dataclass(frozen=True)
class _Foot:
    """How a foot stands below the pelvis: forward, left and up of the ankle [m], its turn."""

    forward: float
    left: float
    height: float
    rotation: Array  # of the ankle, against the heading


class Gait:
    """Plans the steps of a person, one at a time.

    Attributes:
        standing: The posture in which the person stands [rad], shape [112].
    """

    def __init__(self, person: Human) -> None:
        """Take a spawned person in the posture of the start.

        Raises:
            ConfigError: If the legs cannot move, or the person does not stand.
        """
        missing = [dof for dof in NEEDED if dof not in person.movable]
        if missing:
            raise ConfigError(
                f"to walk or kneel, {person.name!r} needs {', '.join(missing)} among the movable DoFs"
            )
        self._person, self._pelvis = person, person.pelvis
        self.standing = person.angles.copy()
        self._joints = person.model.joints
        self._leg = leg_length(self._joints)
        rotations, positions = forward_kinematics(self._joints, self.standing)
        self._check_upright(positions)
        self._feet = {side: self._foot(side, rotations, positions) for side in SIDES}
        legs = [dof for dof in person.movable if dof.split("_")[1] in ("hip", "knee", "ankle")]
        self._ik = WholeBodyIk.of(person, kind="passive", movable=legs)
        self._turn = matrix_from_quaternion(self._pelvis.quaternion)
        level = _yaw(-heading_of(self._pelvis)) @ self._turn
        self._hips = {side: level @ positions[JOINT_INDEX[f"{side}_hip"]] for side in SIDES}

    def _check_upright(self, positions: Array) -> None:
        up = matrix_from_quaternion(self._pelvis.quaternion)[2, 1]
        drops = [
            positions[JOINT_INDEX[f"{s}_hip"], 1] - positions[JOINT_INDEX[f"{s}_ankle"], 1]
            for s in SIDES
        ]
        if up < math.cos(UPRIGHT_WITHIN) or min(drops) < 0.8 * self._leg:
            raise ConfigError(
                f"{self._person.name!r} does not stand, so cannot walk or kneel: posture 'standing' "
                "does, or take the parts out of `moves`"
            )

    def _foot(self, side: str, rotations: Array, positions: Array) -> _Foot:
        base, j = self._pelvis.matrix(), JOINT_INDEX[f"{side}_ankle"]
        place = base[:3, :3] @ positions[j] + base[:3, 3]
        turn = _yaw(-heading_of(self._pelvis))
        offset = turn @ (place - base[:3, 3])
        return _Foot(offset[0], offset[1], place[2], turn @ base[:3, :3] @ rotations[j])

    def plan(self, step: Step, angles: Array, height: float) -> Motion:
        """Return a step as a motion of the legs and the pelvis.

        Args:
            step: The step.
            angles: The posture in which it begins [rad], shape [112].
            height: That of the pelvis then [m].
        """
        count = round(STEP_TIME * RATE) + 1
        heights = self._heights(step, height, np.linspace(0.0, 1.0, count))
        frames, poses, now = [], [], angles
        for k, height in enumerate(heights.tolist()):
            share = k / (count - 1)
            pelvis = self._pelvis_at(step.ground(share), height)
            if k:
                now = self._posture(step, share, pelvis, now)
            frames.append(now)
            poses.append(pelvis)
        if step.ends:
            frames[-1] = self.standing
        return Motion(
            rate=(count - 1) / STEP_TIME,
            angles=np.array(frames),
            pelvis=np.array([pose.position for pose in poses]),
            quaternions=np.array([pose.quaternion for pose in poses]),
        )

    def _pelvis_at(self, ground: Station, height: float) -> Pose:
        rotation = _yaw(ground.heading - heading_of(self._pelvis)) @ self._turn
        turned = tuple(quaternion_from_matrix(rotation).tolist())
        return Pose((ground.x, ground.y, height), turned)

    def _posture(self, step: Step, share: float, pelvis: Pose, now: Array) -> Array:
        """Return the posture of a frame, with bent toes."""
        goals: list[Goal] = []
        rises, yaw, now = {}, _yaw(heading_of(pelvis)), now.copy()
        for side in SIDES:
            hip = yaw @ self._hips[side] + pelvis.position
            place, foot, rises[side] = self._eased(side, hip, *self._ankle(step, side, share))
            # From a straight knee least squares would not know which way to bend.
            bent = 2 * math.acos(min(float(np.linalg.norm(place - hip)) / self._leg, 1.0))
            more = bent - now[DOF_INDEX[f"{side}_knee_flexion"]]
            for dof, portion in _BENDING.items():
                now[DOF_INDEX[f"{side}_{dof}"]] += portion * more
            goals.append(Position(f"{side}_ankle", place))
            goals.append(Orientation(f"{side}_ankle", quaternion_from_matrix(foot)))
        found = self._ik.solve(goals, now, pelvis, rest=self.standing, fallback=False).angles.copy()
        for side in SIDES:
            toes = DOF_INDEX[f"{side}_foot_extension"]
            found[toes] = self.standing[toes] + rises[side]
        return found

    def _ankle(self, step: Step, side: str, share: float) -> tuple[Array, Array, float]:
        """Return place [m], rotation and heel rise [rad] of an ankle at a share of a step."""
        foot, here, left = self._feet[side], step.here, step.goal.seen_from(step.here)[0]
        spot, heading, lift = here.at(foot.forward, foot.left), here.heading, 0.0
        rise = minimum_jerk((share - HEEL_UP) / (1 - HEEL_UP + SWING[0]))  # of the one left behind
        if step.side == side:
            a, b = step.before.at(foot.forward, foot.left), step.goal.at(foot.forward, foot.left)
            passed = (share - SWING[0]) / (SWING[1] - SWING[0])
            gone = minimum_jerk(passed)
            spot = (a[0] + gone * (b[0] - a[0]), a[1] + gone * (b[1] - a[1]))
            heading = step.before.heading + gone * (step.goal.heading - step.before.heading)
            lift = LIFT * math.sin(math.pi * min(max(passed, 0.0), 1.0)) ** 2
            left = here.seen_from(step.before)[0]
            rise = minimum_jerk((share + 1 - HEEL_UP) / (1 - HEEL_UP + SWING[0]))
            rise *= 1 - minimum_jerk(passed / HEEL_DOWN)
        rise *= HEEL_RISE * min(max(left, 0.0) / STEP_LENGTH, 1.0)  # short ways raise no heel
        rotation = _yaw(heading) @ foot.rotation
        ball = self._ball(side)
        place = np.array((*spot, foot.height + lift))
        tipped = rotation @ _about_left(rise)  # about the ball of the foot, which stays
        return place + rotation @ ball - tipped @ ball, tipped, rise

    def _ball(self, side: str) -> Array:
        toes, ankle = (self._joints[JOINT_INDEX[f"{side}_{part}"]] for part in ("foot", "ankle"))
        return np.asarray(toes - ankle)

    def _eased(
        self, side: str, hip: Array, place: Array, rotation: Array, rise: float
    ) -> tuple[Array, Array, float]:
        """Tip a foot further onto its ball where its ankle would have to bend beyond its range.

        Thigh and shank count as equally long: the shank then leans by half the knee's flexion.
        """
        ball = self._ball(side)
        index = self._person.movable.index(f"{side}_ankle_dorsiflexion")
        most = float(self._person.passive[index, 1]) - ANKLE_SPARE
        for _ in range(_EASING):
            way = rotation.T @ (hip - place)
            bent = math.acos(min(float(np.linalg.norm(way)) / self._leg, 1.0))
            excess = math.atan2(way[2], way[1]) + bent - most
            if excess <= 0:
                break
            tipped = rotation @ _about_left(excess)
            place = place + rotation @ ball - tipped @ ball
            rotation, rise = tipped, rise + excess
        return place, rotation, rise

    def _heights(self, step: Step, first: float, shares: Array) -> Array:
        """Return the height of the pelvis [m] at shares of a step: about as high as the legs reach.

        It goes smoothly from where it is to as high as they reach all through the end of the step, where
        the feet are furthest apart, and higher before that.
        """
        standing = self._pelvis.position[2]
        reach = np.array([self._reach(step, share) for share in shares.tolist()])
        last = standing if step.ends else min(float(reach[shares >= VAULT].min()), standing)
        base = first + np.array([minimum_jerk(u) for u in shares.tolist()]) * (last - first)
        wave = np.sin(math.pi * np.minimum(shares / VAULT, 1.0)) ** 2
        middle = wave > 0.3
        bump = float(((reach - base)[middle] / wave[middle]).min())
        return np.asarray(np.minimum(base + bump * wave, standing))

    def _reach(self, step: Step, share: float) -> float:
        """Return how high the pelvis may be [m] so that no knee is straighter than it should be."""
        ground, out = step.ground(share), math.inf
        straight = STRAIGHT
        if step.begins:  # from a standing knee, which may be straight
            straight = 1.0 + minimum_jerk(2 * share) * (straight - 1.0)
        if step.ends:
            straight = 1.0 + minimum_jerk(2 - 2 * share) * (straight - 1.0)
        for side in SIDES:
            hip = _yaw(ground.heading) @ self._hips[side]
            place, _, _ = self._ankle(step, side, share)
            gap = math.hypot(place[0] - ground.x - hip[0], place[1] - ground.y - hip[1])
            up = math.sqrt(max((straight * self._leg) ** 2 - gap * gap, 0.0))
            out = min(out, place[2] + up - hip[2])
        return out


def _yaw(angle: float) -> Array:
    return matrix_from_quaternion(quaternion_from_axis_angle((0, 0, 1), angle))


def _about_left(angle: float) -> Array:
    """Return the turn of a foot that raises its heel: about its x axis, which points left."""
    return matrix_from_quaternion(quaternion_from_axis_angle((1, 0, 0), angle))
