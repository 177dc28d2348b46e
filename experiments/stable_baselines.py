"""Train a robot with Stable-Baselines3 on the Gymnasium form, and say how often it then succeeds.

Nothing of ours stands between: the other roles are played by policies, and the rest is a Gymnasium
environment. Needs `pip install 'rcare-marl[train]'`.

Run: python experiments/stable_baselines.py [TASK] [STEPS]
"""

from __future__ import annotations

import sys

import numpy as np
import numpy.typing as npt
import torch
from rich.console import Console
from stable_baselines3 import SAC
from stable_baselines3.common.monitor import Monitor

from rcare_marl.agents.policy import Policy
from rcare_marl.baselines.evaluation.evaluate import evaluate
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.gym import SingleAgentEnv

EPISODES = 20


class TrainedRobot:
    """A model of Stable-Baselines3 as a policy for `rcare_marl.make` and `evaluate`."""

    def __init__(self, env: CareEnv, role: str, model: SAC) -> None:
        """Take what is observed, by whom, and what decides."""
        self._env, self._role, self._model = env, role, model

    def reset(self, rng: np.random.Generator) -> None:
        """Keep nothing: the model is deterministic and has no memory."""

    def act(self) -> npt.NDArray[np.float64]:
        observation = self._env.observe(self._role)
        action, _ = self._model.predict(observation, deterministic=True)
        return np.asarray(action, float)


def train(task: str, steps: int, *, seed: int = 0) -> SAC:
    """Return a robot that learned `task` for so many control steps against the default partner."""
    env = Monitor(SingleAgentEnv(task, options={"reward": "shaped"}))
    model = SAC("MlpPolicy", env, gamma=0.97, learning_starts=min(1000, steps // 4), seed=seed)
    model.learn(steps)
    env.close()
    return model


def success_rate(task: str, model: SAC) -> float:
    """Return in which share of episodes, seeds 0 to 19, the robot succeeds."""

    def robot(env: CareEnv, role: str) -> Policy:
        return TrainedRobot(env, role, model)

    return evaluate(task, {"robot": robot}, episodes=EPISODES).success_rate


def main() -> None:
    """Train, then evaluate."""
    task = sys.argv[1] if len(sys.argv) > 1 else "feeding"
    steps = int(sys.argv[2]) if len(sys.argv) > 2 else 20_000
    torch.set_num_threads(1)  # so small a network gains nothing from more
    rate = success_rate(task, train(task, steps))
    Console().print(f"{task}: success {rate:.2f} in {EPISODES} episodes after {steps} steps")


if __name__ == "__main__":
    main()
