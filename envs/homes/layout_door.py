"""Where doors go: beside corners, opening against walls, out of each other's way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from rcare_marl.errors import ConfigError

from .layout_tree import Cell
from .layout_wall import Masonry, Panel, Run
from .plan import DOOR_HEIGHT, HINGED_LOSS, JAMB, OUTSIDE, SLIDING_LOSS, Opening
from .rule import Rules

# Lengths in mm, own choice.
CORNER = 100  # from the hinges to the corner, so that the handle does not strike the wall
BETWEEN = 100  # wall that is left between two openings
FRONT = 400  # in front of an opening, where no leaf may swing
LEAF_ROOM = 60  # on each side of the line on which a leaf stands open
WIDEST_PASSAGE = 2400
KITCHEN_PASSAGE = 1400
POCKET_SPARE = 50  # that a pocket is longer than the gap
PASSAGE_HEAD = 2.2  # [m]
_TRIES = 200_000
# Doors swing into the later of the two.
_SWINGS_INTO = ("hall", "entry", "living", "lounge", "dining", "kitchen", "sunroom")
_SWINGS_LAST = ("bedroom", "bathroom")
_SWINGS_OUT_OF = ("closet", "pantry")


DoorKind = Literal["door", "entrance", "passage"]


@dataclass(frozen=True)
class DoorConfig:
    """A door or passage that a house wants.

    Attributes:
        between: The two rooms; for entrances a room and the side of it, such as `south`.
        at: Which end of the wall between them it is at, if it matters; `low` is west or south.
        into: The room that it swings into, if it matters.
        width: Of a passage [m].
    """

    between: tuple[str, str]
    at: Literal["", "low", "middle", "high"] = ""
    into: str = ""
    width: float | None = None

    def __post_init__(self) -> None:
        if self.into and self.into not in self.between:
            raise ConfigError(f"a door between {self.between} cannot swing into {self.into}")
        if self.width is not None and not 0.6 <= self.width <= 6:
            raise ConfigError(f"width of a passage must be within 0.6 and 6 m, got {self.width}")


@dataclass(frozen=True)
class Request:
    """A door to be placed: its name and kind, what is wanted, and the wall for it."""

    name: str
    kind: DoorKind
    wish: DoorConfig
    panels: tuple[Panel, ...]
    into: str


@dataclass(frozen=True)
class Place:
    """A door in its place [mm]: its gap, the wall that it takes, where its leaf swings.

    No leaf swings within `FRONT` of it, nor stands open within `ahead`, so that one gets to it.
    """

    request: Request
    panel: Panel
    run: Run
    low: int
    high: int
    taken: tuple[int, int]
    hinge: Literal["low", "high"]
    hardware: str
    sweep: Cell | None
    cost: float
    ahead: int = FRONT

    @property
    def leaf(self) -> Cell | None:
        """Where the leaf stands when it is open at a right angle; None for what does not swing."""
        if self.sweep is None:
            return None
        axis = self.panel.axis
        at = self.sweep.span(axis)[self.hinge == "high"]
        return Cell.of(axis, (at - LEAF_ROOM, at + LEAF_ROOM), self.sweep.across(axis))

    def meets(self, other: Place) -> bool:
        """Return whether the two are in each other's way."""
        if self.run == other.run:
            (a, b), (c, d) = self.taken, other.taken
            if min(b, d) > max(a, c) - BETWEEN:
                return True
        for door, before in ((self, other), (other, self)):
            if door.leaf and any(door.leaf.overlaps(area) for area in before._fronts(before.ahead)):
                return True
        fronts, sweeps = (self._fronts(FRONT), other._fronts(FRONT)), (self.sweep, other.sweep)
        if sweeps[0] and sweeps[1] and sweeps[0].overlaps(sweeps[1]):
            return True
        return any(
            sweep is not None and any(sweep.overlaps(front) for front in front_set)
            for sweep, front_set in zip(sweeps, fronts[::-1], strict=True)
        )

    def _fronts(self, depth: int) -> tuple[Cell, Cell]:
        axis, gap = self.panel.axis, (self.low, self.high)
        near, far = self.panel.area.across(axis)
        return Cell.of(axis, gap, (near - depth, near)), Cell.of(axis, gap, (far, far + depth))


class Joiner:
    """Finds a place for each door."""

    def __init__(self, masonry: Masonry, uses: dict[str, str], rules: Rules) -> None:
        self._masonry, self._uses, self._rules = masonry, uses, rules
        self._ahead = round(1000 * rules.figure("passage_width"))
        self._deepest, self._tries = 0, 0

    def request(self, name: str, kind: DoorKind, wish: DoorConfig) -> Request:
        """Return a request for a door.

        Raises:
            ConfigError: If the two rooms do not touch, or the room has no outer wall on that side.
        """
        a, b = wish.between
        if kind == "entrance":
            found = [p for p in self._masonry.panels if p.rooms == (a, OUTSIDE) and p.side == b]
            if not found:
                raise ConfigError(f"{a} has no outer wall in the {b} for an entrance")
            return Request(name, kind, wish, tuple(found), a)
        found = [p for p in self._masonry.panels if set(p.rooms) == {a, b}]
        if not found:
            raise ConfigError(f"{a} and {b} do not touch, so there can be no {kind} between them")
        return Request(name, kind, wish, tuple(found), wish.into or self._swings_into(a, b))

    def place(self, requests: list[Request]) -> list[Place]:
        """Return a place for each request, in the same order, none in the way of another.

        Raises:
            ConfigError: If there is no room for a door, or not for all together.
        """
        choices = {}
        for request in requests:
            choices[request.name] = sorted(self._candidates(request), key=lambda c: (c.cost, c.low))
            if not choices[request.name]:
                longest = max(panel.span[1] - panel.span[0] for panel in request.panels) / 1000
                raise ConfigError(
                    f"no room for a {request.kind} between {' and '.join(request.wish.between)} at level "
                    f"{self._rules.level}: they share {longest:.2f} m of wall"
                )
        order = sorted(requests, key=lambda r: (len(choices[r.name]), r.name))
        self._deepest, self._tries = 0, 0
        chosen = self._search([choices[request.name] for request in order], ())
        if chosen is None:
            stuck = order[self._deepest].wish.between
            raise ConfigError(
                f"doors are in each other's way at level {self._rules.level}, last that between "
                f"{' and '.join(stuck)}"
            )
        found = {place.request.name: place for place in chosen}
        return [found[request.name] for request in requests]

    def _search(
        self, choices: list[list[Place]], chosen: tuple[Place, ...]
    ) -> tuple[Place, ...] | None:
        if len(chosen) == len(choices):
            return chosen
        self._deepest = max(self._deepest, len(chosen))
        for place in choices[len(chosen)]:
            self._tries += 1
            if self._tries > _TRIES:
                return None
            if not any(place.meets(other) for other in chosen):
                out = self._search(choices, (*chosen, place))
                if out is not None:
                    return out
        return None

    def _swings_into(self, a: str, b: str) -> str:
        def rank(room: str) -> int:
            use = self._uses[room]
            if use in _SWINGS_OUT_OF:
                return -1
            if use in _SWINGS_LAST:
                return 20 + _SWINGS_LAST.index(use)
            return _SWINGS_INTO.index(use) if use in _SWINGS_INTO else 10

        ranks = rank(a), rank(b)
        if "hall" in (self._uses[a], self._uses[b]):  # never into a hall
            return b if self._uses[a] == "hall" else a
        return a if ranks[0] > ranks[1] else b

    def _candidates(self, request: Request) -> Iterator[Place]:
        for panel in request.panels:
            run = self._masonry.run_of(panel)
            if request.kind == "passage":
                yield from self._passages(request, panel, run)
            else:
                yield from self._doors(request, panel, run)

    def _passages(self, request: Request, panel: Panel, run: Run) -> Iterator[Place]:
        low, high = panel.span
        length = high - low
        is_kitchen = "kitchen" in (self._uses[room] for room in request.wish.between)
        widest = KITCHEN_PASSAGE if is_kitchen else WIDEST_PASSAGE  # cupboards need walls
        width = min(length - 300, widest) if length > 1500 else length
        if request.wish.width is not None:
            width = min(width, round(1000 * request.wish.width))
        if width < 1000 * self._rules.figure("passage_width"):
            return
        spots = {
            "middle": low + (length - width) // 2,
            "low": low + 150,
            "high": high - 150 - width,
        }
        for cost, (name, start) in enumerate(spots.items()):
            if low <= start and start + width <= high and request.wish.at in ("", name):
                taken = start, start + width
                yield Place(request, panel, run, *taken, taken, "low", "", None, cost, self._ahead)

    def _doors(self, request: Request, panel: Panel, run: Run) -> Iterator[Place]:
        hardware = self._rules.choice("door_hardware")
        if request.kind == "entrance" and hardware == "slider":
            hardware = "lever"
        width = self._width(request, hardware)
        low, high = panel.span
        last = high - width
        if last < low:
            return
        spare = min(CORNER, (last - low) // 2)
        starts = {low + spare, last - spare, (low + last) // 2}
        starts |= {low + (last - low) * k // 8 for k in range(1, 8)}
        for start in sorted(starts):
            for hinge in ("low", "high"):
                place = self._door(request, panel, run, (start, start + width), hinge, hardware)
                if place is not None:
                    yield place

    def _door(
        self,
        request: Request,
        panel: Panel,
        run: Run,
        gap: tuple[int, int],
        hinge: Literal["low", "high"],
        hardware: str,
    ) -> Place | None:
        """Return a door in a place, or None if it does not fit there."""
        inside = self._masonry.insides[request.into]
        ends, width = inside.span(panel.axis), gap[1] - gap[0]
        cost = self._away(request.wish.at, panel.span, gap)
        if hardware == "slider":
            reach = width + POCKET_SPARE
            taken = (gap[0] - reach, gap[1]) if hinge == "low" else (gap[0], gap[1] + reach)
            whole = run.area.span(panel.axis)
            if taken[0] < whole[0] or taken[1] > whole[1]:
                return None
            # A pocket along the same two rooms costs no third room a wall to hang things on.
            beside = taken[0] >= panel.span[0] and taken[1] <= panel.span[1]
            cost += min(abs(gap[0] - ends[0]), abs(ends[1] - gap[1])) / 1000 + (
                0 if beside else 0.5
            )
            return Place(request, panel, run, *gap, taken, hinge, hardware, None, cost, self._ahead)
        side = gap[0] - ends[0] if hinge == "low" else ends[1] - gap[1]
        latch = ends[1] - gap[1] if hinge == "low" else gap[0] - ends[0]
        if latch < 1000 * self._rules.figure("latch_side_space") or side < 0:
            return None
        sweep = _sweep(panel, inside, gap, hinge)
        if sweep is None:
            return None
        # A leaf that opens against no wall stands in the room.
        cost += side / 1000 + (0 if side < 400 else 1.0) + (0 if side >= CORNER else 0.3)
        return Place(request, panel, run, *gap, gap, hinge, hardware, sweep, cost, self._ahead)

    def _away(self, at: str, ends: tuple[int, int], gap: tuple[int, int]) -> float:
        """How far a gap is from where it is wanted; counts ten times [m]."""
        off = {
            "low": gap[0] - ends[0],
            "high": ends[1] - gap[1],
            "middle": abs(gap[0] + gap[1] - ends[0] - ends[1]) / 2,
        }
        return off[at] / 100 if at else 0.0

    def _width(self, request: Request, hardware: str) -> int:
        uses = {self._uses[room] for room in request.wish.between if room in self._uses}
        rule = "bathroom_door_clear_width" if "bathroom" in uses else "door_clear_width"
        if request.kind == "entrance":
            rule = "entrance_clear_width"
        return round(
            1000
            * (self._rules.figure(rule) + (SLIDING_LOSS if hardware == "slider" else HINGED_LOSS))
        )

    def opening(self, place: Place) -> Opening:
        """Return the opening that a place stands for."""
        request, panel = place.request, place.panel
        normal, rooms = panel.normal, panel.rooms
        if request.into == rooms[1]:
            normal, rooms = (-normal[0], -normal[1]), (rooms[1], rooms[0])
        uses = {self._uses[room] for room in rooms if room in self._uses}
        rule = "bathroom_threshold" if "bathroom" in uses else "door_threshold"
        if request.kind == "entrance":
            rule = "entrance_threshold"
        is_passage = request.kind == "passage"
        return panel.opening(
            request.name,
            request.kind,
            place.low,
            place.high,
            rooms=rooms,
            head=PASSAGE_HEAD if is_passage else DOOR_HEIGHT,
            hardware=place.hardware,
            hinge=place.hinge,
            threshold=0.0 if is_passage else self._rules.figure(rule),
            normal=normal,
        )


def _sweep(panel: Panel, inside: Cell, gap: tuple[int, int], hinge: str) -> Cell | None:
    """Return the square that a leaf sweeps in a room, or None if it would strike the far wall."""
    jamb, axis = round(1000 * JAMB), panel.axis
    low, high = gap[0] + jamb, gap[1] - jamb
    (near, far), (start, end) = panel.area.across(axis), inside.across(axis)
    across = (far, far + high - low) if start >= far else (near - high + low, near)
    return Cell.of(axis, (low, high), across) if start <= across[0] and across[1] <= end else None
