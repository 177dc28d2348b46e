"""Draw the coach: each exercise of a session at its height, and the behaviour tree at work.

python experiments/coaching_pictures.py --recipient natalia --video runs/coaching.mp4
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import rcare_marl
from rcare_marl.agents.policies.tree_picture import TreePicture
from rcare_marl.baselines.scripted.social_coaching import ScriptedCoaching
from rcare_marl.cli.film import Film
from rcare_marl.envs.tasks.social_coaching import SocialCoaching
from rcare_marl.rendering import make_renderer

SIZE = (480, 360)  # [pixel] of a picture
QUALITY, ENOUGH = 86, 0.9  # of the way through a repetition, when its picture is taken
OUT = Path(__file__).resolve().parents[1] / "docs" / "images"


def draw(recipient: str, robot: str, out: Path, video: Path | None, seed: int) -> None:
    """Play a session and write its pictures into the folder `out`."""
    env = rcare_marl.make(
        "social_coaching", recipient=recipient, robot=robot, options={"repetitions": 1},
        policies={"robot": "scripted", "recipient": "learner"},
    )  # fmt: skip
    task, coach = env.task, env.policies["robot"]
    assert isinstance(task, SocialCoaching) and isinstance(coach, ScriptedCoaching)
    env.reset(seed=seed)
    renderer = make_renderer(env.world)
    sharp = replace(task.view(), width=2 * SIZE[0], height=2 * SIZE[1])
    shots: dict[int, Image.Image] = {}
    film = None
    if video is not None:
        video.parent.mkdir(parents=True, exist_ok=True)
        film = Film(video, env.world, fps=1 / task.control_dt)
    while not env.is_over:
        env.step({})
        session = task.session
        judged = session.judgement
        if film is not None:
            said = task.body.said[-1] if task.demonstration.is_speaking else ""
            state = "follows" if judged.following else "watches"
            count = f"{task.right_count} of {sum(session.wanted)} right, {state}"
            film.add(task.view(), said, count, good=judged.following or None)
        if judged.following and judged.progress > ENOUGH and session.index not in shots:
            picture = Image.fromarray(renderer.render(sharp))
            shots[session.index] = picture.resize(SIZE, Image.Resampling.LANCZOS)
            if len(shots) == 1:
                tree = TreePicture(coach.tree.root, title=f"The coach of {recipient}")
                tree.save(out / "coaching_tree.png")
    sheet = np.hstack([np.asarray(shots[k]) for k in sorted(shots)])
    Image.fromarray(sheet).save(out / "coaching.jpg", quality=QUALITY)
    if film is not None:
        film.hold()
        film.close()
    env.close()


def main() -> None:
    """Draw them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recipient", default="natalia")
    parser.add_argument("--robot", default="nao")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--video", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    draw(given.recipient, given.robot, given.out, given.video, given.seed)


if __name__ == "__main__":
    main()
