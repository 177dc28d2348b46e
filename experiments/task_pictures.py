"""Draw pictures of tasks for docs/images: tasks, phyrc, bathing, meal and faces.jpg, and meal.gif.

python experiments/task_pictures.py [--out FOLDER] [--task NAME ...] [--seed N]
python experiments/task_pictures.py [--out FOLDER] --film runs/demo-1/feeding.mp4

tasks.jpg has every task before and after an episode of the scripted robot; one with a site of its own, such
as a door, at each level. phyrc.jpg and bathing.jpg show three moments of an episode. What is drawn is what
was simulated. faces.jpg has six people. With --task only these tasks are drawn, into tasks.jpg. With --film
meal.jpg and meal.gif are taken out of the film of `make demo`, and nothing else is drawn.
"""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import typer

import rcare_marl
from rcare_marl.agents.agent import Agent
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.envs.homes import LEVELS
from rcare_marl.envs.registry import task_class
from rcare_marl.envs.tasks.bathing import Bathing
from rcare_marl.errors import check_name
from rcare_marl.rendering import Camera
from rcare_marl.rendering.portrait import Picture, contact_sheet, snapshot

SIZE = (480, 360)  # [pixel] of a picture
GAP, QUALITY = 6, 86
OUT = Path(__file__).resolve().parents[1] / "docs" / "images"
STILL = {"robot": "scripted", "recipient": "still"}
PHYRC = {"phyrc_bathing": (0.5, 10.0, 40.0), "phyrc_dressing": (0.5, 9.5, 20.0)}  # [s]
PHYRC_SEED = 1
HERO_WIDTH, GIF_WIDTH, GIF_RATE, GIF_SECONDS = 1280, 720, 10, 10.0  # [pixel], [pixel], [1/s], [s]
AT_MOUTH = 2.6  # [s] into the film
FACE_SIZE = (420, 420)  # [pixel]
PEOPLE = ("daniel", "jose", "karan", "kim", "morgan", "natalia")
WIPED = (0.0, 0.3, 0.75)  # of the upper side of the arm when a picture is taken


def scenes(tasks: Sequence[str]) -> list[tuple[str, dict[str, Any]]]:
    """Return name and arguments of each pair of pictures."""
    found: list[tuple[str, dict[str, Any]]] = []
    for task in tasks:
        levels = LEVELS if task_class(task).site == "door" else ()
        found += [(task, {"level": level}) for level in levels] or [(task, {})]
    return found


def partners(task: str) -> dict[str, str]:
    """Return the policy of each role that is cast: the robot's is the scripted one."""
    roles = task_class(task).roles()
    return {n: r.partner for n, r in roles.items() if r.partner and r.default is not None}


def model(agent: Agent) -> str:
    """Return who plays a role."""
    if isinstance(agent, Human):
        return agent.avatar.name
    assert isinstance(agent, Robot)
    return agent.files.model.name


def pair(task: str, place: dict[str, Any], seed: int) -> list[tuple[Picture, str]]:
    """Play an episode and return pictures of its start and end, with captions."""
    env = rcare_marl.make(task, policies=partners(task), **place)
    env.reset(seed=seed)
    before = snapshot(env.world, env.task.view(), SIZE)
    while not env.is_over:
        env.step({})
    after = snapshot(env.world, env.task.view(), SIZE)
    end = "success" if env.task.succeeded() else "no success"
    who = ", ".join(model(agent) for agent in env.cast.values())
    where = "".join(f", {key} {value}" for key, value in place.items())
    note = f"{end} after {env.world.time:.1f} s"
    env.close()
    return [(before, f"{task.replace('_', ' ')}{where}\n{who}"), (after, f"\n{note}")]


def draw_tasks(tasks: Sequence[str], out: Path, seed: int) -> None:
    """Draw all pairs on one sheet."""
    drawn = [each for task, place in scenes(tasks) for each in pair(task, place, seed)]
    pictures, captions = zip(*drawn, strict=True)
    contact_sheet(pictures, captions, columns=4, gap=GAP).save(out, quality=QUALITY)


def draw_phyrc(out: Path) -> None:
    """Draw both PhyRC challenges at the start, on the way and at the end, a row each."""
    pictures = []
    for name, times in PHYRC.items():
        env = rcare_marl.make(name, policies=STILL)
        env.reset(seed=PHYRC_SEED)
        for time in times:
            while not env.is_over and env.world.time < time:
                env.step({})
            pictures.append(snapshot(env.world, env.task.camera(), SIZE))
        env.close()
    contact_sheet(pictures, columns=3).save(out, quality=QUALITY)


def draw_bathing(out: Path, seed: int) -> None:
    """Draw the sponge at the shoulder, half way and at the elbow: from afar above, from near below."""
    env = rcare_marl.make("bathing", policies=STILL)
    task = env.task
    assert isinstance(task, Bathing)
    env.reset(seed=seed)
    far, near = [], []
    for share in WIPED:
        while not env.is_over and task.state.covered < share:
            env.step({})
        place = task.skin.place(0.6)[0]
        eye = tuple((place + (0.42, -0.2, 0.42)).tolist())
        far.append(snapshot(env.world, task.camera(), SIZE))
        near.append(snapshot(env.world, Camera(eye, tuple(place.tolist()), fov_deg=38), SIZE))
    env.close()
    contact_sheet([*far, *near], columns=3).save(out, quality=QUALITY)


def draw_meal(film: Path, out: Path) -> None:
    """Take a picture of a spoon at the mouth and ten seconds out of the film of a demo."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", "-i", str(film)]
    moment = ["-ss", str(AT_MOUTH), "-frames:v", "1", "-vf", f"scale={HERO_WIDTH}:-1"]
    subprocess.check_call([*command, *moment, "-q:v", "4", str(out / "meal.jpg")])
    small = f"fps={GIF_RATE},scale={GIF_WIDTH}:-1:flags=lanczos"
    colours = "split[a][b];[a]palettegen=max_colors=160[p];[b][p]paletteuse=dither=none"
    part = ["-t", str(GIF_SECONDS), "-vf", f"{small},{colours}", str(out / "meal.gif")]
    subprocess.check_call([*command, *part])


def draw_faces(out: Path) -> None:
    """Draw six people in close-up."""
    pictures = []
    for name in PEOPLE:
        with rcare_marl.make("feeding", recipient=name, policies=partners("feeding")) as env:
            env.reset(seed=0)
            person = env.cast["recipient"]
            assert isinstance(person, Human)
            lips, face = person.mouth_and_face()
            aside = np.cross(face, (0.0, 0.0, 1.0))
            middle = lips + (0.0, 0.0, 0.03)
            eye = middle + 0.75 * face + 0.35 * aside + (0.0, 0.0, 0.08)
            camera = Camera(tuple(eye.tolist()), tuple(middle.tolist()), fov_deg=26)
            pictures.append(snapshot(env.world, camera, FACE_SIZE))
    names = [name.capitalize() for name in PEOPLE]
    contact_sheet(pictures, names, columns=3, gap=GAP).save(out, quality=QUALITY)


def main(
    out: Path = OUT,
    task: list[str] = [],  # noqa: B006  (typer's way)
    film: Path | None = None,
    seed: int = 0,
) -> None:
    """Draw all, or pairs of the named tasks alone, or take pictures out of a film."""
    if film is not None:
        return draw_meal(film, out)
    known = rcare_marl.task_names()
    for name in task:
        check_name("task", name, known)
    draw_tasks(task or known, out / "tasks.jpg", seed)
    if not task:
        draw_phyrc(out / "phyrc.jpg")
        draw_bathing(out / "bathing.jpg", seed)
        draw_faces(out / "faces.jpg")


if __name__ == "__main__":
    typer.run(main)
