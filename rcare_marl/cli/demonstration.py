"""The command `demo`: seeded feeding episodes; a table, a film, a figure and a record of them."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from rich.text import Text

from rcare_marl.agents.people.human import Human
from rcare_marl.atomic_file import draft
from rcare_marl.baselines.evaluation import evaluate as baseline
from rcare_marl.baselines.evaluation.episode_figure import Recorder, draw
from rcare_marl.baselines.trained import best_policy
from rcare_marl.console import console, print_line, progress, table
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.scenes.meal import MOUTH_RADIUS
from rcare_marl.envs.task_options import FORCE_LIMIT
from rcare_marl.envs.tasks.feeding import Feeding
from rcare_marl.errors import ConfigError
from rcare_marl.rendering import Camera
from rcare_marl.rendering.film import Film

from .assessment import successes

TASK = "feeding"
# Of the film: a meal, where, and how often a second there is a picture; our own choices.
MEAL: dict[str, Any] = {"options": {"bites": 3}, "home": "house_06", "room": "dining_1"}
PICTURES = 30  # [1/s]
FOLDER = Path("runs") / "demo"
VIDEO, PLOT, RECORD = "feeding.mp4", "feeding.png", "feeding.json"


def run(
    *,
    episodes: int,
    seed: int,
    output: Path | None,
    video: bool,
    policy: str | None,
    cast: Mapping[str, Any],
) -> None:
    """Run the demo and leave its files, or none if it ends early; arguments as for the command."""
    with draft(output or FOLDER, numbered=output is None) as folder:
        with closing(make(TASK, **cast)) as env:
            if env.company is not None:
                raise ConfigError("the demo shows one person, such as population:test:17")
            chosen = policy or best_policy(env, TASK)
            names, players = baseline.make_players(env, TASK, baseline.lead_policies(TASK, chosen))
            done, records = _run_episodes(env, players, episodes, seed)
            models = baseline.model_names(env)
            config = {
                "physics_dt_s": env.world.physics_dt,
                "control_dt_s": env.task.control_dt,
                "time_limit_s": env.task.time_limit,
                "agents": {role: agent.describe() for role, agent in env.cast.items()},
            }
        result = baseline.Evaluation(TASK, names, models, {}, seed, tuple(done))
        who = f"{models['robot']} ({chosen}) feeds {models['recipient']}"
        title = f"Feeding: {who}, {len(done)} episodes"
        _show(result, title)
        record = {
            "config": config,
            "summary": result.to_dict(),
            "episodes": [
                {**episode.to_dict(), "series": series.to_dict()}
                for episode, series in zip(done, records, strict=True)
            ],
        }
        (folder.path / RECORD).write_text(json.dumps(record, allow_nan=False) + "\n", "utf-8")
        if video:
            print_line(
                "filming a meal; this takes minutes without a graphics card (not with --no-video)"
            )
            _film_meal(folder.path / VIDEO, seed, cast)
        draw(
            folder.path / PLOT,
            done,
            records,
            title=title,
            reach=MOUTH_RADIUS,
            force_limit=FORCE_LIMIT,
        )
        where = folder.publish()
    for name in (VIDEO, PLOT, RECORD)[0 if video else 1 :]:
        console().print(Text(str(where / name)), soft_wrap=True)


def _run_episodes(
    env: CareEnv, players: Mapping[str, Any], count: int, seed: int
) -> tuple[list[baseline.Episode], list[Recorder]]:
    done: list[baseline.Episode] = []
    records: list[Recorder] = []
    with progress("feeding") as bar:
        job = bar.add_task("", total=count)
        for number in range(count):
            records.append(Recorder())
            done.append(baseline.run_episode(env, players, seed + number, on_step=records[-1]))
            bar.advance(job)
    return done, records


def _film_meal(path: Path, seed: int, cast: Mapping[str, Any]) -> None:
    """Film the scripted robot at a meal of several bites, in a dining room."""
    policies = {"robot": "scripted", "recipient": "cooperative"}
    with make(TASK, policies=policies, **MEAL, **cast) as env, progress("filming") as bar:
        env.reset(seed=seed)
        film = Film(path, env.world, fps=PICTURES, close_up=_at_mouth(env))
        each, steps = round(1 / (PICTURES * env.world.physics_dt)), itertools.count(1)

        def look() -> None:
            if next(steps) % each == 0:
                _film(film, env)

        setattr(env.task, "after_substep", look)  # noqa: B010  (feeding has none of its own)
        job = bar.add_task("a meal", total=env.task.time_limit)
        try:
            while not env.is_over:
                env.step({})
                bar.update(job, completed=env.world.time)
            _film(film, env)
            film.hold()
        finally:
            film.close()


def _at_mouth(env: CareEnv) -> Camera:
    """Return a camera that sees mouth and spoon from the side."""
    person = env.cast["recipient"]
    assert isinstance(person, Human)
    lips, face = person.mouth_and_face()
    eye = lips + 0.35 * (face + np.cross(face, (0.0, 0.0, 1.0))) + (0.0, 0.0, 0.05)
    return Camera(tuple(eye.tolist()), tuple((lips + 0.06 * face).tolist()), fov_deg=28)


def _film(film: Film, env: CareEnv) -> None:
    task = env.task
    assert isinstance(task, Feeding)
    seen, bites = task.state, task.options.bites
    bite = min(seen.mouthful.swallowed + 1, bites)
    left = f"bite {bite} of {bites}   {env.world.time:4.1f} s"
    right = f"spoon to mouth {100 * seen.distance:.1f} cm   force {task.report()['force_n']:.1f} N"
    if env.is_over:
        good = task.succeeded()
        film.add(task.view(), left, "eaten" if good else "not eaten", good=good)
    else:
        film.add(task.view(), left, right)


def _show(result: baseline.Evaluation, title: str) -> None:
    columns = ("episode", "seed", "success", "time to mouth", "peak force", "food spilled")
    rows = []
    for number, episode in enumerate(result.episodes, 1):
        facts = episode.to_dict()["metrics"]
        rows.append(
            (
                str(number),
                str(episode.seed),
                "yes" if episode.success else "no",
                seconds(facts["time_to_mouth_s"]),
                f"{facts['peak_force_n']:.1f} N",
                f"{facts['spilled']:.0f}",
            )
        )
    numbers = result.to_dict()
    right = dict.fromkeys(("episode", "seed", "time to mouth", "peak force", "food spilled"), True)
    out = table(title, columns, rows, **right)
    out.add_section()
    out.add_row(
        "all",
        "",
        successes(result),
        f"mean {seconds(numbers['time_to_mouth_s_mean'])}",
        f"max {numbers['peak_force_n']:.1f} N",
        f"{numbers['spilled']:.0f}",
        style="bold",
    )
    console().print(out)


def seconds(value: float | None) -> str:
    """Return a time as a text, a dash where there is none."""
    return "-" if value is None else f"{value:.1f} s"
