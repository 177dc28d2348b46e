"""Where to stand to see most of a room."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rcare_marl.envs.homes.care_home import CareHome
from rcare_marl.envs.homes.furnishing import Placed
from rcare_marl.envs.homes.occupancy import Mask
from rcare_marl.envs.homes.plan import CEILING_HEIGHT
from rcare_marl.envs.rectangle import Rectangle
from rcare_marl.errors import UnknownNameError
from rcare_marl.pose import Array
from rcare_marl.rendering import Camera

# All our own choice.
EYE = 1.5  # [m] over the floor
FOV = 54.0  # [deg], vertical
HORIZON = 0.36  # share of the picture over the height of the eye, which is looked at straight
VIEWS = {
    "sw": (-1, -1),
    "s": (0, -1),
    "se": (1, -1),
    "e": (1, 0),
    "ne": (1, 1),
    "n": (0, 1),
    "nw": (-1, 1),
    "w": (-1, 0),
}
BACK = (-0.9, -0.6, -0.3, 0.0, 0.4, 0.8, 1.2, 1.6)  # [m] from the walls; beyond them if positive
ASIDE = (-0.8, 0.0, 0.8)  # [m]
TURNS = (-0.2, 0.0, 0.2)  # [rad]
NEAR = 1.0  # [m]; what is taller than `TALL` and as near as that fills the picture
TALL = 1.0
AHEAD = 3.0  # [m] from the eye to the middle of what is seen
STANDING_ROOM = 0.2  # [m] around the eye


@dataclass(frozen=True)
class Vantage:
    """A place to look into a room from.

    Attributes:
        eye: Where the camera stands [m], shape [3].
        yaw: Where it looks, level [rad].
        open_sides: Walls of the room that stand in the way, letters of `swne`.
    """

    eye: tuple[float, float, float]
    yaw: float
    open_sides: str

    def camera(self, *, width: int, height: int) -> Camera:
        """Return the camera; it looks level, so that what is upright is upright in the picture."""
        x, y, z = self.eye
        ahead = x + AHEAD * math.cos(self.yaw), y + AHEAD * math.sin(self.yaw), z
        return Camera(
            eye=self.eye,
            target=ahead,
            fov_deg=FOV,
            width=width,
            height=height,
            near=0.12,
            far=90.0,
            center=(0.5 * (width - 1), HORIZON * height),
        )


def best_vantage(home: CareHome, room: str, *, ratio: float, view: str = "") -> Vantage:
    """Return the place from which most of what is in a room is seen.

    Args:
        home: The home.
        room: Name of the room.
        ratio: Width of the picture over its height.
        view: Side or corner of the room to look from, one of `VIEWS`; any if empty.

    Raises:
        UnknownNameError: If there is no such room or view.
    """
    inside = home.room(room).inside
    if view and view not in VIEWS:
        raise UnknownNameError("view of a room", view, VIEWS)
    scene = _Scene(home, room)
    best, best_score = None, -math.inf
    for name in (view,) if view else VIEWS:
        for vantage in _vantages(inside, name):
            score = scene.score(vantage, ratio)
            if score > best_score:
                best, best_score = vantage, score
    assert best is not None
    return best


def _vantages(inside: Rectangle, view: str) -> Iterator[Vantage]:
    sx, sy = VIEWS[view]
    cx, cy = inside.centre
    corner = cx + sx * 0.5 * inside.width, cy + sy * 0.5 * inside.depth
    for back in BACK:
        for aside in ASIDE:
            x = corner[0] + sx * back + (aside if sx == 0 else 0.0)
            y = corner[1] + sy * back + (aside if sx != 0 else 0.0)
            yaw = math.atan2(cy - y, cx - x)
            sides = "s" * (y < inside.y0 + 0.1) + "w" * (x < inside.x0 + 0.1)
            sides += "n" * (y > inside.y1 - 0.1) + "e" * (x > inside.x1 - 0.1)
            for turn in TURNS:
                yield Vantage((x, y, EYE), yaw + turn, sides)


class _Scene:
    """What there is to see in a room, and what may be in the way."""

    def __init__(self, home: CareHome, room: str) -> None:
        inside = self._inside = home.room(room).inside
        self._centre = np.array((*inside.centre, 1.0))
        placed = home.furniture(room)
        boxes = [(p.footprint, 0.02, p.piece.height) for p in placed]
        self._weights = [_weight(p) for p in placed]
        self._fronts = [p.pose.matrix()[:2, 0] for p in placed]
        self._solid = np.array([p.piece.blocks for p in placed], bool)
        for opening in home.plan.openings_of(room):
            boxes.append((opening.gap, opening.sill, opening.head))
            self._weights.append(1.0 if opening.kind == "window" else 0.6)
            sign = 1.0 if opening.rooms[0] == room else -1.0
            self._fronts.append(sign * np.array(opening.normal, float))
        self._low = np.array([(a.x0, a.y0, low) for a, low, _ in boxes]).reshape(-1, 3)
        self._high = np.array([(a.x1, a.y1, high) for a, _, high in boxes]).reshape(-1, 3)

    def score(self, vantage: Vantage, ratio: float) -> float:
        """Return how much is seen, weighed by size; worst if there is no room to stand."""
        eye = np.array(vantage.eye)
        count = len(self._solid)
        low, high = self._low[:count], self._high[:count]
        gap = np.linalg.norm(
            np.maximum(np.maximum(low[:, :2] - eye[:2], eye[:2] - high[:, :2]), 0), axis=1
        )
        tall = self._solid & (high[:, 2] > TALL)
        if (gap[self._solid] < STANDING_ROOM).any() and not vantage.open_sides:
            return -math.inf
        if (gap[tall] < STANDING_ROOM).any():
            return -math.inf
        total = -1.0 * float((gap[tall] < NEAR).sum())
        total -= 0.12 * float(np.linalg.norm(eye - self._centre))
        total -= 0.35 * len(vantage.open_sides)
        total -= 1.5 * float(_in_frame(self._ends(vantage.open_sides), vantage, ratio).sum())
        for i, weight in enumerate(self._weights):
            middle = 0.5 * (self._low[i, :2] + self._high[i, :2])
            towards = eye[:2] - middle
            facing = float(self._fronts[i] @ towards) / max(float(np.linalg.norm(towards)), 0.1)
            if i >= count and facing <= 0:
                continue  # the wall of this opening is taken away
            points = _points(self._low[i], self._high[i])
            seen = _in_frame(points, vantage, ratio) & ~self._hidden(eye, points, i)
            total += weight * float(seen.mean()) * max(0.4 + 0.6 * facing, 0.1)
        return total

    def _ends(self, open_sides: str) -> Array:
        """Return where walls end that are taken away, beyond which there is nothing, shape [n, 3]."""
        a = self._inside
        ends = [
            (x, y, EYE)
            for x, side in ((a.x0, "w"), (a.x1, "e"))
            for y, end in ((a.y0, "s"), (a.y1, "n"))
            if side in open_sides or end in open_sides
        ]
        return np.array(ends).reshape(-1, 3)

    def _hidden(self, eye: Array, points: Array, own: int) -> Mask:
        """Return which points something else is before, shape [n]."""
        others = np.flatnonzero(self._solid)
        others = others[others != own]
        ray = (points - eye)[:, None, :]
        ray = np.where(np.abs(ray) < 1e-9, 1e-9, ray)
        a = (self._low[others] + 0.03 - eye)[None] / ray
        b = (self._high[others] - 0.03 - eye)[None] / ray
        enter = np.minimum(a, b).max(axis=2)
        leave = np.maximum(a, b).min(axis=2)
        hidden: Mask = ((enter < leave) & (leave > 0) & (enter < 0.97)).any(axis=1)
        return hidden


def _weight(placed: Placed) -> float:
    """Return how much a piece counts: what is seen of it from above, and from before it [m²]."""
    own = placed.piece.footprint
    seen = own.area + 0.5 * own.depth * min(placed.piece.height, EYE)
    return 0.2 + min(seen, 3.5)


def _points(low: Array, high: Array) -> Array:
    """Return points all over a box, shape [27, 3]."""
    shares = np.array([(x, y, z) for x in (0, 0.5, 1) for y in (0, 0.5, 1) for z in (0, 0.5, 1)])
    points: Array = low + shares * (np.minimum(high, (np.inf, np.inf, CEILING_HEIGHT)) - low)
    return points


def _in_frame(points: Array, vantage: Vantage, ratio: float) -> Mask:
    away = points - np.array(vantage.eye)
    ahead = away[:, 0] * math.cos(vantage.yaw) + away[:, 1] * math.sin(vantage.yaw)
    right = away[:, 0] * math.sin(vantage.yaw) - away[:, 1] * math.cos(vantage.yaw)
    half = math.tan(math.radians(0.5 * FOV))
    depth = np.maximum(ahead, 1e-6)
    inside: Mask = (
        (ahead > 0.15)
        & (np.abs(right) < ratio * half * depth)
        & (away[:, 2] < 2 * HORIZON * half * depth)
        & (away[:, 2] > -2 * (1 - HORIZON) * half * depth)
    )
    return inside
