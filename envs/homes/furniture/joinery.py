"""How a piece of furniture is put together: boards, rods, doors and drawers, in the frame of the piece."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

from rcare_marl.model.inertia import of_box
from rcare_marl.model.shape import UNSTRETCHED, ZERO, Shape, Triple
from rcare_marl.model.urdf import Joint, Model
from rcare_marl.pose import Array, Pose, quaternion_from_rpy

from ...devices import Frame
from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone, maker
from .stock import Part, box, solid_rods

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
_AXES: dict[str, Triple] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}

Corners = tuple[Triple, Triple]


class Joinery:
    """Puts a piece of furniture together; every place is told in the frame of the piece at rest.

    What is added goes with one link: with the body, or with the link that `joint`, `door` or `drawer`
    made and whose view of the piece they return. All views share what is gathered; footprint, height and
    whether it blocks are told to the first.

    Attributes:
        link: The link that it is added to.
        parts: Its links by name, the body first.
        joints: Its joints by name.
        setting: What the piece is made for.
        rules: The rules of its level.
        frames: Named places on it, to be filled.
        measures: Dimensions that rules are about, to be filled [m].
        zones: Floor that it needs, to be filled.
        knee: Floor under it that is free for knees, to be filled.
        footprint: The floor that it covers; what its shapes cover if None.
        height: Of its highest point [m]; that of its shapes if None.
        blocks: Whether it keeps people from walking there.
    """

    def __init__(self, kind: str, setting: Setting) -> None:
        """Begin a piece of `kind`."""
        self.parts = {BODY: Part(0.0)}
        self.joints: dict[str, Joint] = {}
        self.kind, self.link = kind, BODY
        self.setting = setting
        self.rules = setting.rules
        self.frames: dict[str, Frame] = {}
        self.measures: dict[str, float] = {}
        self.zones: list[Zone] = []
        self.knee: list[Rectangle] = []
        self.footprint: Rectangle | None = None
        self.height: float | None = None
        self.blocks = True

    def ruled(self, name: str, otherwise: float | None = None) -> float:
        """Return what the rules build, see `Rules.figure`, and note it as a measure of the piece [m]."""
        self.measures[name] = self.rules.figure(name, otherwise)
        return self.measures[name]

    def on(self, link: str) -> Joinery:
        """Return the same piece to which is added on another link."""
        view = copy.copy(self)
        view.link = link
        return view

    def draw(self, *shapes: Shape) -> None:
        """Add shapes for the eye."""
        self.parts[self.link].visual += [shape.coarse() for shape in shapes]

    def solid(self, *shapes: Shape) -> None:
        """Add shapes to collide with."""
        self.parts[self.link].collision += shapes

    def add(self, *shapes: Shape) -> None:
        """Add shapes to look at and to collide with."""
        self.draw(*shapes)
        self.solid(*shapes)

    def box(self, low: Triple, high: Triple, material: str, *, bevel: float = 0.0) -> None:
        """Add a box between two corners [m]."""
        self.add(box(material, low, high, bevel=bevel))

    def show(self, low: Triple, high: Triple, material: str, *, bevel: float = 0.0) -> None:
        """Add a box between two corners [m] for the eye."""
        self.draw(box(material, low, high, bevel=bevel))

    def block(self, low: Triple, high: Triple) -> None:
        """Add a box between two corners [m] to collide with."""
        self.solid(box("", low, high))

    def sides(
        self, low: Triple, high: Triple, thick: float, material: str, *, solid: bool = True
    ) -> None:
        """Add the two boards `thick` [m] that close the box between two corners [m] along y."""
        for y in (low[1], high[1] - thick):
            a, b = (low[0], y, low[2]), (high[0], y + thick, high[2])
            (self.box if solid else self.show)(a, b, material)

    def ring(
        self,
        outer: Rectangle,
        inner: Rectangle,
        span: tuple[float, float],
        material: str,
        *,
        solid: bool = True,
    ) -> None:
        """Add what is between two rectangles, from the lower to the upper height of `span` [m]."""
        for part in outer.without(inner):
            low, high = (part.x0, part.y0, span[0]), (part.x1, part.y1, span[1])
            (self.box if solid else self.show)(low, high, material)

    def slab(
        self,
        at: Triple,
        size: Triple,
        material: str,
        *,
        rpy: Triple = ZERO,
        bevel: float = 0.0,
        solid: bool = True,
        seen: bool = True,
    ) -> None:
        """Add a box about its middle `at` [m], turned by `rpy` [rad]."""
        shape = Shape("box", material, at, rpy, size=size, bevel=bevel)
        if seen:
            self.draw(shape)
        if solid:
            self.solid(shape)

    def rod(
        self,
        points: Sequence[Triple],
        radius: float,
        material: str,
        *,
        bend: float = 0.0,
        solid: bool = False,
    ) -> None:
        """Add a round rod along `points` [m], its corners rounded by `bend` [m] for the eye."""
        self.draw(Shape("tube", material, points=tuple(points), radius=radius, bend=bend))
        if solid:
            self.solid(*solid_rods(radius, *points))

    def post(
        self, foot: Triple, top: float, radius: float, material: str, *, solid: bool = False
    ) -> None:
        """Add an upright rod from `foot` up to the height `top` [m]."""
        self.rod((foot, (foot[0], foot[1], top)), radius, material, solid=solid)

    def disc(
        self, at: Triple, radius: float, thick: float, material: str, *, along: str = "z"
    ) -> None:
        """Add a flat disc about `at` [m] for the eye, its axis along x, y or z."""
        half = [0.5 * thick * a for a in _AXES[along]]
        ends = _triple(np.subtract(at, half).tolist()), _triple(np.add(at, half).tolist())
        self.rod(ends, radius, material)

    def cylinder(
        self, at: Triple, radius: float, length: float, *, material: str | None = None
    ) -> None:
        """Add an upright cylinder about `at` [m] to collide with; to see as well if it has a material."""
        self.solid(Shape("cylinder", "", at, radius=radius, length=length))
        if material is not None:
            self.draw(Shape("cylinder", material, at, radius=radius, length=length))

    def lathe(
        self,
        at: Triple,
        profile: Sequence[tuple[float, float]],
        material: str,
        *,
        rpy: Triple = ZERO,
        scale: Triple = UNSTRETCHED,
    ) -> None:
        """Add a turned body for the eye: radii and heights over `at` [m], turned by `rpy` [rad]."""
        self.draw(Shape("lathe", material, at, rpy, profile=tuple(profile), scale=scale))

    def legs(self, area: Rectangle, top: float, side: float, material: str) -> None:
        """Add four square legs of thickness `side` in the corners of `area`, up to `top` [m]."""
        for x in (area.x0, area.x1 - side):
            for y in (area.y0, area.y1 - side):
                self.box((x, y, 0.0), (x + side, y + side, top), material)

    def joint(
        self,
        link: str,
        at: Triple,
        axis: str | Triple,
        upper: float,
        *,
        slides: bool = False,
        mass: float | None = None,
        density: float = WOOD,
        fills: Corners | None = None,
        damping: float = 0.0,
        slowing: float = 0.0,
        friction: float = 0.0,
        drawn_open: bool = False,
    ) -> Joinery:
        """Hang a link on this one, by a joint of the same name from 0 to `upper`, and return it.

        Args:
            link: Its name.
            at: Origin of the link in the piece [m].
            axis: Direction of the joint in the piece, such as `-y`.
            upper: Upper limit [rad or m].
            slides: Whether it slides along the axis; else it turns about it.
            mass: Of the link [kg]; that of its solids if None.
            density: Of its solids [kg/m³].
            fills: Corners of the box that its mass fills evenly [m]; its solids if None.
            damping: See `Joint` [N·m·s/rad or N·s/m].
            slowing: Time in which it loses most of its speed when let go [s], in place of `damping`,
                for what has `mass` and `fills`.
            friction: See `Joint` [N·m or N].
            drawn_open: Whether its shapes are told for the upper end of its joint.
        """
        if isinstance(axis, str):
            sign = -1.0 if axis.startswith("-") else 1.0
            axis = _triple([sign * a if a else 0.0 for a in _AXES[axis[-1]]])
        kind: Literal["revolute", "prismatic"] = "prismatic" if slides else "revolute"
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
        here = self.parts[self.link].origin
        self.joints[link] = Joint(
            kind=kind,
            parent=self.link,
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
        return self.on(link)

    def handle(
        self,
        at: Triple,
        *,
        length: float = 0.16,
        upright: bool = False,
        style: str = "",
        material: str = "metal",
    ) -> None:
        """Add a handle to a front that looks along x, and the frame `handle_<link>`, its grip.

        Args:
            at: Middle of the handle on the front [m].
            length: Of a bar [m].
            upright: Whether a bar stands upright.
            style: `bar` or `knob`; as the rule says if empty.
            material: Its colour.
        """
        x, y, z = at
        style = style or self.rules.choice("cupboard_handle")
        if style == "knob":
            tip = x + KNOB_REACH
            self.rod([at, (x + 0.012, y, z)], 0.006, material)
            self.rod([(x + 0.010, y, z), (tip, y, z)], 0.015, material)
            self.solid(Shape("cylinder", points=(at, (tip, y, z)), radius=0.015))
        else:
            half, tip, thick = 0.5 * length, x + BAR_REACH, 0.010
            dy, dz = (0.006, half) if upright else (half, 0.006)
            self.box((tip - thick, y - dy, z - dz), (tip, y + dy, z + dz), material)
            for side in (-1, 1):
                py, pz = (y, z + side * (half - 0.02)) if upright else (y + side * (half - 0.02), z)
                a, b = (x, py - 0.005, pz - 0.005), (tip - thick, py + 0.005, pz + 0.005)
                self.show(a, b, material)
        self.on(BODY).frame(
            f"handle_{self.link}", (tip - 0.005, y, z), f"{style} of {self.link}, x out of it"
        )

    def front(self, low: Triple, high: Triple, material: str, *, framed: bool = True) -> None:
        """Add a board whose face looks along x; framed, with a raised rim as panelled fronts have."""
        if not framed:
            self.box(low, high, material)
            return
        rim, face = 0.055, high[0] - 0.005
        self.box(low, (face, high[1], high[2]), material)
        for y0, y1 in ((low[1], low[1] + rim), (high[1] - rim, high[1])):
            self.show((face, y0, low[2]), (high[0], y1, high[2]), material)
        for z0, z1 in ((low[2], low[2] + rim), (high[2] - rim, high[2])):
            self.show((face, low[1] + rim, z0), (high[0], high[1] - rim, z1), material)

    def door(
        self,
        name: str,
        low: Triple,
        high: Triple,
        material: str,
        *,
        left: bool,
        mass: float | None = None,
        handle_z: float | None = None,
        swing: float = OPEN,
        framed: bool = False,
    ) -> Joinery:
        """Hang a door that fills the opening from `low` to `high` [m] and looks along x.

        Its hinges are on the `left`, +y, as seen along x, or on the right. It turns about the outer edge
        of its face, so that it opens by `swing` [rad] within its own width, and has a handle on the other
        side.
        """
        (x0, y0, z0), (x1, y1, z1) = low, high
        sign, pivot = (1.0, (x1, y1, z0)) if left else (-1.0, (x1, y0, z0))
        leaf = self.joint(name, pivot, (0.0, 0.0, sign), swing, mass=mass, damping=HINGE_DAMPING)
        low, high = (x0, y0 + GAP, z0 + GAP), (x1, y1 - GAP, z1 - GAP)
        leaf.front(low, high, material, framed=framed)
        free = (y0 if left else y1) + sign * 0.035
        z = 0.5 * (z0 + z1) if handle_z is None else handle_z
        leaf.handle((x1, free, z), upright=True)
        # A leaf past a right angle reaches beside the side that it hangs on.
        past = max(-math.cos(swing), 0.0) * (y1 - y0)
        sides = (y0, y1 + past) if left else (y0 - past, y1)
        self.sweep(Rectangle(x1, sides[0], x1 + y1 - y0, sides[1]))
        return leaf

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
    ) -> Joinery:
        """Put in an open drawer that fills the space from `low` to `high` [m], its front along x.

        It comes out by `travel` [m], three quarters of its length if 0.
        """
        (x0, y0, z0), (x1, y1, z1) = low, high
        thin, tall = 0.012, z1 - z0
        travel = travel or 0.75 * (x1 - x0)
        front, middle = x1 - BOARD, 0.5 * (y0 + y1)
        at = (x1, middle, 0.5 * (z0 + z1))
        box = self.joint(name, at, "x", travel, slides=True, damping=SLIDE_DAMPING)
        a, b = (front, y0 + GAP, z0 + GAP), (x1, y1 - GAP, z1 - GAP)
        box.front(a, b, material, framed=framed)
        side, other, floor, top = y0 + 0.02, y1 - 0.02, z0 + 0.02, z0 + 0.75 * tall
        box.box((x0, side, floor), (front, other, floor + thin), inner)
        box.sides((x0, side, floor + thin), (front, other, top), thin, inner)
        a, b = (x0, side + thin, floor + thin), (x0 + thin, other - thin, top)
        box.box(a, b, inner)
        z = 0.5 * (z0 + z1) if tall < 0.25 else z1 - 0.07
        box.handle((x1, middle, z), length=min(0.3, 0.5 * (y1 - y0)))
        self.sweep(Rectangle(x1, y0, x1 + travel, y1))
        return box

    def frame(self, name: str, at: Triple, note: str = "", *, yaw_deg: float = 0.0) -> None:
        """Name a place on the piece [m]; on a link that is drawn open, it is kept where that rests."""
        joint = self.joints.get(self.link)
        if joint is not None and joint.rpy != ZERO:
            pivot = self.parts[self.link].origin
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

    def outline(self, depth: float, half: float, height: float, *zones: Zone) -> None:
        """Say what floor it covers, from the wall to `depth` and `half` to each side, and its height [m].

        Zones, if any are given, take the place of those that have been gathered.
        """
        self.footprint, self.height = Rectangle(0.0, -half, depth, half), height
        if zones:
            self.zones = list(zones)

    def piece(self) -> Piece:
        """Return the piece."""
        footprint, height = self.footprint, self.height
        used = {shape.material for part in self.parts.values() for shape in part.visual}
        palette = self.setting.palette.materials()
        model = Model(
            name=self.kind,
            source=SOURCE,
            links={name: part.link() for name, part in self.parts.items()},
            joints=self.joints,
            materials={name: palette[name] for name in sorted(used)},
        )
        if footprint is None or height is None:
            low, high = self._bounds()
            footprint = footprint or Rectangle(*low[:2].tolist(), *high[:2].tolist())
            height = float(high[2]) if height is None else height
        return Piece(
            kind=self.kind,
            model=model,
            footprint=footprint,
            height=height,
            zones=tuple(self.zones),
            frames=self.frames,
            measures=self.measures,
            knee=tuple(self.knee),
            blocks=self.blocks,
        )

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


def front_zone(depth: float, half: float, reach: float, why: str = "use") -> Zone:
    """Return the floor before a piece that is `depth` deep, `half` to each side and `reach` deep [m]."""
    return Zone(Rectangle(depth, -half, depth + reach, half), why)


def furniture(kind: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that makes a maker of pieces known as `kind` of what puts one together.

    That takes an empty `Joinery` and keyword options with defaults.
    """

    def register(put_together: Callable[..., None]) -> Callable[..., None]:
        @maker(kind)
        def make(setting: Setting, **options: Any) -> Piece:
            made = Joinery(kind, setting)
            put_together(made, **options)
            return made.piece()

        return put_together

    return register


def _triple(values: Sequence[float]) -> Triple:
    x, y, z = values
    return (float(x), float(y), float(z))


def _minus(a: Triple, b: Triple) -> Triple:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
