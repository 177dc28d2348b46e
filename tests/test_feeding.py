"""Feeding: food must arrive by physics, in an open mouth, gently, and the task can be done."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from typing import cast

import numpy as np
import pytest
from episode import play
from variants import every

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.people.eating import COUGHING, Eating, Mouthful
from rcare_marl.baselines.scripted.feeding import ScriptedFeeding
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.scenes.meal import OPEN_MOUTH
from rcare_marl.envs.tasks import feeding
from rcare_marl.envs.tasks.feeding import Feeding
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose

BOTH = {"robot": "scripted", "recipient": "cooperative"}


def task_of(env: CareEnv) -> Feeding:
    return cast(Feeding, env.task)


def run(env: CareEnv, seed: int) -> Feeding:
    play(env, seed)
    return task_of(env)


@pytest.fixture(scope="module")
def scripted() -> Iterator[CareEnv]:
    env = rcare_marl.make("feeding", policies=BOTH)
    yield env
    env.close()


def test_the_scripted_robot_feeds_karan(scripted: CareEnv) -> None:
    successes = sum(run(scripted, seed).succeeded() for seed in range(10))
    assert successes >= 9


@pytest.mark.parametrize("avatar", every(2, assets.names("avatars")))
def test_every_avatar_can_be_fed(avatar: str) -> None:
    env = rcare_marl.make("feeding", recipient=avatar, policies=BOTH)
    assert run(env, 0).succeeded()
    env.close()


@pytest.mark.parametrize("mount", ["left", "right"])
def test_the_robot_can_be_mounted_on_either_side(mount: str) -> None:
    env = rcare_marl.make("feeding", options={"mount": mount}, policies=BOTH)
    assert sum(run(env, seed).succeeded() for seed in range(3)) >= 2
    env.close()


def test_who_lets_it_happen_with_the_head_turned_away_from_the_arm_is_reached_and_fed() -> None:
    recipient = "population:train:708"
    policies = {"robot": "scripted", "recipient": "passive"}
    with closing(rcare_marl.make("feeding", recipient=recipient, policies=policies)) as env:
        assert run(env, 90758).succeeded()


def test_a_closed_mouth_is_never_fed() -> None:
    env = rcare_marl.make("feeding", policies={"robot": "scripted", "recipient": "still"})
    task = run(env, 0)
    assert task.report()["eaten_pieces"] == 0 and not task.succeeded()
    env.close()


def test_at_the_start_all_food_lies_in_a_level_spoon_before_the_face(scripted: CareEnv) -> None:
    for seed in range(5):
        scripted.reset(seed=seed)
        task = task_of(scripted)
        assert task.report()["spilled"] == 0 and task.rewards("robot", task.state)["food"] == 1
        assert task.state.up[2] > 0.99
        assert feeding.START_GAP[0] - 0.12 < task.state.distance < feeding.START_GAP[1] + 0.12


def test_food_rides_by_contact_alone_and_falls_when_the_spoon_turns_over() -> None:
    env = rcare_marl.make("feeding", policies={"recipient": "still"})
    env.reset(seed=0)
    roll = np.array((0, 0, 0, 1, 0, 0), np.float32)  # about the handle, which points to the person
    while not env.is_over:
        env.step({"robot": roll})
    task = task_of(env)
    assert task.report()["spilled"] > 0 and task.failed() and not task.succeeded()
    env.close()


def test_too_much_force_ends_the_episode_as_a_failure() -> None:
    env = rcare_marl.make("feeding", policies={"recipient": "still"}, options={"force_limit": 2.0})
    env.reset(seed=0)
    while not env.is_over:
        task = task_of(env)
        aim = task.state.mouth - 0.05 * task.state.face - task.state.bowl
        push = np.zeros(6, np.float32)
        push[:3] = np.clip(8 * aim, -0.5, 0.5)
        env.step({"robot": push})
    assert task_of(env).report()["peak_force_n"] > 2.0
    assert task_of(env).failed()
    env.close()


def test_the_mouth_target_follows_the_head(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    task = task_of(scripted)
    before = task.state.mouth.copy()
    task.recipient.set_angles({"neck_rotation_left": 0.5, "head_rotation_left": 0.3})
    task.look()
    assert np.linalg.norm(task.state.mouth - before) > 0.03


def test_eaten_food_is_parked_far_from_the_scene(scripted: CareEnv) -> None:
    task = run(scripted, 1)
    assert all(piece.base_pose().position[2] < -10 for piece in task._food)


def test_a_good_end_pays_at_least_what_waiting_would(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    best = 0.0
    while not scripted.is_over:
        best = max(best, sum(task_of(scripted).rewards("robot", task_of(scripted).state).values()))
        scripted.step({})
    left = (Feeding.time_limit - scripted.world.time) / task_of(scripted).control_dt
    assert task_of(scripted).rewards("robot", task_of(scripted).state)["eaten"] >= best * left


def test_the_paper_reward_is_its_formula() -> None:
    env = rcare_marl.make("feeding")
    env.reset(seed=0)
    terms = task_of(env).rewards("robot", task_of(env).state)
    assert terms["food"] == 1.0 and 0 < terms["approach"] < 1 and terms["eaten"] == 0
    task = task_of(env)
    task._food[0].set_base(Pose((2, 2, 2)))
    task.look()
    assert task.rewards("robot", task.state)["food"] == pytest.approx(0.75**2)
    env.close()


def test_the_shaped_reward_has_its_own_terms() -> None:
    env = rcare_marl.make("feeding", options={"reward": "shaped"})
    _, infos = env.reset(seed=0)
    assert {"food", "approach", "comfort", "level", "eaten"} <= set(infos["robot"])
    env.close()


def test_a_caregiver_can_be_cast_and_learned() -> None:
    env = rcare_marl.make("feeding", caregiver="caregiver")
    assert env.possible_agents == ["robot", "recipient", "caregiver"]
    env.close()


def test_the_scripted_robot_says_which_control_mode_it_needs() -> None:
    with pytest.raises(ConfigError, match="tool_delta"):
        rcare_marl.make(
            "feeding", robot={"control": "joint_velocity"}, policies={"robot": "scripted"}
        )


@pytest.mark.parametrize("control", ["joint_delta", "joint_velocity", "joint_torque", "tool_delta"])
def test_every_control_mode_keeps_the_food_at_rest_for_a_second(control: str) -> None:
    env = rcare_marl.make("feeding", robot={"control": control}, policies={"recipient": "still"})
    env.reset(seed=0)
    rest = np.zeros(env.action_space("robot").shape, np.float32)
    for _ in range(10):
        env.step({"robot": rest})
    assert task_of(env).report()["spilled"] == 0
    env.close()


def test_several_bites_are_chewed_and_swallowed_one_after_the_other() -> None:
    several = {"bites": 2, "texture": "puree"}
    env = rcare_marl.make("feeding", recipient="daniel", options=several, policies=BOTH)
    told = {name for _, name, _ in env.describe("robot")}
    assert {"mouth_ready", "bites_left"} <= told
    task = run(env, 0)
    report, busy = task.report(), task.recipient.avatar.eating.time("puree")
    assert task.succeeded() and report["bites_swallowed"] == 2 and report["spilled"] == 0
    assert report["coughs"] == report["early_offers"] == report["aspiration_risk"] == 0
    assert report["time_to_mouth_s"] > busy and env.world.time >= 2 * busy
    env.close()


def test_one_bite_is_the_paper_s_task_with_nothing_more_to_see_or_to_be_paid_for() -> None:
    env = rcare_marl.make("feeding", policies={"recipient": "still"})
    env.reset(seed=0)
    told = {name for _, name, _ in env.describe("robot")}
    assert not told & {"mouth_ready", "bites_left"} and env.task.time_limit == 20
    assert "cough" not in task_of(env).rewards("robot", task_of(env).state)
    env.close()


@pytest.mark.parametrize("bites", [0, 101])
def test_a_number_of_bites_that_nobody_eats_is_refused(bites: int) -> None:
    with pytest.raises(ConfigError, match=r"bites must lie in 1\.\.100"):
        rcare_marl.make("feeding", options={"bites": bites})


def taken(mouthful: Mouthful, time: float, eating: Eating) -> Mouthful:
    return mouthful.after(time, eating, "solid", is_offered=True, enters=True, is_emptied=True)


def test_food_taken_into_a_full_mouth_makes_one_cough_and_may_be_aspirated() -> None:
    eating = Eating(solid_s=10, swallow_s=2, aspiration=0.3)
    first = taken(Mouthful(), 1.0, eating)
    assert (first.taken, first.coughs, first.swallowed, first.ready_at) == (1, 0, 0, 13)
    second = taken(first, 4.0, eating)
    assert (second.taken, second.coughs, second.early, second.swallowed) == (2, 1, 1, 0)
    assert second.risk == pytest.approx(0.3 * 9 / 12) and second.ready_at == 13 + COUGHING + 12
    waits = dict(is_offered=False, enters=False, is_emptied=False)
    assert second.after(27.9, eating, "solid", **waits).swallowed == 0
    last = second.after(28.0, eating, "solid", **waits)
    assert last.swallowed == 2 and last.is_ready and last.coughs == 1
    assert taken(last, 29.0, eating).coughs == 1  # offered in time


def test_food_held_at_chewing_lips_is_an_early_offer_and_no_cough() -> None:
    eating, mouth = Eating(), taken(Mouthful(), 1.0, Eating())
    for time in (2.0, 2.1, 2.2):
        mouth = mouth.after(time, eating, "solid", is_offered=True, enters=False, is_emptied=False)
    assert (mouth.early, mouth.coughs, mouth.risk) == (1, 0, 0)


def test_who_chokes_coughs_by_their_tree() -> None:
    env = rcare_marl.make("feeding", options={"bites": 2}, policies={"recipient": "behaviour"})
    env.reset(seed=0)
    still = {"robot": np.zeros(6, np.float32)}
    object.__setattr__(task_of(env).state.mouthful, "coughs_now", True)
    env.step(still)
    root = env.policies["recipient"].root  # type: ignore[attr-defined]
    assert next(c for c in root.children if c.name == "cough").status.name == "RUNNING"
    env.close()


def test_who_lives_by_a_ventilator_has_it_on_the_chair_and_eats_beside_its_tube() -> None:
    for avatar, count in (("jose", 1), ("karan", 0)):
        env = rcare_marl.make("feeding", recipient=avatar, policies=BOTH)
        assert sum(body.name == "ventilator" for body in env.world.bodies) == count
        env.close()


def test_the_script_leads_a_level_spoon_round_a_bag_that_hangs_in_the_way() -> None:
    for extra in ("ompl", "pinocchio", "toppra"):
        pytest.importorskip(extra, reason="the extra `plan` is not installed")
    env = rcare_marl.make("feeding", options={"obstacle": "bag"}, policies=BOTH)
    env.reset(seed=1000)
    assert isinstance(task := env.task, Feeding)
    robot, (bag, hose) = env.cast["robot"], task.bag.bodies
    way = task.state.mouth - task.state.bowl
    share = np.subtract(bag.base_pose().position, task.state.bowl) @ way / (way @ way)
    assert 0.2 < share < 0.6  # it is in the straight way
    while not env.is_over:
        env.step({})
        assert env.world.contact_force(robot.body, bag) == 0
        assert env.world.contact_force(robot.body, hose) == 0
    assert task.succeeded()
    env.close()


def test_the_script_plans_anew_when_the_bag_is_moved_into_its_way() -> None:
    for extra in ("ompl", "pinocchio", "toppra"):
        pytest.importorskip(extra, reason="the extra `plan` is not installed")
    env = rcare_marl.make("feeding", options={"obstacle": "bag"}, policies=BOTH)
    env.reset(seed=1000)
    assert isinstance(task := env.task, Feeding)
    script = env.policies["robot"]
    assert isinstance(script, ScriptedFeeding)
    robot, (bag, hose) = env.cast["robot"], task.bag.bodies
    found: list[object] = []
    while not env.is_over:
        env.step({})
        if script._detour is not None and script._detour not in found:
            found.append(script._detour)
        if len(found) == 1 and script._detour is not None:
            there, _ = script._detour._way[-20]
            for body, up in ((bag, 0.0), (hose, 0.48)):
                body.set_base(Pose(tuple((there + (0.0, 0.0, up)).tolist())))
        assert env.world.contact_force(robot.body, bag) == 0
        assert env.world.contact_force(robot.body, hose) == 0
    assert len(found) > 1 and task.succeeded()
    env.close()


@pytest.mark.parametrize(
    ("person", "opens"), [("population:train:425", True), ("population:train:426", False)]
)
def test_by_muscles_a_jaw_of_grade_2_opens_with_gravity_and_a_weaker_one_does_not(
    person: str, opens: bool
) -> None:
    recipient = {"model": person, "actuation": "muscle"}
    with closing(rcare_marl.make("feeding", policies=BOTH, recipient=recipient)) as env:
        env.reset(seed=0)
        for _ in range(20):
            env.step({})
        assert (task_of(env).state.jaw > OPEN_MOUTH) == opens
