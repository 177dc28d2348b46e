"""Where windows go: in the middle of outer walls, clear of doors."""

from __future__ import annotations

from dataclasses import dataclass

from rcare_marl.errors import ConfigError

from .layout_door import Place
from .layout_wall import Masonry, Panel
from .plan import OUTSIDE, Opening

LIVED_IN = ("bedroom", "living", "lounge", "kitchen", "dining")
_MARGIN = 300  # [mm] of wall beside a window
_APART = 900  # [mm] of wall between two windows


@dataclass(frozen=True)
class Sash:
    """Windows of a kind of room: widest and narrowest [mm], sill and head [m]; own choice."""

    widest: int
    narrowest: int
    sill: float
    head: float = 2.1


_SASHES = {
    "bedroom": Sash(1500, 700, 0.85),
    "living": Sash(2200, 900, 0.55),
    "lounge": Sash(1900, 800, 0.65),
    "dining": Sash(1800, 800, 0.75),
    "kitchen": Sash(1300, 700, 1.15),
    "bathroom": Sash(600, 450, 1.55),
    "sunroom": Sash(2400, 700, 0.45, 2.2),
    "hall": Sash(700, 450, 1.1),
    "entry": Sash(600, 400, 1.1),
    "laundry": Sash(700, 450, 1.35),
    "closet": Sash(500, 450, 1.6),
    "pantry": Sash(500, 450, 1.6),
}
_ELSE = Sash(1300, 600, 0.95)


def set_windows(
    masonry: Masonry, uses: dict[str, str], doors: list[Place], only: dict[str, tuple[str, ...]]
) -> list[Opening]:
    """Return windows for all rooms with outer walls.

    Args:
        masonry: Walls.
        uses: What rooms are for, by name.
        doors: Doors in their places.
        only: The sides of some rooms on which their windows are.

    Raises:
        ConfigError: If a room to live in gets no window.
    """
    out: list[Opening] = []
    for room, use in uses.items():
        sash, before = _SASHES.get(use, _ELSE), len(out)
        panels = [p for p in masonry.panels if p.rooms == (room, OUTSIDE)]
        if room in only:
            panels = [p for p in panels if p.side in only[room]]
        elif use in ("bathroom", "closet", "pantry", "laundry"):
            panels = sorted(panels, key=lambda p: p.span[0] - p.span[1])[:1]
        elif use == "hall":  # lit from its ends
            panels = [p for p in panels if p.span[1] - p.span[0] <= 2000]
        for panel in panels:
            for low, high in _free(panel, doors):
                for start, width in _fit(low, high, sash):
                    ends, name = (start, start + width), f"window_{len(out) + 1}"
                    out.append(panel.opening(name, "window", *ends, sill=sash.sill, head=sash.head))
        if use in LIVED_IN and len(out) == before:
            raise ConfigError(f"{room} has no outer wall for a window")
    return out


def _free(panel: Panel, doors: list[Place]) -> list[tuple[int, int]]:
    """Return stretches [mm] of an outer wall where no door and no open leaf is."""
    low, high = panel.span
    taken = []
    for door in doors:
        if door.run.area.overlaps(panel.area):
            taken.append((door.low - _MARGIN, door.high + _MARGIN))
        leaf = door.leaf
        if leaf is not None and leaf.overlaps(panel.area.grown(250)):
            taken.append(leaf.span(panel.axis))
    out, start = [], low
    for a, b in sorted(taken):
        if b <= low or a >= high:
            continue
        if a > start:
            out.append((start, a))
        start = max(start, b)
    if start < high:
        out.append((start, high))
    return out


def _fit(low: int, high: int, sash: Sash) -> list[tuple[int, int]]:
    """Return starts and widths of windows in a stretch of wall [mm]: one, or two in a long one."""
    length = high - low
    if length >= 2 * sash.widest + 2 * _MARGIN + _APART and sash.widest >= 1800:
        step = length // 2
        return [(low + k * step + (step - sash.widest) // 2, sash.widest) for k in range(2)]
    width = min(sash.widest, (length - 2 * _MARGIN) // 50 * 50)
    return [(low + (length - width) // 2, width)] if width >= sash.narrowest else []
