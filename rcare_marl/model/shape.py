"""Shapes of links as data: what is drawn, what collides, and the surfaces that they stand for."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import (
    IDENTITY,
    Array,
    Pose,
    matrix_from_quaternion,
    quaternion_from_rpy,
    rpy_from_matrix,
)

from . import mesh
from .mesh import Mesh

Triple = tuple[float, float, float]
Rgba = tuple[float, float, float, float]
GREY: Rgba = (0.75, 0.75, 0.75, 1.0)  # what has no colour
ZERO: Triple = (0.0, 0.0, 0.0)
UNSTRETCHED: Triple = (1.0, 1.0, 1.0)
UNMOVED = Pose()
ERROR = 0.0025  # [m] by which what is round may be angular: not seen across a room; own choice
SOLID = ("box", "sphere", "cylinder", "capsule")
# What a shape of a kind cannot do without; a radius for all others.
_NEEDS = {
    "box": "size",
    "lathe": "profile",
    "loft": "sections",
    "tube": "points",
    "quads": "points",
}
_ALONG_POINTS = ("tube", "quads", "cylinder", "capsule")
# Points round a shape where it does not say how many.
_SEGMENTS = {"sphere": 24, "cylinder": 36, "capsule": 24, "lathe": 36, "loft": 36, "tube": 14}
_STEPS = {"box": 4, "tube": 6}


@dataclass(frozen=True)
class Shape:
    """A shape in the frame of its link. Lengths in metres.

    Attributes:
        kind: `box`, `sphere`, `cylinder`, `capsule`; for the eye only `lathe`, `loft`, `tube`,
            `quads`.
        material: Name of its colour in the model.
        at: Origin of the shape.
        rpy: Turn of the shape, fixed-axis roll, pitch, yaw [rad].
        size: Edges of a box.
        bevel: Rounding of the edges of a box, for the eye only.
        steps: Strips that make the rounding of an edge of a box, or of a corner of a tube; as many as
            its kind usually has if 0.
        radius: Of a sphere, cylinder, capsule or tube.
        length: Of a cylinder, or between the cap centres of a capsule; along z.
        profile: Of a lathe: (radius, z), see `mesh.lathe`.
        sections: Of a loft: (z, centre x, centre y, half width x, half width y).
        points: Path of a tube; the two ends of a cylinder or capsule; corners of quads, four by four.
        bend: Rounding of the corners of the path of a tube.
        segments: Points round whatever is round, for the eye only; as many as its kind usually has
            if 0.
        scale: Stretch along the shape's own axes, for the eye only.
    """

    kind: Literal["box", "sphere", "cylinder", "capsule", "lathe", "loft", "tube", "quads"]
    material: str = ""
    at: Triple = ZERO
    rpy: Triple = ZERO
    size: Triple = ZERO
    bevel: float = 0.0
    steps: int = 0
    radius: float = 0.0
    length: float = 0.0
    profile: tuple[tuple[float, float], ...] = ()
    sections: tuple[tuple[float, ...], ...] = ()
    points: tuple[Triple, ...] = ()
    bend: float = 0.0
    segments: int = 0
    scale: Triple = UNSTRETCHED

    def __post_init__(self) -> None:
        need = _NEEDS.get(self.kind, "radius")
        if not _has_number(getattr(self, need)):
            raise ValueError(f"a {self.kind} needs `{need}`")
        if self.points and self.kind not in _ALONG_POINTS:
            raise ValueError(f"a {self.kind} has no `points`")
        if self.steps < 0 or (self.steps and self.kind not in _STEPS):
            raise ValueError(f"a {self.kind} cannot be rounded in {self.steps} `steps`")
        if self.segments and (self.segments < 3 or self.kind not in _SEGMENTS):
            raise ValueError(f"a {self.kind} cannot have {self.segments} `segments`")

    def __repr__(self) -> str:
        usual = _DEFAULTS
        told = [
            f"{k}={v!r}" for k, v in self.__dict__.items() if v is not usual[k] and v != usual[k]
        ]
        return f"Shape({', '.join(told)})"

    def pose(self) -> Pose:
        """Return the pose of the shape's own frame in its link, z along cylinders and capsules."""
        if self.points and self.kind in ("cylinder", "capsule"):
            return _between(*self.points)
        return Pose(self.at, _turned(self.rpy))

    def span(self) -> float:
        """Return the length of a cylinder, or between the cap centres of a capsule [m]."""
        if self.points:
            start, end = self.points
            return float(sum((b - a) ** 2 for a, b in zip(start, end, strict=True)) ** 0.5)
        return self.length

    def mesh(self, pose: Pose = UNMOVED) -> Mesh:
        """Return the surface, in the frame in which the link is at `pose`."""
        plain = self._plain()
        if plain is not None:
            template, scale, place = plain
            return template.stretched(scale).moved(pose @ place)
        if self.kind == "box":
            made = mesh.box(self.size, self.bevel, self._steps)
        elif self.kind == "quads":
            made = mesh.quads(self.points)
        else:
            bare = self._twin(material="", at=ZERO, rpy=ZERO, scale=UNSTRETCHED)
            if self.kind == "capsule":
                bare = bare._twin(points=(), length=self.span())
            made = _curved(bare)
        if self.scale != UNSTRETCHED:
            made = made.stretched(self.scale)
        return made.moved(pose @ self.pose())

    def _plain(self) -> tuple[Mesh, Triple, Pose] | None:
        """Return a mesh that many shapes share, its stretch, and its pose in the link; None if none."""
        a, b, c = self.scale
        if self.kind == "box" and self.bevel <= 0:
            x, y, z = self.size
            return mesh.cube(), (0.5 * a * x, 0.5 * b * y, 0.5 * c * z), self.pose()
        r = self.radius
        if self.kind == "sphere":
            return mesh.ball(self._round), (a * r, b * r, c * r), self.pose()
        if self.kind == "cylinder":
            return mesh.rod(self._round), (a * r, b * r, c * self.span()), self.pose()
        if self.kind == "tube" and len(self.points) == 2 and self.scale == UNSTRETCHED:
            place = self.pose() @ _between(*self.points)
            return mesh.rod(self._round), (r, r, self.span()), place
        return None

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest corner of the box round it in its link [m]."""
        if self.kind == "box":
            pose = self.pose()
            turn = np.abs(matrix_from_quaternion(pose.quaternion))
            reach = turn @ (0.5 * np.multiply(self.size, self.scale))
            return pose.position - reach, pose.position + reach
        vertices = self.mesh().vertices
        return vertices.min(axis=0), vertices.max(axis=0)

    def moved(self, pose: Pose, *, material: str | None = None) -> Shape:
        """Return the shape, given in the frame `pose`, in the frame that `pose` is given in.

        Args:
            pose: Where the frame is in the other.
            material: Its colour from now on; the same if None.
        """
        changed: dict[str, object] = {} if material is None else {"material": material}
        if self.points and self.kind in ("cylinder", "capsule"):  # they lie where their ends are
            changed["points"] = tuple((pose @ Pose(point)).position for point in self.points)
        else:
            place = pose @ self.pose()
            changed["at"] = place.position
            changed["rpy"] = self.rpy if pose.quaternion == IDENTITY else turn_rpy(place.quaternion)
        return self._twin(**changed)

    def _twin(self, **changed: object) -> Shape:
        """Return it with changes that need no check: a house has thousands of these."""
        twin = object.__new__(Shape)
        twin.__dict__.update(self.__dict__, **changed)
        return twin

    def coarse(self, error: float = ERROR) -> Shape:
        """Return the shape with no more triangles than keep its surface true to about `error` [m].

        A number of `segments` or `steps` that it says itself is left alone.
        """
        segments, steps = self.segments, self.steps
        if self.kind == "box" and self.bevel > 0:
            steps = steps or min(_chords(self.bevel, error, 0.5 * math.pi), _STEPS["box"])
        elif self.kind == "lathe":
            radius = max(r for r, _ in self.profile) * max(self.scale[:2])
            segments = segments or max(12, _around(radius, error))
        elif self.kind in ("tube", "cylinder", "sphere", "capsule"):
            segments = segments or _around(self.radius, error)
            if self.kind == "tube" and self.bend > 0:
                steps = steps or min(_chords(self.bend, error, 0.5 * math.pi), _STEPS["tube"])
        if (segments, steps) == (self.segments, self.steps):
            return self
        return dataclasses.replace(self, segments=segments, steps=steps)

    @property
    def _round(self) -> int:
        return self.segments or _SEGMENTS[self.kind]

    @property
    def _steps(self) -> int:
        return self.steps or _STEPS.get(self.kind, 0)


def surface(shapes: Sequence[Shape], pose: Pose = UNMOVED) -> Mesh:
    """Return the surfaces of shapes as one, in the frame in which their link is at `pose`."""
    meshes: list[Mesh] = []
    alike: dict[int, list[tuple[Mesh, Triple, Pose]]] = {}
    for shape in shapes:
        plain = shape._plain()
        if plain is None:
            meshes.append(shape.mesh(pose))
        else:
            alike.setdefault(id(plain[0]), []).append(plain)
    for group in alike.values():  # together they take a tenth of the time
        places = [pose @ place for _, _, place in group]
        scales = np.array([scale for _, scale, _ in group])
        turns = np.array([place.quaternion for place in places])
        at = np.array([place.position for place in places])
        meshes.append(group[0][0].copies(scales, turns, at))
    return mesh.merge(meshes)


_DEFAULTS = {field.name: field.default for field in dataclasses.fields(Shape)}


@dataclass(frozen=True)
class MeshFile:
    """A mesh file to draw, or to collide with by its convex hull.

    Attributes:
        file: Absolute path, once it is found.
        rgba: Colour where the file has none.
        scale: Factor on the file's numbers, one an axis.
        at: Origin of the mesh in the link [m].
        rpy: Turn of the mesh in the link [rad].
    """

    file: str
    rgba: Rgba = GREY
    scale: Triple = UNSTRETCHED
    at: Triple = ZERO
    rpy: Triple = ZERO

    def pose(self) -> Pose:
        """Return the pose of the mesh in its link."""
        return Pose(self.at, _turned(self.rpy))


@lru_cache(maxsize=4096)
def _curved(shape: Shape) -> Mesh:
    """Return a surface that takes long to make, in its own frame; the same one for the same shape."""
    if shape.kind == "lathe":
        return mesh.lathe(shape.profile, shape._round)
    if shape.kind == "loft":
        return mesh.loft(shape.sections, shape._round)
    if shape.kind == "capsule":
        return mesh.capsule(shape.radius, shape.span(), shape._round)
    return mesh.tube(shape.points, shape.radius, shape.bend, shape._round, shape._steps)


@lru_cache(maxsize=4096)
def turn_rpy(quaternion: tuple[float, ...]) -> Triple:
    """Return URDF's roll, pitch, yaw of a quaternion [rad]; the same turns come again and again."""
    return rpy_from_matrix(matrix_from_quaternion(quaternion))


@lru_cache(maxsize=4096)
def _turned(rpy: Triple) -> tuple[float, ...]:
    return tuple(quaternion_from_rpy(*rpy).tolist())


def _chords(radius: float, error: float, angle: float) -> int:
    """Return how many chords follow an arc of `angle` [rad] to within `error` [m]."""
    each = 2 * math.acos(max(1 - error / radius, 0.0))
    return max(math.ceil(angle / each - 1e-9), 1)


def _around(radius: float, error: float) -> int:
    """Return how many points go round a circle: a multiple of four, so that halves are alike."""
    quarters = math.ceil(_chords(radius, error, 2 * math.pi) / 4)
    return min(max(4 * quarters, 8 if radius > error else 4), 32)


def _between(start: Triple, end: Triple) -> Pose:
    """Return the pose half-way between two points, z towards the second."""
    middle = tuple((a + b) / 2 for a, b in zip(start, end, strict=True))
    return Pose(middle, _turn_z_to([b - a for a, b in zip(start, end, strict=True)]))


def _turn_z_to(direction: list[float]) -> tuple[float, ...]:
    x, y, z = direction
    length = (x * x + y * y + z * z) ** 0.5
    if length == 0:
        raise ConfigError("a cylinder or capsule needs two points that differ")
    if z / length < -1 + 1e-9:
        return (1.0, 0.0, 0.0, 0.0)
    # Half-way rotation from z: (z × d, 1 + z · d), normalised.
    w = 1 + z / length
    q = (-y / length, x / length, 0.0, w)
    norm = sum(v * v for v in q) ** 0.5
    return tuple(v / norm for v in q)


def _has_number(value: object) -> bool:
    """Return whether something is a number that is not zero, or holds one."""
    return any(map(_has_number, value)) if isinstance(value, tuple) else bool(value)
