"""The outline of a house, as few rectangles that overlap."""

from __future__ import annotations

from collections.abc import Iterable

from ..rectangle import Rectangle


def maximal(areas: Iterable[Rectangle]) -> tuple[Rectangle, ...]:
    """Return the widest and the deepest rectangle over each of some that touch; they may overlap."""
    parts = tuple(areas)
    found: list[Rectangle] = []
    for part in parts:
        for first in ("x", "y"):
            grown = part
            for axis in (first, "y" if first == "x" else "x"):
                grown = _stretched(grown, axis, parts)
            if not any(other.contains(grown, by=1e-6) for other in found):
                found = [other for other in found if not grown.contains(other, by=1e-6)]
                found.append(grown)
    return tuple(found)


def _stretched(area: Rectangle, axis: str, parts: tuple[Rectangle, ...]) -> Rectangle:
    """Return a rectangle made as long along an axis as the parts together cover it."""
    edges = sorted({edge for part in parts for edge in part.span(axis)})
    start, end = area.span(axis)
    best, across = area, area.span("y" if axis == "x" else "x")
    for low in edges:
        for high in edges:
            if low <= start and end <= high:
                tried = Rectangle.of(axis, (low, high), across)
                if tried.area > best.area and _covers(parts, tried):
                    best = tried
    return best


def _covers(parts: tuple[Rectangle, ...], area: Rectangle) -> bool:
    """Return whether rectangles without overlap cover an area."""
    covered = 0.0
    for part in parts:
        width = min(part.x1, area.x1) - max(part.x0, area.x0)
        depth = min(part.y1, area.y1) - max(part.y0, area.y0)
        covered += max(width, 0.0) * max(depth, 0.0)
    return covered > area.area - 1e-6
