"""Furniture sleeps while nobody uses it, and wakes when it is touched, driven or pushed."""

from collections.abc import Iterator

import numpy as np
import pytest

from rcare_marl.body import Body
from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Joint, Link, Model, write
from rcare_marl.pose import Pose
from rcare_marl.world import World

LEAF = Shape(kind="box", material="wood", at=(0.4, 0, 0), size=(0.8, 0.04, 0.5))


def hinged(axis: tuple[float, float, float]) -> Model:
    """A board of 5 kg, hinged at one edge."""
    leaf = Link(
        mass=5.0,
        com=(0.4, 0, 0),
        inertia=(0.1, 0, 0, 0.4, 0, 0.3),
        visual=(LEAF,),
        collision=(LEAF,),
    )
    hinge = Joint(
        kind="revolute",
        parent="wall",
        child="leaf",
        axis=axis,
        lower=-1.5,
        upper=1.5,
        effort=50,
        velocity=5,
        damping=0.2,
    )
    return Model(
        name=f"board_{axis[1]:.0f}",
        source="own choice",
        links={"wall": Link(), "leaf": leaf},
        joints={"hinge": hinge},
        materials={"wood": (0.6, 0.4, 0.2, 1.0)},
    )


@pytest.fixture
def world() -> Iterator[World]:
    world = World()
    yield world
    world.close()


def hang(world: World, axis: tuple[float, float, float] = (0, 0, 1)) -> Body:
    """A board that sleeps and can swing about an axis, 1 m above the ground."""
    board = world.load_urdf(write(hinged(axis), melt_except=()), Pose((0, 0, 1)))
    board.release_motors([0])
    world.sleeping.add(board)
    return board


def begin(world: World) -> None:
    world.mark_start()
    world.rewind()


def angle(board: Body) -> float:
    return board.joint_states([0])[0][0]


def test_what_sleeps_does_not_creep(world: World) -> None:
    board = hang(world, axis=(0, 1, 0))
    board.release_motors([0], friction=30.0)  # holds its weight of 20 N·m
    begin(world)
    for _ in range(3):
        world.step()
    start = board.joint_states([0])
    for _ in range(480):
        world.step()
    assert board.joint_states([0]) == start


@pytest.mark.parametrize("how", ["thrown at", "pushed", "set", "driven"])
def test_what_sleeps_wakes_when_it_is(world: World, how: str) -> None:
    board = hang(world, axis=(0, 1, 0) if how == "set" else (0, 0, 1))
    ball = world.add_sphere(0.05, Pose((0.7, -0.5, 1.4)), mass=1.0)
    begin(world)
    for _ in range(5):
        world.step()
    if how == "thrown at":
        ball.set_base(Pose((0.7, -0.08, 1.0)))
        ball.apply_force(-1, (0, 480, 0), (0.7, -0.08, 1.0))  # for one step: 2 m/s
    elif how == "pushed":
        for _ in range(5):  # Bullet lets the first step of a push on a sleeping body pass
            board.apply_force(0, (0, 20, 0), (0.7, 0, 1))
            world.step()
    elif how == "driven":
        board.drive_velocities([0], [0.5], [20])
    else:
        board.set_joints([0], [0.1])
    start = 0.1 if how == "set" else 0.0
    for _ in range(60):
        world.step()
    assert abs(angle(board) - start) > 0.03


def test_what_moves_slowly_does_not_fall_asleep_on_its_way(world: World) -> None:
    board = hang(world)
    begin(world)
    board.drive_velocities([0], [0.02], [20])
    for _ in range(5 * 240):
        world.step()
    assert angle(board) == pytest.approx(0.1, abs=0.005)


def test_episodes_with_what_wakes_are_bit_equal(world: World) -> None:
    boards = [hang(world)]
    ball = world.add_sphere(0.05, Pose((0.7, -0.5, 1.4)), mass=1.0)
    begin(world)

    def episode(force: float) -> list[float]:
        world.rewind()
        ball.set_base(Pose((0.7, -0.08, 1.0)))
        ball.apply_force(-1, (0, force, 0), (0.7, -0.08, 1.0))
        track = []
        for _ in range(120):
            world.step()
            track += [angle(boards[0]), *ball.base_pose().position]
        return track

    first = episode(480)
    other = episode(700)  # ends elsewhere, awake
    assert episode(480) == first
    assert not np.allclose(first, other)
