"""Fingers on MuJoCo follow the driven one as in Bullet."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest
from mujoco import mjtEq

import rcare_marl
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.engines.mujoco_world import MujocoWorld
from rcare_marl.envs.tasks.ambulating import Ambulating


def test_the_driven_finger_has_all_of_its_torque() -> None:
    """Fingers follow by motors of their own: one bound to the driven joint would take half of its torque."""
    policies = {"robot": "scripted", "recipient": "still"}
    with closing(rcare_marl.make("ambulating", engine="mujoco", policies=policies)) as env:
        env.reset(seed=90005)
        for _ in range(12):  # the script takes the knob in its hand
            env.step({})
        robot, world, task = env.cast["robot"], env.world, env.task
        assert (
            isinstance(robot, Robot) and robot.gripper is not None and isinstance(task, Ambulating)
        )
        assert isinstance(world, MujocoWorld) and world.sim is not None
        kinds = world.sim.model.eq_type
        assert not np.isin(kinds, int(mjtEq.mjEQ_JOINT)).any()
        robot.set_gripper(1.0)
        for _ in range(120):
            for agent in env.cast.values():
                agent.actuate()
            world.step()
        body, config = robot.body, robot.gripper.config
        joint, finger = body.joint(config.joint), body.link_index(config.fingers[0])
        (press,) = (c for c in world.contacts(body, task.door.body) if c.link_a == finger)
        axis = body.link_pose(finger).matrix()[:3, 1]  # of the knuckle
        arm = np.subtract(press.position, body.link_pose(joint.index).position)
        lever = abs(float(np.cross(arm, press.normal) @ axis))
        # Friction bears a little.
        assert press.force * lever == pytest.approx(config.force, rel=0.1)
