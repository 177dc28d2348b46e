"""Distances by boxes first are Bullet's own distances, to the bit."""

from collections.abc import Iterator

import numpy as np
import pybullet as bullet
import pytest

import rcare_marl
from rcare_marl.body import Body
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.pose import Pose
from rcare_marl.separation import ALL_LINKS
from rcare_marl.world import World


@pytest.fixture(scope="module", params=["ambulating", "feeding"])
def env(request: pytest.FixtureRequest) -> Iterator[CareEnv]:
    made = rcare_marl.make(request.param)
    yield made
    made.close()


def plain_gap(world: World, a: Body, b: Body, within: float, link: int = ALL_LINKS) -> float:
    """Return the distance as Bullet finds it among all pairs of links [m]."""
    points = bullet.getClosestPoints(
        a.uid, b.uid, within, link, ALL_LINKS, physicsClientId=world.client
    )
    return min([within, *[point[8] for point in points or ()]])


def wander(env: CareEnv, seed: int, steps: int) -> Iterator[None]:
    """Go through control steps with random actions, as far as the episode lasts."""
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    for _ in range(steps):
        if env.is_over:
            return
        shapes = {role: env.action_space(role).shape for role in env.agents}
        env.step({r: rng.uniform(-1, 1, s).astype(np.float32) for r, s in shapes.items()})
        yield


def test_distances_of_links_are_those_of_bullet_after_steps_and_resets(env: CareEnv) -> None:
    robot, person = env.cast["robot"].body, env.cast["recipient"].body
    links = [(robot, link) for link in robot.solid_links()]
    near = 0
    before: dict[float, list[float]] = {}
    for seed in (1, 2):
        for _ in wander(env, seed, 12):
            for within in (0.05, 0.3):
                wanted = [plain_gap(env.world, robot, person, within, k) for _, k in links]
                assert env.world.gaps(links, person, within=within) == wanted
                hint = before.get(within, [])
                assert env.world.gaps(links, person, within=within, before=hint) == wanted
                before[within] = wanted
                near += sum(gap < within for gap in wanted)
    assert near > 20  # or nothing was measured


def test_distances_of_bodies_are_those_of_bullet(env: CareEnv) -> None:
    solid = [body for body in env.world.bodies if body.solid_links()]
    for _ in wander(env, 3, 4):
        for a in (agent.body for agent in env.cast.values()):
            for b in solid:
                if b is not a:
                    wanted = plain_gap(env.world, a, b, 0.1)
                    assert env.world.separation(a, b, within=0.1) == wanted, (a.name, b.name)


def test_what_is_put_elsewhere_is_found_there() -> None:
    world = World()
    wall = world.add_box((1.0, 1.0, 1.0), name="wall")
    ball = world.add_sphere(0.1, Pose((0.0, 0.0, 5.0)), mass=1.0)
    assert world.separation(ball, wall, within=0.5) == 0.5
    wall.set_base(Pose((0.0, 0.0, 4.0)))
    assert world.separation(ball, wall, within=0.5) == pytest.approx(0.4, abs=1e-3)
    ball.set_base(Pose((0.0, 0.0, 4.8)))
    assert world.separation(ball, wall, within=0.5) == pytest.approx(0.2, abs=1e-3)
    for _ in range(24):
        world.step()
    assert world.separation(ball, wall, within=0.5) < 0.19
    world.close()


def test_torques_told_as_a_tuple_act_as_those_of_a_list() -> None:
    states = []
    for kind in (list, tuple):
        env = rcare_marl.make("feeding")
        env.reset(seed=1)
        arm = env.task.robot.arm  # type: ignore[attr-defined]
        for torques in ([0.0, 3.0, 0.0, -1.0, 0.0, 0.0, 0.0], [0.0] * 7, [0.0, 2.0] + [0.0] * 5):
            told = kind(torques)
            for _ in range(5):
                arm.drive_torques(told)
                env.world.step()
        states.append(np.concatenate(arm.states()))
        env.close()
    assert (states[0] == states[1]).all()
