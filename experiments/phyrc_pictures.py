"""Draws docs/images/phyrc.jpg: both PhyRC challenges at the start, on the way and at the end.

Run: python experiments/phyrc_pictures.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

import rcare_marl
from rcare_marl.rendering import make_renderer

OUT = Path(__file__).resolve().parents[1] / "docs" / "images" / "phyrc.jpg"
TIMES = {"phyrc_bathing": (0.5, 10.0, 40.0), "phyrc_dressing": (0.5, 9.5, 20.0)}  # [s]
SEED = 1


def draw() -> None:
    """Play one episode of each challenge and take pictures at its times, a row each."""
    rows = []
    for name, times in TIMES.items():
        env = rcare_marl.make(name, policies={"robot": "scripted", "recipient": "still"})
        env.reset(seed=SEED)
        renderer = make_renderer(env.world)
        row = []
        for time in times:
            while not env.is_over and env.world.time < time:
                env.step({})
            row.append(renderer.render(env.task.camera()))
        rows.append(np.hstack(row))
        renderer.close()
        env.close()
    Image.fromarray(np.vstack(rows)).resize((1440, 720)).save(OUT, quality=88)


if __name__ == "__main__":
    draw()
