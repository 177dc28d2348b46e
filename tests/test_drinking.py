"""Drinking: water must run into an open mouth, gently and without spilling, and it can be done."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest
from episode import play
from variants import few

import rcare_marl
from rcare_marl import assets
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.tasks import drinking
from rcare_marl.envs.tasks.drinking import Drinking
from rcare_marl.errors import ConfigError
from rcare_marl.soft.fluid import PARKED
from rcare_marl.world import GRAVITY

BOTH = {"robot": "scripted", "recipient": "cooperative"}


def task_of(env: CareEnv) -> Drinking:
    return cast(Drinking, env.task)


def run(env: CareEnv, seed: int) -> Drinking:
    play(env, seed)
    return task_of(env)


@pytest.fixture(scope="module")
def scripted() -> Iterator[CareEnv]:
    env = rcare_marl.make("drinking", policies=BOTH)
    yield env
    env.close()


@pytest.fixture(scope="module")
def learned() -> Iterator[CareEnv]:
    env = rcare_marl.make("drinking", policies={"recipient": "still"})
    yield env
    env.close()


def test_where_the_mouth_was_is_kept_while_the_face_is_turned_away() -> None:
    env = rcare_marl.make("drinking", policies={"robot": "scripted", "recipient": "refusing"})
    env.reset(seed=0)
    task, turned, apart = task_of(env), 0, 0.0
    while not env.is_over and turned < 15:
        kept = task.state.mouth_faced
        env.step({})
        state = task.state
        turned += bool(state.refusal.turned)
        expected = kept if state.refusal.turned else state.mouth
        assert np.array_equal(state.mouth_faced, expected)
        apart = max(apart, float(np.linalg.norm(state.mouth - state.mouth_faced)))
    env.close()
    assert turned == 15
    assert apart > 0.01  # [m]: so there was something to keep


@pytest.mark.parametrize("seed", few(range(3), 0))
def test_the_scripted_robot_gives_karan_to_drink(scripted: CareEnv, seed: int) -> None:
    task = run(scripted, seed)
    metrics = task.report()
    assert task.succeeded()
    assert metrics["drunk_share"] >= drinking.LEAST_DRUNK
    assert metrics["spilled_share"] <= 0.02
    assert metrics["peak_force_n"] < 10.0
    assert metrics["tilt_deg"] > 60.0


def test_the_gentle_script_presses_less_than_half_as_hard_as_the_scripted_one() -> None:
    peaks = []
    for robot in ("scripted", "gentle"):
        policies = {**BOTH, "robot": robot}
        env = rcare_marl.make("drinking", recipient="population:train:748", policies=policies)
        task = run(env, 90801)
        env.close()
        assert task.succeeded()
        peaks.append(task.state.peak_force)
    assert peaks[0] > 2.0 and peaks[1] < 0.5 * peaks[0]


def test_a_panda_holds_the_cup_where_its_wrist_can_still_turn_at_the_lips() -> None:
    policies = {**BOTH, "robot": "gentle"}
    recipient = "population:train:825"
    env = rcare_marl.make("drinking", robot="franka_panda", recipient=recipient, policies=policies)
    assert run(env, 90423).succeeded()
    env.close()


def test_a_ur5_stands_where_it_brings_a_cup_to_lips_that_it_does_not_reach_from_before_the_feet() -> (
    None
):
    policies = {**BOTH, "robot": "gentle"}
    env = rcare_marl.make("drinking", robot="ur5", recipient="kim", policies=policies)
    assert run(env, 90616).succeeded()
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("avatar", assets.names("avatars"))
def test_every_avatar_can_be_given_to_drink(avatar: str) -> None:
    env = rcare_marl.make("drinking", recipient=avatar, policies=BOTH)
    assert run(env, 0).succeeded()
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["kinova_gen2", "franka_panda", "pr2", "fetch"])
def test_other_robots_that_reach_can_do_it(robot: str) -> None:
    env = rcare_marl.make("drinking", robot=robot, policies={**BOTH, "robot": "scripted_anyway"})
    assert run(env, 0).succeeded()
    env.close()


def test_the_hand_that_holds_the_cup_is_kept_clear_of_the_person() -> None:
    both = {"robot": "learned", "recipient": "cooperative"}
    with pytest.warns(UserWarning, match="franka_panda"):
        env = rcare_marl.make("drinking", robot="franka_panda", policies=both)
    assert run(env, 90964).report()["peak_force_n"] < 5.0  # 31 N of the wrist on an arm before
    env.close()


@pytest.mark.slow
def test_the_robot_can_be_mounted_on_the_left() -> None:
    env = rcare_marl.make("drinking", options={"mount": "left"}, policies=BOTH)
    assert run(env, 0).succeeded()
    env.close()


@pytest.mark.parametrize("robot", few(("nao", "stretch_re1"), "nao"))
def test_a_robot_that_cannot_reach_is_refused(robot: str) -> None:
    with pytest.raises(ConfigError, match="no arm that reaches"):
        rcare_marl.make("drinking", robot=robot)


def test_who_lies_in_bed_is_not_given_to_drink() -> None:
    with pytest.raises(ConfigError, match="must sit in the wheelchair"):
        rcare_marl.make("drinking", recipient={"posture": "bed_supine"})


def test_a_closed_mouth_drinks_nothing() -> None:
    env = rcare_marl.make("drinking", policies={"robot": "scripted", "recipient": "still"})
    env.reset(seed=0)
    for _ in range(60):
        env.step({})
    task = task_of(env)
    assert task.state.distance < 0.1  # it waits there
    assert task.report()["drunk_share"] == 0 and not task.succeeded()
    env.close()


def test_at_the_start_all_water_is_in_an_upright_cup_before_the_face(learned: CareEnv) -> None:
    for seed in range(4):
        learned.reset(seed=seed)
        task = task_of(learned)
        assert task.cup.vessel.holds(task.water.positions).all()
        assert task.cup.up_in_world()[2] > 0.99
        low, high = drinking.START_GAP
        assert low - 0.1 < task.state.distance < high + 0.1
        assert task.report()["spilled_share"] == 0


@pytest.mark.parametrize("control", ["joint_velocity", "tool_delta"])
def test_a_robot_at_rest_spills_nothing_and_carries_the_water(control: str) -> None:
    env = rcare_marl.make("drinking", robot={"control": control}, policies={"recipient": "still"})
    env.reset(seed=0)
    task, forces = task_of(env), []
    rest = np.zeros(env.action_space("robot").shape, np.float32)
    for _ in range(15):
        env.step({"robot": rest})
        forces.append(-task.water.force_on(task.cup.body)[2])
    assert task.cup.vessel.holds(task.water.positions).all()
    assert np.mean(forces[5:]) == pytest.approx(task.water.mass * GRAVITY, rel=0.05)
    env.close()


def test_a_cup_that_is_turned_over_away_from_the_mouth_spills_and_fails(learned: CareEnv) -> None:
    learned.reset(seed=0)
    tilt = np.array((0, 0, 0, 0, 1, 0), np.float32)
    while not learned.is_over:
        learned.step({"robot": tilt})
    task = task_of(learned)
    assert task.report()["spilled_share"] > drinking.MOST_SPILLED
    assert task.failed() and not task.succeeded()


def test_too_much_force_fails() -> None:
    env = rcare_marl.make("drinking", policies={"recipient": "still"}, options={"force_limit": 2.0})
    env.reset(seed=0)
    task = task_of(env)
    while not env.is_over:
        push = np.zeros(6, np.float32)
        push[:3] = np.clip(
            8 * (task.mouth.position - 0.05 * task.mouth.face - task.state.rim), -0.5, 0.5
        )
        env.step({"robot": push})
    assert task.report()["peak_force_n"] > 2.0
    assert task.failed()
    env.close()


def test_water_that_is_drunk_leaves_the_scene_and_the_cup_gets_lighter(scripted: CareEnv) -> None:
    task = run(scripted, 1)
    gone = ~task.water.is_active
    assert gone.mean() == pytest.approx(task.report()["drunk_share"])
    assert (task.water.positions[gone] == PARKED).all()
    assert task.water.mass < 0.03


def test_a_good_end_pays_at_least_what_waiting_would(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    best = 0.0
    while not scripted.is_over:
        best = max(best, sum(task_of(scripted).rewards("robot", task_of(scripted).state).values()))
        scripted.step({})
    left = (Drinking.time_limit - scripted.world.time) / task_of(scripted).control_dt
    assert task_of(scripted).rewards("robot", task_of(scripted).state)["done"] >= best * left - 1e-9


def test_the_paper_reward_is_its_formula(learned: CareEnv) -> None:
    learned.reset(seed=0)
    task = task_of(learned)
    terms = task.rewards("robot", task.state)
    assert terms["water"] == 1.0 and 0 < terms["approach"] < 1
    assert terms["drunk"] == terms["done"] == 0
    spilled = np.arange(task.water.size) < 0.25 * task.water.size
    task.water.place(task.water.positions + spilled[:, None] * (0.5, 0.0, 0.0))
    task.look()
    assert task.rewards("robot", task.state)["water"] == pytest.approx(0.75**2, rel=0.02)


def test_the_shaped_reward_has_its_own_terms() -> None:
    env = rcare_marl.make("drinking", options={"reward": "shaped"})
    _, infos = env.reset(seed=0)
    assert {"water", "approach", "drunk", "comfort", "upright", "done"} <= set(infos["robot"])
    assert {"cost", "peak_pressure_pa", "spilled_share"} <= set(infos["robot"])
    env.close()


def test_the_scripted_robot_says_which_control_mode_it_needs() -> None:
    with pytest.raises(ConfigError, match="tool_delta"):
        rcare_marl.make(
            "drinking", robot={"control": "joint_velocity"}, policies={"robot": "scripted"}
        )


@pytest.mark.slow
def test_it_takes_place_in_a_house() -> None:
    env = rcare_marl.make("drinking", policies=BOTH, home="house_07", level=2)
    assert run(env, 0).succeeded()
    env.close()
