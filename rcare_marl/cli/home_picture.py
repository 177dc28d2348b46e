"""Perspectives of homes: the whole house from above, and rooms with the walls before them taken away."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rcare_marl.envs.homes.care_home import CareHome
from rcare_marl.envs.homes.cutaway import cutaway
from rcare_marl.envs.homes.rectangle import Rectangle
from rcare_marl.rendering import Camera, make_renderer
from rcare_marl.world import World

Picture = npt.NDArray[np.uint8]
CUT = 1.35  # [m] at which walls are cut in the view from above: over sills, under lamps
VIEW = (-0.35, -0.75, 1.0)  # direction from the house to the camera: south-west, above
ROOM_CUT = 2.2  # [m] at which the walls behind are cut in views of rooms


def perspective(home: CareHome, *, width: int = 1600, height: int = 1000) -> Picture:
    """Return the house from above without its ceilings, shape [height, width, 3]."""
    world = World()
    try:
        home.spawn(world, ceilings=False, wall_height=CUT)
        outlines = home.plan.outline
        bounds = Rectangle(
            min(a.x0 for a in outlines), min(a.y0 for a in outlines),
            max(a.x1 for a in outlines), max(a.y1 for a in outlines),
        )  # fmt: skip
        camera = framed(bounds, CUT, VIEW, fov_deg=30.0, width=width, height=height)
        return _taken(world, camera)
    finally:
        world.close()


def room_perspective(
    home: CareHome, room: str, *, width: int = 800, height: int = 640, view: str = ""
) -> Picture:
    """Return one room seen from above a corner, the two walls before it taken away.

    Args:
        home: The home.
        room: Name of the room.
        width: Of the picture [pixel].
        height: Of the picture [pixel].
        view: The corner that the camera looks from, `sw`, `se`, `nw` or `ne`; the one from which the
            least furniture is seen from behind if empty.
    """
    inside = home.room(room).inside
    corner = view or _best_corner(home, room)
    world = World()
    try:
        cutaway(home, room, corner).spawn(world, ceilings=False, wall_height=ROOM_CUT)
        x = -1.0 if "w" in corner else 1.0
        y = -1.0 if "s" in corner else 1.0
        camera = framed(inside, 1.6, (0.8 * x, y, 0.85), fov_deg=32.0, width=width, height=height)
        return _taken(world, camera)
    finally:
        world.close()


def framed(
    area: Rectangle,
    top: float,
    direction: tuple[float, float, float],
    *,
    fov_deg: float,
    width: int,
    height: int,
) -> Camera:
    """Return a camera that sees all of the box over `area`, from the floor to `top` [m]."""
    middle = np.array((*area.centre, 0.4 * top))
    back = np.array(direction) / np.linalg.norm(direction)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    half = math.tan(math.radians(0.5 * fov_deg))
    corners = np.array(
        [(x, y, z) for x in (area.x0, area.x1) for y in (area.y0, area.y1) for z in (0.0, top)]
    )
    away = corners - middle
    wide = np.abs(away @ right) * height / width
    needed = np.maximum(wide, np.abs(away @ up)) / half + away @ back
    eye = middle + 1.04 * float(needed.max()) * back
    return Camera(
        eye=(eye[0], eye[1], eye[2]), target=(middle[0], middle[1], middle[2]), fov_deg=fov_deg,
        width=width, height=height, near=1.0, far=200.0,
    )  # fmt: skip


def _best_corner(home: CareHome, room: str) -> str:
    """Return the corner opposite of the walls that the furniture stands against."""
    scores = {"sw": 0.0, "se": 0.0, "nw": 0.0, "ne": 0.0}
    for placed in home.furniture(room):
        x, y = placed.pose.matrix()[:2, 0].tolist()
        size = placed.footprint.area * placed.piece.height
        for corner in scores:
            towards = (-x if "w" in corner else x) + (-y if "s" in corner else y)
            scores[corner] += towards * size
    return max(scores, key=lambda corner: scores[corner])


def _taken(world: World, camera: Camera) -> Picture:
    renderer = make_renderer(world, floor=False)
    try:
        return renderer.render(camera)
    finally:
        renderer.close()


__all__ = ["framed", "perspective", "room_perspective"]
