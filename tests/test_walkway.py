"""Ways on the floor: who walks and who drives goes round what stands there, also when it moves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from standing_person import CONTROL_DT, CONTROL_STEPS, person_in

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.motion.caregiving import Caregiving
from rcare_marl.agents.people.motion.gait import LEGS
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.body import Body
from rcare_marl.envs.walkway import WALKER, driving, standing, way_of, way_round
from rcare_marl.errors import ConfigError, PlanningError
from rcare_marl.pose import Pose
from rcare_marl.world import World

GOAL = (2.2, 0.0)


def room(*tables: tuple[float, float]) -> tuple[World, list[Body]]:
    """Return a floor with tables on it, 0.6 m by 0.6 m, at some places."""
    world = World()
    world.add_box((8, 8, 0.1), Pose((0, 0, -0.05)), name="floor")
    size = (0.6, 0.6, 0.8)
    return world, [world.add_box(size, Pose((x, y, 0.4)), name="table") for x, y in tables]


def walker(world: World) -> tuple[Human, Caregiving]:
    joints = (*LEGS, "right_shoulder", "right_elbow")
    person = person_in(world, Pose((-1.0, 0.0, 0.0)), joints, moves=("walk",))
    return person, Caregiving(person, world, CONTROL_DT)


def step(world: World, agent: Human | Robot, action: np.ndarray) -> None:
    agent.command(action, CONTROL_DT)
    for _ in range(CONTROL_STEPS):
        agent.actuate()
        world.step()
    agent.sense()


def place(person: Human) -> tuple[float, float]:
    x, y, _ = person.pelvis.position
    return x, y


def walk(world: World, person: Human, caregiving: Caregiving, table: Body, steps: int) -> float:
    """Walk for some control steps; return the least distance of the person from a table [m]."""
    nearest = math.inf
    for _ in range(steps):
        step(world, person, caregiving.act())
        nearest = min(nearest, world.separation(person.body, table, within=1.0))
    return nearest


def test_a_caregiver_walks_round_the_table_that_stands_in_the_way() -> None:
    world, (table,) = room((0.3, 0.1))
    person, caregiving = walker(world)
    world.mark_start()
    caregiving.reset(np.random.default_rng(0))
    caregiving.walk_along(lambda: way_of(person, GOAL), 0.0)
    assert walk(world, person, caregiving, table, 200) > 0.0
    assert caregiving.is_idle and not caregiving.trouble
    assert place(person) == pytest.approx(GOAL, abs=0.05)
    assert caregiving.planning_s > 0
    world.close()


def test_a_free_way_is_straight_and_one_that_is_shut_is_told() -> None:
    world, _ = room((0.3, 1.2))
    obstacles = standing(world, ())
    assert {obstacle.name for obstacle in obstacles} == {"table"}  # one walks on the floor
    assert way_round(obstacles, (-1.0, 0.0), GOAL) == [GOAL]
    with pytest.raises(PlanningError, match="no way"):
        way_round(obstacles, (-1.0, 0.0), (0.3, 1.2), width=2.0, least=2.0)
    world.close()


def test_no_corner_of_a_way_is_cut() -> None:
    world, _ = room((0.3, 0.1), (0.3, -0.9), (1.0, 1.3))
    obstacles = standing(world, ())
    way = np.array([(-1.0, 0.0), *way_round(obstacles, (-1.0, 0.0), GOAL)])
    rows = np.array([obstacle.area.row for obstacle in obstacles])
    assert len(way) > 2
    for a, b in zip(way, way[1:], strict=False):
        for point in np.linspace(a, b, 100):
            out = np.maximum(np.maximum(rows[:, :2] - point, point - rows[:, 2:]), 0.0)
            assert np.linalg.norm(out, axis=1).min() > 0.5 * WALKER - 0.06
    world.close()


@pytest.mark.slow
def test_a_walk_goes_another_way_when_something_is_moved_into_it() -> None:
    world, (table,) = room((0.3, 2.5))
    person, caregiving = walker(world)
    world.mark_start()
    caregiving.reset(np.random.default_rng(0))
    caregiving.walk_along(lambda: way_of(person, GOAL), 0.0)
    assert way_of(person, GOAL) == [GOAL]
    walk(world, person, caregiving, table, 5)
    table.set_base(Pose((0.9, 0.1, 0.4)))
    assert walk(world, person, caregiving, table, 200) > 0.0
    assert place(person) == pytest.approx(GOAL, abs=0.05)
    world.close()


def test_a_walk_that_finds_its_way_shut_ends_in_trouble() -> None:
    world, _ = room((-1.0, -0.7), (-1.0, 0.7), (-0.3, 0.0), (-1.7, 0.0))
    person, caregiving = walker(world)
    world.mark_start()
    caregiving.reset(np.random.default_rng(0))
    caregiving.walk_along(lambda: way_of(person, GOAL), 0.0)
    step(world, person, caregiving.act())
    assert "no way" in caregiving.trouble and caregiving.is_idle
    world.close()


@pytest.mark.parametrize("model", ["stretch_re1", "fetch"])
def test_a_base_drives_round_a_table_and_another_way_when_it_is_moved(model: str) -> None:
    world, (table,) = room((0.3, 0.0))
    robot = Robot("robot", load_robot(model), moves=("base",))
    robot.spawn(world, robot.mount("floor", Pose((-1.2, 0.0, 0.0))))
    nearest, moved = math.inf, False
    for k, action in enumerate(driving(robot, (2.6, 0.0, math.pi / 2))):
        step(world, robot, action)
        nearest = min(nearest, world.separation(robot.body, table, within=1.0))
        if k == 30:
            x, y, _ = robot.base.place()  # type: ignore[union-attr]
            table.set_base(Pose((0.9, -0.5 if y < 0 else 0.5, 0.4)))
            moved = True
        assert k < 600
    assert moved and nearest > 0.0
    world.close()


def test_who_does_not_drive_is_told() -> None:
    world, _ = room()
    robot = Robot("robot", load_robot("fetch"))
    robot.spawn(world, robot.mount("floor"))
    with pytest.raises(ConfigError, match="base"):
        next(driving(robot, (1.0, 0.0, 0.0)))
    world.close()
