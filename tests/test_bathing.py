"""Bathing: an arm is wiped by contact in one stroke, gently, and what was wiped is known."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest
from episode import play
from variants import few

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.scenes import wiped_skin
from rcare_marl.envs.tasks import bathing
from rcare_marl.envs.tasks.bathing import Bathing
from rcare_marl.errors import ConfigError, UnknownNameError

BOTH = {"robot": "scripted", "recipient": "still"}


def task_of(env: CareEnv) -> Bathing:
    return cast(Bathing, env.task)


def run(env: CareEnv, seed: int) -> Bathing:
    play(env, seed)
    return task_of(env)


@pytest.fixture(scope="module")
def scripted() -> Iterator[CareEnv]:
    env = rcare_marl.make("bathing", policies=BOTH)
    yield env
    env.close()


@pytest.fixture(scope="module")
def learned() -> Iterator[CareEnv]:
    env = rcare_marl.make("bathing", policies={"recipient": "still"})
    yield env
    env.close()


def push_down(env: CareEnv, steps: int) -> None:
    """Move the tool of the learning robot straight down at 6 cm/s."""
    action = np.zeros(env.action_space("robot").shape, np.float32)
    action[2] = -0.24
    for _ in range(steps):
        if env.is_over:
            break
        env.step({"robot": action})


@pytest.mark.parametrize("seed", few(range(5), 0, 1))
def test_the_scripted_robot_bathes_natalia_gently(scripted: CareEnv, seed: int) -> None:
    task = run(scripted, seed)
    metrics = task.report()
    assert task.succeeded()
    assert metrics["peak_force_n"] < 8.0
    assert metrics["coverage"] > 0.6
    assert metrics["prom_violation_deg_s"] == 0.0


def test_the_gentle_script_bathes_with_less_force_than_the_scripted_one(scripted: CareEnv) -> None:
    task = run(scripted, 0)
    assert task.succeeded()
    env = rcare_marl.make("bathing", policies={**BOTH, "robot": "gentle"})
    other = run(env, 0)
    env.close()
    assert other.succeeded() and 0 < other.state.peak_force < 0.8 * task.state.peak_force


@pytest.mark.slow
def test_the_gentle_script_gives_way_to_a_belly_beside_the_elbow() -> None:
    """With 4.0 N at most on the trunk; 5.0 N before it gave way."""
    policies = {**BOTH, "robot": "gentle"}
    env = rcare_marl.make("bathing", recipient="population:train:637", policies=policies)
    report = run(env, 90637).report()
    env.close()
    assert report["coverage"] > 0.4 and 0.5 < report["peak_force_trunk_n"] < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("avatar", assets.names("avatars"))
def test_every_avatar_can_be_bathed(avatar: str) -> None:
    env = rcare_marl.make("bathing", recipient=avatar, policies=BOTH)
    assert all(run(env, seed).succeeded() for seed in range(2))
    env.close()


@pytest.mark.slow
# A UR5's script is refused: 21 of 24 in docs/tasks.md.
@pytest.mark.parametrize("robot", sorted(set(assets.names("robots")) - {"nao", "pepper", "ur5"}))
def test_every_robot_that_reaches_can_bathe(robot: str) -> None:
    env = rcare_marl.make("bathing", robot=robot, policies={**BOTH, "robot": "scripted_anyway"})
    assert run(env, 0).succeeded()
    env.close()


def test_a_robot_that_cannot_reach_is_refused() -> None:
    with pytest.raises(ConfigError, match="no arm that reaches"):
        rcare_marl.make("bathing", robot="nao")


def test_who_sits_is_not_bathed_in_bed() -> None:
    with pytest.raises(ConfigError, match="must lie on the back"):
        rcare_marl.make("bathing", recipient={"posture": "wheelchair"})


def test_flesh_that_a_sponge_cannot_feel_is_refused() -> None:
    with pytest.raises(ConfigError, match="does not feel flesh"):
        rcare_marl.make("bathing", recipient={"tissue": ["left_arm"]})


def test_the_elbow_alone_is_not_the_goal(learned: CareEnv) -> None:
    learned.reset(seed=0)
    task = task_of(learned)
    task._set_sponge(task._over(task.target_on_arm()[0], 0.03))
    push_down(learned, 20)
    metrics = task.report()
    assert metrics["sponge_force_n"] > 1.0
    assert metrics["distance_m"] < 0.04
    assert not task.succeeded()


def test_too_much_force_fails_and_costs_more_than_to_go_on() -> None:
    env = rcare_marl.make("bathing", policies=BOTH, options={"force_limit": 3.0})
    task = run(env, 0)
    terms = task.rewards("robot", task.state)
    left = (task.time_limit - env.world.time) / task.control_dt
    assert task.failed() and not task.succeeded()
    assert terms["hurt"] == pytest.approx(-bathing.HURT * left)
    assert terms["hurt"] < left * (terms["distance"] + terms["force"])
    env.close()


def test_the_arm_yields_to_the_sponge_and_the_cushion_bears_it(learned: CareEnv) -> None:
    learned.reset(seed=3)
    task = task_of(learned)
    before = np.array(task.recipient.joint_pose("left_elbow").position)
    task._set_sponge(task._over(0.6, 0.02))
    push_down(learned, 30)
    after = np.array(task.recipient.joint_pose("left_elbow").position)
    cushion = next(b for b in learned.world.bodies if b.name == "cushion")
    assert 0.0003 < before[2] - after[2] < 0.02
    assert learned.world.contact_force(task.recipient.body, cushion) > 0.5


def test_pressing_is_felt_by_person_and_robot_alike(scripted: CareEnv) -> None:
    scripted.reset(seed=1)
    task = task_of(scripted)
    for _ in range(30):
        scripted.step({})
    own = float(np.linalg.norm(task.state.push))
    assert 3.0 < own < 7.0
    assert task.recipient.contact_forces(task.sponge.body)["left_shoulder"] == pytest.approx(
        own, rel=0.2
    )
    assert scripted.world.contact_force(task.sponge.body) >= own * 0.99


def test_only_skin_of_the_arm_gets_wet_and_it_can_be_seen(scripted: CareEnv) -> None:
    task = run(scripted, 2)
    skin, person = task.skin, task.recipient
    wet = np.flatnonzero(skin.wetness)
    owners = {int(j) for j in np.unique(person.model.owner[wet])}
    names = {JOINT_INDEX[f"left_{j}"] for j in ("shoulder", "elbow")}
    assert len(wet) > 50 and owners <= names
    assert skin.wetness.max() == 1.0
    painted = next(s for s in scripted.world.skins if s.body is person.body)
    assert (painted.colors != skin._dry).any(axis=1).sum() <= len(wet)
    scripted.reset(seed=2)
    assert not skin.wetness.any() and skin.coverage == 0.0
    assert (painted.colors == skin._dry).all()


def test_coverage_grows_by_what_is_wiped_and_never_falls(scripted: CareEnv) -> None:
    scripted.reset(seed=4)
    seen = []
    while not scripted.is_over:
        scripted.step({})
        seen.append(task_of(scripted).state.covered)
    assert seen[0] == 0.0 and (np.diff(seen) >= 0).all() and 0.3 < seen[-1] <= 1.0


def test_the_arm_is_bare(scripted: CareEnv) -> None:
    model, dry = task_of(scripted).recipient.model, task_of(scripted).skin._dry
    arm = task_of(scripted).skin.vertices
    arm = arm[model.owner[arm] == JOINT_INDEX["left_shoulder"]]
    other = model.owner == JOINT_INDEX["right_shoulder"]
    assert len(np.unique(dry[arm], axis=0)) == 1
    assert (dry[other] == model.colors[other]).all()


def test_places_on_the_arm_follow_it(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    skin = task_of(scripted).skin
    points = [skin.place(share)[0] for share in (0.3, 0.6, 0.9)]
    assert [skin.progress(p) for p in points] == pytest.approx([0.3, 0.6, 0.9], abs=1e-6)
    point, out = skin.place(0.6)
    assert out[2] > 0.95 and float(out @ skin.direction()) == pytest.approx(0.0, abs=1e-9)
    right = skin.place(0.6, 0.3)[1]
    assert float(np.cross(skin.direction(), (0, 0, 1)) @ right) > 0.2


@pytest.mark.slow
def test_the_sponge_never_goes_through_the_arm_in_ten_minutes_of_random_actions() -> None:
    """Checked each second, against the capsule of the upper arm: flesh yields by some millimetres."""
    policies = {"robot": "random", "recipient": "random"}
    env = rcare_marl.make("bathing", options={"force_limit": 1e6}, policies=policies)
    task = task_of(env)
    person, presses = task.recipient, 0
    shape = person.segments["left_shoulder"].shapes[0]
    for seed in range(30):  # of 20 s each
        env.reset(seed=seed)
        while not env.is_over:
            env.step({})
            points = task.sponge.points()
            assert np.isfinite(points).all()
            assert task.sponge.soft.deviation() < 0.1
            presses += task.report()["force_n"] > 1
            if round(env.world.time / task.control_dt) % 10 == 0:
                frame = np.linalg.inv(person.joint_pose("left_shoulder").matrix())
                local = points @ frame[:3, :3].T + frame[:3, 3]
                assert min(shape.distance(point) for point in local) > -0.02
    assert presses > 100
    env.close()


def test_shaped_rewards_pay_for_wiping() -> None:
    env = rcare_marl.make("bathing", policies=BOTH, options={"reward": "shaped"})
    env.reset(seed=0)
    wiped = 0.0
    while not env.is_over:
        env.step({})
        terms = task_of(env).rewards("robot", task_of(env).state)
        wiped += terms["wiped"]
    weights = bathing.BathingOptions.SHAPED_WEIGHTS
    assert wiped == pytest.approx(weights["wiped"] * task_of(env).state.covered)
    assert terms["reached"] == weights["reached"]
    env.close()


def test_a_limb_must_be_known(scripted: CareEnv) -> None:
    task = task_of(scripted)
    with pytest.raises(UnknownNameError, match="left_shoulder"):
        wiped_skin.WipedSkin(task.recipient, scripted.world, "left_sholder", "left_elbow")
    with pytest.raises(ConfigError, match="not one capsule"):
        wiped_skin.WipedSkin(task.recipient, scripted.world, "head", "jaw")


def test_options_are_checked() -> None:
    with pytest.raises(ConfigError, match="force_limit"):
        rcare_marl.make("bathing", options={"force_limit": 0})
    with pytest.raises(ConfigError, match="least_coverage"):
        rcare_marl.make("bathing", options={"least_coverage": 2})


@pytest.mark.slow
def test_bathing_finds_a_room_in_a_house() -> None:
    env = rcare_marl.make("bathing", home="house_01", level=3, policies=BOTH)
    assert run(env, 0).succeeded()
    env.close()
