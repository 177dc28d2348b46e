"""What furniture a kind of room gets, and where it likes to stand; from `assets/furnishing`."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

from rcare_marl import assets
from rcare_marl.config import load

from .plan import Room
from .rule import LEVELS

Spot = Literal["wall", "corner", "middle", "beside", "before", "around", "on_wall", "under"]
Preference = Literal["far", "near", "window", "no_window", "corner", "centre", "facing"]


@dataclass(frozen=True)
class Entry:
    """One kind of furniture in a room.

    Attributes:
        piece: Kind of the piece.
        at: Where it goes: against a `wall` or in a `corner`, in the `middle` of the room, `beside` or
            `before` a piece of the kind `to`, `around` it at its frames `place_1`, ..., `under` it,
            or `on_wall`, where no floor is needed.
        to: The kind of piece that `at` speaks of.
        unless: Kind of piece in whose stead it comes: it stays out of rooms that get one of those.
        count: How many, where the house does not say in the options of a room; 0 for only there.
        required: Whether the room is no such room without it.
        options: Options of the maker.
        fit: Options to try in turn, the best first.
        levels: Levels at which it is there.
        area: Least and greatest area of the rooms that get it [m²].
        prefer: What makes one place better than another: `far` from doors or `near` them, at a
            `window` or at `no_window`, in a `corner`, at the `centre` of the wall or room, `facing` the
            piece `to`.
        gap: Distance to the piece `to` [m].
    """

    piece: str
    at: Spot = "wall"
    to: str = ""
    unless: str = ""
    count: int = 1
    required: bool = False
    options: dict[str, Any] = field(default_factory=dict)
    fit: tuple[dict[str, Any], ...] = ({},)
    levels: tuple[int, ...] = LEVELS
    area: tuple[float, float] = (0.0, 1000.0)
    prefer: tuple[Preference, ...] = ()
    gap: float = 0.02

    def __post_init__(self) -> None:
        needs = self.at in ("beside", "before", "around", "under") or "facing" in self.prefer
        if needs and not self.to:
            raise ValueError(f"{self.piece!r} goes {self.at!r}, or is facing, and needs `to`")


@dataclass(frozen=True)
class Recipe:
    """What a room gets.

    Attributes:
        pieces: In the order of placing, what matters first.
        turning: Whether the rule `turning_diameter` holds for the room.
        source: Where it is from.
    """

    pieces: tuple[Entry, ...]
    turning: bool = False
    source: str = "own choice"

    def wanted(self, room: Room, level: int) -> tuple[tuple[Entry, int], ...]:
        """Return what a room is to get at a level, and how many of each."""
        area = room.inside.area
        counts = [
            (entry, int(str(room.options.get(entry.piece, entry.count))))
            for entry in self.pieces
            if level in entry.levels and entry.area[0] <= area <= entry.area[1]
        ]
        there = {entry.piece for entry, count in counts if count}
        return tuple((e, count) for e, count in counts if count and e.unless not in there)


@lru_cache(maxsize=64)
def recipe_for(use: str) -> Recipe:
    """Return what rooms of a use get; UnknownNameError if there is no such use."""
    return load(Recipe, assets.find("furnishing", use))
