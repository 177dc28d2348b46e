"""Pictures for sheets: a world as it is now, bodies that just fit, and many pictures with captions."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from ..body import Body
from ..pose import Array
from ..world import World
from . import Camera, make_renderer

Picture = npt.NDArray[np.uint8]
FOV = 28.0  # [deg] of portraits
FILLED = 0.95  # of a portrait's edge, by what is seen
LARGEST = 24  # [pixel] of the letters of a caption
QUALITY = 88  # of a JPEG
INK, GREY = (28, 32, 38), (110, 116, 124)


def snapshot(world: World, camera: Camera, size: tuple[int, int] | None = None) -> Picture:
    """Return a picture of a world, shape [height, width, 3].

    Args:
        world: What is seen.
        camera: From where.
        size: Width and height [pixel], for which it is drawn twice as large; the camera's if None.
    """
    if size is not None:
        camera = replace(camera, width=2 * size[0], height=2 * size[1])
    renderer = make_renderer(world)
    try:
        picture = renderer.render(camera)
    finally:
        renderer.close()
    if size is None:
        return picture
    return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.LANCZOS))


def encoded(picture: Picture | Image.Image, kind: str = "PNG") -> bytes:
    """Return the contents of a file with a picture; a JPEG is as small as a page needs it."""
    stream = io.BytesIO()
    image = picture if isinstance(picture, Image.Image) else Image.fromarray(picture)
    image.save(stream, kind, **({"quality": QUALITY, "optimize": True} if kind == "JPEG" else {}))
    return stream.getvalue()


def portrait(
    world: World, bodies: Sequence[Body], direction: Sequence[float], size: tuple[int, int]
) -> Picture:
    """Return a picture in which bodies just fit, shape [height, width, 3].

    Args:
        world: Where they are.
        bodies: What is to be seen; below the floor nothing is.
        direction: From them to the camera.
        size: Width and height [pixel].
    """
    ends = np.array([body.bounds() for body in bodies])  # [bodies, low and high, 3]
    corners = [[each[k >> i & 1][i] for i in range(3)] for each in ends for k in range(8)]
    points = np.array(corners)
    points[:, 2] = np.maximum(points[:, 2], 0.0)
    width, height = size
    camera = framed(points, direction, fov_deg=FOV, width=width, height=height, margin=1 / FILLED)
    return snapshot(world, camera)


def framed(
    points: Array,
    direction: Sequence[float],
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
    axes = np.stack((right, np.cross(back, right), back), axis=1)
    tall = math.tan(math.radians(fov_deg / 2)) / margin
    half = np.array((tall * width / height, tall))
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for _ in range(8):  # moving it moves what is at the edges: it settles quickly
        seen = (points - middle) @ axes
        far = float(((np.abs(seen[:, :2]) / half).max(axis=1) + seen[:, 2]).max())
        flat = seen[:, :2] / (far - seen[:, 2:])
        middle = middle + axes[:, :2] @ (0.5 * far * (flat.min(axis=0) + flat.max(axis=0)))
    eye, target = (tuple(point.tolist()) for point in (middle + far * back, middle))
    return Camera(eye, target, fov_deg=fov_deg, width=width, height=height)


def contact_sheet(
    pictures: Sequence[Picture], captions: Sequence[str] = (), *, columns: int, gap: int = 0
) -> Image.Image:
    """Return pictures of one size in rows, each with its caption below.

    Args:
        pictures: Each of shape [height, width, 3].
        captions: For each one, its further lines smaller; what is too long is cut. None if empty.
        columns: Pictures in a row, at most.
        gap: Between two pictures [pixel].
    """
    tall, wide = pictures[0].shape[:2]
    large = min(LARGEST, wide // 20)
    fonts = ImageFont.load_default(large), ImageFont.load_default(round(0.7 * large))
    lines = max((1 + caption.count("\n") for caption in captions), default=0)
    band = (large + round(large * lines * 0.8)) if lines else 0
    columns = min(columns, len(pictures))
    rows = math.ceil(len(pictures) / columns)
    edges = (columns * (wide + gap) - gap, rows * (tall + band + gap) - gap)
    sheet = Image.new("RGB", edges, "white")
    pen = ImageDraw.Draw(sheet)
    for k, picture in enumerate(pictures):
        x, y = k % columns * (wide + gap), k // columns * (tall + band + gap)
        sheet.paste(Image.fromarray(picture), (x, y))
        y += tall + large // 3
        for i, text in enumerate(captions[k].split("\n") if captions else ()):
            font, ink = fonts[min(i, 1)], GREY if i else INK
            while pen.textlength(text, font) > wide - large:
                text = text.rstrip("…").rsplit(" ", 1)[0].rstrip(" ,") + "…"
            pen.text((x + large // 2, y), text, ink, font)
            y += round(1.25 * large)
    return sheet
