"""A person who is coached, as the task knows them: what they do, what it counts for, how they fare."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rcare_marl.agents.actuation.muscular import MuscleDrive
from rcare_marl.agents.body.skeleton import DOF_INDEX
from rcare_marl.agents.coaching.exercise import Exercise, Reach
from rcare_marl.agents.coaching.joints_source import JointsSource
from rcare_marl.agents.coaching.reach import reach_of
from rcare_marl.agents.coaching.recogniser import ERRORS
from rcare_marl.agents.coaching.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.session import WORDS, Demonstration, Lesson, Session
from rcare_marl.agents.coaching.upper_body import MOTION_INDEX, MOTIONS
from rcare_marl.agents.human import Human
from rcare_marl.agents.physiology_model import REGIONS
from rcare_marl.agents.robot import Robot
from rcare_marl.observable import Observable
from rcare_marl.pose import Array

from ..safety import SafetyMeter
from .option import SocialCoachingOptions

# [rad/s] of an arm or the head in what is shown: people here go at 0.8 and catch up; muscles come later.
# Our own choice.
SPEED, SPEED_OF_MUSCLES = 1.2, 0.9
LOOKS = math.radians(30)  # of the face from the coach, to count as looking there; our own choice
HEAD_TURN = math.radians(15)  # uniform, each way, at the start; our own choice
# What muscles reach. From 90 degrees to the front a straight arm slides to the side: the shoulder's muscles
# have no scapula to turn, and hardly any leverage left there. Shown 75 degrees, Karan and Daniel hold 57;
# shown 60 they hold 52 to 56. Over the last degrees of the active range muscles fade, in neck and head
# alike. Found by trying with the people who ship.
MUSCLES_FRONT = math.radians(60)
MUSCLES_NECK = math.radians(10)
TIRING = ("neck", "left_arm", "right_arm")  # regions whose fatigue people tell of


class Trainee:
    """One person of a lesson.

    Attributes:
        person: Who it is.
        seen: Angles of the upper body as the simulator knows them [rad], shape [16].
        reach: What the person can do, seated as they are.
        speed: How fast what is shown goes at most, for this person to follow [rad/s].
        session: What is asked of them and what they have done; once `ask` was called.
        safety: What they go through.
        gaze: Cosine between the face and the way to the robot's head.
    """

    session: Session

    def __init__(self, person: Human, safety: SafetyMeter) -> None:
        """Take a person who has been spawned, and what measures them."""
        self.person, self.safety, self.gaze = person, safety, 0.0
        self._order = [DOF_INDEX[dof] for dof in person.movable]
        self._begin_to_look()
        self.reach, self.speed = reach_of(person.avatar.profile, self.seen), SPEED
        if isinstance(person.drive, MuscleDrive):
            self.reach = reach_of_muscles(self.reach)
            self.speed = SPEED_OF_MUSCLES

    def ask(self, exercises: Sequence[Exercise], repetitions: int) -> None:
        """Give the person their programme."""
        # Made once, and copied for each episode: what it has seen of a person changes a recogniser.
        self._unused = RuleRecogniser(known=exercises)
        self.session = Session(exercises, copy.deepcopy(self._unused), repetitions=repetitions)

    def reset(self, rng: np.random.Generator, repetitions: int) -> None:
        """Begin an episode in which so many repetitions of each exercise are asked for."""
        turn = rng.uniform(-HEAD_TURN, HEAD_TURN)
        halves = [dof for dof in ("neck_rotation_left", "head_rotation_left")
                  if dof in self.person.movable]  # fmt: skip
        self.person.set_angles(dict.fromkeys(halves, turn / 2))
        self.session.wanted = [repetitions for _ in self.session.exercises]
        self.session.reset(copy.deepcopy(self._unused))
        self._begin_to_look()
        self.safety.reset()
        self._before = self._new = (0, 0)

    def _begin_to_look(self) -> None:
        self._source = JointsSource(self.person.model.joints)
        self._look(0.0)

    def _look(self, time: float) -> None:
        """See the person: all joint angles, as the simulator knows them."""
        angles = self.person.angles.copy()
        angles[self._order] = self.person.positions
        frame = self._source.update(angles, time)
        assert frame is not None  # the simulator knows them all
        self.frame, self.seen = frame, np.nan_to_num(frame.angles)

    def after_step(self, time: float, duration: float) -> None:
        """Look at the person at the end of a control step, before the session does."""
        self.safety.after_step(duration)
        physiology = self.person.physiology
        self.session.fatigue = max(
            physiology.fatigue_of(region) for region in REGIONS if region in TIRING
        )
        self._look(time)

    def tally(self, coach: Array) -> None:
        """Count what the session has seen; the coach's head is at `coach` in the world [m]."""
        counts = self.session.right_count, sum(self.session.wrong)
        self._new = counts[0] - self._before[0], counts[1] - self._before[1]
        self._before = counts
        mouth, face = self.person.mouth_and_face()
        way = coach - mouth
        self.gaze = float(face @ way / np.linalg.norm(way))

    def observables(
        self, is_asked: Callable[[], bool] = lambda: True, prefix: str = ""
    ) -> list[Observable]:
        """Return what there is to see of the person.

        Args:
            is_asked: Whether the person has a part in the exercise that is on.
            prefix: Goes before each name.
        """
        session = self.session

        def left() -> float:
            k = session.index
            is_on = is_asked() and k < len(session.wanted)
            return float(session.wanted[k] - session.right[k]) if is_on else 0.0

        return [
            Observable(f"{prefix}{name}", unit, size, read)
            for name, unit, size, read in (
                ("seen_angles", "rad", len(MOTIONS), lambda: self.seen),
                ("following", "1", 1, lambda: (float(session.judgement.following),)),
                ("progress", "1", 1, lambda: (session.judgement.progress,)),
                ("last_error", "1", len(ERRORS), self._error),
                ("repetitions_left", "1", 1, lambda: (left(),)),
                ("since_right", "s", 1, lambda: (session.since_right,)),
                ("gaze_at_coach", "1", 1, lambda: (self.gaze,)),
                ("told_fatigue", "1", 1, lambda: (session.fatigue,)),
                ("contact_force", "N", 1, lambda: (self.safety.force,)),
            )
        ]

    def _error(self) -> Array:
        found = self.session.repetitions[-1:]
        errors = found[0].errors if found else ()
        return np.array([float(error in errors) for error in ERRORS])

    def rewards(
        self, options: SocialCoachingOptions, *, is_speaking: bool, steps_left: float
    ) -> dict[str, float]:
        """Return what the last control step was worth.

        Args:
            options: The settings of the task.
            is_speaking: Whether the coach says something.
            steps_left: Control steps until the time limit where the episode ends well, 0 elsewhere: it is
                paid as if it had gone on so, or to dawdle would pay more.
        """
        terms = {"repetition": float(self._new[0])}
        if options.reward == "paper":
            return terms
        session = self.session
        terms["wrong"] = -float(self._new[1])
        looks = 0.5 if self.gaze > math.cos(LOOKS) else 0.0
        terms["engagement"] = 1.0 if session.judgement.following else looks
        terms["pain"] = -self.person.physiology.pain / 10.0
        terms["fatigue"] = -session.fatigue
        terms["talk"] = -float(is_speaking)
        return {**options.weighted(terms), "done": options.weight("engagement") * steps_left}

    def metrics(self) -> Mapping[str, float]:
        """Return what is reported of this person's part of the episode so far."""
        session = self.session
        return {
            **self.safety.metrics(),
            "right_repetitions": float(session.right_count),
            "wanted_repetitions": float(sum(session.wanted)),
            "wrong_repetitions": float(sum(session.wrong)),
            "exercises_done": float(
                sum(r >= w for r, w in zip(session.right, session.wanted, strict=True))
            ),
            "fatigue": session.fatigue,
            "following": float(session.judgement.following),
        }


def reach_of_muscles(reach: Reach) -> Reach:
    """Return what is left of a person's reach when muscles drive them."""
    low, high = reach.low.copy(), reach.high.copy()
    turn = MOTION_INDEX["neck_rotation_left"]
    low[turn], high[turn] = min(low[turn] + MUSCLES_NECK, 0.0), max(high[turn] - MUSCLES_NECK, 0.0)
    most = reach.front or (math.inf, math.inf)
    return Reach(low, high, (min(most[0], MUSCLES_FRONT), min(most[1], MUSCLES_FRONT)))


def head_of(robot: Robot) -> Array:
    """Return where the head of a robot is in the world [m], shape [3]."""
    joints = robot.parts["head"].joints
    assert joints is not None
    return np.array(robot.body.link_pose(joints.indices[-1]).position)


def shown_observables(
    lesson: Lesson, shown: Demonstration, exercises: Sequence[str]
) -> list[Observable]:
    """Return what everybody sees and hears of the coach, `exercises` being the names of all of them."""

    def which() -> Array:
        on = "" if lesson.index >= len(lesson.exercises) else lesson.exercise.name
        return np.array([float(name == on) for name in exercises])

    def said() -> Array:
        word = shown.word if shown.is_speaking else "nothing"
        return np.array([float(word == known) for known in WORDS])

    return [
        Observable("exercise", "1", len(exercises), which),
        Observable("shown_angles", "rad", len(MOTIONS), lambda: shown.angles),
        Observable("shown_phase", "1", 1, lambda: (shown.phase,)),
        Observable("said", "1", len(WORDS), said),
    ]


__all__ = ["Trainee", "head_of", "shown_observables"]
