"""Draw the coach: each exercise of a session at its height, and the behaviour tree at work; or a group.

python experiments/coaching_pictures.py --recipient natalia
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from PIL import Image

import rcare_marl
from rcare_marl.agents.people.behaviour.tree_picture import TreePicture
from rcare_marl.baselines.scripted.social_coaching import ScriptedCoaching
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.coaching.coaching_task import CoachingTask
from rcare_marl.envs.tasks.group_coaching import RECIPIENTS
from rcare_marl.envs.tasks.social_coaching import SocialCoaching
from rcare_marl.rendering.portrait import Picture, contact_sheet, snapshot

SIZE = (480, 360)  # [pixel] of a picture
QUALITY, ENOUGH = 86, 0.9  # of the way through a repetition, when its picture is taken
OUT = Path(__file__).resolve().parents[1] / "docs" / "images"
TOGETHER = 0.4  # of the way that everybody of a group has gone, when its picture is taken
GROUP = ("daniel", "kim", "karan", "natalia")


def session(robot: str, repetitions: int, *recipients: str) -> CareEnv:
    """Return a session of one person, or of a group."""
    cast: dict[str, Any] = dict(zip(RECIPIENTS, recipients, strict=False))
    policies = {"robot": "scripted", **dict.fromkeys(cast, "learner")}
    task = "group_coaching" if len(cast) > 1 else "social_coaching"
    return rcare_marl.make(
        task, options={"repetitions": repetitions}, policies=policies, robot=robot, **cast
    )


def draw(recipient: str, robot: str, out: Path, seed: int) -> None:
    """Play a session and write its pictures into the folder `out`."""
    env = session(robot, 1, recipient)
    task, coach = env.task, env.policies["robot"]
    assert isinstance(task, SocialCoaching) and isinstance(coach, ScriptedCoaching)
    env.reset(seed=seed)
    shots: dict[int, Picture] = {}
    while not env.is_over:
        env.step({})
        lesson = task.session
        judged = lesson.judgement
        if judged.following and judged.progress > ENOUGH and lesson.index not in shots:
            shots[lesson.index] = snapshot(env.world, task.view(), SIZE)
            if len(shots) == 1:
                tree = TreePicture(coach.tree.root, title=f"The coach of {recipient}")
                tree.save(out / "coaching_tree.png")
    pictures = [shots[k] for k in sorted(shots)]
    contact_sheet(pictures, columns=len(shots)).save(out / "coaching.jpg", quality=QUALITY)
    env.close()


def draw_group(robot: str, out: Path, seed: int) -> None:
    """Write a picture of a group class in its first exercise."""
    env = session(robot, 3, *GROUP)
    task = env.task
    assert isinstance(task, CoachingTask)
    env.reset(seed=seed)
    while not env.is_over and task.session.judgement.progress < TOGETHER:
        env.step({})
    picture = snapshot(env.world, task.view(), (2 * SIZE[0], 2 * SIZE[1]))
    Image.fromarray(picture).save(out / "group_coaching.jpg", quality=QUALITY)
    env.close()


def main(
    recipient: str = "natalia",
    robot: str = "nao",
    out: Path = OUT,
    group: Annotated[bool, typer.Option("--group", help="a group of four")] = False,
    seed: int = 0,
) -> None:
    """Draw the coach of a person, or of a group."""
    if group:
        draw_group(robot, out, seed)
    else:
        draw(recipient, robot, out, seed)


if __name__ == "__main__":
    typer.run(main)
