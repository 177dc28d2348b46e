"""The command `play`: episodes on a live page."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from rcare_marl.baselines.evaluation import evaluate as baseline
from rcare_marl.baselines.trained import best_policy
from rcare_marl.console import print_line
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv


def play(
    task: str,
    policy: str | None,
    role_policies: Mapping[str, str],
    *,
    episodes: int,
    seed: int,
    options: Mapping[str, Any],
    cast: Mapping[str, Any],
) -> None:
    """Show episodes until Ctrl-C, or `episodes` of them if not 0; the page keeps real time.

    Without a `policy` the robot plays what it was trained, where that ships, and its script elsewhere.
    """
    others = baseline.lead_policies(
        task, policy or "", role_policies
    )  # unknown names before all else
    played = baseline.played_cast(task, cast, others)
    env = make(task, options=options, render_mode="human", **played)
    told: list[str] = []

    def tell(env: CareEnv) -> None:
        if not told and env.viewer_url is not None:
            told.append(env.viewer_url)
            print_line(f"watch at {env.viewer_url}  (Ctrl-C ends)")

    try:
        chosen = policy or best_policy(env, task)
        policies = baseline.lead_policies(task, chosen, role_policies)
        print_line(f"{task}, {chosen}")
        _, players = baseline.make_players(env, task, policies)
        for number in range(episodes) if episodes else itertools.count():
            episode = baseline.run_episode(env, players, seed + number, on_step=tell)
            outcome = "success" if episode.success else "no success"
            print_line(f"episode {number}: {outcome} after {episode.duration:.1f} s")
    except KeyboardInterrupt:  # the way to end it, so no failure
        print_line("stopped")
    finally:
        env.close()
