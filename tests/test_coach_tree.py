"""Promises of the coach's behaviour tree, of its session and of what carries out its orders."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import numpy as np
import pytest

from rcare_marl.agents.coaching.exercise import (
    Exercise,
    exercise_names,
    load_exercise,
    load_exercises,
)
from rcare_marl.agents.coaching.imitation import reach_of
from rcare_marl.agents.coaching.recognition.recogniser import Frame, Judgement, Repetition
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.session import (
    SPENT,
    Demonstration,
    Order,
    Session,
    programme,
    top_speed,
)
from rcare_marl.agents.coaching.style import Style
from rcare_marl.agents.coaching.tree import AGAIN, LONGEST_REST, MORE_TIRED, PATIENCE, Coach
from rcare_marl.agents.coaching.upper_body import MOTION_INDEX, MOTIONS
from rcare_marl.agents.people.avatar import load_avatar
from rcare_marl.agents.people.behaviour.tree_picture import TreePicture
from rcare_marl.envs.coaching.coaching_task import SIZE, decode, encode
from rcare_marl.errors import ConfigError

STEP = 0.1


class Body:
    """A body that only remembers."""

    def __init__(self) -> None:
        self.angles = np.zeros(len(MOTIONS))
        self.said: list[str] = []
        self.is_still = True

    def show(self, angles: np.ndarray) -> None:
        self.angles, self.is_still = angles, False

    def say(self, text: str) -> None:
        self.said.append(text)

    def stand_still(self) -> None:
        self.is_still = True


class Told:
    """A recogniser that finds what it is told to find."""

    def __init__(self) -> None:
        self.next = Judgement()
        self.begun: list[str] = []

    def begin(self, exercise: Exercise) -> None:
        self.begun.append(exercise.name)

    def update(self, frame: Frame) -> Judgement:
        found, self.next = self.next, Judgement()
        return found

    def finds(self, *errors: str, hint: str = "") -> None:
        repetition = Repetition(0.0, 1.0, not errors, errors, 1.0)
        self.next = Judgement(not errors, 1.0, repetition, hint)


class Lesson:
    """A coach without a robot, before a person who is only told of."""

    def __init__(self, *names: str, repetitions: int = 2) -> None:
        self.told, self.body, self.time = Told(), Body(), 0.0
        exercises = load_exercises(names or ("front_raise", "head_rotation"))
        self.session = Session(exercises, self.told, repetitions=repetitions)
        self.coach = Coach(self.session, self.body)

    def go(self, seconds: float = STEP, *, looks: float = 0.0) -> Order:
        order = Order()
        angles = np.zeros(len(MOTIONS))
        angles[MOTION_INDEX["neck_rotation_left"]] = looks
        for _ in range(round(seconds / STEP)):
            frame = Frame(self.time, angles)
            order = self.coach.step(frame, self.time, STEP)
            self.time += STEP
        return order

    def follow(self, count: int = 1) -> None:
        """Let the person do repetitions that are right."""
        for _ in range(count):
            self.go(2.0)
            self.told.finds()
            self.go()


def test_exercises_come_one_after_the_other_each_as_often_as_asked() -> None:
    lesson = Lesson(repetitions=2)
    lesson.follow()
    assert lesson.session.exercise.name == "front_raise" and lesson.session.right == [1, 0]
    lesson.follow()
    lesson.go()
    assert lesson.session.exercise.name == "head_rotation"
    lesson.follow(2)
    lesson.go()
    assert lesson.session.is_complete and lesson.session.is_over
    assert lesson.session.skipped == [False, False]
    assert lesson.go(1.0).act == "stand" and lesson.body.is_still


def test_what_was_wrong_is_said_at_once() -> None:
    lesson = Lesson("front_raise")
    lesson.go(7.0)
    lesson.told.finds("range", hint="Please go a little further.")
    lesson.go(0.3)
    assert lesson.body.said[-1] == "Please go a little further."


def test_who_looks_away_is_called_only_where_the_style_says_so() -> None:
    for call, called in ((0.0, 0), (1.0, 1)):
        lesson = Lesson("front_raise")
        lesson.go(7.5)
        before = len(lesson.body.said)
        lesson.session.style = Style(call=call)
        lesson.go(1.0, looks=0.5)
        assert len(lesson.body.said) == before + called


def test_a_hint_is_said_again_where_the_style_says_so() -> None:
    said = []
    for remind in (0.0, 1.0):
        lesson = Lesson("front_raise")
        lesson.session.style = Style(remind=remind)
        lesson.go(7.0)
        lesson.told.finds("range", hint="Please go a little further.")
        lesson.go(9.0)
        said.append(lesson.body.said.count("Please go a little further."))
    assert said[1] > said[0] >= 1


def test_a_repetition_that_nobody_joins_is_begun_anew_once_where_the_style_says_so() -> None:
    lesson = Lesson("front_raise")
    lesson.session.style = Style(anew=1.0)
    lesson.go(1.0)
    seen = [lesson.go().act for _ in range(round(lesson.session.exercise.duration / STEP))]
    assert seen.count("stand") == 1 and lesson.coach.demonstration.count == 0


def test_a_style_shortens_the_pause_and_sets_the_tempo_of_the_next_repetition() -> None:
    shown = {}
    for name, style in (("tree", Style()), ("short", Style(long=-1.0)), ("fast", Style(fast=1.0))):
        lesson = Lesson("front_raise")
        lesson.session.style = style
        lesson.go(30.0)
        shown[name] = lesson.coach.demonstration.count
    assert shown["short"] > shown["tree"] and shown["fast"] > shown["tree"]


def test_each_exercise_is_explained_once_before_it_is_shown() -> None:
    lesson = Lesson()
    lesson.go()
    first, second = lesson.session.exercises
    assert lesson.body.said == [first.say] and lesson.body.is_still
    lesson.go(1.0)
    assert not lesson.body.is_still
    lesson.follow(2)
    lesson.go(6.0)
    assert lesson.body.said.count(first.say) == lesson.body.said.count(second.say) == 1


def test_the_demonstration_goes_on_until_the_person_follows() -> None:
    lesson = Lesson()
    lesson.go(1.0)
    duration = lesson.session.exercise.duration
    highest = 0.0
    for _ in range(3):
        seen = []
        for _ in range(round(duration / STEP)):
            assert lesson.go().act == "show"
            seen.append(lesson.body.angles.copy())
        highest = float(np.ptp(np.array(seen), axis=0).max())
    assert highest > 1.0 and lesson.session.index == 0
    assert lesson.coach.demonstration.count >= 1


def test_a_right_repetition_is_praised() -> None:
    lesson = Lesson()
    lesson.go(12.0)
    lesson.told.finds()
    assert lesson.go().word == "praise"
    assert lesson.body.said[-1] in ("Well done.", "Very good.", "That was right.")


def test_who_does_not_follow_for_long_is_encouraged_slower_and_with_the_hint() -> None:
    lesson = Lesson()
    lesson.go(1.0)
    assert lesson.go().tempo == 1.0
    lesson.told.finds("range", hint="Please go a little further.")
    lesson.go(PATIENCE * lesson.session.exercise.duration)
    assert lesson.body.said[-1] == "Please go a little further."
    assert lesson.go().tempo < 1.0
    lesson.go(AGAIN + 1.0)
    assert len(lesson.body.said) == 3 and lesson.body.said[-1] != lesson.body.said[-2]
    lesson.follow()
    lesson.go()
    assert lesson.go().tempo == 1.0


def test_a_stop_is_obeyed_at_once_whatever_runs_and_for_good() -> None:
    for seconds in (0.0, 0.5, 3.0, 20.0):
        lesson = Lesson()
        lesson.go(seconds)
        lesson.session.must_stop = True
        assert lesson.go().act == "stand" and lesson.body.is_still
        count = len(lesson.body.said)
        lesson.go(30.0)
        assert lesson.body.is_still and len(lesson.body.said) == count
        assert lesson.session.is_over and not lesson.session.is_complete


def test_a_pause_keeps_what_has_been_done() -> None:
    lesson = Lesson()
    lesson.follow()
    lesson.session.must_pause = True
    lesson.go(5.0)
    assert lesson.body.is_still and lesson.session.right == [1, 0]
    lesson.session.must_pause = False
    lesson.go(0.5)
    assert not lesson.body.is_still and lesson.session.right == [1, 0]
    assert lesson.body.said.count(lesson.session.exercises[0].say) == 1


def test_an_exercise_can_be_skipped_and_then_is_not_done() -> None:
    lesson = Lesson()
    lesson.go(2.0)
    lesson.session.must_skip = True
    lesson.go(0.5)
    assert lesson.session.index == 0 and lesson.body.is_still
    lesson.go(0.6)
    assert lesson.session.index == 1 and lesson.session.skipped == [True, False]
    assert not lesson.session.must_skip
    lesson.follow(2)
    lesson.go()
    assert lesson.session.is_over and not lesson.session.is_complete


def test_the_tired_rest_until_they_are_rested() -> None:
    lesson = Lesson()
    lesson.go(2.0)
    lesson.session.fatigue = 0.7
    assert lesson.go().act == "rest" and lesson.coach.demonstration.is_resting
    lesson.session.fatigue = 0.5
    assert lesson.go().act == "rest"
    lesson.session.fatigue = 0.3
    assert lesson.go().act == "show"
    lesson.session.must_rest = True
    assert lesson.go().act == "rest"


def test_what_was_wrong_with_the_last_before_a_rest_is_said_as_it_begins() -> None:
    lesson = Lesson("front_raise")
    lesson.go(7.0)
    lesson.session.fatigue = 0.7
    lesson.told.finds("range", hint="Please go a little further.")
    assert lesson.go().act == "rest"
    assert lesson.body.said[-1] == "Please go a little further."


def test_what_somebody_does_who_was_invited_to_rest_is_not_judged() -> None:
    lesson = Lesson()
    lesson.go(8.0)
    lesson.session.must_rest = True
    lesson.go(1.0)
    begun = len(lesson.told.begun)
    lesson.told.finds("no_movement")
    lesson.go(5.0)
    assert not lesson.session.repetitions and not lesson.session.judgement.following
    lesson.session.must_rest, lesson.told.next = False, Judgement()
    lesson.go(1.0)
    assert len(lesson.told.begun) == begun + 1  # nothing from before the rest is gone on with


def test_who_does_not_recover_by_resting_is_led_on_and_rests_again_when_more_tired() -> None:
    lesson = Lesson()
    lesson.go(8.0)
    lesson.session.fatigue = 0.7
    assert lesson.go().act == "rest"
    assert lesson.go(LONGEST_REST - 1.0).act == "rest"
    assert lesson.go(2.0).act == "show" and lesson.go(20.0).act == "show"
    lesson.session.fatigue = 0.7 + 1.5 * MORE_TIRED
    assert lesson.go().act == "rest"


def test_who_fell_short_for_being_tired_rests_before_each_further_repetition_of_it() -> None:
    def after(*errors: str) -> str:
        lesson.go(2.0)
        lesson.told.finds(*errors)
        return lesson.go().act

    lesson = Lesson(repetitions=4)
    lesson.session.fatigue = 0.3
    assert after() == "show"  # tired, and it goes well
    assert after("range", "direction") == "show"  # wrong in another way
    assert after("range") == "rest"
    lesson.session.fatigue = 0.13
    assert lesson.go().act == "rest"
    lesson.session.fatigue = SPENT  # of 0.4 of 0.3, no less
    assert lesson.go().act == "show"
    lesson.session.fatigue = 0.2
    assert after() == "rest"
    lesson.session.fatigue = 0.1
    assert after() == "show"
    lesson.session.fatigue = 0.2
    assert after() == "next"  # the fourth
    lesson.go(8.0)
    assert lesson.session.index == 1 and after() == "show"  # another exercise


def test_nothing_is_said_before_the_last_sentence_is_over() -> None:
    session = Session(load_exercises(["front_raise"]), Told())
    body = Body()
    demonstration = Demonstration(session, body)
    for k in range(20):
        session.see(None, k * STEP)
        demonstration.perform(Order("stand", "praise"), STEP)
    assert len(body.said) == 2  # two words and a breath each


def test_a_demonstration_can_be_faster_and_is_then_judged_so() -> None:
    told = Told()
    session = Session(load_exercises(["front_raise"]), told)
    demonstration = Demonstration(session, Body())
    demonstration.perform(Order("show", tempo=2.0), 0.5)
    assert demonstration.phase == pytest.approx(1.0 / session.exercise.duration)
    assert told.begun == ["front_raise", "front_raise"]
    demonstration.perform(Order("stand"), STEP)
    assert not demonstration.is_showing and demonstration.phase == 0.0
    demonstration.perform(Order("show", tempo=1.9), STEP)
    assert len(told.begun) == 2  # nearly the same tempo


def test_another_tempo_waits_for_the_end_of_the_repetition_that_is_under_way() -> None:
    told = Told()
    session = Session(load_exercises(["front_raise"]), told)
    told.next = Judgement(following=True, progress=0.6)
    session.see(Frame(0.0, np.zeros(16)), 0.0)
    session.keep_tempo(0.5)
    told.next = Judgement(following=True, progress=0.9)
    session.see(Frame(0.1, np.zeros(16)), 0.1)
    assert told.begun == ["front_raise"]
    told.next = Judgement(True, 1.0, Repetition(0.0, 0.2, True, (), 1.0))
    session.see(Frame(0.2, np.zeros(16)), 0.2)
    assert told.begun == ["front_raise", "front_raise"]
    session.see(Frame(0.3, np.zeros(16)), 0.3)
    assert len(told.begun) == 2 and session.right == [1]


def test_a_programme_is_what_the_person_can_do_at_a_tempo_that_they_can_follow() -> None:
    profile = load_avatar("jose").profile
    found = programme(load_exercises(), reach_of(profile), speed=1.2)
    assert [exercise.name for exercise in found] == ["head_rotation"]
    fast = programme(load_exercises(), reach_of(load_avatar("daniel").profile), speed=0.6)
    assert all(top_speed(exercise) <= 0.6 * 1.01 for exercise in fast) and len(fast) == 5
    with pytest.raises(ConfigError, match="none of the exercises front_raise"):
        programme([load_exercise("front_raise")], reach_of(profile), speed=1.0)


def test_impossible_sessions_are_refused() -> None:
    with pytest.raises(ConfigError, match="at least one exercise"):
        Session([], Told())
    with pytest.raises(ConfigError, match="repetitions"):
        Session(load_exercises(), Told(), repetitions=0)


def test_orders_are_actions_and_back() -> None:
    for order in (Order(), Order("show", "hint", 0.5), Order("next", "praise", 2.0), Order("rest")):
        style = Style(fast=0.5, call=-1.0)
        action = encode(order, style)
        assert action.shape == (SIZE,) and np.abs(action).max() <= 1
        assert decode(action) == (order, style)
    assert decode(np.zeros(SIZE)) == (Order("stand", "nothing", 1.0), Style())


def test_the_same_tree_coaches_somebody_who_mirrors_any_body() -> None:
    """All five exercises from start to end, without a simulated robot: as with a real one."""
    body, exercises = Body(), load_exercises()
    session = Session(exercises, RuleRecogniser(), repetitions=2)
    coach = Coach(session, body)
    step, seen = 1 / 30, deque([exercises[0].angles(0.0)] * 15, maxlen=15)
    for k in range(round(200 / step)):
        coach.step(Frame(k * step, seen[0]), k * step, step)
        seen.append(session.exercise.angles(0.0) if body.is_still else body.angles)
        if session.is_over:
            break
    assert session.is_complete
    assert session.wrong == [0] * len(exercise_names())


def test_the_tree_can_be_looked_at_while_it_runs(tmp_path: Path) -> None:
    lesson = Lesson(*exercise_names())
    lesson.go(3.0)
    picture = TreePicture(lesson.coach.tree.root, title="The coach")
    labels = " ".join(box.label for box in picture.boxes)
    for name in ("stop", "pause", "rest", "skip", "demonstrate", "observe", "head rotation"):
        assert name in labels
    assert "⇉" in labels and picture.save(tmp_path / "tree.png").stat().st_size > 10_000
    running = [box.label for box in picture.boxes if box.status.name == "RUNNING"]
    assert "demonstrate" in running and "observe" in running
