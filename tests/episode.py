"""One episode from start to end, for the tests of tasks."""

from __future__ import annotations

from rcare_marl.envs.care_env import CareEnv


def play(env: CareEnv, seed: int) -> None:
    """Run an episode in which policies play all roles."""
    env.reset(seed=seed)
    while not env.is_over:
        env.step({})
