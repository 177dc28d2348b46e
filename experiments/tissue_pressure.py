"""Draw a sphere that presses a forearm, the skin painted by pressure: a picture and a short film.

Run: python experiments/tissue_pressure.py [--out FOLDER] [--avatar NAME]

Writes tissue_pressure.png and tissue_pressure.mp4. The person sits; the sphere of 20 mm radius goes 12 mm
deep into the flesh, slides 4 cm along the forearm and leaves.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from rcare_marl import assets
from rcare_marl.agents.avatar import body_model, load_avatar, load_posture, person_urdf
from rcare_marl.agents.body.posture import pelvis_pose
from rcare_marl.agents.body.skin import JointFrame, PersonSkin
from rcare_marl.agents.body.tissue import Tissue, attach_tissue
from rcare_marl.body import Body
from rcare_marl.cache import cached
from rcare_marl.cli.film import Film
from rcare_marl.pose import Pose
from rcare_marl.rendering import Camera, make_renderer
from rcare_marl.world import World

JOINT = "left_elbow"
RADIUS = 0.02  # [m]
DEPTH = 0.012  # [m]
SLIDE = 0.04  # [m]
FPS = 30
STEPS = 8  # physics steps a picture, so that the film runs in real time
PRESS, HOLD, MOVE, LEAVE = 24, 12, 40, 24  # pictures

Array = npt.NDArray[np.float64]


def make_scene(avatar_name: str) -> tuple[World, Tissue, Body]:
    """Return a seated person with flesh on the left arm, and the sphere."""
    world, avatar = World(), load_avatar(avatar_name)
    posture, model = load_posture("wheelchair"), body_model(avatar.body_path(), avatar.height_m)
    angles = posture.angles(avatar.profile.limits("passive"))
    urdf = person_urdf(avatar, "passive", movable=(), posture=angles, tissue=("left_arm",))
    file = cached(f"{avatar_name}_flesh", ".urdf", urdf.text)
    body = world.load_urdf(file, pelvis_pose(posture, model, angles, Pose((0, 0, 0.5))))
    frames = [JointFrame(body.link_index(f.link), f.rotation, f.offset) for f in urdf.frames]
    skin = PersonSkin(model, body, frames)
    world.skins.append(skin)
    tissue = attach_tissue(world, body, model, frames, ("left_arm",), skin=skin)
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


def main() -> None:
    """Write the picture and the film."""
    parser = argparse.ArgumentParser(description="Draw the pressure of a sphere on a forearm.")
    parser.add_argument("--out", type=Path, default=Path("runs/tissue_pressure"))
    parser.add_argument("--avatar", default="karan", choices=assets.names("avatars"))
    chosen = parser.parse_args()
    folder: Path = chosen.out
    folder.mkdir(parents=True, exist_ok=True)
    world, tissue, ball = make_scene(chosen.avatar)
    course = path(tissue)
    middle, out = course[PRESS + HOLD]
    side = np.cross(out, (0.0, 0.0, 1.0)) + (0.4, 0.0, 0.0)
    eye = middle + 0.28 * out + 0.16 * side
    camera = Camera(eye=tuple(eye), target=tuple(middle - 0.02 * out), width=960, height=720)
    film = Film(folder / "tissue_pressure.mp4", world, fps=FPS)
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
            renderer = make_renderer(world)
            picture = renderer.render(camera)
            renderer.close()
            Image.fromarray(picture).save(folder / "tissue_pressure.png")
    film.close()


if __name__ == "__main__":
    main()
