"""Draw docs/images/tasks.jpg: every task before and after an episode of the scripted robot.

python experiments/task_pictures.py [--out FILE] [--task NAME ...] [--seed N]

A task with a site of its own, such as a door, is drawn at each level. What is drawn is what was simulated:
the second picture is that of the last step of the episode.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import rcare_marl
from rcare_marl.agents.agent import Agent
from rcare_marl.agents.human import Human
from rcare_marl.agents.robot import Robot
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.homes.rule import LEVELS
from rcare_marl.envs.registry import task_class
from rcare_marl.errors import UnknownNameError
from rcare_marl.rendering import make_renderer

SIZE = (480, 360)  # [pixel] of a picture
BAND, GAP, COLUMNS, QUALITY = 34, 6, 2, 86  # pairs in a row
OUT = Path(__file__).resolve().parents[1] / "docs" / "images" / "tasks.jpg"


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


def shot(env: CareEnv) -> Image.Image:
    """Return a picture of the scene as it is."""
    renderer = make_renderer(env.world)
    picture = renderer.render(replace(env.task.view(), width=2 * SIZE[0], height=2 * SIZE[1]))
    renderer.close()
    return Image.fromarray(picture).resize(SIZE, Image.Resampling.LANCZOS)


def model(agent: Agent) -> str:
    """Return who plays a role."""
    if isinstance(agent, Human):
        return agent.avatar.name
    assert isinstance(agent, Robot)
    return agent.files.model.name


def pair(task: str, place: dict[str, Any], seed: int) -> Image.Image:
    """Play an episode and return the pictures of its start and end side by side, with a title."""
    env = rcare_marl.make(task, policies=partners(task), **place)
    env.reset(seed=seed)
    before = shot(env)
    while not env.is_over:
        env.step({})
    after = shot(env)
    end = "success" if env.task.is_success() else "no success"
    who = ", ".join(model(agent) for agent in env.cast.values())
    where = "".join(f", {key} {value}" for key, value in place.items())
    title = f"{task.replace('_', ' ')}{where}: {who}"
    note = f"{end} after {env.world.time:.1f} s"
    env.close()
    sheet = Image.new("RGB", (2 * SIZE[0] + GAP, SIZE[1] + BAND), "white")
    sheet.paste(before, (0, BAND))
    sheet.paste(after, (SIZE[0] + GAP, BAND))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(20)
    draw.text((4, 5), title, fill="black", font=font)
    draw.text((2 * SIZE[0] + GAP - 4, 5), note, fill="black", font=font, anchor="ra")
    return sheet


def draw(tasks: Sequence[str], out: Path, seed: int) -> None:
    """Draw all pairs on one sheet."""
    pairs = [pair(task, place, seed) for task, place in scenes(tasks)]
    width, height = pairs[0].size
    rows = -(-len(pairs) // COLUMNS)
    sheet = np.full((rows * (height + GAP), COLUMNS * (width + 3 * GAP), 3), 255, np.uint8)
    for i, picture in enumerate(pairs):
        y, x = (i // COLUMNS) * (height + GAP), (i % COLUMNS) * (width + 3 * GAP)
        sheet[y : y + height, x : x + width] = np.asarray(picture)
    Image.fromarray(sheet).save(out, quality=QUALITY)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--task", action="append", default=[])
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    known = rcare_marl.task_names()
    for name in arguments.task:
        if name not in known:
            raise UnknownNameError("task", name, known)
    draw(arguments.task or known, arguments.out, arguments.seed)
