"""An environment as a robot that takes twists, poses and trajectories; knows no transport.

The robot's role is not played by a policy: what it was told last moves it, as long as that is fresh, through
a servo of 120 Hz. What is told between two physics steps counts in the next. Everybody else is played by the
partners of the task, ten times a second.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as xml

import numpy as np

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.policy import Policy
from rcare_marl.agents.robots.control import GripperClosing, ToolServo, moving_tool
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.baselines.evaluation import evaluate as baseline
from rcare_marl.envs import make
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array, Pose

from ..scripted.tool_script import limited, turning

FRESH = 0.3  # [s] for which a twist or a pose holds; our own choice
GAIN = 2.0  # [1/s] of the pose servo; our own choice
SEPARATION = 1.0  # [m] from people, as far as is looked
ROLE = "robot"


@dataclass(frozen=True)
class Trajectory:
    """Where joints are to be, and when.

    Attributes:
        times: Since it began [s], rising, shape [k].
        positions: Joints of the main arm [rad or m], shape [k, n].
    """

    times: Array
    positions: Array

    def at(self, time: float) -> Array:
        """Return where the joints are to be at a time [s], shape [n], straight between points."""
        columns = self.positions.T
        return np.array([np.interp(time, self.times, column) for column in columns])


class ServedRobot:
    """A robot in a task, moved by what it is told.

    Attributes:
        env: The environment.
        robot: The robot.
        outcomes: Whether each episode ended well, by its seed.
        is_stopped: Whether an emergency stop holds it.
        closing: How far its gripper is to be closed [1].
        on_step: Called before each physics step, as by who keeps real time.
    """

    def __init__(
        self,
        task: str,
        *,
        cast: Mapping[str, Any] | None = None,
        options: Mapping[str, Any] | None = None,
        seed: int = 0,
    ) -> None:
        """Begin the first episode.

        Raises:
            ConfigError: If the task has no robot, or it has another control mode than `tool_servo`.
            UnknownNameError: If there is no such task.
        """
        policies = {**baseline.lead_policies(task, "still"), ROLE: "still"}
        played = baseline.played_cast(task, _with_servo(cast or {}), policies)
        self.env = make(task, options=options or {}, **played)
        found = self.env.cast.get(ROLE)
        if not isinstance(found, Robot):
            raise ConfigError(f"{task} has no robot to serve")
        tool = moving_tool(found.control)
        if not isinstance(tool, ToolServo):
            raise ConfigError(
                f"a robot is served in control mode 'tool_servo', got {type(tool).__name__}"
            )
        self.robot, self._tool = found, tool
        self.on_step: Callable[[], None] = lambda: None
        tool.on_step = self._before_step
        _, players = baseline.make_players(self.env, task, policies)
        self._players: dict[str, Policy] = players
        self.outcomes: dict[int, bool] = {}
        self.is_stopped, self.closing = False, 0.0
        self.reset(seed)
        self.advance()  # compiles what it needs before anybody waits
        self.outcomes.clear()
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """Begin the episode of a seed; nothing is told yet, and an emergency stop stays."""
        self.env.reset(seed=seed)
        order = list(self.env.task.roles())
        for role, policy in self._players.items():
            policy.reset(np.random.default_rng([seed, order.index(role)]))
        self.cancel()

    def cancel(self) -> None:
        """Forget all that was told."""
        self._twist: Array | None = None
        self._pose: Pose | None = None
        self._fresh_until = -np.inf
        self.trajectory: Trajectory | None = None
        self.progress = 0.0  # [s] of the trajectory

    def tell_twist(self, twist: Array) -> None:
        """Move the tool so [m/s] and [rad/s] about the world's axes, shape [6], while that is fresh."""
        self.cancel()
        self._twist, self._fresh_until = twist, self.env.world.time + FRESH

    def tell_pose(self, pose: Pose) -> None:
        """Bring the tool to a pose in the world, while that is fresh."""
        self.cancel()
        self._pose, self._fresh_until = pose, self.env.world.time + FRESH

    def tell_trajectory(self, names: list[str], times: Array, positions: Array) -> None:
        """Follow a trajectory of all joints of the main arm from now on.

        Args:
            names: The joints, in any order.
            times: Of its points since the start [s], rising, shape [k].
            positions: Of the joints [rad or m], shape [k, n].

        Raises:
            ConfigError: If joints are missing, times do not rise, or places or speeds pass limits.
            UnknownNameError: If a joint is not one of the arm.
        """
        arm = self.robot.arm
        for name in names:
            check_name("joint of the arm", name, arm.names)
        if sorted(names) != sorted(arm.names):
            raise ConfigError(f"a trajectory names all joints of the arm: {', '.join(arm.names)}")
        if len(times) == 0 or positions.shape != (len(times), len(names)):
            raise ConfigError("a trajectory has a position of every joint at each of its points")
        if not (np.isfinite(times).all() and np.isfinite(positions).all()):
            raise ConfigError("a trajectory has finite numbers")
        if times[0] < 0 or (np.diff(times) <= 0).any():
            raise ConfigError("the times of a trajectory rise, from 0 s on")
        ordered = positions[:, [names.index(name) for name in arm.names]]
        outside = (ordered < arm.lower - 1e-6) | (ordered > arm.upper + 1e-6)
        here = arm.positions()
        ways = np.diff(np.vstack((here, ordered)), axis=0)
        fast = np.abs(ways) > arm.velocity * np.diff(times, prepend=0.0)[:, None] + 0.02
        for what, wrong in (("beyond the limits", outside), ("faster than allowed", fast)):
            if wrong.any():
                name = arm.names[int(np.argmax(wrong.any(axis=0)))]
                raise ConfigError(f"a trajectory takes {name} {what}")
        self.cancel()
        self.trajectory = Trajectory(np.append(0.0, times + 1e-9), np.vstack((here, ordered)))

    def stop(self, is_stopped: bool) -> None:
        """Stop at once and refuse to move, or move again when told anew."""
        self.is_stopped = is_stopped
        self.cancel()

    def advance(self) -> bool:
        """Let everybody act for one control step; return whether the episode is over."""
        env = self.env
        actions = {role: policy.act() for role, policy in self._players.items() if role != ROLE}
        actions[ROLE] = self._action()
        env.step(actions)  # type: ignore[arg-type]  # float64 will do
        if env.is_over:
            self.outcomes[env.seed] = bool(env.task.succeeded())
        return env.is_over

    def _before_step(self) -> None:
        """Hand in what the servo is to do in the physics step to come."""
        self.on_step()
        if self.trajectory is not None and not self.is_stopped:
            self.progress += self.env.world.physics_dt
            self._tool.go_to(self.trajectory.at(self.progress))
        self._tool.command(self._tool_action(), 0.0)

    def _action(self) -> Array:
        parts = []
        for part in self.robot.parts.values():
            if isinstance(part.control, GripperClosing):
                parts.append(np.array([2 * self.closing - 1]))
            else:
                parts.append(np.zeros(part.control.size))
        return np.concatenate(parts)

    def _tool_action(self) -> Array:
        if self.is_stopped or self.env.world.time > self._fresh_until:
            return np.zeros(6)
        if self._pose is not None:
            here = self.robot.tool_pose()
            way = GAIN * np.subtract(self._pose.position, here.position)
            turn = turning(self._pose.quaternion, here.quaternion, GAIN)
            return self._tool.action(limited(way, float(self._tool.max[0])), turn)
        assert self._twist is not None
        return self._tool.action(self._twist[:3], self._twist[3:])

    @property
    def is_there(self) -> bool:
        """Whether the joints are within 0.02 rad or m of the end of the trajectory, which has run out."""
        if self.trajectory is None or self.progress < self.trajectory.times[-1]:
            return False
        error = self.robot.arm.positions() - self.trajectory.positions[-1]
        return bool(np.abs(error).max() < 0.02)

    def separation(self) -> float:
        """Return the least distance of the robot and what it holds from anybody [m]; 1 if farther."""
        world = self.env.world
        return min(
            (
                world.separation(mover, person.body, within=SEPARATION)
                for mover in self._movers()
                for person in self.env.task.people
            ),
            default=SEPARATION,
        )

    def _movers(self) -> list[Any]:
        body = self.robot.body
        return [body, *self.env.world.held_by(body)]

    def wrench(self) -> Array:
        """Return what people do to the robot and what it holds, at the tool: [N] and [N·m], shape [6]."""
        tool, out = np.array(self.robot.tool_pose().position), np.zeros(6)
        for person in self.env.task.people:
            for mover in self._movers():
                for contact in self.env.world.contacts(mover, person.body):
                    force = contact.force * np.array(contact.normal)
                    out[:3] += force
                    out[3:] += np.cross(np.subtract(contact.position, tool), force)
        return out

    def frames(self) -> dict[str, Pose]:
        """Return the poses of the robot's links, of what it holds and of people's joints in the world."""
        body = self.robot.body
        out = {link: body.link_pose(i) for link, i in body.links.items() if link != "base"}
        out["tool"] = self.robot.tool_pose()
        for held in self.env.world.held_by(body):
            out[held.name] = held.base_pose()
        for role, agent in self.env.cast.items():
            if isinstance(agent, Human):
                out |= {f"{role}/{name}": agent.joint_pose(name) for name in agent.segments}
        return out

    def urdf(self) -> str:
        """Return the URDF of the robot as it is simulated, its meshes as files of this computer."""
        path = Path(self.robot.files.urdf)
        root = xml.fromstring(path.read_text(encoding="utf-8"))
        for mesh in root.iter("mesh"):
            mesh.set("filename", f"file://{(path.parent / mesh.get('filename', '')).resolve()}")
        return xml.tostring(root, encoding="unicode")

    def close(self) -> None:
        """Close the environment."""
        self.env.close()


def _with_servo(cast: Mapping[str, Any]) -> dict[str, Any]:
    """Return a cast whose robot follows at the rate of a servo, unless it says otherwise."""
    robot = cast.get(ROLE, {})
    said = robot if isinstance(robot, Mapping) else {"model": robot}
    return {**cast, ROLE: {"control": "tool_servo", **said}}
