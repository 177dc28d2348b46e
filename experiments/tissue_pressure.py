"""Draw a sphere that presses a forearm, the skin painted by pressure: a picture and a short film.

Run: python experiments/tissue_pressure.py [--out FOLDER] [--avatar NAME]

Writes tissue_pressure.png and tissue_pressure.mp4. The person sits; the sphere of 20 mm radius goes 12 mm
deep into the flesh, slides 4 cm along the forearm and leaves.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import typer
from PIL import Image

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.body.tissue import Tissue
from rcare_marl.agents.people.human import Human
from rcare_marl.body import Body
from rcare_marl.pose import Array, Pose
from rcare_marl.rendering import Camera
from rcare_marl.rendering.film import Film
from rcare_marl.rendering.portrait import snapshot
from rcare_marl.world import World

JOINT = "left_elbow"
RADIUS = 0.02  # [m]
DEPTH = 0.012  # [m]
SLIDE = 0.04  # [m]
FPS = 30
STEPS = 8  # physics steps a picture, so that the film runs in real time
PRESS, HOLD, MOVE, LEAVE = 24, 12, 40, 24  # pictures


def make_scene(avatar_name: str) -> tuple[World, Tissue, Body]:
    """Return a seated person with flesh on the left arm, and the sphere."""
    world = World()
    avatar, posture = load_avatar(avatar_name), load_posture("wheelchair")
    person = Human("person", avatar, posture=posture, movable=(), tissue=("left_arm",))
    person.spawn(world, Pose((0, 0, 0.5)))
    tissue = person.tissue
    assert tissue is not None
    tissue.show_pressure()
    ball = world.add_sphere(RADIUS, Pose((5, 5, 5)), rgba=(0.5, 0.6, 0.7, 0.35))
    return world, tissue, ball


def path(tissue: Tissue) -> list[tuple[Array, Array]]:
    """Return where the middle of the sphere is in each picture [m], and the way out of the flesh."""
    point, out = tissue.skin_point(JOINT, (0.3, 0.3, 1.0), along=0.45)
    further, _ = tissue.skin_point(JOINT, (0.3, 0.3, 1.0), along=0.75)
    along = (further - point) / np.linalg.norm(further - point)
    gaps = [0.02 - (0.02 + DEPTH) * min(k / PRESS, 1.0) for k in range(PRESS + HOLD)]
    middles = [point + (RADIUS + gap) * out for gap in gaps]
    middles += [middles[-1] + SLIDE * (k + 1) / MOVE * along for k in range(MOVE)]
    middles += [middles[-1] + 0.06 * (k + 1) / LEAVE * out for k in range(LEAVE)]
    return [(middle, out) for middle in middles]


def main(out: Path = Path("runs/tissue_pressure"), avatar: str = "karan") -> None:
    """Draw the pressure of a sphere on a forearm: the picture and the film."""
    out.mkdir(parents=True, exist_ok=True)
    world, tissue, ball = make_scene(avatar)
    course = path(tissue)
    middle, way = course[PRESS + HOLD]
    side = np.cross(way, (0.0, 0.0, 1.0)) + (0.4, 0.0, 0.0)
    eye = middle + 0.28 * way + 0.16 * side
    camera = Camera(eye=tuple(eye), target=tuple(middle - 0.02 * way), width=960, height=720)
    film = Film(out / "tissue_pressure.mp4", world, fps=FPS)
    here = course[0][0]
    for k, (there, _) in enumerate(course):
        for step in range(STEPS):
            at = here + (there - here) * (step + 1) / STEPS
            ball.set_base(Pose(tuple(at.tolist())))
            world.step()
        here = there
        force = sum(tissue.contact_forces().values())
        peak = float(tissue.pressure().max()) / 1e3
        film.add(camera, f"force {force:5.1f} N", f"greatest pressure {peak:5.1f} kPa")
        if k == PRESS + HOLD - 1:
            Image.fromarray(snapshot(world, camera)).save(out / "tissue_pressure.png")
    film.close()


if __name__ == "__main__":
    typer.run(main)
