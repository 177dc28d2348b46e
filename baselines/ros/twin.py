"""A policy's own copy of the scene, put where messages say that everything is; nothing in it is stepped."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from rcare_marl.agents.policy import Policy
from rcare_marl.agents.robots.control import GripperClosing, moving_tool
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array


def account(state: Any) -> str:
    """Return what a task reads of its scene as JSON: what perception tells on a real robot."""
    return json.dumps(_plain(state))


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(each) for each in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def told(text: str, like: Any) -> Any:
    """Return the state that was told as JSON.

    Args:
        text: What `account` returned.
        like: A state of the same task, whose names, shapes and kinds of numbers it has.

    Raises:
        ConfigError: If it is no JSON, or lacks something, or has it in another shape.
    """
    try:
        return _like(json.loads(text), like, "scene")
    except (ValueError, TypeError, KeyError) as error:
        raise ConfigError(f"the scene told is not one of this task: {error}") from error


def _like(value: Any, like: Any, name: str) -> Any:
    if dataclasses.is_dataclass(like) and not isinstance(like, type):
        fields = {f.name: getattr(like, f.name) for f in dataclasses.fields(like)}
        return dataclasses.replace(
            like, **{key: _like(value[key], each, f"{name}.{key}") for key, each in fields.items()}
        )
    if isinstance(like, Mapping):
        return {key: _like(value[key], each, f"{name}.{key}") for key, each in like.items()}
    if isinstance(like, np.ndarray):
        out = np.asarray(value, like.dtype)
        if out.shape != like.shape:
            raise ValueError(f"{name} of shape {out.shape}, not {like.shape}")
        return out
    if isinstance(like, tuple) and len(like) == len(value):
        made = [_like(a, b, name) for a, b in zip(value, like, strict=True)]
        return type(like)(*made) if hasattr(like, "_fields") else tuple(made)
    if isinstance(like, bool | int | float) and not isinstance(value, bool | int | float):
        raise ValueError(f"{name} is {value!r}, not a number")
    return value


def numbers(value: Any) -> list[float]:
    """Return all numbers of a state or of a part of it."""
    value = _plain(value)
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [number for each in value for number in numbers(each)]
    return [float(value)] if isinstance(value, bool | int | float) else []


class Twin:
    """An environment that is not stepped but put where a robot and a scene are said to be.

    Attributes:
        env: The environment.
        robot: Its robot, whose tool actions move.
        joints: The joints that must be told.
    """

    def __init__(self, env: CareEnv, role: str = "robot") -> None:
        """Take an environment, and begin an episode in it.

        Raises:
            ConfigError: If actions move more than one tool of the robot.
        """
        robot = env.cast.get(role)
        if not isinstance(robot, Robot):
            raise ConfigError(f"{role!r} is no robot of this task")
        tool = moving_tool(robot.control)
        others = [name for name, part in robot.parts.items() if part.control is not tool]
        closing = [n for n in others if isinstance(robot.parts[n].control, GripperClosing)]
        if others != closing:
            raise ConfigError(
                f"over ROS a policy moves one tool and grippers; {role!r} moves {', '.join(robot.parts)}"
            )
        self.env, self.robot, self.joints = env, robot, robot.arm.names
        self._tool = tool
        env.reset(seed=0)
        self._like = env.task.state

    def see(self, positions: Array, velocities: Array, text: str) -> Array:
        """Put everything where it is said to be, and return all numbers that the scene told.

        Args:
            positions: Of `joints` [rad or m], shape [n].
            velocities: Of them, shape [n].
            text: The scene, see `account`.

        Raises:
            ConfigError: If the scene told is not one of this task.
        """
        self.env.task.state = told(text, self._like)
        self.robot.arm.teleport(positions)
        self.robot.sense()
        part = next(p for p in self.robot.parts.values() if p.control is self._tool)
        part.take_rates(velocities)
        return np.array(numbers(self.env.task.state))

    def rehearse(self, policy: Policy) -> None:
        """See and decide some times for nothing: compiles what it needs before anybody waits."""
        here, rates = self.robot.arm.positions(), self.robot.arm.velocities()
        for _ in range(3):
            self.see(here, rates, account(self._like))
            self.twist(policy)

    def twist(self, policy: Policy) -> Array:
        """Return how a policy moves the tool now [m/s] and [rad/s], shape [6], in the world's axes."""
        return np.asarray(policy.act(), np.float64)[:6] * self._tool.max
