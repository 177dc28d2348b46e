"""PhyRC's dressing challenge: a sleeve counts only where it goes round the arm."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest
from episode import play

import rcare_marl
from rcare_marl.agents.people.avatar import body_model, load_avatar
from rcare_marl.agents.people.garment import tailor
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.feasibility import girth_along
from rcare_marl.envs.phyrc.arm_cover import ArmCover, widest_gap
from rcare_marl.envs.phyrc.gown_stand import hang
from rcare_marl.envs.phyrc.phyrc_score import ScoreSheet
from rcare_marl.envs.scenes.leg_path import pierced
from rcare_marl.envs.tasks.phyrc_dressing import PhyrcDressing
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

BOTH = {"robot": "scripted", "recipient": "still"}


def task_of(env: CareEnv) -> PhyrcDressing:
    return cast(PhyrcDressing, env.task)


@pytest.fixture(scope="module")
def scripted() -> Iterator[CareEnv]:
    env = rcare_marl.make("phyrc_dressing", policies=BOTH)
    yield env
    env.close()


def tube(cover: ArmCover, radius: float, opening: float) -> Array:
    """Return points of cloth about the left forearm, open below by an angle [rad], shape [n, 3]."""
    wrist, elbow, _ = cover.ends
    axis = (elbow - wrist) / np.linalg.norm(elbow - wrist)
    side = np.cross(axis, (0.0, 0.0, 1.0))
    side /= np.linalg.norm(side)
    up = np.cross(side, axis)
    angles = np.linspace(-math.pi + 0.5 * opening, math.pi - 0.5 * opening, 24)
    ring = radius * (np.sin(angles)[:, None] * side + np.cos(angles)[:, None] * up)
    shares = np.linspace(0.05, 0.95, 12)
    return np.concatenate([wrist + share * (elbow - wrist) + ring for share in shares])


def test_a_sleeve_counts_where_it_goes_round_and_a_shawl_does_not(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    cover = task_of(scripted).score._covers["left"]
    forearm = cover._counts[0]
    assert cover.slices(tube(cover, 0.06, 0.0))[:forearm].all()
    assert not cover.slices(tube(cover, 0.06, math.pi)).any()  # it lies on the arm
    assert not cover.slices(tube(cover, 0.15, 0.0)).any()  # it is nowhere near the skin
    assert not cover.slices(tube(cover, 0.06, 0.0) + (0.0, 0.0, 0.2)).any()


def test_it_is_said_before_whether_a_hand_goes_through_the_cuff(
    scripted: CareEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, infos = scripted.reset(seed=0)
    task = task_of(scripted)
    assert task.feasible.holds and not task.feasible.reason
    assert all(info["feasible"] == 1.0 for info in infos.values())
    cube = np.array([[x, y, z] for x in (0, 9) for y in (0, 0.2) for z in (0, 0.1)])
    assert girth_along(cube) == pytest.approx(0.6)
    monkeypatch.setattr(task, "_hand_points", lambda wrist: cube @ task._axes().T)
    refused = task._fits()
    assert not refused.holds and "60 cm" in refused.reason


def test_a_ring_is_round_the_arm_only_if_the_arm_goes_through_it(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    cover = task_of(scripted).score._covers["left"]
    ring = tube(cover, 0.07, 0.3)[:24]
    assert cover.is_round(ring) and cover.near(ring).all()
    assert not cover.is_round(ring + (0.0, 0.0, 0.08))


def test_gaps_and_crossings_are_counted() -> None:
    assert widest_gap(np.array((0.0, 1.0, 3.0))) == pytest.approx(2 * math.pi - 3.0)
    assert widest_gap(np.array((1.0,))) == pytest.approx(2 * math.pi)
    square = np.array(((1.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (1.0, -1.0, 0.0)))
    after = np.roll(square, -1, axis=0)
    up = np.array((0.1, 0.2, -1.0)), np.array((0.1, 0.2, 1.0))
    assert pierced(*up, np.zeros(3), square, after)[0].tolist() == [1]
    assert pierced(*up[::-1], np.zeros(3), square, after)[0].tolist() == [-1]
    beside = np.array((3.0, 0.0, 0.0))
    assert not pierced(up[0] + beside, up[1] + beside, np.zeros(3), square, after)[0].any()


def test_a_shoulder_not_reached_keeps_nothing_else_back() -> None:
    worth: dict[str, int | None] = {"a": 5, "loose": None, "last": 4}
    items = {name: lambda n=name: worth[n] for name in worth}
    sheet = ScoreSheet(items, loose=("loose",))
    sheet.update(1.0)
    assert sheet.points == {"a": 5, "loose": 0, "last": 4} and sheet.stage == 2


@pytest.mark.slow
def test_the_gown_hangs_on_its_stand_and_earns_nothing_by_itself() -> None:
    env = rcare_marl.make("phyrc_dressing", policies={"recipient": "still"})
    env.reset(seed=0)
    task = task_of(env)
    seam = task.gown.seam
    for _ in range(20):
        env.step({"robot": np.zeros(7, np.float32)})
    assert math.dist(task.gown.seam, seam) < 0.01
    metrics = task.report()
    assert metrics["score"] == metrics["covered_left"] == 0.0
    assert metrics["peak_force_n"] < 0.5  # it brushes against the knee
    assert task.gown.stand.travelled == pytest.approx(0.0, abs=1e-3)
    env.close()


@pytest.mark.slow
def test_the_scripted_robot_pulls_the_sleeve_to_the_shoulder(scripted: CareEnv) -> None:
    scripted.reset(seed=6)
    task = task_of(scripted)
    while task.score.sheet.total < 19 and not scripted.is_over:
        scripted.step({})
    metrics = task.report()
    assert metrics["score_pick_up"] == metrics["score_sleeve"] == 5.0
    assert metrics["score_left_shoulder"] == 5.0 and metrics["covered_left"] > 0.4
    assert metrics["score_right_shoulder"] == metrics["covered_right"] == 0.0
    assert metrics["peak_force_n"] < task.options.force_limit
    assert metrics["prom_violation_deg_s"] < 0.1
    assert not task.succeeded()  # that is told at the end


@pytest.mark.slow
def test_a_sleeve_is_pulled_the_slower_the_more_it_presses(scripted: CareEnv) -> None:
    scripted.reset(seed=6)
    task = task_of(scripted)
    while not task.state.is_held:
        scripted.step({})
    robot = scripted.policies["robot"]
    robot.act()
    # Nobody steps the world: the hand stays where it is.
    speeds = []
    for force in (0.0, 20.0, 30.0, 36.0, 40.0):
        pressed = dataclasses.replace(task.state.safety["recipient"], force=force)
        task.state = dataclasses.replace(task.state, safety={"recipient": pressed})
        speeds.append(-float(robot.act()[:3] @ task.out))
    assert speeds[0] == pytest.approx(speeds[1]) and speeds[1] > speeds[2] > 0.0
    assert speeds[3] == pytest.approx(0.0, abs=1e-6) and speeds[4] < 0.0


@pytest.mark.parametrize("name", ("daniel", "natalia", "kim"))
def test_an_armhole_hangs_open_round_the_hand_for_tall_and_small(name: str) -> None:
    avatar = load_avatar(name)
    gown = hang(tailor("bed_jacket", body_model(avatar.body_path(), avatar.height_m)))
    for ring in (gown.armhole, gown.cuffs["left"]):
        _, aside, up = gown.positions[ring].T
        assert np.hypot(aside, up).min() > 0.05  # a fist is 8 cm high
        assert widest_gap(np.arctan2(up, aside)) < math.radians(90)  # but for the seam above
    seam, height = gown.clips["left"], gown.positions[:, 2]
    assert height[seam].min() > height[gown.armhole].max() - 0.02
    # No pocket hangs out ahead, where knees would be drawn into it.
    assert gown.positions[:, 0].max() < gown.positions[gown.cuffs["left"], 0].mean() + 0.2


@pytest.mark.slow
def test_the_scripted_robot_scores_what_one_arm_can() -> None:
    env = rcare_marl.make("phyrc_dressing", policies=BOTH)
    scores = []
    for seed in range(20):
        play(env, seed)
        scores.append(task_of(env).report()["score"])
        assert task_of(env).succeeded() == (scores[-1] >= 19 and not task_of(env).failed())
    env.close()
    assert np.mean(scores) > 17.0


@pytest.mark.slow
def test_a_random_robot_does_not_dress_anybody() -> None:
    env = rcare_marl.make("phyrc_dressing", policies={"robot": "random", "recipient": "still"})
    for seed in range(5):
        play(env, seed)
        assert task_of(env).report()["score"] <= 5.0
    env.close()


@pytest.mark.slow
def test_random_actions_leave_all_finite() -> None:
    env = rcare_marl.make("phyrc_dressing", options={"force_limit": 1e6})
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(250):
        shapes = {role: env.action_space(role).shape for role in env.agents}
        env.step({role: rng.uniform(-1, 1, s).astype(np.float32) for role, s in shapes.items()})
        assert np.isfinite(env.state()).all()
    env.close()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_episode(scripted: CareEnv) -> None:
    ends = []
    for _ in range(2):
        scripted.reset(seed=3)
        for _ in range(30):
            scripted.step({})
        ends.append(scripted.state().tobytes() + task_of(scripted).gown.cloth.positions.tobytes())
    assert ends[0] == ends[1]


def test_a_robot_that_cannot_reach_is_refused() -> None:
    with pytest.raises(ConfigError, match="no arm that reaches"):
        rcare_marl.make("phyrc_dressing", robot="nao")


def test_who_lies_is_not_dressed_so() -> None:
    with pytest.raises(ConfigError, match="hold the left arm out"):
        rcare_marl.make("phyrc_dressing", recipient={"posture": "bed_supine"})


def test_options_are_checked() -> None:
    with pytest.raises(ConfigError, match="success_score"):
        rcare_marl.make("phyrc_dressing", options={"success_score": 0})
