"""Faces and boxes of a building, gathered by colour."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from rcare_marl.model.shape import ZERO, Shape, Triple
from rcare_marl.model.urdf import Link, Model
from rcare_marl.pose import Pose, rpy_from_matrix

from ..rectangle import Rectangle
from .palette import Palette, Rgba

Axis = Literal["x", "y"]
Span = tuple[float, float]


class Canvas:
    """What is built of a house that stands still: faces for the eye, boxes to run into.

    Attributes:
        visual: Shapes for the eye, without the faces.
        solids: Shapes to collide with.
    """

    def __init__(self) -> None:
        self.visual: list[Shape] = []
        self.solids: list[Shape] = []
        self._faces: dict[str, list[Triple]] = {}

    def face(self, material: str, corners: Sequence[Triple]) -> None:
        """Add a four-sided face; its corners go anticlockwise as seen from outside [m]."""
        self._faces.setdefault(material, []).extend(corners)

    def level(self, material: str, area: Rectangle, z: float, *, up: bool = True) -> None:
        """Add a level face at height `z` [m] that looks up, or down."""
        corners = [
            (area.x0, area.y0, z),
            (area.x1, area.y0, z),
            (area.x1, area.y1, z),
            (area.x0, area.y1, z),
        ]
        self.face(material, corners if up else corners[::-1])

    def upright(
        self, material: str, axis: Axis, at: float, along: Span, high: Span, sign: int
    ) -> None:
        """Add an upright face.

        Args:
            material: Name of its colour.
            axis: Direction in which it runs.
            at: Where it is across that direction [m].
            along: Where it begins and ends along it [m].
            high: Its lower and upper edge [m].
            sign: 1 if it looks where the other coordinate grows, or -1.
        """
        (a, b), (low, top) = along, high
        corners: list[Triple] = [
            (s, at, z) if axis == "x" else (at, s, z)
            for s, z in ((a, low), (b, low), (b, top), (a, top))
        ]
        is_forward = (axis == "x") == (sign < 0)
        self.face(material, corners if is_forward else corners[::-1])

    def box(
        self,
        material: str,
        area: Rectangle,
        high: Span,
        *,
        solid: bool = False,
        bevel: float = 0.0,
        pose: Pose | None = None,
    ) -> None:
        """Add a box over `area`, from its lower to its upper edge [m]; given in `pose`, if any.

        An empty material makes it invisible.
        """
        size = (area.width, area.depth, high[1] - high[0])
        at = (*area.centre, 0.5 * (high[0] + high[1]))
        rpy: Triple = ZERO
        if pose is not None:
            place = pose @ Pose(at)
            at = (place.position[0], place.position[1], place.position[2])
            rpy = rpy_from_matrix(place.matrix()[:3, :3])
        if material:
            self.visual.append(
                Shape(kind="box", material=material, at=at, rpy=rpy, size=size, bevel=bevel)
            )
        if solid:
            self.solids.append(Shape(kind="box", at=at, rpy=rpy, size=size))

    def model(self, name: str, palette: Palette, tones: Mapping[str, Rgba] | None = None) -> Model:
        """Return all of it as one link; `tones` are colours beside those of the palette."""
        faces = [
            Shape(kind="quads", material=material, points=tuple(corners))
            for material, corners in self._faces.items()
        ]
        link = Link(visual=(*faces, *self.visual), collision=tuple(self.solids))
        return Model(
            name=name,
            source="a plan by rule; sizes of parts from memory",
            links={name: link},
            materials=palette.materials() | {k: tuple(v) for k, v in (tones or {}).items()},
        )


def shade(colour: Rgba, factor: float) -> Rgba:
    """Return a colour made lighter or darker by a factor."""
    r, g, b, a = colour
    return (min(factor * r, 1.0), min(factor * g, 1.0), min(factor * b, 1.0), a)
