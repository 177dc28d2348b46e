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
    edges = {e for p in parts for e in ((p.x0, p.x1) if axis == "x" else (p.y0, p.y1))}
    best = area
    for low in sorted(edges):
        for high in sorted(edges):
            if axis == "x":
                if low > area.x0 or high < area.x1:
                    continue
                tried = Rectangle(low, area.y0, high, area.y1)
            else:
                if low > area.y0 or high < area.y1:
                    continue
                tried = Rectangle(area.x0, low, area.x1, high)
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
