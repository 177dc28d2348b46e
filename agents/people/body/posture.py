"""Postures: how a person sits, lies or stands, and where that puts the pelvis."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rcare_marl.errors import UnknownNameError, check_name
from rcare_marl.pose import Array, Pose, Vector, axis_rotation, quaternion_from_matrix

from .skeleton import (
    DOF_INDEX,
    DOFS,
    JOINT_INDEX,
    JOINTS,
    SIDES,
    forward_kinematics,
    joint_rotation,
)
from .skin import BodyModel, Floats

# SMPL-X axes (x left, y up, z forward) in the world (x forward, y left, z up).
UPRIGHT = np.array(((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))


MOST_LEVELLING = 45  # [deg]; our own choice

PostureKind = Literal["sitting", "lying", "standing", "hanging"]


# A posture, a body, its limits by DoF [rad], and the support that it is on.
Seated = tuple["PostureConfig", BodyModel, Mapping[str, tuple[float, float]], Pose]


@dataclass(frozen=True)
class Bearing:
    """How somebody holds a part of the body, in whatever posture of some kinds.

    Attributes:
        reason: What of the condition makes it so, and who describes it.
        angles_deg: Clinical angle by DoF [deg], in place of the posture's; without a side it holds for
            both. Cut to the passive range.
        postures: Kinds of posture in which it shows.
    """

    reason: str
    angles_deg: dict[str, float]
    postures: tuple[PostureKind, ...] = ("sitting", "lying", "standing", "hanging")

    def __post_init__(self) -> None:
        if not self.angles_deg or not self.postures:
            raise ValueError("a bearing needs an angle and a kind of posture at least")
        if not self.reason.strip():
            raise ValueError("a bearing needs its reason")
        for name, angle in _by_dof(self.angles_deg).items():
            if not -180 <= angle <= 180:
                raise ValueError(f"{name} must lie in -180..180 deg, got {angle}")


@dataclass(frozen=True)
class PostureConfig:
    """A posture (`assets/postures/<name>.yaml`).

    Attributes:
        description: One line for a person to read.
        recline_deg: How far the pelvis is turned backwards from upright [deg]; 90 lies on the back.
        angles_deg: Clinical angle by DoF [deg], zero where absent; without a side it holds for both.
        rests_on: Segments that may touch the surface below; the lowest point of these lies on it.
        leans_on: Segments that may touch the backrest; empty where there is none.
        sink: How far the body sinks into what it rests on [m].
        supported: Joints that furniture holds where the person's own muscles are weaker than
            grade 3; `all` for every joint.
        carried: Joints whose limb furniture bears from below, whoever lies there: it pushes against
            sagging from the posture, and never pulls. For muscle-driven people, who can relax.
        eased: Joints that nothing holds, but whose limb lies on something near the posture, such as a hand on
            a wheel or in the lap that is not simulated: there its weight tires nobody.
        arms: `free`, or `armrests` where the device offers them.
        kind: What a person's bearing goes by.
        posed: Joints that the posture is about: there somebody's own bearing does not count.
        own_arms: Sides whose arm is held by its owner, and laid on no armrest.
    """

    description: str
    recline_deg: float
    angles_deg: dict[str, float]
    rests_on: tuple[str, ...]
    leans_on: tuple[str, ...] = ()
    sink: float = 0.0
    supported: tuple[str, ...] | Literal["all"] = "all"
    carried: tuple[str, ...] = ()
    eased: tuple[str, ...] = ()
    arms: Literal["free", "armrests"] = "free"
    source: str = field(default="our own choice")
    kind: PostureKind = "sitting"
    posed: tuple[str, ...] = ()
    own_arms: tuple[Literal["left", "right"], ...] = ()

    def __post_init__(self) -> None:
        for key in self.angles_deg:
            _dofs_named(key)
        lists = [self.rests_on, self.leans_on, self.carried, self.eased, self.posed]
        lists += [] if self.supported == "all" else [self.supported]
        for joint in (name for names in lists for name in names):
            check_name("joint", joint, JOINTS)
        if not self.rests_on:
            raise ValueError("rests_on needs at least one segment")
        if not 0 <= self.sink <= 0.1:
            raise ValueError(f"sink must lie in 0..0.1 m, got {self.sink}")

    def angles(self, limits: Mapping[str, tuple[float, float]]) -> Array:
        """Return the angle of every DoF [rad], shape [112], kept inside `limits` [rad] by name."""
        out = np.array([-dof.clinical_zero for dof in DOFS])  # the anatomical position
        for name, degrees in _by_dof(self.angles_deg).items():
            dof = DOFS[DOF_INDEX[name]]
            out[DOF_INDEX[name]] = math.radians(degrees) - dof.clinical_zero
        low, high = np.array([limits[dof.name] for dof in DOFS]).T
        return np.clip(out, low, high)

    def borne(self, bearings: Sequence[Bearing]) -> PostureConfig:
        """Return the posture as somebody holds it: with their angles, where the posture has none of its own.

        An arm whose shoulder or elbow they hold is laid on no armrest.
        """
        own = self._own_angles(bearings)
        held = {DOFS[DOF_INDEX[name]].joint for name in own}
        arms: list[Literal["left", "right"]] = [
            side for side in ("left", "right") if {f"{side}_shoulder", f"{side}_elbow"} & held
        ]
        return dataclasses.replace(
            self,
            angles_deg=_by_dof(self.angles_deg) | own,
            own_arms=tuple(arms),
        )

    def _own_angles(self, bearings: Sequence[Bearing]) -> dict[str, float]:
        own: dict[str, float] = {}
        for bearing in bearings:
            if self.kind in bearing.postures:
                own |= _by_dof(bearing.angles_deg)
        return {n: a for n, a in own.items() if DOFS[DOF_INDEX[n]].joint not in self.posed}


def _by_dof(angles_deg: Mapping[str, float]) -> dict[str, float]:
    """Return angles by DoF; what has no side holds for both, and what comes later counts."""
    return {name: angle for key, angle in angles_deg.items() for name in _dofs_named(key)}


def _dofs_named(key: str) -> list[str]:
    """Return the DoFs of a key: one, or the same on both sides."""
    names = [key] if key in DOF_INDEX else [f"{side}_{key}" for side in SIDES]
    if any(name not in DOF_INDEX for name in names):
        both = {name.split("_", 1)[1] if name.startswith(SIDES) else name for name in DOF_INDEX}
        raise UnknownNameError("degree of freedom", key, [*both, *DOF_INDEX])
    return names


def pelvis_pose(posture: PostureConfig, model: BodyModel, angles: Array, support: Pose) -> Pose:
    """Return where the pelvis lies in the world for a body on a support.

    Args:
        posture: The posture.
        model: The body.
        angles: Angle of every DoF [rad], shape [112].
        support: The surface: its origin, z out of it, x where the person looks when upright. For a
            seat the origin lies at the foot of the backrest, which leans back by `recline_deg`.
    """
    recline = math.radians(posture.recline_deg)
    turned = UPRIGHT @ axis_rotation((1.0, 0.0, 0.0), -recline)
    rotations, positions = forward_kinematics(model.joints, angles)
    surface = model.posed(rotations, positions) @ turned.T
    owner = model.owner
    below = surface[np.isin(owner, [JOINT_INDEX[j] for j in posture.rests_on])]
    z = -float(below[:, 2].min()) - posture.sink
    x = 0.0
    if posture.leans_on:
        behind = surface[np.isin(owner, [JOINT_INDEX[j] for j in posture.leans_on])]
        # The backrest is the plane through the origin that leans back by the recline.
        depth = behind[:, 0] * math.cos(recline) + (behind[:, 2] + z) * math.sin(recline)
        x = (-float(depth.min()) - posture.sink) / math.cos(recline)
    local = Pose((x, 0.0, z), tuple(quaternion_from_matrix(turned).tolist()))
    return support @ local


def soles(
    posture: PostureConfig,
    model: BodyModel,
    limits: Mapping[str, tuple[float, float]],
    support: Pose,
    facing: Vector | None = None,
) -> dict[str, Array]:
    """Return the middle of each sole in the world, by side [m], for a body on a support.

    With `facing`, where a plate looks that is to be under it, a unit vector: lowered so far that the plate
    touches heel or toes and is nowhere inside the foot.
    """
    base, rotations, positions, surface = _placed(posture, model, limits, support)
    out = {}
    for side in SIDES:
        ankle = JOINT_INDEX[f"{side}_ankle"]
        foot = np.isin(model.owner, (ankle, JOINT_INDEX[f"{side}_foot"]))
        local = (surface[foot] - positions[ankle]) @ rotations[ankle]  # y out of the sole
        low, high = local.min(axis=0), local.max(axis=0)
        middle = (0.5 * (low[0] + high[0]), low[1], 0.5 * (low[2] + high[2]))
        here = rotations[ankle] @ middle + positions[ankle]
        out[side] = (base @ np.append(here, 1.0))[:3]
        if facing is not None:
            normal = base[:3, :3].T @ facing
            deep = float(((surface[foot] - here) @ normal).min())
            out[side] = out[side] + (0.0, 0.0, deep / facing[2])
    return out


def levelled(
    posture: PostureConfig,
    model: BodyModel,
    limits: Mapping[str, tuple[float, float]],
    support: Pose,
    dof: str,
    limb: tuple[str, str],
) -> PostureConfig:
    """Return a posture in which one DoF holds a limb as level as it can.

    Args:
        posture: As it is.
        model: The body.
        limits: Within which the DoF is turned [rad], by name; by `MOST_LEVELLING` at most.
        support: Where the body is, as for `pelvis_pose`.
        dof: The degree of freedom.
        limb: The joints where the limb begins and ends.
    """
    start, end = (JOINT_INDEX[joint] for joint in limb)
    base = pelvis_pose(posture, model, posture.angles(limits), support).matrix()
    angles_deg = _by_dof(posture.angles_deg)

    def turned(degrees: float) -> PostureConfig:
        angle = angles_deg.get(dof, 0.0) + degrees
        return dataclasses.replace(posture, angles_deg=angles_deg | {dof: angle})

    def slope(degrees: float) -> float:
        _, positions = forward_kinematics(model.joints, turned(degrees).angles(limits))
        way = base[:3, :3] @ (positions[end] - positions[start])
        return abs(float(way[2]))

    return turned(min(range(-MOST_LEVELLING, MOST_LEVELLING + 1), key=slope))


def calf_back(
    posture: PostureConfig,
    model: BodyModel,
    limits: Mapping[str, tuple[float, float]],
    support: Pose,
) -> float:
    """Return how far ahead the backs of the calves are at least, x in the world [m], as for `soles`."""
    base, *_, surface = _placed(posture, model, limits, support)
    calves = np.isin(model.owner, [JOINT_INDEX[f"{side}_knee"] for side in SIDES])
    placed = surface[calves] @ base[:3, :3].T + base[:3, 3]
    return float(placed[placed[:, 2] < support.position[2], 0].min(initial=math.inf))


def _placed(
    posture: PostureConfig,
    model: BodyModel,
    limits: Mapping[str, tuple[float, float]],
    support: Pose,
) -> tuple[Array, Array, Array, Floats]:
    """Return the pelvis in the world [4, 4], and as `BodyModel.posed`: rotations, joints and skin."""
    angles = posture.angles(limits)
    base = pelvis_pose(posture, model, angles, support).matrix()
    rotations, positions = forward_kinematics(model.joints, angles)
    return base, rotations, positions, model.posed(rotations, positions)


_ARM_DOFS = (
    "shoulder_abduction",
    "shoulder_flexion",
    "shoulder_external_rotation",
    "elbow_flexion",
    "elbow_pronation",
)
# What is found by what it depends on, the latest: each arm is laid anew whenever somebody is put there.
_LAID: dict[tuple[object, ...], Array] = {}
_MOST_LAID = 512
_FOREARM_DOWN = 0.75  # weight of a palm that looks down, against centimetres of position error


def lay_arm(
    side: str,
    model: BodyModel,
    angles: Array,
    pelvis: Pose,
    pad: Pose,
    limits: Mapping[str, tuple[float, float]],
    *,
    clearance: float,
) -> Array:
    """Return `angles` [rad] with one arm laid on an armrest: elbow and wrist above the pad.

    Args:
        side: `left` or `right`.
        model: The body.
        angles: Angle of every DoF [rad], shape [112].
        pelvis: Pose of the pelvis in the world.
        pad: Middle of the pad's top in the world, x along it to the front.
        limits: Limits by DoF [rad].
        clearance: Height of the forearm's axis over the pad [m].
    """
    out = angles.copy()
    chosen = [DOF_INDEX[f"{side}_{name}"] for name in _ARM_DOFS]
    bounds = np.array([limits[f"{side}_{name}"] for name in _ARM_DOFS])
    out[chosen] = np.clip(np.radians((20 - 90, 15, 0, 80, 40)), bounds[:, 0], bounds[:, 1])
    names = [f"{side}_{joint}" for joint in ("collar", "shoulder", "elbow", "wrist")]
    collar, *moved = (JOINT_INDEX[name] for name in names)
    links = dict(zip(names[1:], np.diff(model.joints[[collar, *moved]], axis=0), strict=True))
    forearm = float(np.linalg.norm(links[names[-1]]))
    base = pelvis.matrix()
    to_pad = pad.inverse().matrix()
    rotations, positions = forward_kinematics(model.joints, out)  # up to the collar they stay

    def residual(x: Array) -> Array:
        out[chosen] = x
        rotation, position, at = rotations[collar], positions[collar], []
        for name, link in links.items():
            position = position + rotation @ link
            rotation = rotation @ joint_rotation(name, out)
            at.append((to_pad @ base @ np.append(position, 1.0))[:3])
        _, elbow, wrist = at
        palm = to_pad[:3, :3] @ base[:3, :3] @ rotation @ np.array((0.0, 1.0, 0.0))
        error = [
            elbow[1],
            elbow[2] - clearance,
            wrist[1],
            wrist[2] - clearance,
            0.3 * (elbow[0] + 0.4 * forearm),
            0.1 * _FOREARM_DOWN * (1 - palm[2]),
        ]
        return np.array([*error, *(0.004 * (x - start))])

    start = out[chosen].copy()
    on = (model.joints, out, base, to_pad, bounds)
    key = (side, clearance, *(np.asarray(value).tobytes() for value in on))
    if key not in _LAID:
        if len(_LAID) >= _MOST_LAID:
            del _LAID[next(iter(_LAID))]
        _LAID[key] = _least_squares(residual, start, bounds)
    out[chosen] = _LAID[key]
    return out


def _least_squares(residual: Callable[[Array], Array], start: Array, bounds: Array) -> Array:
    """Minimise a residual inside bounds by damped Gauss-Newton steps with a numeric Jacobian."""
    x, damping = start.copy(), 1e-3
    value = residual(x)
    for _ in range(60):
        jacobian = np.column_stack(
            [(residual(x + 1e-5 * e) - value) / 1e-5 for e in np.eye(len(x))]
        )
        hessian = jacobian.T @ jacobian
        step = -np.linalg.solve(hessian + damping * np.eye(len(x)), jacobian.T @ value)
        trial = np.clip(x + step, bounds[:, 0], bounds[:, 1])
        trial_value = residual(trial)
        if trial_value @ trial_value < value @ value:
            moved = float(np.abs(trial - x).max())
            x, value, damping = trial, trial_value, damping * 0.3
            if moved < 1e-6:
                break
        else:
            damping *= 5
            if damping > 1e6:
                break
    return x
