"""The command `demo`: seeded feeding episodes; a table, a film, a figure and a record of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from rich.text import Text

from rcare_marl.atomic_file import draft
from rcare_marl.baselines.evaluation import evaluate as baseline
from rcare_marl.baselines.evaluation.episode_figure import Recorder, draw
from rcare_marl.baselines.trained import best_policy
from rcare_marl.console import console, progress, table
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.scenes.meal import MOUTH_RADIUS
from rcare_marl.envs.task_options import FORCE_LIMIT
from rcare_marl.errors import ConfigError
from rcare_marl.rendering.film import Film

from .assessment import successes

TASK = "feeding"
FILMED = 3  # episodes
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
            film = None
            try:
                if video:
                    film = Film(folder.path / VIDEO, env.world, fps=1 / env.task.control_dt)
                done, records = _run_episodes(env, players, episodes, seed, film)
            finally:
                if film is not None:
                    film.close()
            models = baseline.model_names(env)
            config = {
                "physics_dt_s": env.world.physics_dt,
                "control_dt_s": env.task.control_dt,
                "time_limit_s": env.task.time_limit,
                "agents": {role: agent.describe() for role, agent in env.cast.items()},
            }
        result = baseline.Evaluation(TASK, names, models, {}, seed, tuple(done))
        record = {
            "config": config,
            "summary": result.to_dict(),
            "episodes": [
                {**episode.to_dict(), "series": series.to_dict()}
                for episode, series in zip(done, records, strict=True)
            ],
        }
        (folder.path / RECORD).write_text(json.dumps(record, allow_nan=False) + "\n", "utf-8")
        who = f"{models['robot']} ({chosen}) feeds {models['recipient']}"
        title = f"Feeding: {who}, {len(done)} episodes"
        draw(
            folder.path / PLOT,
            done,
            records,
            title=title,
            reach=MOUTH_RADIUS,
            force_limit=FORCE_LIMIT,
        )
        where = folder.publish()
    _show(result, title, [where / name for name in (VIDEO, PLOT, RECORD)][0 if video else 1 :])


def _run_episodes(
    env: CareEnv,
    players: Mapping[str, Any],
    count: int,
    seed: int,
    film: Film | None,
) -> tuple[list[baseline.Episode], list[Recorder]]:
    done: list[baseline.Episode] = []
    records: list[Recorder] = []
    with progress("feeding") as bar:
        job = bar.add_task("", total=count)
        for number in range(count):
            record = Recorder()
            shot = film if number < FILMED else None
            bar.update(job, description="with video" if shot else "")

            def on_step(env: CareEnv, record: Recorder = record, shot: Film | None = shot) -> None:
                record(env)
                if shot is not None:
                    _film_step(shot, env, f"episode {len(done) + 1} of {count}")

            done.append(baseline.run_episode(env, players, seed + number, on_step=on_step))
            records.append(record)
            bar.advance(job)
    return done, records


def _film_step(film: Film, env: CareEnv, title: str) -> None:
    metrics = env.task.report()
    left = f"{title}   {env.world.time:4.1f} s"
    right = (
        f"spoon to mouth {100 * metrics['distance_m']:.1f} cm   force {metrics['force_n']:.1f} N"
    )
    if not env.is_over:
        film.add(env.task.view(), left, right)
        return
    good = env.task.succeeded()
    film.add(env.task.view(), left, "success" if good else "no success", good=good)
    film.hold()


def _show(result: baseline.Evaluation, title: str, files: Sequence[Path]) -> None:
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
    screen = console()
    screen.print(out)
    for file in files:
        screen.print(Text(str(file)), soft_wrap=True)


def seconds(value: float | None) -> str:
    """Return a time as a text, a dash where there is none."""
    return "-" if value is None else f"{value:.1f} s"
