"""Episodes for the tests of tasks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rcare_marl.envs.care_env import CareEnv


def play(env: CareEnv, seed: int) -> None:
    """Run an episode in which policies play all roles."""
    env.reset(seed=seed)
    while not env.is_over:
        env.step({})


def rollout(env: CareEnv, seed: int, steps: int = 25) -> Iterator[list[np.ndarray]]:
    """Yield all that comes out of an episode of seeded random actions, step by step."""
    observations, _ = env.reset(seed=seed)
    rng = np.random.default_rng(seed)
    yield [env.state(), *observations.values()]
    for _ in range(steps):
        if env.is_over:
            return
        actions = {
            role: rng.uniform(-1, 1, env.action_space(role).shape).astype(np.float32)
            for role in env.agents
        }
        observations, rewards, _, _, infos = env.step(actions)
        numbers = [float(v) for info in infos.values() for v in info.values()]
        yield [env.state(), *observations.values(), np.array([*rewards.values(), *numbers])]


def assert_same(a: list[list[np.ndarray]], b: list[list[np.ndarray]]) -> None:
    assert len(a) == len(b)
    for x, y in zip(a, b, strict=True):
        for left, right in zip(x, y, strict=True):
            np.testing.assert_array_equal(left, right)
