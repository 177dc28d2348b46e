"""Draws docs/images/bathing.jpg: the sponge at the shoulder, half way and at the elbow.

Run: python experiments/bathing_pictures.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

import rcare_marl
from rcare_marl.envs.tasks.bathing import Bathing
from rcare_marl.rendering import make_renderer
from rcare_marl.rendering.camera import Camera

OUT = Path(__file__).resolve().parents[1] / "docs" / "images" / "bathing.jpg"
SHARES = (0.0, 0.3, 0.75)  # of the upper side that is wiped when a picture is taken
SEED = 0


def draw() -> None:
    """Play one episode and take a picture from afar and from near at each share."""
    env = rcare_marl.make("bathing", policies={"robot": "scripted", "recipient": "still"})
    task = env.task
    assert isinstance(task, Bathing)
    env.reset(seed=SEED)
    renderer = make_renderer(env.world)
    columns = []
    for share in SHARES:
        while not env.is_over and task.coverage() < share:
            env.step({})
        place = task.skin.place(0.6)[0]
        eye = tuple((place + (0.42, -0.2, 0.42)).tolist())
        near = Camera(eye=eye, target=tuple(place.tolist()), fov_deg=38)
        columns.append(np.vstack([renderer.render(task.camera()), renderer.render(near)]))
    renderer.close()
    env.close()
    Image.fromarray(np.hstack(columns)).resize((1440, 720)).save(OUT, quality=88)


if __name__ == "__main__":
    draw()
