"""PhyRC's bathing challenge: every point is earned by what happened, and none by a hole in the rules."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest
from episode import play
from variants import few

import rcare_marl
from rcare_marl import assets
from rcare_marl.baselines.scripted.phyrc_bathing import KEEP, ScriptedPhyrcBathing
from rcare_marl.contact import Contact
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.phyrc.bath_scene import BED_RAISE
from rcare_marl.envs.phyrc.bath_score import BathScore
from rcare_marl.envs.phyrc.phyrc_score import ScoreSheet
from rcare_marl.envs.tasks.phyrc_bathing import PhyrcBathing
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose, quaternion_from_rpy

BOTH = {"robot": "scripted", "recipient": "still"}


def task_of(env: CareEnv) -> PhyrcBathing:
    return cast(PhyrcBathing, env.task)


@pytest.fixture(scope="module")
def scripted() -> Iterator[CareEnv]:
    env = rcare_marl.make("phyrc_bathing", policies=BOTH)
    yield env
    env.close()


@pytest.fixture(scope="module")
def learned() -> Iterator[CareEnv]:
    env = rcare_marl.make("phyrc_bathing", policies={"recipient": "still"})
    yield env
    env.close()


def wait(env: CareEnv, steps: int, closing: float = 0.0) -> None:
    """Let the arm stand still for some control steps."""
    action = np.zeros(env.action_space("robot").shape, np.float32)
    action[-1] = closing
    for _ in range(steps):
        env.step({"robot": action})


def test_items_count_in_order_once_a_second_and_what_was_earned_stays() -> None:
    worth: dict[str, int | None] = {"a": None, "b": 5, "c": 7}
    sheet = ScoreSheet({name: lambda n=name: worth[n] for name in worth})  # type: ignore[misc]
    sheet.update(1.0)
    assert sheet.total == 0 and sheet.stage == 0
    worth["a"] = 5
    sheet.update(1.9)
    assert sheet.total == 0  # no second has passed
    sheet.update(2.0)
    assert sheet.points == {"a": 5, "b": 5, "c": 7} and sheet.stage == 3
    worth.update(a=None, b=-5)
    sheet.update(3.0)
    assert sheet.points == {"a": 5, "b": -5, "c": 7}
    sheet.reset()
    assert sheet.total == 0 and sheet.stage == 0


@pytest.mark.slow
def test_the_scripted_robot_takes_dips_and_brings_the_sponge(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    task, paid, in_the_air = task_of(scripted), 0.0, 0
    score = task.score
    while score.sheet.stage < 3 and not scripted.is_over:
        scripted.step({})
        paid += task.rewards("robot", task.state)["score"]
        if score.sheet.stage == 2 and task.state.push == 0.0:
            in_the_air += 1  # held, wet, at 0 N
            assert score.sheet.points["move"] == 0
    assert in_the_air > 10
    assert score.sheet.points == {"pick_up": 5, "dip": 5, "move": 5, "wash": 0}
    assert paid == task.report()["score"] == 15.0
    assert scripted.world.time < 25.0
    metrics = task.report()
    assert metrics["wetness"] == 1.0 and metrics["basin_tipped"] == 0.0
    assert metrics["peak_force_n"] < 12.0


@pytest.mark.slow
def test_the_scripted_robot_scores_most_points() -> None:
    env = rcare_marl.make("phyrc_bathing", policies=BOTH)
    scores = []
    for seed in range(20):
        play(env, seed)
        scores.append(task_of(env).report()["score"])
        assert task_of(env).report()["peak_force_n"] < 20.0
    env.close()
    assert np.mean(scores) > 35.0 and min(scores) >= 25.0


@pytest.mark.slow
def test_a_random_robot_scores_nothing() -> None:
    env = rcare_marl.make("phyrc_bathing", policies={"robot": "random", "recipient": "still"})
    for seed in range(10):
        play(env, seed)
        assert task_of(env).report()["score"] <= 0.0
        assert not task_of(env).succeeded()
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("avatar", assets.names("avatars"))
def test_the_sponge_is_brought_to_every_avatar_and_washes(avatar: str) -> None:
    env = rcare_marl.make("phyrc_bathing", recipient=avatar, policies=BOTH)
    play(env, 0)
    assert task_of(env).report()["score"] > 15.0  # three items of five, and some of the last
    env.close()


def test_the_bed_is_lowered_until_heavy_people_lie_clear_of_the_table() -> None:
    env = rcare_marl.make("phyrc_bathing", recipient="population:train:81")  # 117 kg, 1.60 m
    scene, person = task_of(env).scene, task_of(env).recipient
    assert scene.bed.position("height") < BED_RAISE
    for seed in range(90010, 90020):
        env.reset(seed=seed)
        for thing in (scene.table, scene.basin, scene.sponge):
            assert env.world.separation(person.body, thing.body, within=0.1) > 0.0
    env.close()


def test_who_does_not_fit_under_the_table_is_refused() -> None:
    with pytest.raises(ConfigError, match="does not fit under the table over the bed"):
        rcare_marl.make("phyrc_bathing", recipient="population:train:807")  # 121 kg, 1.63 m


def test_nothing_hard_is_moved_onto_the_person(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    script = cast(ScriptedPhyrcBathing, scripted.policies["robot"])
    place = (0.0, 0.0, 0.0)

    def near(gap: float, *normal: float) -> Contact:
        return Contact(0, 0, place, cast(tuple[float, float, float], normal), gap, 0.0)

    down, along = np.array((0.0, 0.0, -0.1)), np.array((0.1, 0.0, 0.0))
    script._near = [near(KEEP, 0.0, 0.0, 1.0)]
    assert script._spared(down) == pytest.approx(0.0)
    assert script._spared(along) == pytest.approx(along)
    script._near = [near(0.0, 0.0, 0.0, 1.0), near(KEEP, -1.0, 0.0, 0.0)]
    x, _, z = script._spared(along)  # out of what is touched, and not into what is beside it
    assert x == pytest.approx(0.0) and z > 0.0


@pytest.mark.slow
def test_the_plate_of_the_sponge_spares_a_forearm_that_lies_on_the_thigh() -> None:
    env = rcare_marl.make("phyrc_bathing", recipient="karan", policies=BOTH)
    play(env, 90003)  # of the seeds that it was tuned on: 22 N before
    assert task_of(env).succeeded() and task_of(env).report()["peak_force_n"] < 12.0
    env.close()


def test_a_robot_that_cannot_reach_is_refused() -> None:
    with pytest.raises(ConfigError, match="no arm that reaches"):
        rcare_marl.make("phyrc_bathing", robot="nao")


def test_fingers_that_do_not_move_are_refused() -> None:
    with pytest.raises(ConfigError, match="name the gripper among `moves`"):
        rcare_marl.make("phyrc_bathing", robot={"moves": ["arm"]})


def test_the_sponge_rests_on_the_table_and_closing_beside_it_takes_nothing(
    learned: CareEnv,
) -> None:
    learned.reset(seed=0)
    task = task_of(learned)
    start = task.scene.sponge_at.position
    wait(learned, 20, closing=1.0)
    assert math.dist(task.scene.sponge.pose.position, start) < 0.003
    assert not task.state.is_held


def test_the_sponge_is_taken_where_it_is_and_falls_when_the_hand_opens(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    task = task_of(scripted)
    while not task.state.is_held:
        before = task.scene.sponge.pose.position
        scripted.step({})
    assert (
        math.dist(task.scene.sponge.pose.position, before) < 0.01
    )  # it does not jump into the hand
    while task.scene.sponge.pose.position[2] < task.scene.sponge_at.position[2] + 0.1:
        scripted.step({})
    gripper = task.robot.gripper
    assert gripper is not None
    scripted.policies["robot"].act = lambda: np.array([0, 0, 0, 0, 0, 0, -1.0])  # type: ignore[method-assign]
    for _ in range(15):
        scripted.step({})
    del scripted.policies["robot"].act
    assert not task.state.is_held
    assert task.scene.sponge.pose.position[2] < task.scene.sponge_at.position[2] + 0.05


def test_water_wets_what_is_under_its_surface_and_a_tipped_basin_has_none(learned: CareEnv) -> None:
    learned.reset(seed=0)
    basin = task_of(learned).scene.basin
    middle = np.array(basin.frame_in_world("water").position)
    points = middle + np.array(((0, 0, -0.01), (0, 0, -0.05), (0, 0, 0.01), (0.5, 0, -0.01)))
    assert basin.submerged(points) == pytest.approx(0.5)
    assert not basin.spills()
    at = basin.pose.position
    basin.body.set_base(Pose(at, tuple(quaternion_from_rpy(0.3, 0, 0).tolist())))
    assert basin.spills() and basin.tilt() == pytest.approx(0.3)


def test_a_pushed_basin_earns_nothing(learned: CareEnv) -> None:
    learned.reset(seed=0)
    task = task_of(learned)
    x, y, z = task.scene.basin_at.position
    task.scene.basin.body.set_base(Pose((x + 0.05, y, z)))
    wait(learned, 1)
    score = task.score
    score._wetness, score._is_held = 1.0, True
    assert task.report()["basin_tipped"] == 1.0 and score._dip() is None


def test_one_good_sample_and_one_place_earn_next_to_nothing(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    score: BathScore = task_of(scripted).score
    score._samples = score._good = 1
    score._coverage = 1.0
    assert score._gentleness() == pytest.approx(0.01)
    score._samples = score._good = 1000
    assert score._gentleness() == 1.0
    score._coverage = 0.005  # pressed on one spot all the time
    assert score._gentleness() == pytest.approx(0.1)


def test_too_much_force_is_remembered(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    score = task_of(scripted).score
    score._has_touched = True
    assert score._move() == 5
    score._is_exceeded = True
    assert score._move() == -5


def test_person_and_joints_lie_elsewhere_in_each_episode_within_the_rule(learned: CareEnv) -> None:
    task = task_of(learned)
    person, places, abductions = task.recipient, [], []
    for seed in range(8):
        learned.reset(seed=seed)
        wait(learned, 5)
        places.append(person.joint_pose("pelvis").position[:2])
        abductions.append(person.angle("left_shoulder_abduction"))
        low, high = person.passive.T
        angles = np.array(person.positions)
        assert (angles > low - 0.01).all() and (angles < high + 0.01).all()
    spread = np.ptp(np.array(places), axis=0)
    assert (spread > 0.05).all() and (spread <= 0.2).all()
    assert 0.1 < np.ptp(abductions) <= 0.53  # it stays as it was laid
    learned.reset(seed=3)
    wait(learned, 5)
    assert person.joint_pose("pelvis").position[:2] == places[3]


def test_the_same_seed_gives_the_same_episode(scripted: CareEnv) -> None:
    ends = []
    for _ in range(2):
        scripted.reset(seed=7)
        for _ in range(30):
            scripted.step({})
        ends.append(scripted.state().tobytes())
    assert ends[0] == ends[1]


@pytest.mark.slow
@pytest.mark.parametrize("steps", few((100, 300), 100))
def test_random_actions_leave_all_finite(steps: int) -> None:
    env = rcare_marl.make("phyrc_bathing", options={"force_limit": 1e6})
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(steps):
        shapes = {role: env.action_space(role).shape for role in env.agents}
        env.step({role: rng.uniform(-1, 1, s).astype(np.float32) for role, s in shapes.items()})
        assert np.isfinite(env.state()).all()
    env.close()


def test_options_are_checked() -> None:
    with pytest.raises(ConfigError, match="success_score"):
        rcare_marl.make("phyrc_bathing", options={"success_score": 51})
