"""A hospital bed: height, backrest, knees, side rails, and how one lies on it when it bends."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.people.avatar import AvatarConfig, body_model, body_segments, load_posture
from rcare_marl.agents.people.body.posture import UPRIGHT, PostureConfig, pelvis_pose
from rcare_marl.agents.people.body.segment import Shape
from rcare_marl.agents.people.body.skeleton import (
    DOF_INDEX,
    JOINT_INDEX,
    JOINTS,
    SIDES,
    forward_kinematics,
)
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.resting.support import Support, bed
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, axis_rotation, quaternion_from_matrix
from rcare_marl.world import World

from .device import Device

_STEPS, _CLOSE = 40, 2e-4  # at most so many tries, until something lies as deep as it should [m]
_HIP_RANGE, _KNEE_RANGE = math.radians(130), math.radians(120)
_RINGS, _POINTS = 5, 30  # along a capsule and round it
_LEG = tuple(f"{side}_{part}" for side in SIDES for part in ("hip", "knee", "ankle", "foot"))
HIPS = 0.06  # from the fold to the hips of who lies flat [m]; own choice
# Buttocks move so far along the bed to touch a backrest that is raised so far or more; own choice.
_SHIFT, _RAISED = 0.04, 0.5  # [m], [rad]
_LEGS = ("hip_flexion", "knee_flexion")
_SINK = 0.014  # of a body in the mattress [m]; own choice
# Hands on the belly [deg]; own choice.
_ARMS = {
    "shoulder_abduction": 22.0,
    "shoulder_flexion": 2.0,
    "shoulder_external_rotation": -70.0,
    "elbow_flexion": 70.0,
    "elbow_pronation": 75.0,
}
_POSED = tuple(f"{s}_{j}" for s in SIDES for j in ("shoulder", "elbow", "wrist", "hip", "knee"))


@dataclass(frozen=True)
class Sections:
    """A mattress of four sections: back, seat, thighs and calves.

    Attributes:
        seat: Length of the seat [m].
        thigh: Length under the thighs [m].
        thickness: Of the mattress, whose sections turn at its underside [m].
    """

    seat: float
    thigh: float
    thickness: float

    def depths(self, points: Array, back: float, knee: float, calf: float) -> Array:
        """Return how deep points lie in the mattress [m], shape [n], negative above it.

        Args:
            points: Points along and over the bed [m], shape [n, 2], from where backrest and seat meet.
            back: How far the backrest is raised [rad].
            knee: How far the thighs are raised [rad].
            calf: How far the calves are bent from the thighs [rad].
        """
        under = np.array((0.0, -self.thickness))
        fold = under + (self.seat, 0.0)
        ridge = fold + self.thigh * np.array((math.cos(knee), math.sin(knee)))

        def inside(hinge: Array, rise: float) -> Array:
            """Below the top of a section that rises against the way along the bed."""
            normal = np.array((math.sin(rise), math.cos(rise)))
            return np.asarray(self.thickness - (points - hinge) @ normal)

        valley = np.maximum(inside(under, back), inside(under, 0.0))
        crest = np.minimum(inside(fold, -knee), inside(ridge, calf - knee))
        return np.maximum(valley, crest)


class BedRest:
    """A person whom a bed bends: finds their place and the angles of hips and knees.

    The trunk is parallel to the backrest, buttocks lie in the fold, legs lie down as far as they go.
    """

    def __init__(
        self, avatar: AvatarConfig, posture: PostureConfig, sections: Sections, *, sink: float
    ) -> None:
        """Prepare.

        Args:
            avatar: Who it is.
            posture: How trunk, arms and feet are held.
            sections: The mattress.
            sink: How deep each part of the body lies in it [m].
        """
        self._sections, self._sink = sections, sink
        model = body_model(avatar.body_path(), avatar.height_m)
        limits = avatar.profile.limits("passive")
        angles = posture.angles(limits)
        for side in SIDES:
            for name in _LEGS:
                angles[DOF_INDEX[f"{side}_{name}"]] = 0.0
        rotations, positions = forward_kinematics(model.joints, angles)
        segments = body_segments(avatar.body_path(), avatar.height_m, avatar.mass_kg, avatar.sex)
        parts = {}
        for i, joint in enumerate(JOINTS):
            if segments[joint].shapes:
                outlines = [_outline(s, rotations[i]) for s in segments[joint].shapes]
                parts[joint] = np.concatenate(outlines) + positions[i]
        self._trunk = np.concatenate([parts[joint] for joint in parts if joint not in _LEG])
        self._hips = np.mean([positions[JOINT_INDEX[f"{s}_hip"]] for s in SIDES], axis=0)
        self._legs = [_Leg(side, parts, rotations, positions, limits) for side in SIDES]

    def lie(self, back: float, knee: float, calf: float) -> tuple[Pose, dict[str, float]]:
        """Return the pelvis over where backrest and seat meet, and angles of hips and knees [rad].

        Args:
            back: How far the backrest is raised [rad].
            knee: How far the thighs are raised [rad].
            calf: How far the calves are bent from the thighs [rad].
        """
        turn = UPRIGHT @ axis_rotation((1.0, 0.0, 0.0), back - 0.5 * math.pi)

        at, angles = self._place(turn, back), dict[str, float]()

        def over(points: Array) -> float:
            flat = (points @ turn.T)[:, ::2] + at
            return float(self._sections.depths(flat, back, knee, calf).max()) - self._sink

        def rise(points: Array) -> bool:
            """Lift the body until points lie as deep as they may, and say whether that was needed."""
            start = at[1]
            while (deep := over(points)) > _CLOSE:
                at[1] += deep  # too little where sections are steep
            return bool(at[1] > start)

        at[1] += over(self._trunk)
        rise(self._trunk)
        for leg in self._legs:
            angles |= leg.lie(over)
        # Buttocks partly belong to the thighs.
        if rise(np.concatenate([leg.buttock(angles) for leg in self._legs])):
            for leg in self._legs:
                angles |= leg.lie(over)
        pelvis = Pose(
            (float(at[0]), 0.0, float(at[1])), tuple(quaternion_from_matrix(turn).tolist())
        )
        return pelvis, angles

    def _place(self, turn: Array, back: float) -> Array:
        """Return where the pelvis is that touches the seat [m], shape [2], and the backrest if it can."""
        flat = (self._trunk @ turn.T)[:, ::2]
        hips = (turn @ self._hips)[::2]
        thick, sink = self._sections.thickness, self._sink
        z = -sink - float(flat[:, 1].min())
        # Where hips lie as far from the backrest as from the seat; own choice while it is flat.
        x = math.hypot(HIPS, (thick + z + float(hips[1])) * math.tan(0.5 * back)) - float(hips[0])
        if back > 0:
            normal = np.array((math.sin(back), math.cos(back)))
            behind = thick - sink - float((flat @ normal).min()) - (z + thick) * math.cos(back)
            shift = _SHIFT * min(back / _RAISED, 1.0)
            x = min(max(behind / math.sin(back), x - shift), x + shift)
        return np.array((x, z))


class _Leg:
    """A leg whose hip and knee bend, in the frame of the pelvis."""

    def __init__(
        self,
        side: str,
        parts: Mapping[str, Array],
        rotations: Array,
        positions: Array,
        limits: Mapping[str, tuple[float, float]],
    ) -> None:
        """Take it off a body whose hips and knees are straight."""
        self._names = [f"{side}_{name}" for name in _LEGS]
        self._limits = [limits[name] for name in self._names]
        hip, knee = JOINT_INDEX[f"{side}_hip"], JOINT_INDEX[f"{side}_knee"]
        self._hip, self._turn = positions[hip], rotations[hip]
        self._knee = (positions[knee] - self._hip) @ self._turn
        thigh = (parts[f"{side}_hip"] - self._hip) @ self._turn
        far = (thigh @ self._knee) > 0.5 * float(self._knee @ self._knee)
        self._near, self._thigh = thigh[~far], thigh[far]
        lower = [parts[name] for name in _LEG if name.startswith(side) and name in parts]
        self._calf = (np.concatenate(lower[1:]) - self._hip) @ self._turn - self._knee

    def lie(self, over: Callable[[Array], float]) -> dict[str, float]:
        """Return the angles [rad] at which it lies down on what `over` is above zero in."""
        (low, high), (straight, bent) = self._limits
        stretched = min(max(0.0, straight), bent)

        def clears(hip: float) -> float:
            both = np.concatenate((self._points(self._thigh, hip), self._lower(hip, stretched)))
            return -over(both)

        hip = _least(clears, max(low, -0.5), min(high, _HIP_RANGE))
        knee = _least(
            lambda angle: over(self._lower(hip, angle)), stretched, min(bent, _KNEE_RANGE)
        )
        return dict(zip(self._names, (hip, knee), strict=True))

    def buttock(self, angles: Mapping[str, float]) -> Array:
        """Return the upper half of the thigh in the frame of the pelvis [m], shape [n, 3]."""
        return self._points(self._near, angles[self._names[0]])

    def _points(self, points: Array, hip: float) -> Array:
        out: Array = points @ (axis_rotation((-1.0, 0.0, 0.0), hip) @ self._turn).T + self._hip
        return out

    def _lower(self, hip: float, knee: float) -> Array:
        bent = self._calf @ axis_rotation((1.0, 0.0, 0.0), knee).T + self._knee
        return self._points(bent, hip)


def _outline(shape: Shape, turn: Array) -> Array:
    """Return points of a collision shape that may touch a bed, about its joint [m], shape [n, 3].

    Args:
        shape: The shape.
        turn: How its joint is turned, shape [3, 3].
    """
    if shape.kind == "box":
        corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * shape.size
        return np.asarray((corners @ shape.rotation.T + shape.centre) @ turn.T)
    length, radius = shape.size
    along = np.linspace(-0.5, 0.5, _RINGS)[:, None] * length * shape.rotation[:, 2]
    # Round in the plane in which beds bend.
    turns = np.linspace(0.0, 2 * math.pi, _POINTS, endpoint=False)
    ring = radius * np.column_stack((np.zeros(_POINTS), np.cos(turns), np.sin(turns)))
    return np.asarray((((shape.centre + along) @ turn.T)[:, None] + ring).reshape(-1, 3))


def _least(value: Callable[[float], float], low: float, high: float) -> float:
    """Return the angle [rad] at which a rising length [m] comes to zero: the Illinois method.

    `low` where it is above zero all along, `high` where it never is.
    """
    below, above = value(low), value(high)
    if below >= 0 or above <= 0:
        return low if below >= 0 else high
    last = 0
    for _ in range(_STEPS):
        angle = (low * above - high * below) / (above - below)
        now = value(angle)
        if abs(now) < _CLOSE:
            return angle
        if now > 0:
            high, above, below = angle, now, below * (0.5 if last > 0 else 1.0)
        else:
            low, below, above = angle, now, above * (0.5 if last < 0 else 1.0)
        last = 1 if now > 0 else -1
    return high


class HospitalBed(Device):
    """A bed whose platform rises between its ends and bends in three places.

    x towards the feet, y to the left of who lies on the back, origin on the floor at the head end.

    Frames: `mattress` (where the pelvis of somebody lies who lies flat), `fold` (where backrest and
    seat meet), `pillow`, `rail_left`, `rail_right` (top bar), `side_left`, `side_right` (floor beside
    it, x towards the bed). Controls: `height` [m over the lowest], `backrest`, `knee` [rad],
    `rail_left`, `rail_right` (0 lowered, the upper limit raised).

    Nothing of the mattress yields; a person lies in the posture of `posture` and is moved with the
    sections by `raise_with`, who fits each part of their body to its section.
    """

    def __init__(self) -> None:
        """Make a bed."""
        super().__init__("hospital_bed")
        figures = ("low", "mattress_thickness", "seat", "thigh", "calf")
        self._low, self._thick, self._seat, self._thigh, self._calves = map(
            self.model.figure, figures
        )
        self._lying: tuple[AvatarConfig, BedRest] | None = None

    def mattress_height(self) -> float:
        """Return the present height of the top of the mattress [m]."""
        return self._low + self._thick + self.position("height")

    def bears(self, mattress: str = "hospital_foam") -> Support:
        """Return what bears somebody in it now, for `Human.rest_on`, thighs and calves flat.

        Args:
            mattress: Of `assets/cushions`.
        """
        return bed(self.frame_in_world("fold"), mattress, math.degrees(self.position("backrest")))

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        knee = self.model.joints["knee"]
        ratio = self._calf(knee.upper) / knee.upper  # nearly fixed: the feet stay level to 5 mm
        body.gear(body.joint("knee").index, body.joint("calf").index, ratio, knee.effort)
        return body

    def set_position(self, name: str, position: float) -> None:
        if name == "knee":
            bend = self._calf(min(max(position, 0.0), self.model.joints["knee"].upper))
            self.body.set_joints([self.body.joint("calf").index], [bend])
        super().set_position(name, position)

    def _calf(self, knee: float) -> float:
        """Return how far the calves are bent from the thighs that rise by `knee` [rad]."""
        return knee + math.asin(self._thigh * math.sin(knee) / self._calves)

    def posture(
        self, avatar: AvatarConfig, *, backrest: float | None = None, knee: float | None = None
    ) -> PostureConfig:
        """Return how somebody lies on the bed bent as it is, or by these angles [rad].

        Hands lie on the belly, where no section of the bed comes upon them.
        """
        back = self.position("backrest") if backrest is None else backrest
        bent = self.position("knee") if knee is None else knee
        lying = load_posture("bed_supine")
        legs = self._rest_of(avatar).lie(back, bent, self._calf(bent))[1]
        degrees = {name: math.degrees(angle) for name, angle in legs.items()}
        return dataclasses.replace(
            lying,
            description=f"lying in bed, backrest raised by {math.degrees(back):.0f} degrees",
            recline_deg=90.0 - math.degrees(back),
            angles_deg=lying.angles_deg | _ARMS | degrees,
            posed=_POSED,
        )

    def support(self, person: Human) -> Pose:
        """Return where to spawn a person whose posture is that of `posture` at present."""
        model = body_model(person.avatar.body_path(), person.avatar.height_m)
        angles = person.posture.angles(person.avatar.profile.limits("passive"))
        alone = pelvis_pose(person.posture, model, angles, Pose())
        return self._pelvis(person.avatar)[0] @ alone.inverse()

    def raise_with(self, person: Human) -> None:
        """Put a person who lies here where the sections of the bed are now; to be called as it moves.

        They are put there, not pushed: pelvis, hips and knees follow without slip.

        Raises:
            ConfigError: If the person's hips and knees do not move.
        """
        dofs = [f"{side}_{name}" for side in SIDES for name in _LEGS]
        fixed = [dof for dof in dofs if dof not in person.movable]
        if fixed:
            raise ConfigError(
                f"{person.name!r} cannot be raised: {', '.join(fixed)} must be movable"
            )
        pelvis, angles = self._pelvis(person.avatar)
        person.place(pelvis)
        person.set_angles(angles)

    def _pelvis(self, avatar: AvatarConfig) -> tuple[Pose, dict[str, float]]:
        """Return where the pelvis of somebody lies in the world, and angles of hips and knees [rad]."""
        knee = self.position("knee")
        bends = (self.position("backrest"), knee, self._calf(knee))
        pelvis, angles = self._rest_of(avatar).lie(*bends)
        return self.frame_in_world("fold") @ pelvis, angles

    def _rest_of(self, avatar: AvatarConfig) -> BedRest:
        if self._lying is None or self._lying[0] is not avatar:
            lying = load_posture("bed_supine")
            lying = dataclasses.replace(
                lying, angles_deg=lying.angles_deg | _ARMS, posed=_POSED
            ).borne(avatar.bearing)
            sections = Sections(self._seat, self._thigh, self._thick)
            self._lying = (avatar, BedRest(avatar, lying, sections, sink=_SINK))
        return self._lying[1]
