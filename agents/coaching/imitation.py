"""Angles of an upper body as degrees of freedom of a person, within their active range.

The way back of `JointsSource`: what somebody sees a coach do becomes what their own shoulders, elbows, neck
and trunk have to do. A shoulder of our people abducts first, then flexes, then rotates, and has two ways to
point the arm anywhere: the one is taken that stays within the range and near to where the shoulder is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from ..people.body.skeleton import DOF_INDEX, DOFS, SIDES
from ..people.profile import ClinicalProfile
from .exercise import Reach
from .upper_body import ARM, MOTION_INDEX, MOTIONS, swing, turn_z

Limits = Mapping[str, tuple[float, float]]

AXIAL = {  # motion of the trunk or of the neck: the joints that share it
    motion: [f"{joint}_{name}" for joint in joints]
    for region, joints in (("trunk", ("spine1", "spine2", "spine3")), ("neck", ("neck", "head")))
    for motion, name in (
        (f"{region}_{name}", name) for name in ("flexion", "lateral_flexion_left", "rotation_left")
    )
}
SHOULDER = ("shoulder_abduction", "shoulder_flexion", "shoulder_external_rotation")
# Axes of a person's body (x left, y up, z forward) in those of the upper body (x forward, y left, z up).
IN_UPPER_BODY = np.array(((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
HANGING = math.radians(-90.0)  # abduction of the hanging arm, from the T-pose
# What a shoulder weighs when it chooses: how the arm is turned about itself against where it points, and
# each radian that it has to move from where it is; our own choice.
TURN_WEIGHT, WAY_WEIGHT = 0.1, 0.03
# An arm in front of the body or above it that points less than this to the side is flexed from hanging,
# without abduction: past the front the other way would turn the shoulder over. Our own choice.
SIDEWAYS, AHEAD = math.sin(math.radians(12.0)), 0.7


class Imitation:
    """Makes degrees of freedom of a person of angles of an upper body.

    Attributes:
        dofs: Those that it sets.
    """

    def __init__(self, limits: Limits) -> None:
        """Take the range [rad] of each degree of freedom that the person can use."""
        self._limits = dict(limits)
        arm = (*SHOULDER, "elbow_flexion", "elbow_pronation")
        known = [dof for dofs in AXIAL.values() for dof in dofs]
        known += [f"{side}_{name}" for side in SIDES for name in arm]
        self.dofs = tuple(dof for dof in known if dof in self._limits)
        self.reset()

    def reset(self) -> None:
        """Begin with hanging arms."""
        self._shoulders = {side: (HANGING, 0.0, 0.0) for side in SIDES}

    def __call__(self, angles: Array) -> dict[str, float]:
        """Return the angle of each degree of freedom [rad] that does a pose, as well as the range allows.

        Args:
            angles: Angles of `MOTIONS` [rad], shape [16]; those that are not known are left alone.

        Raises:
            ConfigError: If they have another shape.
        """
        angles = np.asarray(angles, np.float64)
        if angles.shape != (len(MOTIONS),):
            raise ConfigError(f"angles must have shape [{len(MOTIONS)}], got {angles.shape}")
        out: dict[str, float] = {}
        for motion, dofs in AXIAL.items():
            self._share(float(angles[MOTION_INDEX[motion]]), dofs, out)
        for side in SIDES:
            elevation, plane, rotation, elbow, pronation = angles[ARM[side]].tolist()
            if math.isfinite(elevation + plane):
                self._shoulder(side, elevation, plane, rotation, out)
            for dof, angle in (("elbow_flexion", elbow), ("elbow_pronation", pronation)):
                self._share(angle, [f"{side}_{dof}"], out)
        return out

    def _share(self, angle: float, dofs: list[str], out: dict[str, float]) -> None:
        """Spread an angle over the joints that have it, as their shares of the clinical range are."""
        found = [dof for dof in dofs if dof in self._limits]
        whole = sum(DOFS[DOF_INDEX[dof]].share for dof in found)
        if math.isfinite(angle):
            for dof in found:
                part = angle * DOFS[DOF_INDEX[dof]].share / whole
                out[dof] = min(max(part, self._limits[dof][0]), self._limits[dof][1])

    def _shoulder(
        self, side: str, elevation: float, plane: float, rotation: float, out: dict[str, float]
    ) -> None:
        names = [f"{side}_{dof}" for dof in SHOULDER]
        if any(name not in self._limits for name in names):
            return
        low, high = np.array([self._limits[name] for name in names]).T
        wanted = shoulder_turn(elevation, plane, 0.0 if math.isnan(rotation) else rotation)
        before = np.array(self._shoulders[side])
        best, least = before, math.inf
        for choice in _shoulder_angles(wanted):
            angles = np.clip(_near(choice, before), low, high)
            found = turned_by(*angles.tolist())
            away = float(np.linalg.norm(found[:, 0] - wanted[:, 0]))
            turn = float(np.linalg.norm(found[:, 1] - wanted[:, 1]))
            cost = away + TURN_WEIGHT * turn + WAY_WEIGHT * float(np.abs(angles - before).sum())
            if cost < least:
                best, least = angles, cost
        self._shoulders[side] = tuple(best.tolist())
        out.update(zip(names, best.tolist(), strict=True))


def shoulder_turn(elevation: float, plane: float, rotation: float) -> Array:
    """Return how a left upper arm is turned in a person's axes, from the T-pose, shape [3, 3].

    A right arm is its mirror image, with the same angles.
    """
    upper = swing("left", np.float64(elevation), np.float64(plane)) @ turn_z(np.float64(-rotation))
    return IN_UPPER_BODY.T @ upper @ IN_UPPER_BODY @ turned_by(HANGING, 0.0, 0.0)


def turned_by(abduction: float, flexion: float, rotation: float) -> Array:
    """Return how a left upper arm is turned by its three degrees of freedom [rad], shape [3, 3]."""
    ca, sa = math.cos(abduction), math.sin(abduction)
    cf, sf = math.cos(flexion), -math.sin(flexion)
    cr, sr = math.cos(rotation), -math.sin(rotation)
    return np.array(
        (
            (ca * cf, ca * sf * sr - sa * cr, ca * sf * cr + sa * sr),
            (sa * cf, sa * sf * sr + ca * cr, sa * sf * cr - ca * sr),
            (-sf, cf * sr, cf * cr),
        )
    )


def _shoulder_angles(turn: Array) -> list[Array]:
    """Return the ways to turn a left upper arm: abduction, flexion, external rotation [rad].

    Args:
        turn: How it is to be turned, shape [3, 3].
    """
    aside, up, ahead = turn[:, 0].tolist()
    if abs(aside) < SIDEWAYS and (ahead > AHEAD or up > 0):
        flexion = math.atan2(ahead, -up)
        left = turned_by(HANGING, flexion, 0.0).T @ turn
        return [
            np.array(
                (HANGING, flexion, math.atan2(left[1, 2] - left[2, 1], left[1, 1] + left[2, 2]))
            )
        ]
    flexion = math.asin(min(max(ahead, -1.0), 1.0))
    out = math.atan2(up, aside)
    rotation = -math.atan2(turn[2, 1], turn[2, 2])
    return [
        np.array((out, flexion, rotation)),
        np.array((out + math.pi, math.pi - flexion, rotation + math.pi)),
    ]


def _near(angles: Array, before: Array) -> Array:
    """Return the same angles by whole turns nearest to others."""
    return angles - 2 * math.pi * np.rint((angles - before) / (2 * math.pi))


AGAINST_GRAVITY = 3.0  # grade from which a muscle moves a limb against its weight
# Grade from which a raised arm is drawn across to the front, where gravity neither helps nor hinders, as
# grade 2 means (Daniels & Worthingham); that it takes the adductors is our own choice.
WITHOUT_GRAVITY = 2.0
ACROSS = math.radians(45.0)  # how far an arm goes past the front, over the body; AAOS, from memory


def reach_of(profile: ClinicalProfile, seated: Array | None = None) -> Reach:
    """Return what a person reaches by themselves.

    An arm is raised against gravity. That takes muscles of grade 3 or better (the meaning of that grade in
    manual muscle testing); an arm whose abductors and flexors are both weaker has no part in an exercise
    and stays where it lies.

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
    low, high = np.minimum(low, high), np.maximum(low, high)
    left, right = (can_sweep(profile, side) for side in SIDES)
    return Reach(low, high, (front[0], front[1]), sweeps=(left, right))


def can_raise(profile: ClinicalProfile, side: str, motion: str) -> bool:
    """Return whether a shoulder's `abduction` or `flexion` raises the arm against its weight."""
    dof = DOFS[DOF_INDEX[f"{side}_shoulder_{motion}"]]
    low, high = profile.limits("active")[dof.name]
    return high > low and profile.grade(dof, positive=True) >= AGAINST_GRAVITY


def can_sweep(profile: ClinicalProfile, side: str) -> bool:
    """Return whether the adductors of a shoulder draw a raised arm from the side to the front."""
    dof = DOFS[DOF_INDEX[f"{side}_shoulder_abduction"]]
    return profile.grade(dof, positive=False) >= WITHOUT_GRAVITY


def raised_sides(profile: ClinicalProfile) -> tuple[str, ...]:
    """Return the sides whose arm the person can raise, to the side or to the front."""
    return tuple(
        side
        for side in SIDES
        if can_raise(profile, side, "abduction") or can_raise(profile, side, "flexion")
    )
