"""Perspectives of homes: the whole house from above without its ceilings, and rooms from within."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rcare_marl.envs.homes.care_home import CareHome
from rcare_marl.envs.homes.cutaway import cutaway
from rcare_marl.envs.homes.plan import CEILING_HEIGHT, OUTSIDE
from rcare_marl.envs.rectangle import Rectangle
from rcare_marl.pose import Array
from rcare_marl.rendering import Camera, Light, SoftwareRenderer, make_renderer
from rcare_marl.rendering.daylight import disc, dome, exposed
from rcare_marl.world import World

from .vantage import best_vantage

Picture = npt.NDArray[np.uint8]

# All our own choice.
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


def perspective(home: CareHome, *, width: int = 1600, height: int = 1000) -> Picture:
    """Return the house from above without its ceilings, shape [height, width, 3]."""
    world = World()
    try:
        home.spawn(world, ceilings=False, wall_height=CUT)
        corners = _corners(home.plan.outline, CUT)
        camera = framed(corners, VIEW, fov_deg=FOV, width=width, height=height)
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


def framed(
    points: Array,
    direction: tuple[float, float, float],
    *,
    fov_deg: float,
    width: int,
    height: int,
    margin: float = 1.04,
) -> Camera:
    """Return a camera that sees all points, with them in the middle of the picture.

    Args:
        points: What to see [m], shape [n, 3].
        direction: From there to the camera.
        fov_deg: Vertical field of view [deg].
        width: Of the picture [pixel].
        height: Of the picture [pixel].
        margin: Size of the picture over that of what is to be seen.
    """
    back = np.array(direction) / np.linalg.norm(direction)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    half = math.tan(math.radians(0.5 * fov_deg)) / margin
    target = points.mean(axis=0)
    distance = 0.0
    for _ in range(8):  # moving the target moves what is at the edges: it settles quickly
        away = points - target
        wide, high, near = away @ right * height / width, away @ up, away @ back
        distance = float((np.maximum(np.abs(wide), np.abs(high)) / half + near).max())
        depth = distance - near
        x, y = away @ right / depth, away @ up / depth
        target = target + distance * 0.5 * ((x.min() + x.max()) * right + (y.min() + y.max()) * up)
    eye = target + distance * back
    (ex, ey, ez), (tx, ty, tz) = eye.tolist(), target.tolist()
    return Camera(
        (ex, ey, ez), (tx, ty, tz), fov_deg=fov_deg, width=width, height=height, near=1.0, far=300.0
    )


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
