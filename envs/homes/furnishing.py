"""Puts furniture into a room: against walls, clear of doors and windows, with ways left free."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose

from ..rectangle import Rectangle
from .doorway import doorway, gate, narrowing, off_switch
from .ground import Gate, Ground
from .occupancy import Mask
from .piece import Piece, Setting, make_piece
from .plan import Plan, Room
from .recipe import Entry, Recipe, recipe_for
from .route import HAND_ROOM, WHEELCHAIR_WIDTH

TO_WALL = 0.005  # [m] between a back and its wall; own choice
STEP = 0.05  # [m] between the places that are tried along a wall; own choice
CHAIR = WHEELCHAIR_WIDTH + HAND_ROOM  # [m] that wheelchairs need
SPARE = 0.003  # [m] by which ways and circles are wider than the rules ask: what `Ground` may err, and 1 mm
ATTEMPTS = 24  # with other chances, until everything that is required stands
TRIALS = 12  # best places of a piece that are tried
OVER_SILL = (
    0.35  # [m] that a back may rise over the sill of the window that it stands before; own choice
)
HIGH_SILL = 1.4  # [m]; before windows with sills as high as that anything may stand; own choice
LEAN = 0.05  # [m] by which a piece reaches farther to one side to belong to the wall there
LEFT = {(1, 0): (0, 1), (0, 1): (-1, 0), (-1, 0): (0, -1), (0, -1): (1, 0)}  # of who looks there
AMID = 12  # attempts after which what found no wall may stand in the middle of the room
QUARTERS = (0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)
APART = 0.3  # [m] between two things that hang on a wall; own choice
ELBOW = 0.05  # [m] round a switch where nothing else is; own choice
WINDOW_REACH = 0.35  # [m] before a window in which nothing higher than its sill stands


@dataclass(frozen=True)
class Placed:
    """A piece of furniture in its place.

    Attributes:
        name: Room, kind and number, such as `bedroom_2.bed`.
        piece: The piece.
        room: Name of the room.
        pose: Of its frame in the house.
    """

    name: str
    piece: Piece
    room: str
    pose: Pose

    @cached_property
    def footprint(self) -> Rectangle:
        """The floor that it covers, in the house [m]."""
        return self.piece.footprint.moved(self.pose)

    @cached_property
    def wheel_footprint(self) -> tuple[Rectangle, ...]:
        """What is left of it for a wheelchair, which reaches under what has room for knees [m]."""
        areas = [self.footprint]
        for knee in self.piece.knee:
            areas = [p for area in areas for p in area.without(knee.moved(self.pose))]
        return tuple(areas)

    @cached_property
    def stands(self) -> tuple[Rectangle, ...]:
        """The floor that it needs where there is room for a wheelchair, in the house [m]."""
        areas = [zone.area for zone in self.piece.zones if zone.why == "use"]
        wide = [area for area in areas if min(area.width, area.depth) >= CHAIR]
        return tuple(area.moved(self.pose) for area in wide)

    def frame(self, name: str) -> Pose:
        """Return the pose of one of its frames in the house."""
        return self.pose @ self.piece.frames[name].pose


def furnish(
    plan: Plan, room: Room, setting: Setting, made: dict[str, Piece] | None = None
) -> tuple[Placed, ...]:
    """Return the furniture of a room; the same for the same house, level and room.

    Args:
        plan: Of the house.
        room: One of its rooms.
        setting: What furniture is made for.
        made: What was made for other rooms with the same setting, to be used again and added to.

    Raises:
        ConfigError: If something that the room must have finds no place.
    """
    recipe = recipe_for(room.use)
    missing: list[str] = []
    made = {} if made is None else made
    for attempt in range(ATTEMPTS):
        seed = zlib.crc32(f"{plan.name}/{room.name}/{attempt}".encode())
        furnisher = _Furnisher(
            plan, room, setting, recipe, attempt, made, np.random.default_rng(seed)
        )
        missing = furnisher.run()
        if not missing:
            furnisher.put_switch()
            return tuple(furnisher.standing)
    inside = room.inside
    raise ConfigError(
        f"{room.name!r} of {plan.name!r}, {inside.width:.2f} x {inside.depth:.2f} m, has no place for "
        f"{', '.join(missing)} at level {setting.rules.level}"
    )


class _Furnisher:
    """One try at a room; all areas in the house."""

    def __init__(
        self,
        plan: Plan,
        room: Room,
        setting: Setting,
        recipe: Recipe,
        attempt: int,
        made: dict[str, Piece],
        rng: np.random.Generator,
    ) -> None:
        self.room, self.leaves, self.keep_free = room, list[Rectangle](), list[Rectangle]()
        self.windows, self.gates = list[tuple[Rectangle, float]](), list[Gate]()
        self.standing: list[Placed] = []
        self._plan, self._attempt, self._made = plan, attempt, made
        self._setting, self._recipe, self._rng = setting, recipe, rng
        self._passage = setting.rules.figure("passage_width")
        for opening in plan.openings_of(room.name):
            if opening.kind == "window":
                near = 0.5 * opening.thickness
                half = 0.5 * opening.width
                side = 1.0 if opening.rooms[0] == room.name else -1.0
                low, high = sorted((side * near, side * (near + WINDOW_REACH)))
                area = Rectangle(-half, low, half, high).moved(opening.pose)
                self.windows.append((area, opening.sill))
            else:
                self.keep_free += doorway(opening, room.name, setting.rules)
                self.gates.append(gate(opening, room.name))
                self._passage = min(self._passage, opening.clear_width - SPARE)
                self.leaves += narrowing(opening)

    def run(self) -> list[str]:
        """Furnish; return what is required and found no place."""
        missing = []
        for entry, count in self._recipe.wanted(self.room, self._setting.rules.level):
            for _ in range(count):
                if not self._add(entry):
                    if entry.required:
                        missing.append(entry.piece)
                    break
        return missing

    def put_switch(self) -> None:
        """Hang a light switch beside a door, where nothing stands before it."""
        piece, room = self._make("light_switch", {}), self.room
        low = piece.frames["rocker"].position[2] - ELBOW
        ways = [o for o in self._plan.openings_of(room.name) if o.kind != "window"]
        taken = [p.footprint for p in self.standing if p.piece.height > low]
        taken += [*self.leaves, *(way.gap for way in ways)]
        taken += [area for area, sill in self.windows if sill < piece.height]
        poses: list[Pose] = []
        costs: list[float] = []
        for yaw in QUARTERS:
            at = self._grid(Entry(piece.kind, at="on_wall"), piece, yaw)
            area = piece.footprint.moved(_pose(0.0, 0.0, yaw)).grown(ELBOW)
            at = at[~_meets(_shifted(area, at), taken)]
            off = [off_switch(way, room.name, at) + (way.kind == "passage") for way in ways]
            costs += np.min(off, axis=0).tolist() if off else [0.0] * len(at)
            poses += [_pose(x, y, yaw) for x, y in at.tolist()]
        if poses:
            self._put(piece, poses[int(np.argmin(costs))])

    def _add(self, entry: Entry) -> bool:
        # Where all did not fit, what is large gives way to what is small.
        first = min(self._attempt // 4, len(entry.fit) - 1)
        for options in entry.fit[first:]:
            piece = self._make(entry.piece, {**entry.options, **options})
            for pose, relative in self._places(entry, piece):
                if self._is_well(piece, pose, relative):
                    self._put(piece, pose)
                    return True
        return False

    def _make(self, kind: str, options: dict[str, Any]) -> Piece:
        key = f"{kind} {sorted(options.items())}"
        if key not in self._made:
            self._made[key] = make_piece(kind, self._setting, options)
        return self._made[key]

    def _put(self, piece: Piece, pose: Pose) -> None:
        room = self.room.name
        taken = {placed.name for placed in self.standing}
        name, number = f"{room}.{piece.kind}", 1
        while name in taken:
            number += 1
            name = f"{room}.{piece.kind}_{number}"
        self.standing.append(Placed(name, piece, room, pose))

    def _places(self, entry: Entry, piece: Piece) -> Iterator[tuple[Pose, str]]:
        """Yield places to try, the best first, with the name of the piece that it belongs to."""
        related = [p for p in self.standing if p.piece.kind == entry.to]
        if entry.at in ("beside", "before", "around", "under"):
            for host in related:
                for pose in self._beside(entry, piece, host):
                    yield pose, host.name
            return
        poses: list[tuple[float, float, float]] = []
        scores: list[float] = []
        for yaw in QUARTERS:
            at = self._grid(entry, piece, yaw)
            if not len(at):
                continue
            at = at[self._fits(piece, yaw, at, "", is_high=entry.at == "on_wall")]
            poses += [(x, y, yaw) for x, y in at.tolist()]
            scores += self._scores(entry, piece, yaw, at, related).tolist()
        for i in np.argsort(-np.array(scores), kind="stable")[:TRIALS].tolist():
            x, y, yaw = poses[i]
            yield _pose(x, y, yaw), ""

    def _grid(self, entry: Entry, piece: Piece, yaw: float) -> Array:
        """Return where the origin of a piece that looks along `yaw` could be [m], shape [n, 2]."""
        inside = self.room.inside
        area = piece.footprint.moved(_pose(0.0, 0.0, yaw))
        xs = _ticks(inside.x0 - area.x0, inside.x1 - area.x1)
        ys = _ticks(inside.y0 - area.y0, inside.y1 - area.y1)
        if not len(xs) or not len(ys):
            return np.empty((0, 2))
        is_amid = entry.required and entry.at == "wall" and self._attempt >= AMID
        is_corner = entry.at == "corner" and self._attempt < AMID
        # What reaches farther to one side, such as the bars of a toilet, belongs to the wall there.
        lean = piece.footprint.y0 + piece.footprint.y1 if entry.at == "corner" else 0.0
        if entry.at in ("wall", "corner", "on_wall") and not is_amid:
            forward = (round(math.cos(yaw)), round(math.sin(yaw)))
            ends = [0, -1] if abs(lean) < LEAN else [-1 if lean * sum(LEFT[forward]) > 0 else 0]
            if forward[0]:
                xs = xs[:1] if forward[0] > 0 else xs[-1:]
                ys = ys[ends] if is_corner or len(ends) == 1 else ys
            else:
                ys = ys[:1] if forward[1] > 0 else ys[-1:]
                xs = xs[ends] if is_corner or len(ends) == 1 else xs
        else:
            xs, ys = xs[::3], ys[::3]
        grid = np.meshgrid(xs, ys)
        return np.stack([axis.ravel() for axis in grid], axis=1)

    def _fits(
        self, piece: Piece, yaw: float, at: Array, host: str, *, is_high: bool = False
    ) -> Mask:
        """Return which places are free, shape [n]; zones of the piece `host` may be stood in."""
        turn = _pose(0.0, 0.0, yaw)
        body = _shifted(piece.footprint.moved(turn), at)
        inside = self.room.inside.grown(1e-6).row
        ok: Mask = _within(body, inside)
        hidden = [
            area
            for area, sill in self.windows
            if sill < HIGH_SILL and piece.height > sill + OVER_SILL
        ]
        ok &= ~_meets(body, hidden)
        if is_high:
            return ok & ~_meets(body, self._high_things(piece))
        if not piece.blocks:
            return ok
        # A chair is pushed under its table.
        solids = [p.footprint for p in self.standing if p.piece.blocks and p.name != host]
        ok &= ~_meets(body, solids + self.keep_free)
        # Others stand where they like beside a host, such as chairs in the zone of a table.
        others = [
            zone.area.moved(p.pose)
            for p in self.standing
            if p.name != host
            for zone in p.piece.zones
        ]
        ok &= ~_meets(body, others)
        things = [
            area
            for p in self.standing
            if p.piece.blocks and p.name != host
            for area in p.wheel_footprint
        ]
        for zone in piece.zones:
            area = _shifted(zone.area.moved(turn), at)
            ok &= _within(area, inside) & ~_meets(area, things)
        return ok

    def _high_things(self, piece: Piece) -> list[Rectangle]:
        """Return what a thing on the wall must not hang in front of, or behind."""
        high = [p.footprint for p in self.standing if p.piece.height > 1.2]
        flat = [
            p.footprint.grown(APART)
            for p in self.standing
            if not p.piece.blocks and p.piece.height > 1.0
        ]
        return high + flat + [area.grown(0.1) for area in self.keep_free]

    def _scores(
        self, entry: Entry, piece: Piece, yaw: float, at: Array, related: Sequence[Placed]
    ) -> Array:
        inside = self.room.inside
        turn = _pose(0.0, 0.0, yaw)
        middle = np.array(piece.footprint.moved(turn).centre) + at
        # The later the attempt, the less wishes count against chance.
        score: Array = self._rng.uniform(0.0, 0.6 + 0.4 * self._attempt, len(at))
        doors = np.array([g.line.centre for g in self.gates] or [inside.centre])
        to_door = np.linalg.norm(middle[:, None] - doors[None], axis=2).min(axis=1)
        windows = [area for area, _ in self.windows]
        body = _shifted(piece.footprint.moved(turn), at)
        scale = max(inside.width, inside.depth)
        for wish in entry.prefer:
            if wish in ("far", "near"):
                score += (2.0 if wish == "far" else -2.0) * to_door / scale
            elif wish in ("window", "no_window"):
                score += (1.0 if wish == "window" else -1.0) * _meets(body, windows)
            elif wish == "corner":
                edges = np.hstack((middle - inside.row[:2], inside.row[2:] - middle))
                score -= 2.0 * np.sort(edges, axis=1)[:, 1] / scale
            elif wish == "centre":
                score -= 2.0 * np.abs(middle - inside.centre).sum(axis=1) / scale
            elif wish == "facing" and related:
                host = related[0].pose.matrix()
                ahead = middle - host[:2, 3]
                turned = math.cos(yaw) * host[0, 0] + math.sin(yaw) * host[1, 0]
                aside = np.abs(-host[1, 0] * ahead[:, 0] + host[0, 0] * ahead[:, 1])
                score -= 3.0 * turned + 2.0 * aside / scale
        return score

    def _beside(self, entry: Entry, piece: Piece, host: Placed) -> Iterator[Pose]:
        """Yield free places at a piece that stands already."""
        yaw = math.atan2(host.pose.matrix()[1, 0], host.pose.matrix()[0, 0])
        own, area = piece.footprint, host.piece.footprint
        local: list[tuple[float, float, float]] = []
        if entry.at == "beside":
            left, right = area.y1 + entry.gap - own.y0, area.y0 - entry.gap - own.y1
            local = [(0.0, left, 0.0), (0.0, right, 0.0)]
        elif entry.at == "before":
            turn = 0.0 if "centre" in entry.prefer else math.pi
            x = area.x1 + entry.gap + (own.x1 if turn else 0.0)
            local = [(x, dy, turn) for dy in (0.0, 0.2, -0.2)]
        elif entry.at == "under":
            x = 0.5 * (area.x0 + area.x1) - 0.5 * (own.x0 + own.x1)
            local = [(x, 0.0, 0.0)]
        for x, y, turn in local:
            pose = host.pose @ _pose(x, y, turn)
            yield from self._free_at(piece, pose, host.name, yaw + turn)
        if entry.at == "around":
            for name in sorted(host.piece.frames):
                if name.startswith("place_"):
                    pose = host.frame(name)
                    pose = Pose((pose.position[0], pose.position[1], 0.0), pose.quaternion)
                    turn = math.atan2(pose.matrix()[1, 0], pose.matrix()[0, 0])
                    yield from self._free_at(piece, pose, host.name, turn)

    def _free_at(self, piece: Piece, pose: Pose, host: str, yaw: float) -> Iterator[Pose]:
        if self._fits(piece, yaw, np.array([pose.position[:2]]), host)[0]:
            yield pose

    def _is_well(self, piece: Piece, pose: Pose, host: str) -> bool:
        """Return whether one can turn, and get from there to each door and wherever one is to stand."""
        if not piece.blocks:
            return True
        standing = [p for p in self.standing if p.piece.blocks]
        standing.append(Placed("", piece, self.room.name, pose))
        things = [area for placed in standing for area in placed.wheel_footprint]
        ground = Ground(self.room.inside, [*self.leaves, *things])
        diameter, middle = ground.circle
        if self._recipe.turning and self._setting.rules.has("turning_diameter"):
            if diameter < self._setting.rules.figure("turning_diameter") + SPARE:
                return False
        width = self._passage + SPARE
        if not ground.joins([g.place(width) for g in self.gates], middle, width):
            return False
        stands = [area for placed in standing for area in placed.stands]
        return ground.joins(stands, middle, min(CHAIR, self._passage))


def _pose(x: float, y: float, yaw: float) -> Pose:
    return Pose((x, y, 0.0), (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)))


def _ticks(low: float, high: float) -> Array:
    """Return places from one end of a room to the other [m], both ends among them."""
    low, high = low + TO_WALL, high - TO_WALL
    if high < low:
        return np.empty(0)
    return np.asarray(np.unique(np.append(np.arange(low, high, STEP), high)))


def _shifted(area: Rectangle, at: Array) -> Array:
    """Return an area at many places, shape [n, 4]."""
    return np.asarray(area.row + np.concatenate((at, at), axis=1))


def _within(areas: Array, room: Array) -> Mask:
    above, below = areas[:, :2] >= room[:2], areas[:, 2:] <= room[2:]
    return np.asarray(above.all(axis=1) & below.all(axis=1), np.bool_)


def _meets(areas: Array, others: Sequence[Rectangle]) -> Mask:
    """Return which of the areas, shape [n, 4], overlap any of the others, shape [n]."""
    if not others:
        return np.zeros(len(areas), np.bool_)
    rows = np.array([other.row for other in others])
    low = np.maximum(areas[:, None, :2], rows[None, :, :2])
    high = np.minimum(areas[:, None, 2:], rows[None, :, 2:])
    return np.asarray(((high - low) > 1e-6).all(axis=2).any(axis=1), np.bool_)
