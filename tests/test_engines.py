"""MuJoCo beside Bullet: the same tasks, people and controllers, on either engine."""

from __future__ import annotations

import builtins
import json
import math
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import rcare_marl
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.baselines.benchmark import batch, engine_episodes, parity
from rcare_marl.cli import app
from rcare_marl.engines import make_world
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.devices import FloorLift, HospitalBed
from rcare_marl.envs.registry import task_class
from rcare_marl.errors import ConfigError, MissingPackageError, UnknownNameError
from rcare_marl.pose import Pose

SCRIPTED = {"robot": "scripted", "recipient": "cooperative"}
SCRATCHED = {"robot": "scripted", "recipient": "still"}


def played(env: CareEnv, seed: int) -> tuple[bool, list[Any]]:
    """Return whether an episode of all policies succeeds, and the exact states after each step."""
    env.reset(seed=seed)
    states = []
    while not env.is_over:
        env.step({})
        states.append([body.state() for body in env.world.bodies])
    return bool(env.task.succeeded()), states


def same(one: list[Any], other: list[Any]) -> bool:
    pairs = zip(one, other, strict=True)
    return all(np.array_equal(a, b) for x, y in pairs for a, b in zip(x, y, strict=True))


def test_a_script_feeds_and_an_episode_repeats_bit_for_bit() -> None:
    with closing(rcare_marl.make("feeding", engine="mujoco", policies=SCRIPTED)) as env:
        first = played(env, 0)
        assert first[0]
        assert played(env, 1)[0]
        assert same(first[1], played(env, 0)[1])
    with closing(rcare_marl.make("feeding", engine="mujoco", policies=SCRIPTED)) as env:
        assert same(first[1], played(env, 0)[1])


def test_people_act_by_muscles_too() -> None:
    person = {"model": "karan", "actuation": "muscle"}
    with closing(rcare_marl.make("feeding", engine="mujoco", recipient=person)) as env:
        env.reset(seed=0)
        for _ in range(5):
            actions = {r: np.zeros(env.action_space(r).shape, np.float32) for r in env.agents}
            seen = env.step(actions)[0]
        assert all(np.isfinite(value).all() for value in seen.values())


@pytest.mark.parametrize(
    "task", [pytest.param("feeding", marks=pytest.mark.slow), "limb_repositioning"]
)
def test_reset_one_second_of_the_same_actions_and_presses_are_bullets(task: str) -> None:
    found = parity.bench(task, seed=20, postures=20)
    assert found["met"], found


def test_a_scratch_is_bullets_to_the_third_digit() -> None:
    """Closed loop, from the reset to the last stroke: the touch of a ball is one contact on either engine."""
    told = []
    for engine in ("bullet", "mujoco"):
        with closing(rcare_marl.make("scratching", engine=engine, policies=SCRATCHED)) as env:
            is_done, states = played(env, 601)
            told.append((is_done, len(states), float(env.task.report()["peak_force_n"])))
    (done, steps, force), (also, count, other) = told
    assert done and also and steps == count and force > 1.0
    assert other == pytest.approx(force, rel=1e-3)


def test_a_lift_and_a_bed_raise_people_as_in_bullet() -> None:
    rises, loads = [], []
    for engine in ("bullet", "mujoco"):
        made, lift, bed = make_world(engine, 1 / 240), FloorLift(), HospitalBed()
        lift.spawn(made)
        bed.spawn(made, Pose((5.0, 0, 0)))
        posture, frame = lift.postures["slung"]
        person = Human("kim", load_avatar("kim"), posture=load_posture(posture), fixed_base=False)
        person.spawn(made, lift.frame_in_world(frame))
        person.reset(np.random.default_rng(0))
        made.mark_start()
        lift.carry(person)  # a bond made in the episode
        start = person.body.base_pose().position[2], bed.position("height")
        lift.command("boom", lift.body.joint("boom").upper)
        bed.command("height", bed.limits("height")[1])
        for _ in range(480):
            person.actuate()
            made.step()
        rise = person.body.base_pose().position[2] - start[0], bed.position("height") - start[1]
        rises.append(rise)
        loads.append(lift.load())
    assert min(rises[0]) > 0.02
    assert rises[1] == pytest.approx(rises[0], abs=0.004)
    assert loads[1] == pytest.approx(loads[0], rel=0.05)


SENSED = ["joint_wrench", "joint_torque", {"kind": "wrist_wrench", "tare": True}]


@pytest.fixture(scope="module")
def sensed() -> Iterator[list[CareEnv]]:
    """Give the same scene in Bullet and in MuJoCo."""
    with ExitStack() as stack:
        yield [
            stack.enter_context(rcare_marl.make("feeding", engine=e, robot={"sensors": SENSED}))
            for e in ("bullet", "mujoco")
        ]


@pytest.mark.parametrize("way", [0.0, 0.2])
def test_joints_and_wrists_feel_what_they_feel_in_bullet(sensed: list[CareEnv], way: float) -> None:
    found = []
    for env in sensed:
        env.reset(seed=0)
        action = np.zeros(env.action_space("robot").shape, np.float32)
        action[0] = -way
        rest = np.zeros(env.action_space("recipient").shape, np.float32)
        for _ in range(8):
            env.step({"robot": action, "recipient": rest})
        assert (suite := env.cast["robot"].sensors) is not None
        read = suite.reading
        names = [("joint_wrench", "force"), ("joint_wrench", "torque")]
        names += [("joint_torque", "effort"), ("wrist_wrench", "force")]
        found.append([np.asarray(read(*name)) for name in [*names, ("wrist_wrench", "torque")]])
    for bullet, mujoco in zip(found[0][:2], found[1][:2], strict=True):
        assert mujoco == pytest.approx(bullet, abs=0.02 * float(np.abs(bullet).max()))
    assert found[1][2] == pytest.approx(found[0][2], abs=0.02 * float(np.abs(found[0][2]).max()))
    for bullet, mujoco in zip(found[0][3:], found[1][3:], strict=True):
        assert mujoco == pytest.approx(bullet, abs=0.2)


def test_what_does_not_run_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="tooth_brushing.*these do: .*feeding"):
        rcare_marl.make("tooth_brushing", engine="mujoco")
    with pytest.raises(UnknownNameError, match="Did you mean 'mujoco'"):
        rcare_marl.make("feeding", engine="mujocco")
    real = builtins.__import__

    def without(name: str, *args: Any) -> Any:
        if name == "mujoco":
            raise ImportError(name)
        return real(name, *args)

    monkeypatch.delitem(sys.modules, "mujoco", raising=False)
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingPackageError, match=r"rcare-marl\[batch\]"):
        rcare_marl.make("feeding", engine="mujoco")


def played_by_partners(task: str, seeds: Sequence[int], **cast: Any) -> list[tuple[bool, float]]:
    """Return of episodes on MuJoCo whether they succeed, and the greatest force on the recipient [N]."""
    with closing(rcare_marl.make(task, engine="mujoco", **cast)) as env:
        here = set(env.cast)
    partners = {name: role.partner for name, role in task_class(task).roles().items()}
    policies = {name: partner for name, partner in partners.items() if name in here}
    found = []
    with closing(rcare_marl.make(task, engine="mujoco", policies=policies, **cast)) as env:
        for seed in seeds:
            env.reset(seed=seed)
            peak = 0.0
            while not env.is_over:
                env.step({})
                peak = max(peak, float(getattr(env.task.state, "force", 0.0)))
            found.append((bool(env.task.succeeded()), peak))
    return found


def test_our_sponge_bathes_in_step_with_mujoco() -> None:
    ((succeeded, peak),) = played_by_partners("bathing", [0])
    assert succeeded
    assert peak == pytest.approx(4.3, abs=0.2)  # as in Bullet


def test_a_cup_is_handed_over_and_our_water_drunk_on_mujoco() -> None:
    for task in ("handing_over", "drinking"):
        assert played_by_partners(task, [0])[0][0], task


@pytest.mark.slow
@pytest.mark.parametrize(
    "task",
    [
        "limb_repositioning",
        "toileting",
        "bathing",
        "drinking",
        "handing_over",
        "phyrc_bathing",
        "dressing",
    ],
)
def test_other_scripts_succeed(task: str) -> None:
    succeeded = sum(success for success, _ in played_by_partners(task, range(3)))
    assert succeeded >= (2 if task == "limb_repositioning" else 3)  # there 2 of 45 do not


@pytest.mark.slow
@pytest.mark.parametrize(
    "task, place", [("feeding", 2), ("toileting", 1), ("ambulating", 3), ("bathing", 1)]
)
def test_scripts_succeed_in_a_house(task: str, place: int) -> None:
    home = "house_09" if task == "bathing" else "house_07"
    found = played_by_partners(task, range(2), home=home, level=place)
    assert all(succeeded for succeeded, _ in found)


@pytest.mark.slow
def test_bench_batch_tells_both_speeds_and_the_ratio() -> None:
    told = CliRunner().invoke(
        app, ["bench", "batch", "feeding", "--device", "cpu", "--steps", "10", "--json"]
    )
    assert told.exit_code == 0, told.output
    found = json.loads(told.stdout)
    both = found["env_steps_per_s"] / found["bullet_env_steps_per_s"]
    assert found["ratio"] == pytest.approx(both)
    assert CliRunner().invoke(app, ["bench", "batch", "--device", "tpu"]).exit_code != 0
    assert CliRunner().invoke(app, ["bench", "homes", "feeding"]).exit_code == 2


@pytest.mark.slow
def test_bench_batch_over_processes_tells_what_the_machine_allows_a_loop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(batch, "ENVS", 1)
    found = batch.bench("toileting", steps=10, processes="2")
    assert found["processes"] == 2
    assert found["efficiency"] > 0 < found["loop_efficiency"]
    assert found["met"].keys() == {"ratio", "efficiency"}


def test_episodes_of_a_policy_are_compared_with_bounds() -> None:
    told, figures = engine_episodes.compare("toileting", 2, 900, 1, "scripted")
    assert {engine: each["episodes"] for engine, each in told["scripted"].items()} == {
        "bullet": 2,
        "mujoco": 2,
    }
    assert figures.keys() == {"success_scripted", "force_scripted"}
    assert figures["success_scripted"]["met"]
    assert engine_episodes.critical(500, 500) == pytest.approx(1.358 * math.sqrt(2 / 500), rel=1e-3)
    with pytest.raises(UnknownNameError, match="learned"):
        engine_episodes.compare("toileting", 2, 900, 1, "learnt")
