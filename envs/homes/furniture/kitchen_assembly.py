"""Joinery: a piece of furniture in the making, told in the frame of the piece with all joints at rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from rcare_marl.urdf import ZERO, Joint, Link, Model, Shape, Triple

from ...devices.device import Frame
from ..piece import Piece, Setting, Zone
from ..rectangle import Rectangle

ROOT = "body"
DENSITY = 650.0  # [kg/m³] of boards, between chipboard and pine, from memory
OPEN = 1.45  # [rad] that hinged fronts open: their handles miss a wall beside the hinge; own choice
# A joint that rests on its limit costs Bullet a constraint in every step: 97 µs for a run with 29 of
# them, and 27 to 39 µs with this slack behind the closed position.
SLACK = 1e-4  # [rad or m]
GAP = 0.0015  # [m] that a front leaves on each side; own choice
BAR_REACH = 0.035  # [m] of bar handles in front of the front; common, from memory
KNOB_REACH = 0.025  # [m]; common, from memory


@dataclass
class _Part:
    """One link in the making.

    Attributes:
        origin: Of its frame in that of the piece [m].
        mass: Mass [kg]; that of boards if None.
        visual: What to draw, in its own frame.
        collision: What to collide with.
    """

    origin: Triple
    mass: float | None = None
    visual: list[Shape] = field(default_factory=list)
    collision: list[Shape] = field(default_factory=list)

    def link(self) -> Link:
        """Return the link; its mass lies evenly in its solid boxes."""
        if not self.collision:
            return Link(visual=tuple(self.visual))
        edges = [_edges(shape) for shape in self.collision]
        volumes = [a * b * c for a, b, c in edges]
        total = sum(volumes)
        mass = self.mass if self.mass is not None else DENSITY * total
        if mass == 0.0:
            return Link(visual=tuple(self.visual), collision=tuple(self.collision))
        middles = [shape.pose().position for shape in self.collision]
        weights = [mass * volume / total for volume in volumes]
        com = tuple(
            sum(w * m[k] for w, m in zip(weights, middles, strict=True)) / mass for k in range(3)
        )
        moments = [0.0, 0.0, 0.0]
        for weight, edge, middle in zip(weights, edges, middles, strict=True):
            for k in range(3):
                i, j = (k + 1) % 3, (k + 2) % 3
                moments[k] += weight * (edge[i] ** 2 + edge[j] ** 2) / 12
                moments[k] += weight * ((middle[i] - com[i]) ** 2 + (middle[j] - com[j]) ** 2)
        return Link(
            mass,
            (com[0], com[1], com[2]),
            (moments[0], 0.0, 0.0, moments[1], 0.0, moments[2]),
            tuple(self.visual),
            tuple(self.collision),
        )


class Assembly:
    """A piece of furniture in the making.

    All places are told in the frame of the piece at rest; the frames of moving links are turned as it
    is, so that everything is where it is said to be.

    Attributes:
        setting: What the piece is made for.
        rules: The rules of its level.
        frames: Named places so far.
        joints: Joints so far.
    """

    def __init__(self, kind: str, setting: Setting) -> None:
        """Begin a piece of `kind`."""
        self.kind = kind
        self.setting = setting
        self.rules = setting.rules
        self.frames: dict[str, Frame] = {}
        self.joints: dict[str, Joint] = {}
        self._parts = {ROOT: _Part(ZERO, 0.0)}

    def box(
        self,
        low: Triple,
        high: Triple,
        material: str,
        *,
        on: str = ROOT,
        bevel: float = 0.0,
        solid: bool = True,
        seen: bool = True,
    ) -> None:
        """Add a box by its lowest and highest corner [m]; not solid, it is for the eye only."""
        size = (high[0] - low[0], high[1] - low[1], high[2] - low[2])
        middle = (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2]))
        made = Shape("box", material, middle, size=size, bevel=bevel)
        self.shape(made, on=on, solid=solid, seen=seen)

    def rod(
        self,
        start: Triple,
        end: Triple,
        radius: float,
        material: str,
        *,
        on: str = ROOT,
        solid: bool = False,
    ) -> None:
        """Add a round rod; drawn with fewer triangles than a cylinder."""
        self.shape(Shape("tube", material, points=(start, end), radius=radius), on=on)
        if solid:
            made = Shape("cylinder", points=(start, end), radius=radius)
            self.shape(made, on=on, solid=True, seen=False)

    def shape(
        self, shape: Shape, *, on: str = ROOT, solid: bool = False, seen: bool = True
    ) -> None:
        """Add a shape, given in the frame of the piece, to a link."""
        part = self._parts[on]
        if shape.points:
            points = tuple(_less(point, part.origin) for point in shape.points)
            placed = replace(shape, points=points)
        else:
            placed = replace(shape, at=_less(shape.at, part.origin))
        if seen:
            part.visual.append(placed.coarse())
        if solid:
            part.collision.append(replace(placed, material="", bevel=0.0))

    def hang(
        self,
        joint: str,
        kind: Literal["revolute", "prismatic"],
        at: Triple,
        axis: Triple,
        upper: float,
        *,
        mass: float | None = None,
        parent: str = ROOT,
        damping: float = 0.3,
        friction: float = 0.0,
    ) -> str:
        """Add a link of the joint's name that moves on a joint, and return the name.

        Args:
            joint: Name of joint and link.
            kind: Kind of joint.
            at: A point on its axis, the origin of the link's frame [m].
            axis: Direction that opens it.
            upper: How far it opens [rad or m].
            mass: Of the link [kg]; that of boards if None.
            parent: Link that carries it.
            damping: Torque or force for each unit of speed [N·m·s/rad or N·s/m].
            friction: Dry friction [N·m or N].
        """
        self._parts[joint] = _Part(at, mass)
        effort, velocity = (60.0, 6.0) if kind == "revolute" else (120.0, 2.0)  # own choice
        self.joints[joint] = Joint(
            kind,
            parent,
            joint,
            _less(at, self._parts[parent].origin),
            axis=axis,
            lower=-SLACK,
            upper=upper,
            effort=effort,
            velocity=velocity,
            damping=damping,
            friction=friction,
        )
        return joint

    def leaf(
        self,
        joint: str,
        low: Triple,
        high: Triple,
        material: str,
        *,
        hinge: Literal["low", "high"],
        mass: float | None = None,
        handle_z: float | None = None,
        upper: float = OPEN,
        framed: bool = False,
    ) -> str:
        """Hang a door with upright hinges on the side `hinge` along y, and return its link.

        The axis is the outer edge of the front face, so that the opened door stays in its own width.
        """
        y = low[1] if hinge == "low" else high[1]
        axis = (0.0, 0.0, -1.0 if hinge == "low" else 1.0)
        self.hang(joint, "revolute", (high[0], y, low[2]), axis, upper, mass=mass)
        low, high = (low[0], low[1] + GAP, low[2] + GAP), (high[0], high[1] - GAP, high[2] - GAP)
        self.front(low, high, material, on=joint, framed=framed)
        free = high[1] - 0.035 if hinge == "low" else low[1] + 0.035
        z = 0.5 * (low[2] + high[2]) if handle_z is None else handle_z
        self.handle(joint, (high[0], free, z), upright=True)
        return joint

    def front(
        self, low: Triple, high: Triple, material: str, *, on: str, framed: bool = True
    ) -> None:
        """Add a board whose face looks along x; framed, with a raised rim as panelled fronts have."""
        if not framed:
            self.box(low, high, material, on=on)
            return
        rim, face = 0.055, high[0] - 0.005
        self.box(low, (face, high[1], high[2]), material, on=on)
        for y0, y1 in ((low[1], low[1] + rim), (high[1] - rim, high[1])):
            self.box((face, y0, low[2]), (high[0], y1, high[2]), material, on=on, solid=False)
        for z0, z1 in ((low[2], low[2] + rim), (high[2] - rim, high[2])):
            a, b = (face, low[1] + rim, z0), (high[0], high[1] - rim, z1)
            self.box(a, b, material, on=on, solid=False)

    def handle(
        self,
        joint: str,
        at: Triple,
        *,
        upright: bool = False,
        length: float = 0.16,
        style: str = "",
        material: str = "metal",
    ) -> None:
        """Add the handle that the rule asks for to the front of a moving link, and its frame.

        Args:
            joint: The link, and the joint that the handle is for.
            at: Middle of the handle on the front face [m].
            upright: Whether a bar stands upright.
            length: Of a bar [m].
            style: `bar` or `knob`; as the rule says if empty.
            material: Its colour.
        """
        x, y, z = at
        style = style or self.rules.choice("cupboard_handle")
        if style == "knob":
            self.rod((x, y, z), (x + 0.012, y, z), 0.006, material, on=joint)
            tip = x + KNOB_REACH
            self.rod((x + 0.010, y, z), (tip, y, z), 0.015, material, on=joint, solid=True)
        else:
            half, tip, thick = 0.5 * length, x + BAR_REACH, 0.010
            dy, dz = (0.006, half) if upright else (half, 0.006)
            low, high = (tip - thick, y - dy, z - dz), (tip, y + dy, z + dz)
            self.box(low, high, material, on=joint)
            for side in (-1, 1):
                py, pz = (y, z + side * (half - 0.02)) if upright else (y + side * (half - 0.02), z)
                a, b = (x, py - 0.005, pz - 0.005), (tip - thick, py + 0.005, pz + 0.005)
                self.box(a, b, material, on=joint, solid=False)
        note = f"{style} of {joint}"
        self.frames[f"handle_{joint}"] = Frame((tip - 0.005, y, z), note=note)

    def drawer(
        self,
        joint: str,
        low: Triple,
        high: Triple,
        material: str,
        *,
        inside: float,
        reach: float,
        inner: str = "trim",
        framed: bool = False,
    ) -> str:
        """Hang a drawer, and return its link.

        Args:
            joint: Name of its slide.
            low: Lowest corner of its front [m].
            high: Highest corner of its front [m].
            material: Of the front.
            inside: Depth of its box behind the front [m].
            reach: How far it pulls out [m].
            inner: Colour of its box.
            framed: Whether the front is panelled.
        """
        self.hang(joint, "prismatic", low, (1.0, 0.0, 0.0), reach, damping=12.0)
        a, b = (low[0], low[1] + GAP, low[2] + GAP), (high[0], high[1] - GAP, high[2] - GAP)
        self.front(a, b, material, on=joint, framed=framed)
        back, wall = low[0] - inside, 0.012
        y0, y1 = low[1] + 0.025, high[1] - 0.025
        z0, z1 = low[2] + 0.02, max(low[2] + 0.07, high[2] - 0.06)
        self.box((back, y0, z0), (low[0], y1, z0 + wall), inner, on=joint)
        self.box((back, y0, z0), (low[0], y0 + wall, z1), inner, on=joint)
        self.box((back, y1 - wall, z0), (low[0], y1, z1), inner, on=joint)
        self.box((back, y0, z0), (back + wall, y1, z1), inner, on=joint)
        middle = 0.5 * (low[1] + high[1])
        z = 0.5 * (low[2] + high[2]) if high[2] - low[2] < 0.25 else high[2] - 0.07
        self.handle(joint, (high[0], middle, z), length=min(0.3, 0.5 * (high[1] - low[1])))
        return joint

    def frame(self, name: str, position: Triple, *, yaw_deg: float = 0.0, note: str = "") -> None:
        """Name a place."""
        self.frames[name] = Frame(position, (0.0, 0.0, yaw_deg), note)

    def piece(
        self,
        footprint: Rectangle,
        height: float,
        *,
        zones: tuple[Zone, ...] = (),
        measures: Mapping[str, float] | None = None,
        knee: tuple[Rectangle, ...] = (),
        blocks: bool = True,
    ) -> Piece:
        """Return the piece as it is now."""
        links = {name: part.link() for name, part in self._parts.items()}
        model = Model(
            self.kind,
            "common sizes, from memory, where the rules of accessibility give none",
            links,
            materials=self.setting.palette.materials(),
            joints=dict(self.joints),
        )
        return Piece(
            self.kind,
            model,
            footprint,
            height,
            zones,
            dict(self.frames),
            dict(measures or {}),
            knee,
            blocks,
        )


def wall_strip(depth: float, width: float) -> Rectangle:
    """Return the floor from the wall to `depth` [m], `width` [m] wide about the middle."""
    return Rectangle(0.0, -0.5 * width, depth, 0.5 * width)


def front_zone(depth: float, width: float, reach: float, why: str = "use") -> Zone:
    """Return the floor in front of a piece as wide as it is, up to `reach` [m] from its front."""
    return Zone(Rectangle(depth, -0.5 * width, depth + reach, 0.5 * width), why)


def _less(point: Triple, origin: Triple) -> Triple:
    return point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]


def _edges(shape: Shape) -> Triple:
    """Return the edges of the box in whose place a solid shape is weighed."""
    if shape.kind == "box":
        return shape.size
    if shape.kind == "sphere":
        edge = shape.radius * (4 * math.pi / 3) ** (1 / 3)
        return edge, edge, edge
    side, span = shape.radius * math.sqrt(math.pi), shape.span()
    if not shape.points:
        return side, side, span
    along = [abs(b - a) for a, b in zip(*shape.points, strict=True)]
    axis = along.index(max(along))  # rods of furniture run close to an axis
    edges = [side, side, side]
    edges[axis] = span
    return edges[0], edges[1], edges[2]


__all__ = ["BAR_REACH", "GAP", "OPEN", "ROOT", "Assembly", "front_zone", "wall_strip"]
