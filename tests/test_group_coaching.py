"""Promises of group coaching: a robot leads several seated people at once, each as far as they can."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
import pytest

import rcare_marl
from rcare_marl.agents.coaching.exercise import Exercise, load_exercises
from rcare_marl.agents.coaching.group_session import GroupSession, group_programme
from rcare_marl.agents.coaching.imitation import reach_of
from rcare_marl.agents.coaching.recognition.recogniser import Frame, Judgement, Repetition
from rcare_marl.agents.coaching.session import Demonstration, Session
from rcare_marl.agents.coaching.tree import CoachTree
from rcare_marl.agents.coaching.upper_body import MOTIONS
from rcare_marl.agents.people.avatar import load_avatar
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.coaching.learner import Learner
from rcare_marl.envs.tasks.group_coaching import RECIPIENTS, GroupCoaching
from rcare_marl.errors import ConfigError, UnknownNameError

STEP = 0.1
FOUR = dict(zip(RECIPIENTS, ("daniel", "jose", "karan", "kim"), strict=True))


class Told:
    """A recogniser that finds what it is told to find, and counts what it was shown."""

    def __init__(self) -> None:
        self.next, self.seen = Judgement(), 0
        self.begun: list[str] = []

    def begin(self, exercise: Exercise) -> None:
        self.begun.append(exercise.name)

    def update(self, frame: Frame) -> Judgement:
        self.seen += 1
        found, self.next = self.next, Judgement()
        return found

    def finds(self, *errors: str, hint: str = "") -> None:
        repetition = Repetition(0.0, 1.0, not errors, errors, 1.0)
        self.next = Judgement(not errors, 1.0, repetition, hint)


class Body:
    """A body that only remembers what it said."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def show(self, angles: np.ndarray) -> None:
        pass

    def say(self, text: str) -> None:
        self.said.append(text)

    def stand_still(self) -> None:
        pass


class Class:
    """A coach without a robot before Kim, who does all, and Jose, who only turns the head."""

    def __init__(self, repetitions: int = 1) -> None:
        shown, own = group_programme(
            load_exercises(("front_raise", "head_rotation")),
            {name: reach_of(load_avatar(name.lower()).profile) for name in ("Kim", "Jose")},
            speed=1.2,
        )
        self.told = {name: Told() for name in own}
        self.members = {
            name: Session(own[name], self.told[name], repetitions=repetitions) for name in own
        }
        self.group, self.body, self.time = GroupSession(shown, self.members), Body(), 0.0
        self.tree = CoachTree(self.group)
        self.shown = Demonstration(self.group, self.body)

    def go(self, seconds: float = STEP) -> None:
        for _ in range(round(seconds / STEP)):
            frame = Frame(self.time, np.zeros(len(MOTIONS)))
            self.group.see(dict.fromkeys(self.members, frame), self.time)
            self.shown.perform(self.tree.tick(), STEP)
            self.time += STEP

    def follows(self, name: str) -> None:
        self.go(2.0)
        self.told[name].finds()
        self.go()


def test_who_cannot_do_an_exercise_rests_and_is_not_watched() -> None:
    lesson = Class()
    assert [e.name for e in lesson.members["Jose"].exercises] == ["head_rotation"]
    lesson.go(3.0)
    assert lesson.group.is_busy("Kim") and not lesson.group.takes_part("Jose")
    assert lesson.told["Kim"].seen == 30 and lesson.told["Jose"].seen == 0


def test_the_class_goes_on_when_all_who_can_have_done_the_exercise() -> None:
    lesson = Class()
    lesson.follows("Kim")
    lesson.go(0.3)
    assert lesson.group.exercise.name == "head_rotation" and not lesson.group.is_done
    lesson.follows("Jose")
    assert lesson.group.index == 1, "Kim has not done it yet"
    assert not lesson.group.is_busy("Jose") and lesson.group.is_busy("Kim")
    lesson.follows("Kim")
    lesson.go(0.3)
    assert lesson.group.is_over and lesson.group.is_complete
    assert all(not any(session.skipped) for session in lesson.members.values())


def test_a_class_that_is_led_on_leaves_undone_what_somebody_had_not_done() -> None:
    lesson = Class()
    lesson.go(1.0)
    lesson.group.must_skip = True
    lesson.go(1.5)
    assert lesson.group.exercise.name == "head_rotation"
    assert lesson.members["Kim"].skipped == [True, False]
    for name in lesson.members:
        lesson.follows(name)
    lesson.go(0.3)
    assert lesson.group.is_over and not lesson.group.is_complete


def test_praise_is_for_who_did_it_and_hints_for_who_waits_longest() -> None:
    lesson = Class(repetitions=2)
    lesson.group.go_on()  # to the exercise that both can do
    lesson.go(9.0)
    lesson.follows("Jose")
    assert lesson.body.said[-1].startswith("Jose: ")
    assert lesson.group.neediest == "Kim"
    lesson.told["Kim"].finds("range", hint="Please go a little further.")
    lesson.go(40.0)
    assert "Kim: Please go a little further." in lesson.body.said
    assert not any(text.startswith("Jose: Please") for text in lesson.body.said)


def test_words_go_round_among_those_who_wait() -> None:
    lesson = Class(repetitions=2)
    lesson.group.go_on()
    lesson.go(90.0)
    called = [text.split(":")[0] for text in lesson.body.said if ":" in text]
    assert {"Kim", "Jose"} == set(called) and called[0] != called[1]


def test_one_person_or_exercise_too_many_is_refused() -> None:
    lesson = Class()
    with pytest.raises(ConfigError, match="at least one person"):
        GroupSession(lesson.group.exercises, {})
    with pytest.raises(ConfigError, match="must be some of head_rotation, in this order"):
        GroupSession(load_exercises(["head_rotation"]), lesson.members)
    with pytest.raises(ConfigError, match="Jose can do none of the exercises front_raise"):
        group_programme(
            load_exercises(["front_raise"]),
            {"Jose": reach_of(load_avatar("jose").profile)},
            speed=1.0,
        )


def make(**settings: Any) -> CareEnv:
    return rcare_marl.make("group_coaching", **settings)


def task_of(env: CareEnv) -> GroupCoaching:
    assert isinstance(env.task, GroupCoaching)
    return env.task


@pytest.fixture(scope="module")
def four() -> Iterator[CareEnv]:
    """A class of four, whose robot is led by the test."""
    policies = dict.fromkeys(RECIPIENTS, "learner")
    env = make(policies=policies, options={"reward": "shaped"}, **FOUR)
    yield env
    env.close()


def test_everybody_sits_in_an_arc_before_the_robot_with_room_for_both_arms(four: CareEnv) -> None:
    four.reset(seed=0)
    task = task_of(four)
    robot = np.array(task.robot.body.base_pose().position)[:2]
    seats = [np.array(pose.position)[:2] for pose in task.chairs().values()]
    assert np.allclose([np.linalg.norm(seat - robot) for seat in seats], 2.3, atol=0.05)
    assert min(np.linalg.norm(a - b) for a, b in combinations(seats, 2)) > 1.8
    assert all(trainee.gaze > 0.9 for trainee in task.state.trainees.values())
    assert four.world.time == 0 and not any(
        four.world.contact_force(person.body) for person in task.recipients.values()
    )


def test_each_has_their_own_programme_at_one_tempo(four: CareEnv) -> None:
    members = task_of(four).session.members
    assert [len(members[name].exercises) for name in ("Daniel", "Jose", "Karan", "Kim")] == [
        5,
        1,
        5,
        5,
    ]
    shown = {exercise.name: exercise.duration for exercise in task_of(four).session.exercises}
    for member in members.values():
        for exercise in member.exercises:
            assert exercise.duration == pytest.approx(shown[exercise.name])


def test_a_recipient_is_paid_for_their_own_repetitions_and_the_robot_for_the_mean() -> None:
    env = make(policies={"robot": "still"})
    env.reset(seed=0)
    task = task_of(env)
    still = {role: np.zeros(env.action_space(role).shape, np.float32) for role in env.agents}
    found = Repetition(0.0, 1.0, True, (), 1.0)
    kim = task.session.members["Kim"]._recogniser
    kim.update = lambda frame: Judgement(True, 1.0, found, "")  # type: ignore[method-assign]
    paid = []
    for _ in range(5):
        _, rewards, *_, infos = env.step(still)
        paid.append((rewards["recipient"], rewards["second_recipient"]))
        assert task.rewards("robot", task.state)["repetition"] == sum(paid[-1]) / 2
    assert paid == [(0, 1)] * 3 + [(0, 0)] * 2
    assert infos["recipient"]["right_repetitions"] == 3
    assert infos["recipient"]["wanted_repetitions"] == 30
    env.close()


def test_the_robot_sees_everybody_and_a_recipient_only_themselves(four: CareEnv) -> None:
    names = {name for _, name, _ in four.describe("robot")}
    assert {f"{role}_following" for role in RECIPIENTS} <= names
    own = {name for _, name, _ in four.describe("third_recipient")}
    assert {"seen_angles", "repetitions_left", "spoken_to", "shown_angles"} <= own
    assert not any(name.startswith(RECIPIENTS) for name in own)


def test_a_word_to_one_is_not_heard_by_the_others(four: CareEnv) -> None:
    four.reset(seed=0)
    task = task_of(four)
    hears = {
        role: four.policies[role]._lesson.demonstration.is_speaking  # type: ignore[attr-defined]
        for role in RECIPIENTS
    }
    assert not any(hears.values())
    task.demonstration.spoken_to, task.session.silent_at = "Kim", 1e9
    task.look()
    for role in RECIPIENTS:
        learner = four.policies[role]
        assert isinstance(learner, Learner)
        assert learner._lesson.demonstration.is_speaking == (role == "fourth_recipient")
        told = next(at for at, name, _ in four.describe(role) if name == "spoken_to")
        assert bool(four.observe(role)[told][0]) == (role == "fourth_recipient")


def test_two_people_of_one_name_are_told_apart() -> None:
    env = make(recipient="kim", second_recipient="kim")
    assert list(task_of(env).session.members) == ["Kim", "Kim 2"]
    env.close()


def test_a_class_of_two_does_its_programme_together() -> None:
    env = make(
        recipient="morgan",
        second_recipient="jose",
        policies={"robot": "scripted", "recipient": "learner", "second_recipient": "learner"},
        options={"repetitions": 1},
    )
    env.reset(seed=0)
    while not env.is_over:
        env.step({})
    assert env.task.succeeded()
    assert env.task.report()["right_repetitions"] == 2 and env.task.report()["peak_force_n"] == 0
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_class_of_four_does_its_programme_together(four: CareEnv, seed: int) -> None:
    env = make(policies={"robot": "scripted", **dict.fromkeys(RECIPIENTS, "learner")}, **FOUR)
    env.reset(seed=seed)
    while not env.is_over:
        env.step({})
    metrics = env.task.report()
    assert env.task.succeeded() and metrics["peak_force_n"] == 0
    assert metrics["right_repetitions"] == metrics["wanted_repetitions"] == 3 * 16
    env.close()


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"second_recipient": None}, ConfigError, "cannot do without its role 'second_recipient'"),
        ({"recipient_2": "kim"}, UnknownNameError, "recipient_2"),
        ({"third_recipient": {"model": "kim", "posture": "standing"}}, ConfigError, "must sit in"),
        ({"robot": "ur5"}, ConfigError, "no arm that reaches out"),
        (
            {"second_recipient": "jose", "options": {"exercises": ["front_raise"]}},
            ConfigError,
            "Jose can do none",
        ),
    ],
)
def test_an_impossible_class_is_refused_in_plain_words(
    settings: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        make(**settings)
