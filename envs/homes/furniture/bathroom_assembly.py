"""Puts a piece of bathroom furniture together: shapes and joints, given in the frame of the piece."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rcare_marl.inertia import of_box
from rcare_marl.pose import Pose, quaternion_from_rpy, rotate
from rcare_marl.urdf import ZERO, Joint, Link, Model, Shape, Triple

from ...devices.device import Frame
from ..piece import Piece, Setting, Zone
from ..rectangle import Rectangle

BODY = "body"  # the root of every piece
SOURCE = "heights by level: assets/accessibility/rules.yaml; other sizes: common, from memory"
_FASTEST = 3.0  # [rad/s or m/s] that joints are made for; own choice
_EFFORT = 100.0  # [N·m or N] that stops take; own choice


def box(
    material: str, low: Triple, high: Triple, *, bevel: float = 0.0, rpy: Triple = ZERO
) -> Shape:
    """Return a box between two corners [m], turned by `rpy` [rad] about its middle."""
    at = _middle(low, high)
    return Shape(kind="box", material=material, at=at, size=_minus(high, low), bevel=bevel, rpy=rpy)


def rod(material: str, radius: float, *points: Triple, bend: float = 0.0) -> Shape:
    """Return a round bar along `points` [m], for the eye; cheaper than a cylinder.

    Its corners are rounded by `bend` [m], by fewer triangles than a tube does it.
    """
    path = [points[0]]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        reach = [min(bend / math.dist(corner, end), 0.49) for end in (before, after)]
        start = _between(corner, before, reach[0])
        end = _between(corner, after, reach[1])
        middle = _between(_between(start, end, 0.5), corner, 0.5)
        path += [start, middle, end] if bend > 0 else [corner]
    if len(points) > 1:
        path.append(points[-1])
    return Shape(kind="tube", material=material, radius=radius, points=tuple(path))


def solid_rods(radius: float, *points: Triple) -> tuple[Shape, ...]:
    """Return capsules along `points` [m], to collide with, that end where the points do."""
    out = []
    for a, b in zip(points, points[1:], strict=False):
        share = min(radius / math.dist(a, b), 0.45)
        ends = (_between(a, b, share), _between(b, a, share))
        out.append(Shape(kind="capsule", radius=radius, points=ends))
    return tuple(out)


@dataclass
class _Part:
    origin: Pose = Pose()
    mass: float = 0.0
    size: Triple = ZERO
    com: Triple = ZERO
    visual: list[Shape] = field(default_factory=list)
    collision: list[Shape] = field(default_factory=list)

    def link(self) -> Link:
        if self.mass == 0.0:
            return Link(visual=tuple(self.visual), collision=tuple(self.collision))
        inertia = of_box(self.mass, self.size)
        return Link(self.mass, self.com, inertia, tuple(self.visual), tuple(self.collision))


class Assembly:
    """A piece of furniture in the making.

    All shapes, joints and frames are given in the frame of the piece; those of a moving link where
    it was drawn: at its rest, or for links hung with `drawn_open`, at the upper end of its joint.

    Attributes:
        setting: What the piece is made for.
        measures: Dimensions that rules are about, under the name of the rule [m].
    """

    def __init__(self, kind: str, setting: Setting) -> None:
        self.setting = setting
        self.measures: dict[str, float] = {}
        self._kind = kind
        self._parts = {BODY: _Part()}
        self._joints: dict[str, Joint] = {}
        self._frames: dict[str, Frame] = {}

    def draw(self, *shapes: Shape, link: str = BODY) -> None:
        """Add shapes for the eye."""
        self._parts[link].visual += [self._local(shape, link).coarse() for shape in shapes]

    def solid(self, *shapes: Shape, link: str = BODY) -> None:
        """Add shapes to collide with."""
        self._parts[link].collision += [self._local(shape, link) for shape in shapes]

    def block(
        self, material: str, low: Triple, high: Triple, *, bevel: float = 0.0, link: str = BODY
    ) -> None:
        """Add a box between two corners [m], to see and to collide with."""
        shape = box(material, low, high, bevel=bevel)
        self.draw(shape, link=link)
        self.solid(replace(shape, bevel=0.0), link=link)

    def bar(
        self, material: str, radius: float, *points: Triple, bend: float = 0.0, link: str = BODY
    ) -> None:
        """Add a round bar along points [m], to see and to collide with."""
        self.draw(rod(material, radius, *points, bend=bend), link=link)
        self.solid(*solid_rods(radius, *points), link=link)

    def hang(
        self,
        name: str,
        at: Triple,
        axis: Triple,
        upper: float,
        *,
        mass: float,
        low: Triple,
        high: Triple,
        slide: bool = False,
        slowing: float = 0.05,
        friction: float = 0.0,
        drawn_open: bool = False,
        parent: str = BODY,
    ) -> None:
        """Add a link on a joint of the same name, which rests at 0.

        Args:
            name: Of the link and the joint.
            at: Where the joint is [m].
            axis: Along which it moves; along x, y or z for what is `drawn_open`.
            upper: Where it ends [rad or m].
            mass: Of the link [kg].
            low: One corner of the box that its mass fills evenly [m].
            high: The other corner [m].
            slide: Whether it slides; it turns otherwise.
            slowing: Time in which it loses most of its speed when let go [s].
            friction: What holds it against gravity [N·m or N].
            drawn_open: Whether the link is drawn at the upper end of its joint.
            parent: The link that carries it.
        """
        size, com = _minus(high, low), _minus(_middle(low, high), at)
        closed = (-upper * axis[0], -upper * axis[1], -upper * axis[2]) if drawn_open else ZERO
        turn = tuple(quaternion_from_rpy(*closed).tolist())
        self._parts[name] = _Part(Pose(at, turn), mass, size, com)
        inertia = np.asarray(of_box(mass, size))[[0, 3, 5]] + mass * (
            np.dot(com, com) - np.square(com)
        )
        moved = mass if slide else float(np.square(axis) @ inertia)
        carrier = self._parts[parent].origin.position
        self._joints[name] = Joint(
            "prismatic" if slide else "revolute",
            parent,
            name,
            at=_minus(at, (carrier[0], carrier[1], carrier[2])),
            rpy=closed,
            axis=axis,
            upper=upper,
            effort=_EFFORT,
            velocity=_FASTEST,
            damping=moved / slowing,
            friction=friction,
        )

    def frame(
        self, name: str, position: Triple, note: str = "", *, yaw_deg: float = 0.0, link: str = BODY
    ) -> None:
        """Name a place [m], on `link` where that was drawn; it is kept where the link rests."""
        origin = self._parts[link].origin
        x, y, z = rotate(origin.quaternion, np.subtract(position, origin.position)).tolist()
        a, b, c = origin.position
        self._frames[name] = Frame((a + x, b + y, c + z), (0.0, 0.0, yaw_deg), note)

    def piece(
        self,
        footprint: Rectangle,
        height: float,
        *,
        zones: Sequence[Zone] = (),
        knee: Sequence[Rectangle] = (),
        blocks: bool = True,
    ) -> Piece:
        """Return the finished piece."""
        colours: Mapping[str, tuple[float, ...]] = self.setting.palette.materials()
        used = {shape.material for part in self._parts.values() for shape in part.visual}
        model = Model(
            name=self._kind,
            source=SOURCE,
            links={name: part.link() for name, part in self._parts.items()},
            materials={name: colours[name] for name in sorted(used)},
            joints=self._joints,
        )
        return Piece(
            self._kind,
            model,
            footprint,
            height,
            tuple(zones),
            self._frames,
            self.measures,
            tuple(knee),
            blocks,
        )

    def _local(self, shape: Shape, link: str) -> Shape:
        """Return a shape, given in the frame of the piece, in the frame of its link."""
        x, y, z = self._parts[link].origin.position
        if shape.points:
            points = tuple(_minus(point, (x, y, z)) for point in shape.points)
            return replace(shape, points=points)
        return replace(shape, at=_minus(shape.at, (x, y, z)))


def _minus(a: Triple, b: Triple) -> Triple:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _between(a: Triple, b: Triple, share: float) -> Triple:
    """Return the point a `share` of the way from `a` to `b`."""
    away = _minus(b, a)
    return (a[0] + share * away[0], a[1] + share * away[1], a[2] + share * away[2])


def _middle(a: Triple, b: Triple) -> Triple:
    return (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]))


def towards(quarter: float) -> Triple:
    """Return the turn [rad] that lays the axis of a lathe along x (0) or y (1)."""
    return (0.0, math.pi / 2, 0.0) if quarter == 0 else (-math.pi / 2, 0.0, 0.0)


__all__ = ["BODY", "Assembly", "box", "rod", "solid_rods", "towards"]
