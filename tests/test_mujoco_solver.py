"""MuJoCo solves motors, bonds, gears and contacts as Bullet does: small worlds on either engine."""

from __future__ import annotations

import math
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import rcare_marl
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.engines import make_world
from rcare_marl.engines.mujoco_world import MujocoWorld
from rcare_marl.errors import WorldError
from rcare_marl.pose import Pose, quaternion_from_axis_angle
from rcare_marl.world import GRAVITY

PENDULUM = """<robot name="pendulum">
<link name="post"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<link name="bob"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="post"/><child link="bob"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="10" velocity="10"/></joint></robot>"""


@pytest.fixture
def world() -> MujocoWorld:
    made = make_world("mujoco", 1 / 240)
    assert isinstance(made, MujocoWorld)
    made.add_box((4, 4, 0.2), Pose((0, 0, -0.1)), name="floor")
    return made


def test_a_box_presses_with_its_weight_and_slides_by_friction(world: MujocoWorld) -> None:
    box = world.add_box((0.2, 0.2, 0.2), Pose((0, 0, 0.1)), mass=3.0)
    world.mark_start()
    for _ in range(240):
        world.step()
    floor = world.bodies[0]
    assert world.contact_force(box, floor) == pytest.approx(3 * GRAVITY, rel=0.01)
    assert world.contact_force(box) == pytest.approx(3 * GRAVITY, rel=0.01)
    pushes = np.sum([touch.force * np.array(touch.normal) for touch in world.touches(box)], axis=0)
    assert pushes == pytest.approx([0, 0, 3 * GRAVITY], abs=0.1)
    force = 0.9 * 0.25 * 3 * GRAVITY  # below what sticks: coefficients are multiplied, 0.5 by 0.5
    start = box.base_pose().position[0]
    for _ in range(120):
        box.apply_force(-1, (force, 0, 0), box.base_pose().position)
        world.step()
    assert box.base_pose().position[0] == pytest.approx(start, abs=0.005)
    drag = np.sum([touch.friction for touch in world.touches(box)], axis=0)
    assert drag[0] == pytest.approx(-force, rel=0.05)
    for _ in range(60):
        box.apply_force(-1, (2 * force, 0, 0), box.base_pose().position)
        world.step()
    assert box.link_motion(-1)[1][0] > 0.1
    assert world.separation(box, floor, within=0.1) == pytest.approx(0.0, abs=0.003)


def test_how_a_box_comes_to_rest_is_the_same_whatever_falls_elsewhere() -> None:
    """What does not touch is solved by itself, as in Bullet, also when its sweeps end."""
    ways = []
    for others in (0, 3):
        with closing(make_world("mujoco", 1 / 240)) as world:
            world.add_box((4, 4, 0.2), Pose((0, 0, -0.1)), name="floor")
            tilted = quaternion_from_axis_angle((0, 1, 0), 0.3)
            box = world.add_box((0.2, 0.1, 0.1), Pose((0, 0, 0.2), tuple(tilted)), mass=1.0)
            for k in range(others):
                world.add_box((0.1, 0.1, 0.1), Pose((1.0, 0.5 * k, 0.1 + 0.1 * k)), mass=2.0)
            world.mark_start()
            for _ in range(120):
                world.step()
            ways.append(box.state())
    alone, beside = ways
    assert np.array_equal(alone, beside)


def test_a_bond_holds_until_it_is_broken_and_comes_back(world: MujocoWorld) -> None:
    post = world.add_box((0.1, 0.1, 0.1), Pose((0, 0, 2.0)), name="post")
    ball = world.add_sphere(0.05, Pose((0.2, 0, 2.0)), mass=0.2, name="ball")
    bond = world.attach(post, "base", ball)
    world.mark_start()
    for _ in range(2):
        for _ in range(60):
            world.step()
        assert ball.base_pose().position == pytest.approx((0.2, 0, 2.0), abs=0.002)
        world.detach(bond)
        for _ in range(60):
            world.step()
        assert ball.base_pose().position[2] == pytest.approx(2.0 - 0.5 * GRAVITY / 16, abs=0.03)
        world.rewind()
        assert bond.is_active


def fall(world: MujocoWorld, steps: int) -> None:
    for _ in range(steps):
        world.step()


def test_a_bond_made_in_an_episode_holds_bears_and_is_gone_after_a_rewind(
    world: MujocoWorld,
) -> None:
    post = world.add_box((0.1, 0.1, 0.1), Pose((0, 0, 2.0)), name="post")
    ball = world.add_sphere(0.05, Pose((0.2, 0, 2.0)), mass=0.2, name="ball")
    bob = world.add_sphere(0.05, Pose((0, 0, 1.5)), mass=0.1, name="bob")
    world.mark_start()
    for _ in range(2):
        bond = world.attach(post, "base", ball, force=50.0)
        fall(world, 60)
        assert ball.base_pose().position == pytest.approx((0.2, 0, 2.0), abs=0.002)
        assert bond.load() == pytest.approx(0.2 * GRAVITY, rel=0.02)
        swing = world.attach(ball, "base", bob, pivot=(-0.2, 0, 0))  # it hangs below the post
        fall(world, 240)
        assert bob.base_pose().position[:2] == pytest.approx((0, 0), abs=1e-4)
        bond.set_force(0.1)  # less than the weights, so it gives way
        fall(world, 60)
        assert ball.base_pose().position[2] < 1.9
        assert bond.load() <= 0.1 * np.sqrt(3) + 1e-9
        world.detach(bond)
        assert not bond.is_active and bond.load() == 0.0
        world.rewind()
        assert not swing.is_active and swing not in world.bonds
        fall(world, 30)
        assert ball.base_pose().position[2] == pytest.approx(2.0 - 0.5 * GRAVITY / 64, abs=0.02)
        world.rewind()
    bonds = [world.attach(post, "base", ball) for _ in range(8)]
    with pytest.raises(WorldError, match="holds 8 bonds at a time"):
        world.attach(post, "base", bob)
    world.detach(bonds[3])
    assert world.attach(post, "base", bob).is_active


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_collisions_switched_in_an_episode_come_back_with_it(engine: str) -> None:
    made = make_world(engine, 1 / 240)
    floor = made.add_box((4, 4, 0.2), Pose((0, 0, -0.1)), name="floor")
    table = made.add_box((0.5, 0.5, 0.1), Pose((0, 0, 0.45)), name="table")
    ball = made.add_sphere(0.05, Pose((0, 0, 0.6)), mass=0.2, name="ball")
    other = made.add_sphere(0.05, Pose((0, 0, 0.8)), mass=0.2, name="other")
    made.set_collision(other, table, False)
    made.mark_start()

    def heights() -> list[float]:
        for _ in range(240):
            made.step()
        return [round(body.base_pose().position[2], 2) for body in (ball, other)]

    made.set_collision(ball, other, False)
    assert heights() == [0.55, 0.05]
    made.rewind()
    made.set_collision(ball, other, False)
    made.set_collision(ball, table, False)
    made.set_collision(other, table, True)
    assert heights() == [0.05, 0.55]
    made.rewind()
    assert made.contact_force(ball, floor) == 0.0
    settled = heights()  # one on the other, or beside it
    assert settled[0] == 0.55 and settled[1] != 0.55


def test_a_cap_on_joint_speeds_is_bullets() -> None:
    speeds = []
    for engine in ("bullet", "mujoco"):
        with closing(rcare_marl.make("feeding", engine=engine)) as env:
            env.reset(seed=0)
            assert isinstance(robot := env.cast["robot"], Robot)
            body, joint = robot.body, robot.arm.indices[5]
            body.limit_speed(0.5)
            body.drive_velocities([joint], [3.0], [1e3])
            for _ in range(10):
                env.world.step()
            speeds.append(body.joint_states([joint])[1][0])
    assert speeds == pytest.approx([0.5, 0.5], abs=1e-6)


@pytest.mark.parametrize("depth", [0.0005, 0.01, 0.06])
def test_what_overlaps_is_pushed_apart_as_fast_as_by_bullet(depth: float) -> None:
    speeds = []
    for engine in ("bullet", "mujoco"):
        made = make_world(engine, 1 / 240)
        made.add_box((4, 4, 0.5), Pose((0, 0, -0.25)), name="floor")
        ball = made.add_sphere(0.1, Pose((0, 0, 0.1 - depth)), mass=1.0)
        made.mark_start()
        made.step()
        speeds.append(ball.link_motion(-1)[1][2])
    assert speeds[1] == pytest.approx(speeds[0], rel=0.01)


@pytest.mark.parametrize("shape", ['<box size=".2 .2 .2"/>', '<cylinder radius=".1" length=".2"/>'])
def test_edges_and_faces_are_where_bullet_has_them(shape: str, tmp_path: Path) -> None:
    file = tmp_path / "block.urdf"
    file.write_text(
        '<robot name="block"><link name="block"><inertial><mass value="1"/><inertia ixx="1" iyy="1" '
        'izz="1" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry>'
        f"{shape}</geometry></collision></link></robot>"
    )
    found: dict[str, list[float]] = {}
    for engine in ("bullet", "mujoco"):
        for way in ((0, 0, 1), (1, 0, 0), (1, 0, 1)):
            made = make_world(engine, 1 / 240)
            block = made.load_urdf(file)
            ball = made.add_sphere(0.05, Pose(tuple(np.array(way) * (0.1 + 0.0495))), mass=1.0)
            if way == (1, 0, 1):
                ball.set_base(Pose(tuple(np.array(way) * (0.1 + 0.0495 / math.sqrt(2)))))
            made.mark_start()
            made.step()
            found.setdefault(engine, []).extend(c.distance for c in made.contacts(ball, block))
    assert len(found["bullet"]) == 3
    assert found["mujoco"] == pytest.approx(found["bullet"], abs=2e-5)


def test_cylinders_have_the_sides_that_they_have_in_bullet(tmp_path: Path) -> None:
    file = tmp_path / "wheel.urdf"
    file.write_text(
        '<robot name="wheel"><link name="wheel"><inertial><mass value="1"/><inertia ixx="1" iyy="1" '
        'izz="1" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry>'
        '<cylinder radius="0.3" length="0.1"/></geometry></collision></link></robot>'
    )
    found: dict[str, list[float]] = {}
    for engine in ("bullet", "mujoco"):
        for turn in np.radians([0.0, 180 / 32, 360 / 32]):
            made = make_world(engine, 1 / 240)
            wheel = made.load_urdf(file)
            far = 0.3 + 0.05 - 0.002
            spot = far * math.cos(turn), far * math.sin(turn), 0.0
            ball = made.add_sphere(0.05, Pose(spot), mass=1.0)
            made.mark_start()
            made.step()
            found.setdefault(engine, []).extend(c.distance for c in made.contacts(ball, wheel))
    assert len(found["bullet"]) == 3
    assert found["bullet"][1] > found["bullet"][0] + 0.001  # the middle of a side is farther in
    assert found["mujoco"] == pytest.approx(found["bullet"], abs=1e-7)


@pytest.mark.parametrize("depth", [0.0005, 0.02])
def test_friction_acts_where_it_acts_in_bullet(depth: float) -> None:
    moves = []
    for engine in ("bullet", "mujoco"):
        made = make_world(engine, 1 / 240)
        made.add_box((4, 4, 0.5), Pose((0, 0, -0.25)), name="floor")
        ball = made.add_sphere(0.1, Pose((0, 0, 0.1 - depth)), mass=1.0)
        made.mark_start()
        for _ in range(3):
            ball.apply_force(-1, (3.0, 0.0, 0.0), ball.base_pose().position)
            made.step()
        _, linear, angular = ball.link_motion(-1)
        moves.append([linear[0], angular[1]])
    assert moves[0][1] > 0.1
    assert moves[1] == pytest.approx(moves[0], rel=0.01)


def test_nothing_is_near_what_has_no_shape(tmp_path: Path) -> None:
    file = tmp_path / "mark.urdf"
    file.write_text('<robot name="mark"><link name="mark"/></robot>')
    for engine in ("bullet", "mujoco"):
        made = make_world(engine, 1 / 240)
        mark = made.load_urdf(file, name="mark")
        ball = made.add_sphere(0.1, Pose(), mass=1.0)
        made.mark_start()
        assert made.separation(ball, mark, within=0.3) == 0.3
        assert made.gaps([(mark, -1), (ball, -1)], mark, within=0.3) == [0.3, 0.3]


@pytest.mark.parametrize("tilt", [0.0, 0.5])
def test_a_box_stops_on_a_box_as_in_bullet(tilt: float) -> None:
    """Not before it overlaps, and with sharp edges, though shapes of other kinds are rounded off."""
    ways = []
    for engine in ("bullet", "mujoco"):
        with closing(make_world(engine, 1 / 240)) as made:
            made.add_box((4, 4, 0.2), Pose((0, 0, -0.1)), name="floor")
            turn = tuple(quaternion_from_axis_angle((0, 1, 0), tilt))
            low = 0.05 * (math.cos(tilt) + math.sin(tilt))
            box = made.add_box(
                (0.1, 0.1, 0.1), Pose((0, 0, low + 0.011), turn), mass=1.0, name="box"
            )
            made.mark_start()
            way = []
            for _ in range(16):
                made.step()
                way.append(box.base_pose().position[2])
            ways.append(way)
    assert min(ways[0]) < low + 1e-4
    assert ways[1] == pytest.approx(ways[0], abs=2e-5)


@pytest.mark.parametrize("beyond", [0.01, 0.1])
def test_a_joint_past_its_limit_returns_as_in_bullet(beyond: float, tmp_path: Path) -> None:
    file = tmp_path / "pendulum.urdf"
    file.write_text(PENDULUM)
    places = []
    for engine in ("bullet", "mujoco"):
        made = make_world(engine, 1 / 240)
        body = made.load_urdf(file)
        body.release_motors([0])
        body.set_joints([0], [1.0 + beyond])
        made.mark_start()
        for _ in range(5):
            made.step()
        places.append(body.joint_states([0])[0][0])
    assert places[1] == pytest.approx(places[0], abs=1e-4)


def chain(count: int) -> str:
    """Return a URDF of an arm of so many joints, every other one without ends."""
    inertia = '<inertia ixx=".01" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/>'
    mass = f'<inertial><mass value="1"/>{inertia}</inertial>'
    links = "".join(f'<link name="l{i}">{mass}</link>' for i in range(count + 1))
    kinds = ('type="continuous"><axis xyz="0 0 1"/>', 'type="revolute"><axis xyz="0 1 0"/>')
    ends = ("", '<limit lower="-1" upper="1" effort="9" velocity="9"/>')
    joints = "".join(
        f'<joint name="j{i}" {kinds[i % 2]}{ends[i % 2]}<parent link="l{i}"/><child link="l{i + 1}"/>'
        '<origin xyz="0.2 0 0.05"/></joint>'
        for i in range(count)
    )
    return f'<robot name="chain">{links}{joints}</robot>'


def test_motors_ends_gears_and_bonds_are_solved_as_by_bullet(tmp_path: Path) -> None:
    """Eight sweeps are far from converged: in the order of before speeds differ by 0.01 rad/s."""
    (tmp_path / "arm.urdf").write_text(chain(5), encoding="utf-8")
    speeds: list[list[list[float]]] = []
    for engine in ("bullet", "mujoco"):
        with closing(make_world(engine, 1 / 240)) as world:
            world.set_solver_iterations(8)
            arms = [
                world.load_urdf(tmp_path / "arm.urdf", Pose((0, y, 2.0)), name=f"arm{y}")
                for y in (0, 3)
            ]
            held = [
                world.add_sphere(0.02, Pose((1.0, y, 2.25 + 0.1 * y)), mass=0.4, name=f"ball{y}")
                for y in (0, 1, 2)
            ]
            for arm in arms:
                arm.release_motors([3])
                arm.gear(1, 3, -2.0, 500.0)
            bonds = [world.attach(arms[0], "l5", ball) for ball in held]
            world.mark_start()
            told = []
            for change in range(4):
                if change == 1:
                    world.detach(bonds[0])
                elif change == 2:
                    bonds.append(world.attach(arms[0], "l4", held[0]))
                elif change == 3:
                    world.rewind()
                for _ in range(3):
                    world.step()
                for arm in arms:
                    told.append(arm.joint_states(range(5))[1])
            speeds.append(told)
    bullets, ours = map(np.array, speeds)
    assert np.abs(bullets).max() > 1e-3
    assert ours == pytest.approx(bullets, abs=1e-5)
