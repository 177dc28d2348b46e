"""A room with cameras in it and a robot with sensors, for several files of tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.agent import Agent
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.agents.sensing.suite import SensorSuite
from rcare_marl.observable import Observable
from rcare_marl.pose import Pose
from rcare_marl.world import World

FORWARD = {"link": "base", "rpy_deg": (-90.0, 0.0, -90.0)}  # along the x axis of the box, z upwards


class Block(Agent):
    """A box that carries cameras."""

    def __init__(self, name: str) -> None:
        self.name = name

    @property
    def action_size(self) -> int:
        return 0

    @property
    def action_names(self) -> tuple[str, ...]:
        return ()

    def spawn(self, world: World, pose: Pose) -> None:
        self.body = world.add_box((0.02, 0.02, 0.02), pose, name=self.name, mass=1.0)

    def reset(self, rng: np.random.Generator) -> None:
        pass

    def command(self, action: npt.NDArray[np.float64], duration: float) -> None:
        pass

    def observables(self) -> Sequence[Observable]:
        return []


class Room:
    """A wall 1 m before a block with cameras."""

    def __init__(self) -> None:
        self.world = World()
        self.wall = self.world.add_box((0.02, 0.8, 0.8), Pose((1.01, 0, 0.5)), name="wall")
        self.suites: list[SensorSuite] = []

    def add(self, *entries: dict[str, Any], pose: Pose = Pose((0, 0, 0.5))) -> SensorSuite:
        agent = Block(f"block_{len(self.suites)}")
        agent.spawn(self.world, pose)
        full = [
            {"kind": "camera", "name": f"eye_{i}", **FORWARD, **e} for i, e in enumerate(entries)
        ]
        suite = SensorSuite(full, agent.name)
        suite.bind(self.world, agent)
        self.suites.append(suite)
        return suite

    def begin(self, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        for suite in self.suites:
            suite.reset(rng)
        self.sense()

    def sense(self) -> None:
        for suite in self.suites:
            suite.sense()

    def close(self) -> None:
        for suite in self.suites:
            suite.close()
        self.world.close()


def robot_with(*entries: dict[str, Any] | str) -> tuple[World, Robot, SensorSuite]:
    world, robot = World(), Robot("robot", load_robot("kinova_gen3"))
    suite = SensorSuite(entries, "robot")
    robot.equip(suite)
    robot.spawn(world, Pose())
    robot.reset(np.random.default_rng(0))
    suite.bind(world, robot)
    suite.reset(np.random.default_rng(0))
    return world, robot, suite
