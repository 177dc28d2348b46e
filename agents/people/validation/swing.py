"""Relaxed limbs that drop: R. Wartenberg's pendulum test of knee and elbow, and the catch of spastic limbs.

The thigh (or upper arm) is held level, the leg (forearm) let go from near full extension. The relaxation index
is the first swing by the way from the start to where the limb comes to rest.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Literal, NamedTuple

import numpy as np

from rcare_marl.pose import Array

from ..actuation.drive import ActuationConfig
from ..avatar import AvatarConfig, load_avatar
from ..body.skeleton import DOF_INDEX, DOFS
from ..profile import ASHWORTH, ClinicalProfile, SideProfile
from .check import Check
from .single_joint import PHYSICS_DT, Motion, SingleJoint

Kind = Literal["skeletal", "muscle"]
KINDS: tuple[Kind, ...] = ("skeletal", "muscle")
Limb = Literal["knee", "elbow"]
START = {"knee": 15.0, "elbow": 15.0}  # [deg] of flexion where it is let go
SPASTIC = {"knee": "knee_extensors", "elbow": "elbow_extensors"}  # that the drop stretches
HIP = 60.0  # [deg] of flexion of who sits half reclined
SWING = math.radians(3.0)  # less is no swing to see
SECONDS = 12.0
CATCH_SPEED = math.radians(180.0)  # [rad/s] of an examiner's fast stretch
CATCH_SHARE = 0.25  # of the most resistance of the stretch, above that of the healthy limb: the catch
BEAT = (3.0, 9.0)  # [1/s] of clonus

TUNED = ("karan", "caregiver")  # avatars on which figures were chosen


class Drop(NamedTuple):
    """A pendulum test.

    Attributes:
        index: Relaxation index.
        first: First swing [deg].
        swings: How often the limb swings beyond where it comes to rest, by 3 degrees or more.
        decrement: By what factor the second such swing is smaller than the first, 0 if there is none.
        period: From the first to the second [s], 0 if there is none.
        speed: Greatest speed [deg/s].
    """

    index: float
    first: float
    swings: int
    decrement: float
    period: float
    speed: float


def examined(avatar: AvatarConfig, **right: object) -> AvatarConfig:
    """Return an avatar's body with a healthy profile, but for the right side."""
    side = SideProfile(**right)  # type: ignore[arg-type]
    return dataclasses.replace(avatar, profile=ClinicalProfile(right=side))


def limb_joint(avatar: AvatarConfig, kind: Kind, limb: Limb) -> SingleJoint:
    """Return the right knee or elbow of a person, what is before it held level."""
    angles = np.array([-dof.clinical_zero for dof in DOFS])
    dof = f"right_{limb}_flexion"
    angles[DOF_INDEX[dof]] = math.radians(START[limb])
    direction = np.array((0.0, 0.0, 1.0))  # the forearm hangs from a level upper arm at 90 degrees
    if limb == "knee":
        hip = math.radians(HIP)
        angles[DOF_INDEX["right_hip_flexion"]] = hip
        direction = np.array((0.0, -math.sin(hip), -math.cos(hip)))
    config = ActuationConfig(kind=kind)
    return SingleJoint(avatar, dof, config, angles=angles, gravity=direction)


def drop(avatar: AvatarConfig, kind: Kind, limb: Limb) -> Drop:
    """Let a limb of a relaxed person drop."""
    joint = limb_joint(avatar, kind, limb)
    joint.drive.relax()
    motion = joint.move(SECONDS)
    angles = motion.angles
    rest = float(angles[-round(1.0 / PHYSICS_DT) :].mean())
    beyond = angles - rest
    inner = beyond[1:-1]
    peaks = np.flatnonzero((inner >= beyond[:-2]) & (inner > beyond[2:]) & (inner > SWING)) + 1
    first = float(angles[: round(2.0 / PHYSICS_DT)].max()) - joint.start
    two = len(peaks) > 1
    return Drop(
        first / (rest - joint.start),
        math.degrees(first),
        len(peaks),
        float(beyond[peaks[1]] / beyond[peaks[0]]) if two else 0.0,
        float(peaks[1] - peaks[0]) * PHYSICS_DT if two else 0.0,
        math.degrees(float(motion.rates.max())),
    )


def stretched(avatar: AvatarConfig, kind: Kind, limb: Limb, *, flexors: bool) -> Array:
    """Return the resistance of a relaxed limb that an examiner turns at `CATCH_SPEED` [N·m], by step.

    The limb goes through the middle of its passive range: flexors are stretched by extension.
    """
    joint = limb_joint(avatar, kind, limb)
    joint.drive.relax()
    low, high = (float(end) for end in joint.passive)
    steps = round((high - low) / CATCH_SPEED / PHYSICS_DT)
    way = np.linspace(low, high, steps)
    sign = -1.0 if flexors else 1.0
    path = way[::-1] if flexors else way
    return np.array(
        [
            -sign * joint.drive.torques([float(at)], [sign * CATCH_SPEED], np.zeros(3))[0]
            for at in path
        ]
    )


def catch(avatar: AvatarConfig, kind: Kind, limb: Limb, grade: str) -> tuple[float, float]:
    """Return where a stretch is caught [share of the passive range] and the most extra torque [N·m].

    The share is 1 where nothing catches.
    """
    flexors = limb == "elbow"
    group = "elbow_flexors" if flexors else SPASTIC[limb]
    free = stretched(examined(avatar), kind, limb, flexors=flexors)
    spastic = stretched(
        examined(avatar, spasticity={group: grade}), kind, limb, flexors=flexors
    )
    extra = spastic - free
    most = float(extra.max())
    if most <= 0.05:
        return 1.0, max(most, 0.0)
    return float(np.argmax(extra >= CATCH_SHARE * most)) / len(extra), most


def beats(avatar: AvatarConfig, kind: Kind, grade: str) -> tuple[int, float]:
    """Return the beats of an ankle that is pushed up briskly and held so, and their rate [1/s]."""
    graded = examined(avatar, spasticity={"ankle_plantarflexors": grade})
    angles = np.array([-dof.clinical_zero for dof in DOFS])
    angles[DOF_INDEX["right_ankle_dorsiflexion"]] = math.radians(-20.0)
    angles[DOF_INDEX["right_knee_flexion"]] = math.radians(30.0)
    joint = SingleJoint(
        graded,
        "right_ankle_dorsiflexion",
        ActuationConfig(kind=kind),
        angles=angles,
        gravity=np.zeros(3),
    )
    joint.drive.relax()
    motion = joint.move(3.0, load=PUSH)
    return _beats(motion)


PUSH = 5.0  # [N·m] of the examiner's hand under the foot


def _beats(motion: Motion) -> tuple[int, float]:
    later = motion.angles[round(0.2 / PHYSICS_DT) :]
    inner = later[1:-1]
    tops = np.flatnonzero((inner >= later[:-2]) & (inner > later[2:])) + 1
    lows = np.flatnonzero((inner <= later[:-2]) & (inner < later[2:])) + 1
    seen = [t for t in tops if len(lows) and later[t] - later[lows[np.argmin(np.abs(lows - t))]] > 0.02]
    if len(seen) < 2:
        return len(seen), 0.0
    return len(seen), float((len(seen) - 1) / ((seen[-1] - seen[0]) * PHYSICS_DT))
