"""What happened in an episode, step by step, for plots."""

from __future__ import annotations

from typing import Any

import numpy as np

from rcare_marl.agents.agent import Array
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.envs.care_env import CareEnv


class Recorder:
    """Notes time, the task's metrics and the robots' motor torques once a control step.

    Give it to `run_episode` as `on_step`; it reads and changes nothing.
    """

    def __init__(self) -> None:
        self._times: list[float] = []
        self._metrics: dict[str, list[float]] = {}
        self._torques: dict[str, list[list[float]]] = {}

    def __call__(self, env: CareEnv) -> None:
        self._times.append(env.world.time)
        for name, value in env.task.report().items():
            self._metrics.setdefault(name, []).append(float(value))
        for role, agent in env.cast.items():
            if isinstance(agent, Robot):
                torques = agent.body.joint_torques(agent.arm.indices)
                if env.world.time == 0:  # Bullet still tells those of the last episode
                    torques = [0.0] * len(torques)
                self._torques.setdefault(role, []).append(torques)

    @property
    def time(self) -> Array:
        """Simulated times [s], shape [steps + 1]; the first is that of the reset."""
        return np.array(self._times)

    def metric(self, name: str) -> Array:
        """Return a metric over time, in its own unit, shape [steps + 1]."""
        return np.array(self._metrics[name])

    def torques(self, role: str) -> Array:
        """Return what the motors of a robot's arm applied [N·m or N], shape [steps + 1, joints].

        What a control mode adds to carry the weight of the arm is not in it. The first row is zero:
        no motor has worked yet.
        """
        return np.array(self._torques[role])

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists for JSON; keys end in their unit."""
        return {
            "time_s": _rounded(self._times),
            **{name: _rounded(values) for name, values in self._metrics.items()},
            "motor_torque_nm": {
                role: [_rounded(row) for row in rows] for role, rows in self._torques.items()
            },
        }


def _rounded(values: list[float]) -> list[float]:
    return [round(value, 6) for value in values]  # a micrometre is enough, and files stay small
