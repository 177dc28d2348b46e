"""How a piece of furniture is put together: boards, rods, doors and drawers, in the frame of the piece."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from rcare_marl.pose import Array
from rcare_marl.urdf import ZERO, Joint, Link, Model, Shape, Triple

from ...devices.device import Frame
from ..piece import Piece, Setting, Zone
from ..rectangle import Rectangle

BODY = "body"
BOARD = 0.018  # [m] thickness of board; common, from memory
WOOD = 600.0  # density of board [kg/m³]; from memory
GAP = 0.003  # [m] round doors and drawers; common, from memory
_REACH = 2.0  # [m]; what is higher takes no floor
DOOR_SWING = math.radians(100.0)  # own choice
# Slow what is pushed, so that nothing slams; own choice.
_HINGE_DAMPING = 0.6  # [N·m·s/rad]
_SLIDE_DAMPING = 12.0  # [N·s/m]

_Side = Literal["left", "right"]


@dataclass
class _Part:
    """A link in the making; its shapes are in the frame of the piece."""

    origin: Triple = ZERO
    density: float = WOOD
    visual: list[Shape] = field(default_factory=list)
    collision: list[Shape] = field(default_factory=list)


class Joinery:
    """Puts a piece of furniture together; every place that it takes is in the frame of the piece.

    Moving links take their mass and inertia from their solids and their density.

    Attributes:
        setting: What the piece is made for.
        frames: Named places on it, to be filled.
        measures: Dimensions that rules are about, to be filled [m].
        zones: Floor that it needs, to be filled.
        knee: Floor under it that is free for knees, to be filled.
    """

    def __init__(self, kind: str, setting: Setting) -> None:
        self.kind = kind
        self.setting = setting
        self.frames: dict[str, Frame] = {}
        self.measures: dict[str, float] = {}
        self.zones: list[Zone] = []
        self.knee: list[Rectangle] = []
        self._parts: dict[str, _Part] = {BODY: _Part()}
        self._joints: dict[str, Joint] = {}

    def add(self, *shapes: Shape, link: str = BODY, solid: bool = False, seen: bool = True) -> None:
        """Add shapes to a link: to look at, to collide with, or both."""
        if seen:
            self._parts[link].visual += [shape.coarse() for shape in shapes]
        if solid:
            self._parts[link].collision += shapes

    def board(
        self,
        low: Triple,
        high: Triple,
        material: str,
        *,
        link: str = BODY,
        bevel: float = 0.0,
        solid: bool = True,
        seen: bool = True,
    ) -> None:
        """Add a box between two corners [m]."""
        at = tuple(0.5 * (a + b) for a, b in zip(low, high, strict=True))
        size = tuple(b - a for a, b in zip(low, high, strict=True))
        shape = Shape(
            kind="box", material=material, at=_triple(at), size=_triple(size), bevel=bevel
        )
        self.add(shape, link=link, solid=solid, seen=seen)

    def slab(
        self,
        at: Triple,
        size: Triple,
        material: str,
        *,
        rpy: Triple = ZERO,
        link: str = BODY,
        bevel: float = 0.0,
        solid: bool = True,
        seen: bool = True,
    ) -> None:
        """Add a box about its middle `at` [m], turned by `rpy` [rad]."""
        shape = Shape(kind="box", material=material, at=at, rpy=rpy, size=size, bevel=bevel)
        self.add(shape, link=link, solid=solid, seen=seen)

    def rod(
        self,
        points: Sequence[Triple],
        radius: float,
        material: str,
        *,
        link: str = BODY,
        bend: float = 0.0,
        solid: bool = False,
    ) -> None:
        """Add a round rod along `points` [m]; drawn as a tube, which is cheap, solid as cylinders."""
        self.add(Shape(kind="tube", material=material, points=tuple(points), radius=radius, bend=bend),
                 link=link)  # fmt: skip
        if solid:
            for ends in zip(points, points[1:], strict=False):
                self.add(Shape(kind="cylinder", points=ends, radius=radius),
                         link=link, solid=True, seen=False)  # fmt: skip

    def legs(self, area: Rectangle, top: float, side: float, material: str) -> None:
        """Add four square legs of thickness `side` in the corners of `area`, up to `top` [m]."""
        for x in (area.x0, area.x1 - side):
            for y in (area.y0, area.y1 - side):
                self.board((x, y, 0.0), (x + side, y + side, top), material)

    def moving(
        self,
        link: str,
        kind: Literal["revolute", "prismatic"],
        at: Triple,
        axis: Triple,
        upper: float,
        *,
        parent: str = BODY,
        joint: str = "",
        density: float = WOOD,
        damping: float = 0.0,
        friction: float = 0.0,
        effort: float = 40.0,
    ) -> None:
        """Add a link that turns about, or slides along, `axis` through `at` from 0 to `upper`.

        Args:
            link: Its name.
            kind: Kind of joint.
            at: Origin of the link in the piece [m].
            axis: Direction of the joint in the piece.
            upper: Upper limit [rad or m].
            parent: Link that carries it.
            joint: Name of its joint; that of the link if empty.
            density: Of its solids [kg/m³].
            damping: See `Joint` [N·m·s/rad or N·s/m].
            friction: See `Joint` [N·m or N].
            effort: See `Joint` [N·m or N].
        """
        self._parts[link] = _Part(origin=at, density=density)
        here = self._parts[parent].origin
        self._joints[joint or link] = Joint(
            kind=kind, parent=parent, child=link, at=_minus(at, here), axis=axis, upper=upper,
            effort=effort, velocity=3.0 if kind == "revolute" else 1.0,
            damping=damping, friction=friction,
        )  # fmt: skip

    def handle(
        self, joint: str, at: Triple, *, length: float = 0.13, upright: bool = False
    ) -> None:
        """Add a handle, by rule a knob or a bar, to a front that looks along x at `at` [m].

        Adds the frame `handle_<joint>`, where it is gripped; x points out of the front.
        """
        x, y, z = at
        link = self._joints[joint].child
        if self.setting.rules.choice("cupboard_handle") == "knob":
            grip = (x + 0.022, y, z)
            self.rod([at, (x + 0.015, y, z)], 0.006, "metal", link=link)
            ends = ((x + 0.012, y, z), (x + 0.03, y, z))
            self.add(Shape(kind="tube", material="metal", points=ends, radius=0.015), link=link)
            self.add(Shape(kind="cylinder", points=(at, ends[1]), radius=0.015),
                     link=link, solid=True, seen=False)  # fmt: skip
        else:
            grip = (x + 0.035, y, z)
            along = (0.0, 0.0, 0.5 * length) if upright else (0.0, 0.5 * length, 0.0)
            bar = [_plus(grip, along, -1.0), _plus(grip, along)]
            self.rod(bar, 0.006, "metal", link=link, solid=True)
            for sign in (-0.8, 0.8):
                end = _plus(grip, along, sign)
                self.rod([(x, end[1], end[2]), end], 0.005, "metal", link=link, solid=True)
        self.frames[f"handle_{joint}"] = Frame(grip, note=f"grip of the joint {joint}, x out of it")

    def door(
        self,
        name: str,
        low: Triple,
        high: Triple,
        material: str,
        *,
        hinge: _Side,
        handle_z: float | None = None,
        swing: float = DOOR_SWING,
    ) -> None:
        """Hang a door that fills the opening from `low` to `high` [m] and looks along x.

        `hinge` is the side seen along x: left is +y. It gets a handle on the other side, and opens
        by `swing` [rad].
        """
        (x0, y0, z0), (x1, y1, z1) = low, high
        sign = 1.0 if hinge == "left" else -1.0
        pivot = (x1, y1 if hinge == "left" else y0, 0.5 * (z0 + z1))
        self.moving(name, "revolute", pivot, (0.0, 0.0, sign), swing,
                    damping=_HINGE_DAMPING)  # fmt: skip
        self.board((x0, y0 + GAP, z0 + GAP), (x1, y1 - GAP, z1 - GAP), material, link=name)
        edge = (y0 if hinge == "left" else y1) + sign * 0.045
        z = pivot[2] if handle_z is None else handle_z
        self.handle(name, (x1, edge, z), upright=True)
        width = y1 - y0
        # A leaf at 100 degrees reaches a little past the side that it hangs on.
        past = 0.18 * width if swing > 0.5 * math.pi else 0.0
        sides = (y0, y1 + past) if hinge == "left" else (y0 - past, y1)
        self.zones.append(Zone(Rectangle(x1, sides[0], x1 + width, sides[1]), "sweep"))

    def drawer(
        self,
        name: str,
        low: Triple,
        high: Triple,
        material: str,
        *,
        travel: float = 0.0,
        inside: str = "wood_light",
    ) -> None:
        """Put in an open drawer that fills the space from `low` to `high` [m], its front along x."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        thin = 0.012
        travel = travel or 0.75 * (x1 - x0)
        middle = 0.5 * (y0 + y1)
        self.moving(name, "prismatic", (x1, middle, 0.5 * (z0 + z1)), (1.0, 0.0, 0.0), travel,
                    damping=_SLIDE_DAMPING)  # fmt: skip
        front = x1 - BOARD
        self.board((front, y0 + GAP, z0 + GAP), (x1, y1 - GAP, z1 - GAP), material, link=name)
        a, b, top = y0 + 0.015, y1 - 0.015, z0 + 0.75 * (z1 - z0)
        floor = z0 + 0.01
        self.board((x0, a, floor), (front, b, floor + thin), inside, link=name)
        for y in (a, b - thin):
            self.board((x0, y, floor + thin), (front, y + thin, top), inside, link=name)
        self.board((x0, a + thin, floor + thin), (x0 + thin, b - thin, top), inside, link=name)
        self.handle(name, (x1, middle, 0.5 * (z0 + z1)), length=min(0.16, 0.5 * (y1 - y0)))
        reach = Rectangle(x1, y0, x1 + travel, y1)
        if not any(zone.area == reach for zone in self.zones):  # stacked drawers share it
            self.zones.append(Zone(reach, "sweep"))

    def mark(self, name: str, at: Triple, note: str, *, yaw_deg: float = 0.0) -> None:
        """Name a place on the piece [m]."""
        self.frames[name] = Frame(at, (0.0, 0.0, yaw_deg), note)

    def stand_zone(self, low: float, high: float, depth: float, *, x: float) -> None:
        """Keep floor free in front of the piece from `x` on, between `low` and `high` along y [m]."""
        self.zones.append(Zone(Rectangle(x, low, x + depth, high)))

    def done(self, *, footprint: Rectangle | None = None, blocks: bool = True) -> Piece:
        """Return the piece; its footprint is what its shapes cover if None is given."""
        links = {name: self._link(part, is_root=name == BODY) for name, part in self._parts.items()}
        palette = self.setting.palette.materials()
        used = {shape.material for link in links.values() for shape in link.visual}
        model = Model(
            name=self.kind,
            source="common sizes, from memory, and our own choice; rules of accessibility",
            links=links,
            materials={name: palette[name] for name in sorted(used)},
            joints=self._joints,
        )
        low, high = self._bounds()
        return Piece(
            kind=self.kind,
            model=model,
            footprint=footprint or Rectangle(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
            height=float(high[2]),
            zones=tuple(self.zones),
            frames=self.frames,
            measures=self.measures,
            knee=tuple(self.knee),
            blocks=blocks,
        )  # fmt: skip

    def _link(self, part: _Part, *, is_root: bool) -> Link:
        visual = tuple(_moved(shape, part.origin) for shape in part.visual)
        collision = tuple(_moved(shape, part.origin) for shape in part.collision)
        if is_root:  # it stands still and needs no mass
            return Link(visual=visual, collision=collision)
        mass, com, inertia = _weigh(collision, part.density)
        return Link(mass, com, inertia, visual=visual, collision=collision)

    def _bounds(self) -> tuple[Array, Array]:
        """Return the corners round all shapes; along x and y only of those below 2 m [m]."""
        lows, highs, tops = [], [], []
        for part in self._parts.values():
            for shape in (*part.visual, *part.collision):
                low, high = shape.bounds()
                tops.append(float(high[2]))
                if low[2] < _REACH:
                    lows.append(low)
                    highs.append(high)
        low, high = np.min(lows, axis=0), np.max(highs, axis=0)
        return np.minimum(low, (0.0, np.inf, np.inf)), np.array((high[0], high[1], max(tops)))


def _weigh(
    shapes: Sequence[Shape], density: float
) -> tuple[float, Triple, tuple[float, float, float, float, float, float]]:
    """Return mass [kg], centre [m] and inertia about it [kg·m²] of solid boxes and cylinders."""
    masses, centres, owns = [], [], []
    for shape in shapes:
        if shape.kind == "box":
            size = np.asarray(shape.size)
            mass = density * float(size.prod())
            squares = size**2
            own = mass / 12 * (squares.sum() - squares)
        else:  # a cylinder; capsules and spheres are not used for what moves
            length, radius = shape.span(), shape.radius
            mass = density * math.pi * radius**2 * length
            side = mass * (3 * radius**2 + length**2) / 12
            own = np.array((side, side, 0.5 * mass * radius**2))
        turn = shape.pose().matrix()[:3, :3]
        masses.append(mass)
        centres.append(np.asarray(shape.pose().position))
        owns.append(turn @ np.diag(own) @ turn.T)
    total = sum(masses)
    com = sum((m * c for m, c in zip(masses, centres, strict=True)), np.zeros(3)) / total
    inertia = np.zeros((3, 3))
    for mass, centre, own in zip(masses, centres, owns, strict=True):
        arm = centre - com
        inertia += own + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    rows = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    xx, xy, xz, yy, yz, zz = (float(inertia[row]) for row in rows)
    return total, _triple(com.tolist()), (xx, xy, xz, yy, yz, zz)


def _moved(shape: Shape, origin: Triple) -> Shape:
    """Return a shape of the piece in the frame of a link whose origin is at `origin`."""
    if origin == ZERO:
        return shape
    if shape.points and shape.kind in ("cylinder", "capsule"):
        return replace(shape, points=tuple(_minus(point, origin) for point in shape.points))
    return replace(shape, at=_minus(shape.at, origin))


def _triple(values: Sequence[float]) -> Triple:
    x, y, z = values
    return (float(x), float(y), float(z))


def _plus(a: Triple, b: Triple, factor: float = 1.0) -> Triple:
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


def _minus(a: Triple, b: Triple) -> Triple:
    return _plus(a, b, -1.0)
