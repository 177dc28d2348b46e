"""A film of episodes: one picture a control step, with a caption, as an MP4."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import numpy.typing as npt
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

from rcare_marl.rendering import Camera, make_renderer
from rcare_marl.world import World

SIZE = (960, 720)  # [pixel], even as the codec wants
QUALITY = 8  # of 10, in imageio-ffmpeg's scale
BAR = 46  # [pixel] height of the caption
FONT_SIZE = 20  # [pixel]
HOLD = 1.0  # [s] that the last picture of an episode stays

Picture = npt.NDArray[np.uint8]


class Film:
    """An MP4 in the making; close it before the file is used."""

    def __init__(self, path: Path, world: World, *, fps: float) -> None:
        """Begin.

        Args:
            path: The file.
            world: What to film.
            fps: Pictures a second; the control rate gives real time.
        """
        self._fps = fps
        self._font = ImageFont.truetype(font_manager.findfont("DejaVu Sans"), FONT_SIZE)
        self._renderer = make_renderer(world)
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
        image = Image.fromarray(self._renderer.render(view))
        pen = ImageDraw.Draw(image, "RGBA")
        pen.rectangle((0, height - BAR, width, height), fill=(20, 24, 28, 200))
        middle = height - BAR // 2
        colour = {None: "white", True: "#7fd99a", False: "#ff9a8a"}[good]
        pen.text((16, middle), left, font=self._font, fill="white", anchor="lm")
        pen.text((width - 16, middle), right, font=self._font, fill=colour, anchor="rm")
        self._last = np.asarray(image)
        self._writer.send(np.ascontiguousarray(self._last))

    def hold(self) -> None:
        """Show the last picture a while longer."""
        for _ in range(round(HOLD * self._fps)):
            if self._last is not None:
                self._writer.send(np.ascontiguousarray(self._last))

    def close(self) -> None:
        """Finish the file and free the renderer."""
        self._writer.close()
        self._renderer.close()
