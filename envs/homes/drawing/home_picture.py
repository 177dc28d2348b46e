"""Perspectives of homes: the whole house from above, and rooms from where most of them is seen."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rcare_marl.envs.homes.care_home import CareHome
from rcare_marl.envs.homes.furnishing import Placed
from rcare_marl.envs.homes.occupancy import Mask
from rcare_marl.envs.homes.plan import CEILING_HEIGHT, OUTSIDE
from rcare_marl.envs.rectangle import Rectangle
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Array
from rcare_marl.rendering import Camera, Light, SoftwareRenderer, make_renderer
from rcare_marl.rendering.daylight import disc, dome, exposed
from rcare_marl.rendering.portrait import framed
from rcare_marl.world import World

Picture = npt.NDArray[np.uint8]

# All our own choice.
EYE = 1.5  # [m] over the floor
EYE_FOV = 54.0  # [deg], vertical
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
CUT = 1.35  # [m] at which walls are cut in the view from above: over sills, under lamps
VIEW = (-0.35, -0.75, 1.0)  # direction from the house to the camera: south-west, above
FOV = 24.0  # [deg] of the view from above
LAMPS = 14  # lights that a sky, or a bright ceiling, is made of
SMOOTH = 4  # pictures against jagged edges
SUNS = 7  # lights that a sun is made of
BRIGHTEST = 0.9  # of nearly all of a picture
EVERYTHING = 100.0  # [m]; nothing is higher
SUN = (-0.8, 0.45, 0.85)  # towards the sun over a house
CEILING_LIGHT = Light(key=1.7, fill=0.95, bounce=1.0, reach=6.0, lid=CEILING_HEIGHT - 0.15)
WINDOW_SUN = Light(key=4.8, fill=0.95, bounce=1.0, reach=6.0, lid=EVERYTHING)
SUN_HEIGHT = 0.75  # rise of the sun that shines into a room, over its run
SIDES = "swne"
ON_WALL = 0.2  # [m] from a wall; what stands out less hangs on it, and goes with it


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
            fov_deg=EYE_FOV,
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
        return np.asarray(((enter < leave) & (leave > 0) & (enter < 0.97)).any(axis=1))


def _weight(placed: Placed) -> float:
    """Return how much a piece counts: what is seen of it from above, and from before it [m²]."""
    own = placed.piece.footprint
    seen = own.area + 0.5 * own.depth * min(placed.piece.height, EYE)
    return 0.2 + min(seen, 3.5)


def _points(low: Array, high: Array) -> Array:
    """Return points all over a box, shape [27, 3]."""
    shares = np.array([(x, y, z) for x in (0, 0.5, 1) for y in (0, 0.5, 1) for z in (0, 0.5, 1)])
    return np.asarray(low + shares * (np.minimum(high, (np.inf, np.inf, CEILING_HEIGHT)) - low))


def _in_frame(points: Array, vantage: Vantage, ratio: float) -> Mask:
    away = points - np.array(vantage.eye)
    ahead = away[:, 0] * math.cos(vantage.yaw) + away[:, 1] * math.sin(vantage.yaw)
    right = away[:, 0] * math.sin(vantage.yaw) - away[:, 1] * math.cos(vantage.yaw)
    half = math.tan(math.radians(0.5 * EYE_FOV))
    depth = np.maximum(ahead, 1e-6)
    inside: Mask = (
        (ahead > 0.15)
        & (np.abs(right) < ratio * half * depth)
        & (away[:, 2] < 2 * HORIZON * half * depth)
        & (away[:, 2] > -2 * (1 - HORIZON) * half * depth)
    )
    return inside


def perspective(home: CareHome, *, width: int = 1600, height: int = 1000) -> Picture:
    """Return the house from above without its ceilings, shape [height, width, 3]."""
    world = World()
    try:
        home.spawn(world, ceilings=False, wall_height=CUT)
        corners = _corners(home.plan.outline, CUT)
        camera = framed(corners, VIEW, fov_deg=FOV, width=width, height=height)
        camera = dataclasses.replace(camera, near=1.0, far=300.0)
        reach = 0.5 * float(np.ptp(corners[:, :2], axis=0).max()) + 2.0
        sky = Light(key=0.75, fill=1.15, bounce=0.6, reach=reach, lid=EVERYTHING)
        sun = Light(SUN, key=2.2, fill=1.15, bounce=0.6, reach=reach, lid=EVERYTHING)
        return _taken(world, camera, [*dome(sky, LAMPS), *disc(sun, SUNS)])
    finally:
        world.close()


def room_perspective(
    home: CareHome, room: str, *, width: int = 960, height: int = 720, view: str = ""
) -> Picture:
    """Return one room by daylight, seen at the height of the eyes, shape [height, width, 3].

    If it is too small to stand in and see it, the walls behind the eye are taken away.

    Args:
        home: The home.
        room: Name of the room.
        width: Of the picture [pixel].
        height: Of the picture [pixel].
        view: Side or corner of the room to look from, such as `s` or `ne`; the one from which most is
            seen if empty.

    Raises:
        UnknownNameError: If there is no such room or view.
    """
    vantage = best_vantage(home, room, ratio=width / height, view=view)
    camera = vantage.camera(width=width, height=height)
    world = World()
    try:
        cutaway(home, room, vantage.open_sides).spawn(world, articulated=(room,))
        return _taken(world, camera, _light(home, room, vantage.open_sides))
    finally:
        world.close()


def _corners(areas: Sequence[Rectangle], top: float) -> Array:
    return np.array(
        [(x, y, z) for a in areas for x in (a.x0, a.x1) for y in (a.y0, a.y1) for z in (0.0, top)]
    )


def _light(home: CareHome, room: str, open_sides: str) -> list[Light]:
    """Return light from all of the ceiling, and a sun that shines in where there is a window."""
    lamps = dome(CEILING_LIGHT, LAMPS, spread=0.93)
    walls = {(0, 1): "s", (1, 0): "w", (0, -1): "n", (-1, 0): "e"}  # by the direction into the room
    windows = [
        o
        for o in home.plan.openings_of(room)
        if o.kind == "window" and o.rooms[1] == OUTSIDE and walls[o.normal] not in open_sides
    ]
    if not windows:
        return lamps
    x, y = max(windows, key=lambda o: o.width * (o.head - o.sill)).normal
    towards = (-x - 0.45 * y, -y + 0.45 * x, SUN_HEIGHT)
    return [*lamps, *disc(dataclasses.replace(WINDOW_SUN, direction=towards), SUNS)]


def _taken(world: World, camera: Camera, lights: Sequence[Light]) -> Picture:
    renderer = make_renderer(world, floor=False, samples=0, ambient_occlusion=False)
    if isinstance(renderer, SoftwareRenderer):  # it has one light: more pictures only smooth edges
        lights = lights[:SMOOTH]
    try:
        return exposed(renderer, camera, lights, brightest=BRIGHTEST)
    finally:
        renderer.close()


def cutaway(home: CareHome, room: str, open_sides: str = "") -> CareHome:
    """Return a home without the walls on some sides of a room, and what stands beyond them.

    Floors and ceilings stay.

    Args:
        home: The home.
        room: Name of the room.
        open_sides: Sides to look in from, letters of `swne` for south, west, north and east.

    Raises:
        UnknownNameError: If there is no such room.
        ConfigError: If a side is none of these.
    """
    inside = home.room(room).inside
    if set(open_sides) - set(SIDES):
        raise ConfigError(f"open sides must be letters of {SIDES}, got {open_sides!r}")
    kept = Rectangle(
        inside.x0 if "w" in open_sides else -math.inf,
        inside.y0 if "s" in open_sides else -math.inf,
        inside.x1 if "e" in open_sides else math.inf,
        inside.y1 if "n" in open_sides else math.inf,
    )
    walls = [
        dataclasses.replace(wall, area=area)
        for wall in home.plan.walls
        if (area := wall.area.common(kept)) is not None and min(area.width, area.depth) > 0.01
    ]
    openings = {
        o.name: o
        for o in home.plan.openings.values()
        if any(wall.axis == o.axis and wall.area.contains(o.gap, by=1e-6) for wall in walls)
    }
    plan = dataclasses.replace(
        home.plan,
        name=f"{home.plan.name}_{room}_{open_sides}",
        walls=tuple(walls),
        openings=openings,
    )
    near = inside.grown(-ON_WALL)
    gone = {
        "w": lambda a: a.x1 <= near.x0,
        "s": lambda a: a.y1 <= near.y0,
        "e": lambda a: a.x0 >= near.x1,
        "n": lambda a: a.y0 >= near.y1,
    }
    placed = tuple(p for p in home.placed if not any(gone[s](p.footprint) for s in open_sides))
    return dataclasses.replace(home, plan=plan, name=plan.name, placed=placed)
