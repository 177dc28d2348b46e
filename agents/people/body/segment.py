"""Segments of a person: collision shapes fitted to the skin, and mass, centre and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np

from rcare_marl.pose import Array

from .anthropometry import WHOLE_SEGMENT, Sex, limb_centre, limb_inertia, segment_masses
from .skeleton import EYES, JOINT_INDEX, JOINTS, PARENTS
from .skin import BodyModel

# Fingers weigh grams; below these the discrete-time dynamics at 1/240 s has no stable gains.
# Our own choice: a tenth of a hand's inertia.
LEAST_INERTIA = 2e-5  # [kg·m²]
_CHILD_OF = {  # the joint at the far end of a segment, where it has several children
    "left_wrist": "left_middle1",
    "right_wrist": "right_middle1",
    "spine3": "neck",
    "pelvis": "spine1",
}


_KINDS = {"capsule": 0.0, "box": 1.0, "cylinder": 2.0}


@dataclass(frozen=True, eq=False)
class Shape:
    """A collision shape in the frame of its joint.

    Attributes:
        kind: `capsule` along its own z axis, or `box`; of things beside a person `cylinder`, too.
        size: Capsule: length between the centres of its ends, and radius; cylinder: length and radius; box:
            three edges [m].
        centre: Centre [m], shape [3].
        rotation: Axes of the shape, shape [3, 3].
    """

    kind: Literal["capsule", "box", "cylinder"]
    size: tuple[float, ...]
    centre: Array
    rotation: Array

    @property
    def volume(self) -> float:
        """Volume [m³]."""
        if self.kind == "box":
            return float(np.prod(self.size))
        length, radius = self.size
        return float(np.pi * radius**2 * (length + 4 / 3 * radius))

    def distance(self, point: Array) -> float:
        """Return how far a point in the frame of the joint is from the surface [m]; negative inside."""
        return float(_gap(shape_row(self, np.eye(3), np.zeros(3)), point))

    def inertia(self, mass: float) -> Array:
        """Return the inertia about the centre of a homogeneous shape [kg·m²], shape [3, 3]."""
        if self.kind == "box":
            a, b, c = self.size
            principal = np.array((b * b + c * c, a * a + c * c, a * a + b * b)) * mass / 12
        else:
            length, r = self.size
            tube = length / (length + 4 / 3 * r) * mass
            ball = mass - tube
            along = tube * r**2 / 2 + ball * 0.4 * r**2
            across = tube * (length**2 / 12 + r**2 / 4) + ball * (
                0.4 * r**2 + length**2 / 4 + 3 / 8 * length * r
            )
            principal = np.array((across, across, along))
        return np.asarray(self.rotation @ np.diag(principal) @ self.rotation.T)


@dataclass(frozen=True, eq=False)
class Segment:
    """The rigid part of a person that moves with one SMPL-X joint, in the frame of that joint.

    Attributes:
        joint: SMPL-X joint.
        mass: Mass [kg].
        centre: Centre of mass [m], shape [3].
        inertia: Inertia about the centre of mass [kg·m²], shape [3, 3].
        shapes: Collision shapes; an eye has none.
    """

    joint: str
    mass: float
    centre: Array
    inertia: Array
    shapes: tuple[Shape, ...]


def shape_row(shape: Shape, rotation: Array, offset: Array) -> Array:
    """Return a shape whose joint is turned and shifted in a link as a row for `nearest`, shape [16]."""
    size = (*shape.size, 0.0)[:3]
    turn = (rotation @ shape.rotation).T
    return np.array(
        (_KINDS[shape.kind], *size, *(rotation @ shape.centre + offset), *turn.ravel()), np.float64
    )


@numba.njit(cache=True)
def nearest(rows, point):  # type: ignore[no-untyped-def]
    """Return which of the shapes in `rows` [n, 16] has its surface nearest to a point [3] of the link."""
    best, least = 0, np.inf
    for k in range(rows.shape[0]):
        distance = _gap(rows[k], point)
        if distance < least:
            best, least = k, distance
    return best


@numba.njit(cache=True)
def least_gap(rows, point):  # type: ignore[no-untyped-def]
    """Return how far a point [3] is from the nearest of the shapes in `rows` [n, 16] [m]."""
    least = np.inf
    for k in range(rows.shape[0]):
        least = min(least, _gap(rows[k], point))
    return least


@numba.njit(cache=True)
def _gap(row, point):  # type: ignore[no-untyped-def]
    """Return how far a point [3] of the link is from the surface of a shape [m]; negative inside."""
    local, beyond = np.zeros(3), np.empty(3)
    for i in range(3):
        for j in range(3):
            local[i] += row[7 + 3 * i + j] * (point[j] - row[4 + j])
    if row[0] == 1.0:
        outside, inside = 0.0, -np.inf
        for i in range(3):
            beyond[i] = abs(local[i]) - 0.5 * row[1 + i]
            outside += max(beyond[i], 0.0) ** 2
            inside = max(inside, beyond[i])
        return np.sqrt(outside) + min(inside, 0.0)
    if row[0] == 2.0:
        aside = np.sqrt(local[0] ** 2 + local[1] ** 2) - row[2]
        ahead = abs(local[2]) - 0.5 * row[1]
        return np.hypot(max(aside, 0.0), max(ahead, 0.0)) + min(max(aside, ahead), 0.0)
    along = min(max(local[2], -0.5 * row[1]), 0.5 * row[1])
    return np.sqrt(local[0] ** 2 + local[1] ** 2 + (local[2] - along) ** 2) - row[2]


def combined(parts: Sequence[tuple[float, Array, Array]]) -> tuple[float, Array, Array]:
    """Return mass [kg], centre [m] and inertia about it [kg·m²] of parts given by the same three."""
    mass = sum(m for m, _, _ in parts)
    centre = sum((m * c for m, c, _ in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for m, c, i in parts:
        arm = c - centre
        inertia += i + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, centre, inertia


def make_segments(model: BodyModel, weight: float, sex: Sex) -> dict[str, Segment]:
    """Return all 55 segments of a person of `weight` [kg], by joint."""
    masses = segment_masses(weight, sex)
    owner = model.owner
    out = {}
    for joint in JOINTS:
        j = JOINT_INDEX[joint]
        points = model.vertices[owner == j].astype(np.float64) - model.joints[j]
        if len(points) < 4:  # a coarse user body may give a phalanx or an eye no vertex of its own
            points = np.array(((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)))
            points = points * 0.006
        shapes = _fit(joint, points, model)
        out[joint] = _segment(joint, masses[joint], shapes, model, sex)
    return out


def _segment(
    joint: str, mass: float, shapes: tuple[Shape, ...], model: BodyModel, sex: Sex
) -> Segment:
    density = mass / sum(s.volume for s in shapes)
    _, centre, inertia = combined(
        [(s.volume * density, s.centre, s.inertia(s.volume * density)) for s in shapes]
    )
    kind = joint.split("_", 1)[-1]
    if kind in WHOLE_SEGMENT:
        to_end = _far_end(joint, model)
        length = float(np.linalg.norm(to_end))
        along_axis = to_end / length
        across, along = limb_inertia(joint, mass, length, sex)
        projector = np.outer(along_axis, along_axis)
        inertia = across * (np.eye(3) - projector) + along * projector
        centre = to_end * limb_centre(joint, sex)
    inertia = inertia + max(0.0, LEAST_INERTIA - float(np.linalg.eigvalsh(inertia)[0])) * np.eye(3)
    return Segment(joint, mass, centre, inertia, () if joint in EYES else shapes)


def _far_end(joint: str, model: BodyModel) -> Array:
    """Return the vector from a joint to the end of its segment [m]; zero if nothing hangs on it."""
    j = JOINT_INDEX[joint]
    children = [c for c in range(len(JOINTS)) if PARENTS[c] == j]
    child = _CHILD_OF.get(joint, JOINTS[children[0]] if children else "")
    return np.asarray(model.joints[JOINT_INDEX[child]] - model.joints[j]) if child else np.zeros(3)


def _fit(joint: str, points: Array, model: BodyModel) -> tuple[Shape, ...]:
    kind = joint.split("_", 1)[-1] if joint.startswith(("left_", "right_")) else joint
    if kind in ("ankle", "foot", "wrist"):
        return (_box(points),)
    if kind in ("pelvis", "spine1", "spine2", "spine3", "jaw"):
        return (_capsule(points, axis=0, is_top=kind == "spine3"),)
    if kind == "head":
        level = np.quantile(points[:, 1], 0.5)
        cranium = points[points[:, 1] > level]
        face = points[
            (points[:, 2] > np.quantile(points[:, 2], 0.4)) & (points[:, 1] < level + 0.06)
        ]
        return (_capsule(cranium, axis=2), _capsule(face, axis=1))
    to_end = _far_end(joint, model)
    if not to_end.any():
        to_end = points.mean(axis=0)
    return (_limb(points, to_end),)


def _box(points: Array) -> Shape:
    low, high = np.quantile(points, 0.02, axis=0), np.quantile(points, 0.98, axis=0)
    size = np.maximum(high - low, 0.008)
    return Shape("box", tuple(size.tolist()), (low + high) / 2, np.eye(3))


def frame_along(direction: Array) -> Array:
    """Return a rotation whose third column is `direction`, of unit length, shape [3, 3]."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(helper, direction)
    first /= np.linalg.norm(first)
    return np.column_stack((first, np.cross(direction, first), direction))


def _capsule(points: Array, *, axis: int, is_top: bool = False) -> Shape:
    """Fit a capsule along a coordinate axis: as thick as the thinner of the two other extents.

    Args:
        points: Of the skin [m], shape [n, 3].
        axis: Which.
        is_top: Whether it is the top of the trunk, which may not rise above its skin, before chin and mouth.
    """
    low, high = np.quantile(points, 0.03, axis=0), np.quantile(points, 0.97, axis=0)
    half = (high - low) / 2
    others = [k for k in range(3) if k != axis]
    radius = max(0.004, float(half[others].min()))
    if axis == 0 and not is_top:  # the trunk: deep rather than high, so that neighbours overlap
        radius = max(radius, float(half[2])) if half[0] > half[2] else radius
    length = max(0.001, 2 * float(half[axis]) - 2 * radius)
    return Shape("capsule", (length, radius), (low + high) / 2, frame_along(np.eye(3)[axis]))


def _limb(points: Array, to_end: Array) -> Shape:
    """Fit a capsule along the segment; its radius is the typical distance of the skin from it."""
    direction = to_end / np.linalg.norm(to_end)
    along = points @ direction
    across = points - along[:, None] * direction
    middle = np.median(across, axis=0)
    radius = max(0.004, float(np.quantile(np.linalg.norm(across - middle, axis=1), 0.7)))
    low, high = np.quantile(along, 0.02), np.quantile(along, 0.98)
    length = max(0.001, float(high - low) - 2 * radius)
    centre = middle + direction * (low + high) / 2
    return Shape("capsule", (length, radius), centre, frame_along(direction))
