"""Relaxed limbs that drop: R. Wartenberg's pendulum test of knee and elbow, and the catch of spastic limbs.

The thigh (or upper arm) is held level, the leg (forearm) let go from near full extension. The relaxation
index is the first swing by the way from the start to where the limb comes to rest.
"""

from __future__ import annotations

import dataclasses
import math
from functools import partial
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
LIMBS: tuple[Limb, ...] = ("knee", "elbow")
START = {"knee": 15.0, "elbow": 15.0}  # [deg] of flexion where it is let go
SPASTIC = {"knee": "knee_extensors", "elbow": "elbow_extensors"}  # that the drop stretches
HIP = 60.0  # [deg] of flexion of who sits half reclined
SWING = math.radians(3.0)  # less is no swing to see
SECONDS = 12.0
CATCH_SPEED = math.radians(180.0)  # [rad/s] of an examiner's fast stretch
CATCH_SHARE = 0.25  # of the most resistance above that of the healthy limb: the catch

PUSH = 0.068  # [N·m/kg] of the examiner's hand under the foot, by body weight

TUNED = ("karan", "caregiver")  # avatars on which figures were chosen
HELD_OUT = ("daniel", "kim", "natalia")
FIGURE = "figure 1 of J. Sports Med. Doping Stud. S6:001 (caption): a healthy leg"
BAJD = "T. Bajd & L. Vodovnik 1984; E. Fowler et al. 2000"
WHITE = "H. White et al., Gait & Posture 26, 2007 (abstract): 293 deg/s of healthy children"
ORDER = (
    "index and first swing fall with the Modified Ashworth grade (abstracts read: 127 hemiplegic patients, "
    "Annals of Rehabilitation Medicine; A. Whelan et al. 2018): loosely there, strictly here"
)
TARDIEU = (
    "Ashworth grade and angle of catch go with one resting angle (17 patients, Frontiers in Neurology "
    "PMC4549629, abstract read): loosely there, strictly here"
)
CLONUS = "clonus at grades 3 and 4 only, from memory"
ARM = "our own expectation: an arm swings, and less often than a leg"


class Drop(NamedTuple):
    """A pendulum test.

    Attributes:
        relaxation: Relaxation index.
        first: First swing [deg].
        swings: How often the limb swings beyond where it comes to rest, by 3 degrees or more.
        decrement: By what factor the second such swing is smaller than the first, 0 if there is none.
        period: From the first to the second [s], 0 if there is none.
        speed: Greatest speed [deg/s].
    """

    relaxation: float
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
    spastic = stretched(examined(avatar, spasticity={group: grade}), kind, limb, flexors=flexors)
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
    motion = joint.move(3.0, load=PUSH * avatar.mass_kg)
    return _beats(motion)


def _beats(motion: Motion) -> tuple[int, float]:
    later = motion.angles[round(0.2 / PHYSICS_DT) :]
    inner = later[1:-1]
    tops = np.flatnonzero((inner >= later[:-2]) & (inner > later[2:])) + 1
    lows = np.flatnonzero((inner <= later[:-2]) & (inner < later[2:])) + 1
    seen = [
        t for t in tops if len(lows) and later[t] - later[lows[np.argmin(np.abs(lows - t))]] > 0.02
    ]
    if len(seen) < 2:
        return len(seen), 0.0
    return len(seen), float((len(seen) - 1) / ((seen[-1] - seen[0]) * PHYSICS_DT))


def checks() -> list[Check]:
    """Return the checks of the family `swing`: healthy drops, and spastic ones in order of their grade."""
    out = []
    for name in (*TUNED, *HELD_OUT):
        person = load_avatar(name)
        for kind in KINDS:
            for row in _healthy(person, kind) + _spastic(person, kind):
                case = f"{name}, {kind}: {row.case}"
                is_fitted = row.is_fitted and name in TUNED
                out.append(dataclasses.replace(row, case=case, is_fitted=is_fitted))
    return out


_row = partial(Check, "swing")  # whose it is comes later; fitted if it was, on tuned avatars


def _healthy(person: AvatarConfig, kind: Kind) -> list[Check]:
    leg, arm = (drop(examined(person), kind, limb) for limb in LIMBS)
    knee, elbow = "healthy knee, ", "healthy elbow, "
    return [
        _row(f"{knee}relaxation index", leg.relaxation, 1.5, 2.1, "1", BAJD, "memory", True),
        _row(
            f"{knee}index of that leg",
            leg.relaxation,
            1.6,
            2.1,
            "1",
            f"{FIGURE}: 1.87",
            "read",
            True,
        ),
        _row(f"{knee}swings", leg.swings, 5, 9, "1", f"{FIGURE}: 8", "read", True),
        _row(
            f"{knee}second by first", leg.decrement, 0.5, 0.76, "1", f"{FIGURE}: 0.64", "read", True
        ),
        _row(f"{knee}period", leg.period, 0.95, 1.25, "s", f"{FIGURE}: 1.10 s", "read", False),
        _row(f"{knee}greatest speed", leg.speed, 235, 365, "deg/s", WHITE, "read", False),
        _row(f"{elbow}relaxation index", arm.relaxation, 1.4, 2.0, "1", ARM, "memory", False),
        _row(f"{elbow}swings", arm.swings, 3, 8, "1", ARM, "memory", False),
    ]


def _spastic(person: AvatarConfig, kind: Kind) -> list[Check]:
    """Return where spasticity begins, and how far the grades are apart at the least."""
    inf = math.inf
    drops = [
        drop(examined(person, spasticity={SPASTIC["knee"]: g}), kind, "knee") for g in ASHWORTH
    ]
    index = float((-np.diff([each.relaxation for each in drops])).min())
    first = float((-np.diff([each.first for each in drops])).min())
    out = [
        _row(
            "knee of grade 1, relaxation index",
            drops[1].relaxation,
            1.0,
            1.4,
            "1",
            BAJD,
            "memory",
            True,
        ),
        _row("knee, least fall of the index by grade", index, 0.0, inf, "1", ORDER, "read", True),
        _row(
            "knee, least fall of the first swing by grade",
            first,
            0.0,
            inf,
            "deg",
            ORDER,
            "read",
            True,
        ),
    ]
    for limb in LIMBS:
        places = [catch(person, kind, limb, grade)[0] for grade in ASHWORTH[1:]]
        case, least = (
            f"{limb}, least advance of the catch by grade",
            float((-np.diff(places)).min()),
        )
        is_tuned = limb == "knee"
        out.append(_row(case, least, 0.0, inf, "of the range", TARDIEU, "read", is_tuned))
    for grade in ASHWORTH:
        low, high = (3.0, inf) if grade in ("3", "4") else (0.0, 2.0)
        case, count = f"ankle of grade {grade}, beats of clonus", beats(person, kind, grade)[0]
        out.append(_row(case, count, low, high, "1", CLONUS, "memory", True))
    return out
