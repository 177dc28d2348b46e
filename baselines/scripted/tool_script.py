"""What hand-written robots that move their tool have in common."""

from __future__ import annotations

from typing import TypeVar

from rcare_marl.agents.robots.control import GripperClosing, moving_tool
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.task import Task
from rcare_marl.errors import ConfigError

T = TypeVar("T", bound=Task)


def scripted_task(env: CareEnv, role: str, kind: type[T], *, with_gripper: bool = False) -> T:
    """Return the task that a script plays.

    Args:
        env: The environment.
        role: Of the robot that it plays.
        kind: The task that it is written for.
        with_gripper: Whether actions must move the arm and its gripper, and nothing else.

    Raises:
        ConfigError: If it is another task or robot, or actions move other things than the tool.
    """
    task, robot, name = env.task, env.cast[role], kind.__name__
    if not isinstance(task, kind):
        raise ConfigError(f"the script of {name} cannot play {type(task).__name__}")
    if role not in ("robot", "robot_0"):
        raise ConfigError(f"the script of {name} plays the first robot, and not {role!r}")
    assert isinstance(robot, Robot)
    moving_tool(robot.control)
    others = [type(part.control) for part in robot.parts.values()][1:]
    if with_gripper and others != [GripperClosing]:
        raise ConfigError(
            f"the script of {name} needs the control mode 'tool_delta' and moves arm and gripper only, "
            f"got {', '.join(robot.parts)}"
        )
    return task
