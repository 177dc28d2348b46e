"""A robot or a person with sensors and things around, for several files of tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import GripperUse, Robot
from rcare_marl.agents.robots.robot_config import load_robot, urdf_robot
from rcare_marl.agents.sensing.suite import Entry, SensorSuite
from rcare_marl.pose import Pose
from rcare_marl.world import World

Array = npt.NDArray[np.float64]
STEPS = 24  # physics steps of a control step
POSTURES = (
    (0.0, 0.45, 3.14, -2.05, 0.0, 0.93, 1.57),
    (0.6, 1.2, 0.3, -1.1, 0.8, -0.6, -0.4),
    (-1.1, 0.2, -0.7, 1.3, 0.4, 1.1, 2.2),
    (0.3, -0.6, 1.4, -0.9, -1.2, 0.5, 0.9),
    (1.4, 0.9, -1.5, 0.7, 1.0, -1.3, -2.0),
)


class Scene:
    """A robot, a Gen3 if none is given, with sensors, and things."""

    def __init__(
        self,
        *sensors: Entry,
        control: str = "joint_velocity",
        physics_dt: float = 1 / 240,
        gripper: GripperUse = "held",
        robot: Robot | None = None,
    ) -> None:
        self.world = World(physics_dt)
        self.robot = robot or Robot(
            "robot", load_robot("kinova_gen3"), control=control, gripper=gripper
        )
        self.suite = SensorSuite(sensors, "robot")
        self.robot.equip(self.suite)
        self.robot.spawn(self.world, Pose())
        self.robot.reset(np.random.default_rng(0))

    def begin(self, posture: Sequence[float] = POSTURES[0], seed: int = 0) -> None:
        self.robot.set_posture(posture)
        self.suite.bind(self.world, self.robot)
        self.suite.reset(np.random.default_rng(seed))
        self.suite.sense()

    def run(self, control_steps: int, action: Array | None = None) -> None:
        for _ in range(control_steps):
            zero = np.zeros(self.robot.action_size)
            self.robot.command(zero if action is None else action, STEPS * self.world.physics_dt)
            for _ in range(STEPS):
                self.robot.actuate()
                self.world.step()
                self.suite.after_substep()
            self.suite.sense()

    def link(self, name: str) -> Pose:
        return self.robot.body.link_pose(self.robot.body.link_index(name))

    def read(self, sensor: str, channel: str) -> npt.NDArray[Any]:
        return self.suite.reading(sensor, channel)


def urdf(path: Path, links: str) -> Path:
    path.write_text(f'<robot name="own"><link name="root"/>{links}</robot>')
    return path


def arm_link(
    name: str, parent: str, *, at: str, axis: str, com: str, mass: float, kind: str = "revolute"
) -> str:
    return f"""
    <link name="{name}"><inertial><origin xyz="{com}" rpy="0.3 -0.2 0.5"/><mass value="{mass}"/>
    <inertia ixx="0.002" iyy="0.003" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="{name}_joint" type="{kind}"><parent link="{parent}"/><child link="{name}"/>
    <origin xyz="{at}"/><axis xyz="{axis}"/>
    <limit lower="-9" upper="9" effort="1000" velocity="50"/></joint>"""


def own_robot(path: Path, joints: Sequence[str], tool: str, *sensors: Entry) -> Scene:
    """Return a scene with the robot of a URDF; its motors stand still."""
    robot = Robot("robot", urdf_robot(path, joints, tool), control="joint_velocity")
    return Scene(*sensors, robot=robot)


def person(*sensors: Entry, tissue: Sequence[str] = ()) -> tuple[World, Human, SensorSuite]:
    world = World()
    human = Human(
        "recipient",
        load_avatar("karan"),
        posture=load_posture("wheelchair"),
        movable=(),
        tissue=tissue,
    )
    suite = SensorSuite(sensors, "recipient")
    human.equip(suite)
    human.spawn(world, Pose((0, 0, 0.5)))
    human.reset(np.random.default_rng(0))
    return world, human, suite
