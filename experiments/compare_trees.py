"""Jacobians, mass matrices, loads and inverse kinematics of all robots and people, before and after.

    python experiments/compare_trees.py dump FILE.npz     (in either checkout, on its PYTHONPATH)
    python experiments/compare_trees.py compare A.npz B.npz

It knows the modules of both: 6c66acc, where joint trees were five, and this one, where they are one.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import rcare_marl
from rcare_marl.pose import Pose
from rcare_marl.world import World

try:
    from rcare_marl.agents.people.avatar import load_avatar, load_posture
    from rcare_marl.agents.people.body.goal import Position
    from rcare_marl.agents.people.body.ik import WholeBodyIk
    from rcare_marl.agents.people.body.person_tree import person_tree
    from rcare_marl.agents.people.human import Human
    from rcare_marl.agents.robots.robot import Robot
    from rcare_marl.agents.robots.robot_config import load_robot
except ModuleNotFoundError:
    from rcare_marl.agents.actuation.chain import make_chain as person_tree
    from rcare_marl.agents.avatar import load_avatar, load_posture
    from rcare_marl.agents.body.goal import Position
    from rcare_marl.agents.body.ik import WholeBodyIk
    from rcare_marl.agents.human import Human
    from rcare_marl.agents.robot import Robot
    from rcare_marl.agents.robot_config import load_robot


ASSETS = Path(rcare_marl.__file__).parents[1] / "assets"


def of_robots(out, rng):
    for name in sorted(p.stem for p in ASSETS.glob("robots/*.yaml")):
        world = World()
        robot = Robot("robot", load_robot(name))
        robot.spawn(world, Pose())
        robot.reset(np.random.default_rng(0))
        for index, arm in enumerate(robot.arms.values()):
            chain = arm.chain
            chain.place(Pose())
            for k in range(20):
                low, high = np.maximum(arm.lower, -3), np.minimum(arm.upper, 3)
                q, seed = rng.uniform(low, high), rng.uniform(low, high)
                key = f"{name}.{index}.{k}"
                out[f"{key}.jacobian"] = chain.jacobian(q)
                out[f"{key}.gravity"] = chain.gravity_torques(q)
                tip = chain.tip_pose(q)
                out[f"{key}.tip"] = np.array(tip.position)
                out[f"{key}.ik"] = arm.solve(tip, seed, position_only=False).posture
        world.close()


def of_people(out, rng):
    for name in sorted(p.stem for p in ASSETS.glob("avatars/*.yaml")):
        world = World()
        person = Human(name, load_avatar(name), posture=load_posture("wheelchair"))
        person.spawn(world, Pose())
        person.reset(np.random.default_rng(0))
        model = person.model
        names = list(person.movable)
        tree = person_tree(person.segments, model.joints, person.angles, names)
        ik = WholeBodyIk.of(person)
        for k in range(10):
            key = f"{name}.{k}"
            out[f"{key}.mass"] = tree.mass_matrix(rng.uniform(-0.5, 0.5, len(names)))
            angles = person.angles + rng.uniform(-0.2, 0.2, len(person.angles))
            goal = Position("right_wrist", tuple(rng.uniform((0.2, -0.4, 0.0), (0.5, 0, 0.4))))
            out[f"{key}.jacobian"] = ik.jacobian([goal], angles)
            out[f"{key}.ik"] = ik.solve([goal], angles, fallback=False).angles
        world.close()


if __name__ == "__main__":
    if sys.argv[1] == "dump":
        kept: dict[str, np.ndarray] = {}
        of_robots(kept, np.random.default_rng(0))
        of_people(kept, np.random.default_rng(1))
        np.savez(sys.argv[2], **kept)
    else:
        a, b = (np.load(path) for path in sys.argv[2:4])
        assert set(a.files) == set(b.files)
        worst: dict[str, tuple[float, str]] = {}
        for key in a.files:
            kind = key.rsplit(".", 1)[1]
            gap = float(np.abs(a[key] - b[key]).max())
            worst[kind] = max(worst.get(kind, (0.0, key)), (gap, key))
        print(len(a.files), "arrays", worst)
