"""Measures furniture: heights, knee room, free floor beside it, what opens it, grab bars."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Link, Model, joint_pose
from rcare_marl.pose import Pose, rotate

from ..rectangle import Rectangle
from .care_home import CareHome
from .furnishing import Placed
from .measurement import FAR, Measurement, Surroundings
from .merging import extent, link_poses
from .piece import Piece
from .plan import Room

BAR_RADIUS = (0.01, 0.03)  # [m] of what hands hold to hold themselves; own choice
BAR_LENGTH = 0.3  # [m], least
BAR_TOP = 1.2  # [m]; what is level but higher is a rail for a curtain; own choice
_LEVEL = 0.1  # most that a bar rises for its length
# From the least to the most accessible.
BATHING = ("shower_cabin", "bathtub", "bathtub_with_seat", "transfer_shower", "roll_in_shower")
KITCHEN = ("kitchen_run", "fridge", "oven_tower", "tall_cupboard")
CUPBOARDS = tuple(
    """
    bathroom_cabinet chest_of_drawers desk dresser_cabinet kitchen_run nightstand sideboard
    tall_cupboard tv_stand wardrobe washbasin
    """.split()
)
TABLES = ("desk", "dining_table", "round_table")
LIGHT = ("chair", "bin", "bath_mat", "laundry_basket")  # moved aside with a hand
# Taken from the model of the piece as it is built; all else is measured where it stands.
HEIGHTS = tuple(
    """
    basin_rim_height bath_seat_height bathtub_rim_height bed_height counter_height seat_height
    shower_depth shower_threshold shower_width switch_height table_height toilet_seat_height
    wall_cabinet_height wardrobe_rail_height
    """.split()
)
BESIDE_BED = 1.22  # [m], 48 in: ADA 305.3, length of the clear floor space of a wheelchair
BESIDE_TOILET = (0.1, 1.42)  # [m] from the wall behind it; 56 in: ADA 604.3.1
_SLICE = 0.05  # [m] in which fronts of kitchens are looked at
_CORNER = 0.08  # [m]; what stands nearer than this to a front of a kitchen is joined to it
_ARM = 0.06  # [m]; what turns a tap further out than this is a lever, else a knob; own choice
_BAR = 0.075  # [m], least length of a bar that opens a cupboard; own choice
_SLIM = 0.025  # [m], most thickness of such a bar


@dataclass(frozen=True)
class Bar:
    """A straight bar, in the frame of what it serves.

    Attributes:
        ends: Both ends of its middle line [m].
        radius: [m].
        length: Over all [m].
        folds: Whether it is on a joint.
    """

    ends: tuple[tuple[float, ...], tuple[float, ...]]
    radius: float
    length: float
    folds: bool

    @property
    def top(self) -> float:
        """Height of its top [m]."""
        return max(end[2] for end in self.ends) + self.radius

    def runs(self, axis: int) -> bool:
        """Return whether it is level and runs along an axis: 0 for x, 1 for y."""
        return abs(self.ends[1][axis] - self.ends[0][axis]) >= 0.95 * self.length - 4 * self.radius

    @property
    def is_level(self) -> bool:
        """Whether it is level."""
        return abs(self.ends[1][2] - self.ends[0][2]) <= _LEVEL * self.length


def bars(model: Model) -> Iterator[Bar]:
    """Yield the bars of a model, in its own frame; those on joints as they are unfolded.

    A bar on a joint is unfolded at that end of the joint at which it is level.
    """
    ends: dict[str, tuple[bool, tuple[Pose, ...]]] = {model.root: (False, (Pose(),))}
    for joint in model.joints.values():
        moves, parents = ends[joint.parent]
        places = (joint.lower, joint.upper) if joint.kind != "fixed" else (0.0,)
        moved = tuple(parent @ joint_pose(joint, place) for parent in parents for place in places)
        ends[joint.child] = (moves or joint.kind != "fixed", moved)
    for name, link in model.links.items():
        moves, poses = ends[name]
        for shape in link.collision:
            found = [bar for at in poses if (bar := _bar(shape, at, moves)) is not None]
            level = [bar for bar in found if bar.is_level]
            yield from (level or found)[:1]


def _bar(shape: Shape, pose: Pose, folds: bool) -> Bar | None:
    if shape.kind not in ("cylinder", "capsule"):
        return None
    span = shape.span()
    length = span + 2 * shape.radius if shape.kind == "capsule" else span
    if not BAR_RADIUS[0] <= shape.radius <= BAR_RADIUS[1] or length < BAR_LENGTH:
        return None
    at = pose @ shape.pose()
    half = rotate(at.quaternion, (0.0, 0.0, 0.5 * span))
    a = tuple(c - h for c, h in zip(at.position, half.tolist(), strict=True))
    b = tuple(c + h for c, h in zip(at.position, half.tolist(), strict=True))
    return Bar((a, b), shape.radius, length, folds)


def measure_toilet_bars(home: CareHome, toilet: Placed) -> Iterator[Measurement]:
    """Yield which grab bars a toilet has, how long, thick and high they are, and how far off the wall."""
    found = list(bars(toilet.piece.model))
    inside = home.plan.room(toilet.room).inside.moved(toilet.pose.inverse())
    fixed = [bar for bar in found if not bar.folds and bar.is_level and bar.top < BAR_TOP]
    folding = [bar for bar in found if bar.folds]
    word = "none" if not fixed else "wall_and_fold_down" if folding else "wall"
    yield Measurement("grab_bars", toilet.room, toilet.name, word)
    if word == "none":
        return
    side = [bar for bar in fixed if bar.runs(0)]
    rear = [bar for bar in fixed if bar.runs(1)]
    for rule, group in (("grab_bar_side_length", side), ("grab_bar_rear_length", rear)):
        longest = max((bar.length for bar in group), default=None)
        yield Measurement(rule, toilet.room, toilet.name, longest)
    for bar in _topmost([*side, *rear, *folding]):
        yield Measurement("grab_bar_height", toilet.room, toilet.name, bar.top)
        yield Measurement("grab_bar_diameter", toilet.room, toilet.name, 2 * bar.radius)
    for bar in (*side, *rear):
        yield Measurement("grab_bar_gap", toilet.room, toilet.name, _gap(bar, inside))


def _topmost(found: Sequence[Bar]) -> list[Bar]:
    """Return the bars without what runs below them as part of the same loop."""

    def is_under(low: Bar, high: Bar) -> bool:
        same = all(
            math.dist(a[:2], b[:2]) < 0.2
            for a, b in zip(sorted(low.ends), sorted(high.ends), strict=True)
        )
        return same and low.folds and high.folds and low.top < high.top - 1e-6

    return [bar for bar in found if not any(is_under(bar, other) for other in found)]


def _gap(bar: Bar, inside: Rectangle) -> float:
    """Return the gap between a bar and the wall behind it, in a frame whose walls bound `inside` [m]."""
    (x, y), r = bar.ends[0][:2], bar.radius
    if bar.runs(1):
        return x - r - inside.x0
    return min(inside.y1 - y, y - inside.y0) - r


def measure_furniture(home: CareHome) -> Iterator[Measurement]:
    """Yield what is measured of each piece of furniture."""
    for placed in home.placed:
        piece, room, name = placed.piece, placed.room, placed.name
        for rule in HEIGHTS:
            if rule in piece.measures:
                yield Measurement(rule, room, name, piece.measures[rule])
        if piece.kind == "toilet":
            yield from _toilet(home, placed)
        if "bed_height" in piece.measures:
            better, worse = _beside_bed(home, placed)
            yield Measurement("bed_side_space", room, name, better)
            yield Measurement("bed_far_side_space", room, name, worse)
        if piece.kind == "washbasin":
            knee = piece.measures.get("basin_knee_height") if piece.knee else None
            yield Measurement("basin_knee_height", room, name, knee)
        if piece.kind in TABLES:
            knee = piece.measures.get("table_knee_height") if piece.knee else None
            yield Measurement("table_knee_height", room, name, knee)
        if piece.kind in BATHING:
            has_bars = any(bar.is_level and bar.top < BAR_TOP for bar in bars(piece.model))
            yield Measurement("bath_grab_bars", room, name, "wall" if has_bars else "none")
        if piece.kind in KITCHEN:
            yield Measurement("kitchen_aisle", room, name, _aisle(home, placed))
        tap, handle = tap_word(piece), handle_word(piece)
        if tap is not None:
            yield Measurement("tap", room, name, tap)
        if piece.kind in CUPBOARDS and handle is not None:
            yield Measurement("cupboard_handle", room, name, handle)


def measure_sets(home: CareHome) -> Iterator[Measurement]:
    """Yield what a room's furniture has together: where one washes, and one worktop to sit at."""
    for room in home.plan.rooms.values():
        pieces = [placed.piece for placed in home.placed if placed.room == room.name]
        bathing = [BATHING.index(piece.kind) for piece in pieces if piece.kind in BATHING]
        if room.kind == "bathroom" and bathing:
            yield Measurement("bathing", room.name, room.name, BATHING[max(bathing)])
        if any("counter_height" in p.measures and p.kind in KITCHEN for p in pieces):
            yield from _worktop(room, pieces)


def _worktop(room: Room, pieces: list[Piece]) -> Iterator[Measurement]:
    """Yield the room for knees under the worktop of a kitchen that has most of it."""
    knees = [
        (piece.measures["counter_knee_height"], area)
        for piece in pieces
        if piece.kind in KITCHEN and "counter_knee_height" in piece.measures
        for area in piece.knee
    ]
    if not knees:
        for side in ("height", "width", "depth"):
            yield Measurement(f"counter_knee_{side}", room.name, room.name, None)
        return
    height, area = max(knees, key=lambda knee: knee[1].area)
    yield Measurement("counter_knee_height", room.name, room.name, height)
    yield Measurement("counter_knee_width", room.name, room.name, area.depth)
    yield Measurement("counter_knee_depth", room.name, room.name, area.width)


def _toilet(home: CareHome, placed: Placed) -> Iterator[Measurement]:
    room, name = placed.room, placed.name
    around = Surroundings(home, room, placed.pose, but=(name,), kinds_but=LIGHT)
    wall = min(around.inside.y1, -around.inside.y0)
    yield Measurement("toilet_centre_to_wall", room, name, wall)
    low, high = _half_width(placed.piece)
    beside = max(
        around.free(high, BESIDE_TOILET, along="y"),
        around.free(low, BESIDE_TOILET, along="y", sign=-1),
    )
    yield Measurement("toilet_side_space", room, name, beside)
    yield from measure_toilet_bars(home, placed)


def _half_width(piece: Piece) -> tuple[float, float]:
    """Return the sides of a toilet's bowl below its seat, along y [m]."""
    seat = piece.measures["toilet_seat_height"]
    boxes = [extent(shape) for shape in piece.model.links[piece.model.root].collision]
    sides = [
        float(corner[1]) for low, high in boxes if low[2] < seat - 0.05 for corner in (low, high)
    ]
    return (min(sides), max(sides)) if sides else (piece.footprint.y0, piece.footprint.y1)


def _beside_bed(home: CareHome, placed: Placed) -> tuple[float, float]:
    """Return the free floor beside a bed on its better and its worse side [m]."""
    around = Surroundings(home, placed.room, placed.pose, but=(placed.name,), kinds_but=LIGHT)
    bed = placed.piece.footprint
    starts = np.arange(bed.x0, max(bed.x1 - BESIDE_BED, bed.x0) + 1e-9, _SLICE).tolist()
    sides = []
    for edge, sign in ((bed.y1, 1), (bed.y0, -1)):
        spans = [(x, min(x + BESIDE_BED, bed.x1)) for x in starts]
        sides.append(max(around.free(edge, span, along="y", sign=sign) for span in spans))
    return max(sides), min(sides)


def _aisle(home: CareHome, placed: Placed) -> float:
    """Return the free floor before a piece of a kitchen, but for what is joined to it at a corner [m]."""
    around = Surroundings(home, placed.room, placed.pose, but=(placed.name,), kinds_but=LIGHT)
    front = placed.piece.footprint
    starts = np.arange(front.y0, front.y1 - _SLICE + 1e-9, _SLICE).tolist()
    free = [around.free(front.x1, (y, y + _SLICE), along="x") for y in starts]
    return min((reach for reach in free if reach > _CORNER), default=FAR)


def tap_word(piece: Piece) -> str | None:
    """Return how the taps of a piece are worked, by how far from its axis one takes hold; None for none."""
    places = link_poses(piece.model)
    arms = []
    for name, joint in piece.model.joints.items():
        grip = piece.frames.get(f"handle_{name}")
        if not name.startswith("tap") or joint.kind == "fixed" or grip is None:
            continue
        frame = places[joint.child]
        axis = frame.matrix()[:3, :3] @ np.array(joint.axis)
        arm = np.array(grip.position) - np.array(frame.position)
        arms.append(float(np.linalg.norm(np.cross(axis, arm))))
    if not arms:
        return None
    return "lever" if min(arms) > _ARM else "knob"


def handle_word(piece: Piece) -> str | None:
    """Return whether bars or knobs open a cupboard, by their shapes; None if nothing opens."""
    places = link_poses(piece.model)
    words = set()
    for name, joint in piece.model.joints.items():
        grip = piece.frames.get(f"handle_{name}")
        if name.startswith(("tap", "turn")) or joint.kind == "fixed" or grip is None:
            continue
        link = piece.model.links[joint.child]
        words.add("bar" if _has_bar(link, places[joint.child], grip.position) else "knob")
    if not words:
        return None
    return "knob" if "knob" in words else "bar"


def _has_bar(link: Link, pose: Pose, grip: tuple[float, float, float]) -> bool:
    """Return whether a long slim solid lies where the link is gripped."""
    for shape in link.collision:
        low, high = extent(shape.moved(pose))
        edges = sorted(b - a for a, b in zip(low, high, strict=True))
        is_here = all(a - 0.02 <= at <= b + 0.02 for a, at, b in zip(low, grip, high, strict=True))
        if is_here and edges[2] >= _BAR and edges[1] <= _SLIM:
            return True
    return False
