"""Finds grab bars in the shapes that furniture collides with, and measures them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Model, joint_pose
from rcare_marl.pose import Pose, rotate

from ..rectangle import Rectangle
from .care_home import CareHome
from .furnishing import Placed
from .measurement import Measurement

BAR_KINDS = ("grab_bar", "fold_down_bar")
BAR_RADIUS = (0.01, 0.03)  # [m] of what hands hold to hold themselves; own choice
BAR_LENGTH = 0.3  # [m], least
BAR_TOP = 1.2  # [m]; what is level but higher is a rail for a curtain; own choice
BAR_NEAR = 0.6  # [m] from the toilet or bath that a bar of its own serves; own choice
_LEVEL = 0.1  # most that a bar rises for its length


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


def bars(model: Model, pose: Pose = Pose()) -> Iterator[Bar]:
    """Yield the bars of a model that stands at `pose`; those on joints as they are unfolded.

    A bar on a joint is unfolded at that end of the joint at which it is level.
    """
    ends: dict[str, tuple[bool, tuple[Pose, ...]]] = {model.root: (False, (pose,))}
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


def bars_at(home: CareHome, placed: Placed) -> list[Bar]:
    """Return the bars on a piece, and those of their own beside it, in the frame of the piece."""
    found = list(bars(placed.piece.model))
    back, reach = placed.pose.inverse(), placed.footprint.grown(BAR_NEAR)
    for other in home.placed:
        is_bar = other.piece.kind in BAR_KINDS and other.room == placed.room
        if is_bar and other.footprint.overlaps(reach):
            found += bars(other.piece.model, back @ other.pose)
    return found


def measure_toilet_bars(home: CareHome, toilet: Placed) -> Iterator[Measurement]:
    """Yield which grab bars a toilet has, how long, thick and high they are, and how far off the wall."""
    found = bars_at(home, toilet)
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
