"""How a piece of furniture is put together: boards, rods, doors and drawers, in the frame of the piece."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from rcare_marl.model.inertia import of_box
from rcare_marl.model.shape import ZERO, Shape, Triple
from rcare_marl.model.urdf import Joint
from rcare_marl.pose import Array, Pose, quaternion_from_rpy

from ...devices import Assembly, Frame, Part
from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone
from .stock import box, solid_rods

BODY = "body"  # the root of every piece
BOARD = 0.018  # [m] thickness of board; common, from memory
WOOD = 600.0  # [kg/m³] of boards, between chipboard and pine; from memory
SOURCE = "heights by level: assets/accessibility/rules.yaml; other sizes: common, from memory"
GAP = 0.002  # [m] that a front leaves on each side; own choice
OPEN = 1.45  # [rad] that hinged fronts open: their handles miss a wall beside the hinge; own choice
# A joint that rests on its limit costs Bullet a constraint in every step: 97 µs for a run with 29 of
# them, and 27 to 39 µs with this slack behind the closed position.
SLACK = 1e-4  # [rad or m]
BAR_REACH = 0.035  # [m] of bar handles in front of the front; common, from memory
KNOB_REACH = 0.025  # [m]; common, from memory
_REACH = 2.0  # [m]; what is higher takes no floor
# Slow what is pushed, so that nothing slams; own choice.
HINGE_DAMPING = 0.5  # [N·m·s/rad]
SLIDE_DAMPING = 12.0  # [N·s/m]
# What joints are made for: greatest effort [N·m, N] and speed [rad/s, m/s]; own choice.
_MADE_FOR = {"revolute": (60.0, 6.0), "prismatic": (120.0, 2.0)}


class Joinery(Assembly):
    """Puts a piece of furniture together; every place is told in the frame of the piece at rest.

    Attributes:
        setting: What the piece is made for.
        rules: The rules of its level.
        frames: Named places on it, to be filled.
        measures: Dimensions that rules are about, to be filled [m].
        zones: Floor that it needs, to be filled.
        knee: Floor under it that is free for knees, to be filled.
    """

    def __init__(self, kind: str, setting: Setting) -> None:
        """Begin a piece of `kind`."""
        super().__init__(BODY, 0.0)
        self.kind = kind
        self.setting = setting
        self.rules = setting.rules
        self.frames: dict[str, Frame] = {}
        self.measures: dict[str, float] = {}
        self.zones: list[Zone] = []
        self.knee: list[Rectangle] = []

    def draw(self, *shapes: Shape, link: str = BODY) -> None:
        """Add shapes for the eye to a link."""
        self.parts[link].visual += [shape.coarse() for shape in shapes]

    def solid(self, *shapes: Shape, link: str = BODY) -> None:
        """Add shapes to collide with to a link."""
        self.parts[link].collision += shapes

    def add(self, *shapes: Shape, link: str = BODY) -> None:
        """Add shapes to a link, to look at and to collide with."""
        self.draw(*shapes, link=link)
        self.solid(*shapes, link=link)

    def box(
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
        self._place(box(material, low, high, bevel=bevel), link, solid=solid, seen=seen)

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
        self._place(shape, link, solid=solid, seen=seen)

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
        """Add a round rod along `points` [m], its corners rounded by `bend` [m] for the eye."""
        path = tuple(points)
        self.draw(
            Shape(kind="tube", material=material, points=path, radius=radius, bend=bend), link=link
        )
        if solid:
            self.solid(*solid_rods(radius, *path), link=link)

    def legs(self, area: Rectangle, top: float, side: float, material: str) -> None:
        """Add four square legs of thickness `side` in the corners of `area`, up to `top` [m]."""
        for x in (area.x0, area.x1 - side):
            for y in (area.y0, area.y1 - side):
                self.box((x, y, 0.0), (x + side, y + side, top), material)

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
        mass: float | None = None,
        density: float = WOOD,
        fills: tuple[Triple, Triple] | None = None,
        damping: float = 0.0,
        slowing: float = 0.0,
        friction: float = 0.0,
        drawn_open: bool = False,
    ) -> None:
        """Add a link that turns about, or slides along, `axis` through `at` from 0 to `upper`.

        Args:
            link: Its name.
            kind: Kind of joint.
            at: Origin of the link in the piece [m].
            axis: Direction of the joint in the piece; x, y or z for what is `drawn_open`.
            upper: Upper limit [rad or m].
            parent: Link that carries it.
            joint: Name of its joint; that of the link if empty.
            mass: Of the link [kg]; that of its solids if None.
            density: Of its solids [kg/m³].
            fills: Corners of the box that its mass fills evenly [m]; its solids if None.
            damping: See `Joint` [N·m·s/rad or N·s/m].
            slowing: Time in which it loses most of its speed when let go [s], in place of `damping`,
                for what has `mass` and `fills`.
            friction: See `Joint` [N·m or N].
            drawn_open: Whether its shapes are told for the upper end of its joint.
        """
        part = Part(mass, origin=at, density=density)
        if mass is not None and fills is not None:
            size, middle = np.subtract(fills[1], fills[0]), 0.5 * np.add(*fills) - at
            inertia = of_box(mass, _triple(size.tolist()))
            part.inertia = _triple(middle.tolist()), inertia
            if slowing > 0:
                about = np.array(inertia)[[0, 3, 5]] + mass * (middle @ middle - middle**2)
                moved = mass if kind == "prismatic" else float(np.square(axis) @ about)
                damping = moved / slowing
        self.parts[link] = part
        closed = _triple([-upper * a for a in axis]) if drawn_open else ZERO
        effort, velocity = _MADE_FOR[kind]
        here = self.parts[parent].origin
        self.joints[joint or link] = Joint(
            kind=kind,
            parent=parent,
            child=link,
            at=_minus(at, here),
            rpy=closed,
            axis=axis,
            lower=-SLACK,
            upper=upper,
            effort=effort,
            velocity=velocity,
            damping=damping,
            friction=friction,
        )

    def handle(
        self,
        joint: str,
        at: Triple,
        *,
        length: float = 0.16,
        upright: bool = False,
        style: str = "",
        material: str = "metal",
    ) -> None:
        """Add a handle to a front that looks along x, and the frame `handle_<joint>`, its grip.

        Args:
            joint: The joint that it is for.
            at: Middle of the handle on the front [m].
            length: Of a bar [m].
            upright: Whether a bar stands upright.
            style: `bar` or `knob`; as the rule says if empty.
            material: Its colour.
        """
        x, y, z = at
        link = self.joints[joint].child
        style = style or self.rules.choice("cupboard_handle")
        if style == "knob":
            tip = x + KNOB_REACH
            self.rod([at, (x + 0.012, y, z)], 0.006, material, link=link)
            self.rod([(x + 0.010, y, z), (tip, y, z)], 0.015, material, link=link)
            self.solid(Shape("cylinder", points=(at, (tip, y, z)), radius=0.015), link=link)
        else:
            half, tip, thick = 0.5 * length, x + BAR_REACH, 0.010
            dy, dz = (0.006, half) if upright else (half, 0.006)
            low, high = (tip - thick, y - dy, z - dz), (tip, y + dy, z + dz)
            self.box(low, high, material, link=link)
            for side in (-1, 1):
                py, pz = (y, z + side * (half - 0.02)) if upright else (y + side * (half - 0.02), z)
                a, b = (x, py - 0.005, pz - 0.005), (tip - thick, py + 0.005, pz + 0.005)
                self.box(a, b, material, link=link, solid=False)
        self.frame(f"handle_{joint}", (tip - 0.005, y, z), f"{style} of {joint}, x out of it")

    def front(
        self, low: Triple, high: Triple, material: str, *, link: str, framed: bool = True
    ) -> None:
        """Add a board whose face looks along x; framed, with a raised rim as panelled fronts have."""
        if not framed:
            self.box(low, high, material, link=link)
            return
        rim, face = 0.055, high[0] - 0.005
        self.box(low, (face, high[1], high[2]), material, link=link)
        for y0, y1 in ((low[1], low[1] + rim), (high[1] - rim, high[1])):
            self.box((face, y0, low[2]), (high[0], y1, high[2]), material, link=link, solid=False)
        for z0, z1 in ((low[2], low[2] + rim), (high[2] - rim, high[2])):
            a, b = (face, low[1] + rim, z0), (high[0], high[1] - rim, z1)
            self.box(a, b, material, link=link, solid=False)

    def door(
        self,
        name: str,
        low: Triple,
        high: Triple,
        material: str,
        *,
        hinge: Literal["left", "right"],
        mass: float | None = None,
        handle_z: float | None = None,
        swing: float = OPEN,
        framed: bool = False,
    ) -> None:
        """Hang a door that fills the opening from `low` to `high` [m] and looks along x.

        `hinge` is the side seen along x: left is +y. It turns about the outer edge of its face, so
        that it opens by `swing` [rad] within its own width, and has a handle on the other side.
        """
        (x0, y0, z0), (x1, y1, z1) = low, high
        sign = 1.0 if hinge == "left" else -1.0
        pivot = (x1, y1 if hinge == "left" else y0, z0)
        self.moving(
            name, "revolute", pivot, (0.0, 0.0, sign), swing, mass=mass, damping=HINGE_DAMPING
        )
        low, high = (x0, y0 + GAP, z0 + GAP), (x1, y1 - GAP, z1 - GAP)
        self.front(low, high, material, link=name, framed=framed)
        free = (y0 if hinge == "left" else y1) + sign * 0.035
        z = 0.5 * (z0 + z1) if handle_z is None else handle_z
        self.handle(name, (x1, free, z), upright=True)
        # A leaf past a right angle reaches beside the side that it hangs on.
        past = max(-math.cos(swing), 0.0) * (y1 - y0)
        sides = (y0, y1 + past) if hinge == "left" else (y0 - past, y1)
        self.sweep(Rectangle(x1, sides[0], x1 + y1 - y0, sides[1]))

    def drawer(
        self,
        name: str,
        low: Triple,
        high: Triple,
        material: str,
        *,
        travel: float = 0.0,
        inner: str = "wood_light",
        framed: bool = False,
    ) -> None:
        """Put in an open drawer that fills the space from `low` to `high` [m], its front along x.

        It comes out by `travel` [m], three quarters of its length if 0.
        """
        (x0, y0, z0), (x1, y1, z1) = low, high
        thin, tall = 0.012, z1 - z0
        travel = travel or 0.75 * (x1 - x0)
        front, middle = x1 - BOARD, 0.5 * (y0 + y1)
        self.moving(
            name,
            "prismatic",
            (x1, middle, 0.5 * (z0 + z1)),
            (1.0, 0.0, 0.0),
            travel,
            damping=SLIDE_DAMPING,
        )
        a, b = (front, y0 + GAP, z0 + GAP), (x1, y1 - GAP, z1 - GAP)
        self.front(a, b, material, link=name, framed=framed)
        side, other, floor, top = y0 + 0.02, y1 - 0.02, z0 + 0.02, z0 + 0.75 * tall
        self.box((x0, side, floor), (front, other, floor + thin), inner, link=name)
        for y in (side, other - thin):
            self.box((x0, y, floor + thin), (front, y + thin, top), inner, link=name)
        a, b = (x0, side + thin, floor + thin), (x0 + thin, other - thin, top)
        self.box(a, b, inner, link=name)
        z = 0.5 * (z0 + z1) if tall < 0.25 else z1 - 0.07
        self.handle(name, (x1, middle, z), length=min(0.3, 0.5 * (y1 - y0)))
        self.sweep(Rectangle(x1, y0, x1 + travel, y1))

    def frame(
        self, name: str, at: Triple, note: str = "", *, yaw_deg: float = 0.0, link: str = BODY
    ) -> None:
        """Name a place on the piece [m]; on a link that is drawn open, it is kept where that rests."""
        for joint in self.joints.values():
            if joint.child == link and joint.rpy != ZERO:
                pivot = self.parts[link].origin
                turn = Pose(pivot, tuple(quaternion_from_rpy(*joint.rpy).tolist()))
                at = _triple((turn @ Pose(_minus(at, pivot))).position)
        self.frames[name] = Frame(at, (0.0, 0.0, yaw_deg), note)

    def sweep(self, area: Rectangle) -> None:
        """Keep the floor free that a door or drawer moves over; those one above another share it."""
        if not any(zone.area == area for zone in self.zones):
            self.zones.append(Zone(area, "sweep"))

    def stand_zone(self, low: float, high: float, depth: float, *, x: float) -> None:
        """Keep floor free in front of the piece from `x` on, between `low` and `high` along y [m]."""
        self.zones.append(Zone(Rectangle(x, low, x + depth, high)))

    def piece(
        self,
        footprint: Rectangle | None = None,
        height: float | None = None,
        *,
        zones: Sequence[Zone] | None = None,
        blocks: bool = True,
    ) -> Piece:
        """Return the piece.

        Args:
            footprint: The floor that it covers; what its shapes cover if None.
            height: Of its highest point [m]; that of its shapes if None.
            zones: The floor that it needs; what has been gathered if None.
            blocks: Whether it keeps people from walking there.
        """
        used = {shape.material for part in self.parts.values() for shape in part.visual}
        palette = self.setting.palette.materials()
        model = self.model(self.kind, SOURCE, {name: palette[name] for name in sorted(used)})
        if footprint is None or height is None:
            low, high = self._bounds()
            footprint = footprint or Rectangle(*low[:2].tolist(), *high[:2].tolist())
            height = float(high[2]) if height is None else height
        return Piece(
            kind=self.kind,
            model=model,
            footprint=footprint,
            height=height,
            zones=tuple(self.zones if zones is None else zones),
            frames=self.frames,
            measures=self.measures,
            knee=tuple(self.knee),
            blocks=blocks,
        )

    def _place(self, shape: Shape, link: str, *, solid: bool, seen: bool) -> None:
        if seen:
            self.draw(shape, link=link)
        if solid:
            self.solid(shape, link=link)

    def _bounds(self) -> tuple[Array, Array]:
        """Return the corners round all shapes; along x and y only of those below 2 m [m]."""
        lows, highs, tops = [], [], []
        for part in self.parts.values():
            for shape in (*part.visual, *part.collision):
                low, high = shape.bounds()
                tops.append(float(high[2]))
                if low[2] < _REACH:
                    lows.append(low)
                    highs.append(high)
        low, high = np.min(lows, axis=0), np.max(highs, axis=0)
        return np.minimum(low, (0.0, np.inf, np.inf)), np.array((high[0], high[1], max(tops)))


def wall_strip(depth: float, width: float) -> Rectangle:
    """Return the floor from the wall to `depth` [m], `width` [m] wide about the middle."""
    return Rectangle(0.0, -0.5 * width, depth, 0.5 * width)


def front_zone(depth: float, width: float, reach: float, why: str = "use") -> Zone:
    """Return the floor in front of a piece as wide as it is, up to `reach` [m] from its front."""
    return Zone(Rectangle(depth, -0.5 * width, depth + reach, 0.5 * width), why)


def _triple(values: Sequence[float]) -> Triple:
    x, y, z = values
    return (float(x), float(y), float(z))


def _minus(a: Triple, b: Triple) -> Triple:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
