"""A film of episodes, with captions, as an MP4.

While the camera stands still only the rectangle in which something moved is drawn anew: a small picture
tells which, so that shadows count, too. What never moved keeps the smooth edges of the first picture.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import numpy.typing as npt
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import binary_dilation  # type: ignore[import-untyped]

from rcare_marl.rendering import Camera, make_renderer
from rcare_marl.world import World

SIZE = (1920, 1080)  # [pixel], even as the codec wants
QUALITY = 8  # of 10, in imageio-ffmpeg's scale
BAR = 64  # [pixel] height of the caption
FONT_SIZE = 28  # [pixel]
HOLD = 1.0  # [s] that the last picture of an episode stays
COARSE = 4  # of the film's pixels are one of the picture that tells what moved
TALL = 700  # [pixel] of what is drawn anew, at least: less would shade nooks less
AROUND = 3  # of those to each side are drawn anew with what moved
UNLIKE = 2  # of 255, by which what moved differs
INSET, FINER = (4, 3), 1.5  # the film is so many times a close-up; that is drawn so much finer
INSET_EVERY = 3  # pictures there is a new close-up
GAP, EDGE = 16, 4  # [pixel] around it, and of its frame

Picture = npt.NDArray[np.uint8]


class Film:
    """An MP4 in the making; close it before the file is used."""

    def __init__(
        self, path: Path, world: World, *, fps: float, close_up: Camera | None = None
    ) -> None:
        """Begin.

        Args:
            path: The file.
            world: What to film.
            fps: Pictures a second; the control rate gives real time.
            close_up: What sees a detail, shown in the lower right corner.
        """
        self._fps, self._close_up, self._count = fps, close_up, 0
        self._font = ImageFont.truetype(font_manager.findfont("DejaVu Sans"), FONT_SIZE)
        self._smooth = make_renderer(world)
        self._quick = make_renderer(world, samples=0)
        self._view: Camera | None = None
        self._last: Picture | None = None
        self._writer = imageio_ffmpeg.write_frames(
            str(path),
            SIZE,
            fps=fps,
            codec="libx264",
            quality=QUALITY,
            macro_block_size=2,
            output_params=["-movflags", "+faststart"],
        )
        self._writer.send(None)

    def add(self, camera: Camera, left: str, right: str, *, good: bool | None = None) -> None:
        """Add a picture with a caption; `good` colours the text on the right green or red."""
        width, height = SIZE
        view = dataclasses.replace(camera, width=width, height=height)
        if view != self._view:
            self._look_anew(view)
        self._draw_what_moved(view)
        self._last = self._now.copy()
        if self._close_up is not None:
            self._put_close_up(self._close_up, self._last)
        bar = Image.fromarray(self._last[-BAR:])
        pen = ImageDraw.Draw(bar, "RGBA")
        pen.rectangle((0, 0, width, BAR), fill=(20, 24, 28, 200))
        colour = {None: "white", True: "#7fd99a", False: "#ff9a8a"}[good]
        pen.text((16, BAR // 2), left, font=self._font, fill="white", anchor="lm")
        pen.text((width - 16, BAR // 2), right, font=self._font, fill=colour, anchor="rm")
        self._last[-BAR:] = np.asarray(bar)
        self._writer.send(self._last)

    def _put_close_up(self, camera: Camera, picture: Picture) -> None:
        width, height = SIZE[0] // INSET[0], SIZE[1] // INSET[1]
        if self._count % INSET_EVERY == 0:
            fine = round(FINER * width), round(FINER * height)
            seen = self._quick.render(dataclasses.replace(camera, width=fine[0], height=fine[1]))
            small = Image.fromarray(seen).resize((width, height), Image.Resampling.BOX)
            self._inset = np.asarray(small)
        self._count += 1
        right, end = SIZE[0] - GAP, SIZE[1] - BAR - GAP
        picture[end - height - 2 * EDGE : end, right - width - 2 * EDGE : right] = 255
        picture[end - height - EDGE : end - EDGE, right - width - EDGE : right - EDGE] = self._inset

    def _look_anew(self, view: Camera) -> None:
        self._view, self._now = view, self._smooth.render(view).copy()
        self._first, self._jagged = self._now.copy(), self._quick.render(view)
        self._small = self._empty = self._coarse(view)

    def _coarse(self, view: Camera) -> npt.NDArray[np.int16]:
        size = view.width // COARSE, view.height // COARSE
        return self._quick.render(dataclasses.replace(view, width=size[0], height=size[1])).astype(
            np.int16
        )

    def _draw_what_moved(self, view: Camera) -> None:
        small = self._coarse(view)
        moved = (np.abs(small - self._small) > UNLIKE).any(axis=2)
        self._small = small
        if not moved.any():
            return
        left, right = _span(np.flatnonzero(moved.any(axis=0)), view.width)
        top, end = _span(np.flatnonzero(moved.any(axis=1)), view.height)
        end = min(max(end, top + TALL), view.height)
        top = max(min(top, end - TALL), 0)
        drawn = self._quick.render(_window(view, left, right, top, end))
        part = slice(top, end), slice(left, right)
        unlike = (np.abs(drawn.astype(np.int16) - self._jagged[part]) > UNLIKE).any(axis=2)
        wide = np.pad(unlike, 1)  # with what lies beside it: the first picture's edges are smooth
        unlike |= wide[:-2, 1:-1] | wide[2:, 1:-1] | wide[1:-1, :-2] | wide[1:-1, 2:]
        unlike &= self._is_near_change(small)[part]  # elsewhere only the nooks' shade is another
        self._now[part] = np.where(unlike[..., None], drawn, self._first[part])

    def _is_near_change(self, small: npt.NDArray[np.int16]) -> npt.NDArray[np.bool_]:
        """Return which of the film's pixels are not, or are near what is not, as in the first picture."""
        other = (np.abs(small - self._empty) > UNLIKE).any(axis=2)
        near = binary_dilation(other, iterations=AROUND)
        return near.repeat(COARSE, axis=0).repeat(COARSE, axis=1)

    def hold(self) -> None:
        """Show the last picture a while longer."""
        for _ in range(round(HOLD * self._fps)):
            if self._last is not None:
                self._writer.send(self._last)

    def close(self) -> None:
        """Finish the file and free the renderer."""
        self._writer.close()
        self._smooth.close()
        self._quick.close()


def _span(moved: npt.NDArray[np.intp], limit: int) -> tuple[int, int]:
    """Return between which of the film's pixels those of the coarse picture lie, and some around them."""
    low, high = (int(moved[0]) - AROUND) * COARSE, (int(moved[-1]) + 1 + AROUND) * COARSE
    return max(low, 0), min(high, limit)


def _window(view: Camera, left: int, right: int, top: int, end: int) -> Camera:
    """Return the camera that sees some of the pixels that another sees."""
    share = (end - top) / view.height
    fov = 2 * math.atan(share * math.tan(math.radians(view.fov_deg) / 2))
    middle = 0.5 * (view.width - 1) - left, 0.5 * (view.height - 1) - top
    wide, tall = right - left, end - top
    return dataclasses.replace(
        view, fov_deg=math.degrees(fov), center=middle, width=wide, height=tall
    )
