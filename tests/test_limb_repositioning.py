"""Limb repositioning: the arm is lifted by contact alone, lies by its weight, and the task can be done."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from episode import play

import rcare_marl
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.engines import make_world
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.devices import ArmCradle
from rcare_marl.envs.feasibility import FEASIBLE
from rcare_marl.envs.tasks import limb_repositioning as module
from rcare_marl.envs.tasks.limb_repositioning import LimbRepositioning
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose, multiply, quaternion_from_rpy, rotate

BOTH = {"robot": "scripted", "recipient": "cooperative"}


def task_of(env: CareEnv) -> LimbRepositioning:
    return cast(LimbRepositioning, env.task)


def run(env: CareEnv, seed: int) -> LimbRepositioning:
    play(env, seed)
    return task_of(env)


@pytest.fixture(scope="module")
def scripted() -> Iterator[CareEnv]:
    env = rcare_marl.make("limb_repositioning", policies=BOTH)
    yield env
    env.close()


@pytest.fixture(scope="module")
def still() -> Iterator[CareEnv]:
    policies = {"robot": "still", "recipient": "still"}
    env = rcare_marl.make("limb_repositioning", policies=policies)
    yield env
    env.close()


def test_the_scripted_robot_lays_the_arm_of_jose_on_the_armrest_within_its_passive_range(
    scripted: CareEnv,
) -> None:
    loads, done = [], 0
    for seed in range(3):
        task = run(scripted, seed)
        if not task.succeeded():
            continue
        done += 1
        weight = 9.81 * sum(task.recipient.segments[f"left_{j}"].mass for j in ("elbow", "wrist"))
        loads.append(task.report()["force_on_armrest_n"] / weight)
        top = task.chair.frame_in_world("armrest_left")
        length, width, _ = task.chair.armrest_size
        x, y, z = 0.5 * (task.state.elbow + task.state.wrist) - top.position
        assert abs(x) < 0.5 * length and abs(y) < width and abs(z - task.radius) < 0.02
        assert task.report()["beyond_prom_deg"] < 1
        assert task.report()["peak_force_n"] < task.options.force_limit
    assert done >= 2
    assert min(loads) > 0.2 and np.median(loads) < 5  # one that is wedged presses more: 6.6 here


def test_left_alone_the_arm_hangs_outside_the_armrest(still: CareEnv) -> None:
    still.reset(seed=3)
    task = task_of(still)
    for _ in range(40):
        still.step({})
    outside = (
        task.chair.frame_in_world("armrest_left").position[1] + 0.5 * task.chair.armrest_size[1]
    )
    assert task.state.wrist[1] > outside and task.state.wrist[2] < task.state.target[2] - 0.1
    assert task.report()["force_on_armrest_n"] == 0 and not task.succeeded()
    assert task.recipient.contact_forces(task.chair.body)  # it leans on the chair


def test_nothing_touches_the_person_at_the_start(still: CareEnv) -> None:
    for seed in range(10):
        still.reset(seed=seed)
        assert min(task_of(still)._gaps()) >= module.LET_GO


@pytest.mark.parametrize("person", ["jose", "kim"])  # elbows of both began inside the armrest
def test_the_arm_swings_out_of_the_chair_and_neither_into_nor_over_it(person: str) -> None:
    policies = {"robot": "still", "recipient": "still"}
    with rcare_marl.make("limb_repositioning", recipient=person, policies=policies) as env:
        task = task_of(env)
        arm, chair = task.recipient.body, task.chair.body
        links = arm.carried_by(task.recipient.frames[JOINT_INDEX["left_shoulder"]].link)
        gap = env.world.separation
        for seed in (*range(12), 9800):
            env.reset(seed=seed)
            assert min(gap(arm, chair, within=0.1, links=(k, -1)) for k in links) > -0.001
            assert task.state.wrist[2] < task.chair.frame_in_world("armrest_left").position[2]


def test_pressing_too_hard_fails_and_is_charged_to_the_end() -> None:
    env = rcare_marl.make("limb_repositioning", options={"force_limit": 1.0}, policies=BOTH)
    env.task.feasible = FEASIBLE  # else the script does not begin
    task = run(env, 0)
    assert task.failed() and not task.succeeded()
    terms = task.rewards("robot", task.state)
    assert terms["failed"] < 10 * terms["distance"] < 0
    env.close()


@pytest.mark.slow
def test_an_arm_that_weighs_more_than_may_press_is_infeasible_and_told_with_the_reason() -> None:
    policies = {"robot": "still", "recipient": "still"}
    options = {"force_limit": 25.0}  # Jose's arm weighs 31 N
    with rcare_marl.make("limb_repositioning", options=options, policies=policies) as env:
        assert not env.task.feasible.holds and "31 N" in env.task.feasible.reason
    with rcare_marl.make("limb_repositioning", options=options, policies=BOTH) as env:
        assert not run(env, 0).succeeded()
        assert env.task.report()["peak_force_n"] == 0.0  # nobody begins with it
    with rcare_marl.make("limb_repositioning", policies={"recipient": "still"}) as env:
        assert env.task.feasible.holds
        assert env.reset(seed=0)[1]["robot"]["feasible"] == 1.0


def test_an_arm_that_is_held_by_furniture_is_refused() -> None:
    with pytest.raises(ConfigError, match="hangs beside an armrest"):
        rcare_marl.make("limb_repositioning", recipient={"posture": "wheelchair"})
    with pytest.raises(ConfigError, match="left_elbow_flexion"):
        rcare_marl.make("limb_repositioning", recipient={"movable": ("left_shoulder",)})


def test_a_robot_without_reach_says_so() -> None:
    with pytest.raises(ConfigError, match="reaches"):
        rcare_marl.make("limb_repositioning", robot="nao")


def test_a_pr2_stands_where_its_elbow_stays_bent_while_it_lays_the_arm() -> None:
    policies = {**BOTH, "robot": "scripted_anyway"}
    env = rcare_marl.make("limb_repositioning", recipient="karan", robot="pr2", policies=policies)
    task = run(env, 90951)
    env.close()
    assert task.succeeded()
    assert task.state.peak_force < 45.0


def test_the_plate_lies_under_a_level_forearm_and_behind_one_that_hangs() -> None:
    cradle, elbow = ArmCradle(), np.array((-0.1, 0.3, 0.8))
    for along, out in (((1.0, 0.0, 0.0), 2), ((0.0, 0.0, -1.0), 0)):
        place, turn = cradle.under(elbow, elbow + 0.25 * np.array(along), 0.03)
        up = rotate(turn, (1.0, 0.0, 0.0))
        assert up[out] > 0.9
        assert (elbow - place) @ up == pytest.approx(0.03, abs=1e-9)  # its surface touches the skin
        assert rotate(turn, (0.0, 0.0, 1.0))[1] < -0.9  # the tip points inwards


def test_a_plate_that_is_drawn_out_does_not_take_the_arm_along() -> None:
    with closing(rcare_marl.make("limb_repositioning", recipient="morgan", policies=BOTH)) as env:
        assert run(env, 93090).succeeded()  # let go right in its place it falls off the armrest


FOREARM = """<robot name="forearm"><link name="forearm">
<inertial><mass value="1"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><capsule radius="0.04" length="0.2"/></geometry></collision></link></robot>"""


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_a_forearm_that_rocks_on_the_plate_is_not_pressed_twice_as_hard_at_once(
    engine: str, tmp_path: Path
) -> None:
    """Sunk in by 5 mm and rocked by a twentieth of a degree, it changes the force by a tenth at most."""
    path = tmp_path / "forearm.urdf"
    path.write_text(FOREARM)
    cradle = ArmCradle()
    stiffness = cradle.model.contact["plate"].stiffness
    assert stiffness is not None
    forces = []
    for angle in np.radians(np.arange(-6.0, 6.01, 0.05)):
        with closing(make_world(engine, 1 / 240)) as world:
            plate = ArmCradle().spawn(world, Pose())
            seat = cradle.frame("seat")
            up = rotate(seat.quaternion, (1.0, 0.0, 0.0))
            place = np.array(seat.position) + (0.04 - 0.005) * up
            turn = quaternion_from_rpy(np.pi / 2 + float(angle), 0.0, 0.0)
            across = tuple(multiply(seat.quaternion, turn))
            world.load_urdf(path, Pose(tuple(place), across), name="forearm", fixed=True)
            world.mark_start()
            world.step()
            forces.append(stiffness * sum(max(-c.distance, 0.0) for c in world.contacts(plate)))
    assert max(forces) > 10.0
    assert np.abs(np.diff(forces)).max() < 0.1 * max(forces), forces
