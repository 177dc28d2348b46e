"""A person who is coached, as the task knows them: what they do, what it counts for, how they fare."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rcare_marl.agents.coaching.exercise import Exercise, Reach, load_exercises
from rcare_marl.agents.coaching.imitation import reach_of
from rcare_marl.agents.coaching.recognition.recogniser import ERRORS
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.session import Session
from rcare_marl.agents.coaching.sources.joints_source import JointsSource
from rcare_marl.agents.coaching.upper_body import MOTION_INDEX, MOTIONS, SIDES
from rcare_marl.agents.people.actuation.muscular import MuscleDrive
from rcare_marl.agents.people.body.skeleton import DOF_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.physiology import WORST_PAIN
from rcare_marl.agents.people.physiology_model import REGIONS
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from ..state import Seen, Values, where
from ..task_options import TaskOptions
from .endurance import reach_within_strength
from .learner_kind import LearnerKind, load_learner_kind

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
# Pain of a sore shoulder [1/rad] beyond where it begins, of 10: at rest a share of that of an arm at FAST
# [rad/s]. Our own choice.
PAIN, SORE_AT_REST, FAST = 6.0, 0.4, 0.8
RAISED = [MOTION_INDEX[f"{side}_shoulder_elevation"] for side in SIDES]
TIRING = ("neck", "left_arm", "right_arm")  # regions whose fatigue people tell of


@dataclass(frozen=True)
class SocialCoachingOptions(TaskOptions):
    """Settings of the social coaching task.

    Attributes:
        reward: `paper`: right repetitions alone, for the paper has no reward here; `shaped` adds engagement,
            wrong repetitions, pain, fatigue, talk and, where it is given a weight, time.
        exercises: Which ones, by name or YAML file, in this order; what a person cannot do is left out.
        repetitions: Right repetitions asked of each.
        learners: Kinds of learners (`learner_kind.py`), by name or YAML file; each person is one of them in
            each episode.
    """

    SHAPED_WEIGHTS = {
        "repetition": 1.0,
        "wrong": 0.2,
        "engagement": 0.02,
        "pain": 0.05,
        "fatigue": 0.02,
        "talk": 0.002,
        "time": 0.0,
    }

    exercises: tuple[str, ...] = tuple(
        """
        lateral_raise upper_lift front_raise chest_expansion head_rotation
        """.split()
    )
    repetitions: int = 3
    learners: tuple[str, ...] = ("anybody",)

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [exercise.name for exercise in load_exercises(self.exercises)]
        if len(set(names)) != len(names) or not names:
            raise ConfigError(f"exercises must name some, each once, got {self.exercises}")
        if self.repetitions < 1:
            raise ConfigError(f"repetitions must be at least 1, got {self.repetitions}")
        if not self.learners:
            raise ConfigError("learners must name at least one kind")
        for name in self.learners:
            load_learner_kind(name)  # refuses what is none


@dataclass(frozen=True, eq=False)
class TraineeState:
    """What is read of one person of a lesson."""

    angles: Array  # of the upper body as the simulator knows them [rad], shape [16]
    following: bool  # whether the person follows: the green window
    progress: float  # how far the present repetition is, 0 to 1
    errors: Array  # which of `ERRORS` the last repetition had, shape [n]
    left: float  # repetitions that are left of the exercise that is on
    since_right: float  # since the last right repetition, or since the exercise began [s]
    gaze: float  # cosine between the face and the way to the robot's head
    told_fatigue: float  # how tired they say that they are, 0 to 1
    is_told: bool  # whether what is being said is said to them
    pain: float  # what they feel, and tell, 0 to 10
    suffered: float  # pain summed over time so far [s]
    right: float  # right repetitions so far, of each exercise no more than asked for
    new_right: float  # those of the last control step
    wrong: float  # wrong repetitions so far
    new_wrong: float  # those of the last control step
    wanted: float  # repetitions asked for
    done: float  # exercises that are done


class Trainee:
    """One person of a lesson.

    Attributes:
        person: Who it is.
        seen: Angles of the upper body as the simulator knows them [rad], shape [16].
        reach: What the person can do, seated as they are.
        tires: Whether strength, and not range alone, ends how far their arms rise.
        speed: How fast what is shown goes at most, for this person to follow [rad/s].
        session: What is asked of them and what they have done; once `ask` was called.
        kind: Which kind of learner they are in this episode.
    """

    session: Session

    def __init__(self, person: Human) -> None:
        """Take a person who has been spawned."""
        self.person, self.kind = person, LearnerKind()
        self._hurts_from = math.inf  # elevation of an arm [rad]
        self._order = [DOF_INDEX[dof] for dof in person.movable]
        self._begin_to_look()
        within_range = reach_of(person.avatar.profile, self.seen)
        if isinstance(person.drive, MuscleDrive):
            self.reach, self.speed = reach_of_muscles(within_range), SPEED_OF_MUSCLES
            self.tires = False
        else:
            self.reach, self.speed = reach_within_strength(within_range, person, self.seen), SPEED
            lower = self.reach.high[RAISED] < within_range.high[RAISED]
            self.tires = bool(lower.any()) or self.reach.front != within_range.front

    def ask(self, exercises: Sequence[Exercise], repetitions: int) -> None:
        """Give the person their programme."""
        # Made once, and copied for each episode: what it has seen of a person changes a recogniser.
        self._unused = RuleRecogniser(known=exercises)
        self.session = Session(exercises, copy.deepcopy(self._unused), repetitions=repetitions)

    def reset(
        self, rng: np.random.Generator, repetitions: int, kinds: Sequence[LearnerKind]
    ) -> None:
        """Begin an episode as one of some kinds of learners.

        Args:
            rng: Of the episode.
            repetitions: How many are asked of each exercise.
            kinds: Of which one is drawn, each alike.
        """
        self.kind = kinds[int(rng.integers(len(kinds)))] if len(kinds) > 1 else kinds[0]
        if self.kind.fatigue[1] > 0:
            tired = float(rng.uniform(*self.kind.fatigue))
            for region in TIRING:
                self.person.physiology.set_fatigue(region, tired)
        is_sore = self.kind.hurts_from[0] <= 180
        self._hurts_from = math.radians(rng.uniform(*self.kind.hurts_from)) if is_sore else math.inf
        turn = rng.uniform(-HEAD_TURN, HEAD_TURN)
        halves = [
            dof
            for dof in ("neck_rotation_left", "head_rotation_left")
            if dof in self.person.movable
        ]
        self.person.set_angles(dict.fromkeys(halves, turn / 2))
        self.session.wanted = [repetitions for _ in self.session.exercises]
        self.session.reset(copy.deepcopy(self._unused))
        self._begin_to_look()

    def _begin_to_look(self) -> None:
        self._source, self._suffered = JointsSource(self.person.model.joints), 0.0
        self.look(0.0)
        self._raised = self.seen[RAISED]

    def look(self, time: float) -> None:
        """See the person: all joint angles, as the simulator knows them."""
        angles = self.person.angles.copy()
        angles[self._order] = self.person.positions
        frame = self._source.update(angles, time)
        assert frame is not None  # the simulator knows them all
        self.frame, self.seen = frame, np.nan_to_num(frame.angles)

    def feel(self, duration: float) -> None:
        """Hurt where a sore arm is raised high, the more the faster, after a control step [s]."""
        raised = self.seen[RAISED]
        speed = np.abs(raised - self._raised) / duration
        self._raised = raised
        beyond = np.maximum(raised - self._hurts_from, 0.0)
        felt = float((PAIN * beyond * (SORE_AT_REST + speed / FAST)).max())
        physiology = self.person.physiology
        if felt > physiology.pain:
            physiology.set({"pain": min(felt, WORST_PAIN)})
        self._suffered += physiology.pain * duration

    def tell_fatigue(self) -> None:
        """Let the session know how tired the person is."""
        fatigue_of = self.person.physiology.fatigue_of
        self.session.fatigue = max(fatigue_of(region) for region in REGIONS if region in TIRING)

    def read(
        self, coach: Array, before: TraineeState | None, *, is_asked: bool, is_told: bool
    ) -> TraineeState:
        """Return the person at the end of a control step, after the session has seen them.

        Args:
            coach: Where the head of the robot is in the world [m], shape [3].
            before: The state before; None at the beginning of an episode.
            is_asked: Whether the person has a part in the exercise that is on.
            is_told: Whether what is being said is said to them.
        """
        session, k = self.session, self.session.index
        is_on = is_asked and k < len(session.wanted)
        found = session.repetitions[-1:]
        errors = found[0].errors if found else ()
        right, wrong = float(session.right_count), float(sum(session.wrong))
        mouth, face = self.person.mouth_and_face()
        way = coach - mouth
        return TraineeState(
            angles=self.seen,
            following=session.judgement.following,
            progress=session.judgement.progress,
            errors=np.array([float(error in errors) for error in ERRORS]),
            left=float(session.wanted[k] - session.right[k]) if is_on else 0.0,
            since_right=session.since_right,
            gaze=float(face @ way / np.linalg.norm(way)),
            told_fatigue=session.fatigue,
            is_told=is_told,
            pain=self.person.physiology.pain,
            suffered=self._suffered,
            right=right,
            new_right=right - (0.0 if before is None else before.right),
            wrong=wrong,
            new_wrong=wrong - (0.0 if before is None else before.wrong),
            wanted=float(sum(session.wanted)),
            done=float(sum(r >= w for r, w in zip(session.right, session.wanted, strict=True))),
        )


def trainee_seen(role: str, prefix: str = "") -> list[Seen]:
    """Return what there is to see of a person in a lesson, `prefix` before each name."""

    def of(name: str) -> Callable[[Any], Values]:
        return lambda state: getattr(state.trainees[role], name)

    return [
        Seen(f"{prefix}seen_angles", "rad", len(MOTIONS), of("angles")),
        Seen(f"{prefix}following", "1", 1, of("following")),
        Seen(f"{prefix}progress", "1", 1, of("progress")),
        Seen(f"{prefix}last_error", "1", len(ERRORS), of("errors")),
        Seen(f"{prefix}repetitions_left", "1", 1, of("left")),
        Seen(f"{prefix}since_right", "s", 1, of("since_right")),
        Seen(f"{prefix}gaze_at_coach", "1", 1, of("gaze")),
        Seen(f"{prefix}told_fatigue", "1", 1, of("told_fatigue")),
        Seen(f"{prefix}told_pain", "1", 1, of("pain")),
        Seen(f"{prefix}contact_force", "N", 1, lambda state: state.safety[role].force),
    ]


def trainee_rewards(
    options: SocialCoachingOptions, trainee: TraineeState, is_speaking: Values
) -> dict[str, Values]:
    """Return what a control step was worth to a person, while the coach says something or not."""
    terms: dict[str, Values] = {"repetition": trainee.new_right}
    if options.reward != "shaped":
        return terms
    terms["wrong"] = -trainee.new_wrong
    looks = where(trainee.gaze > math.cos(LOOKS), 0.5, 0.0)
    terms["engagement"] = where(trainee.following, 1.0, looks)
    terms["pain"] = -trainee.pain / 10.0
    terms["fatigue"] = -trainee.told_fatigue
    terms["talk"] = -(is_speaking * 1.0)
    terms["time"] = -1.0
    return options.weighted(terms)


def trainee_metrics(trainee: TraineeState, time: Values) -> dict[str, Values]:
    """Return what is reported of a person's part of the episode so far, `time` [s] long."""
    return {
        "right_repetitions": trainee.right,
        "wanted_repetitions": trainee.wanted,
        "wrong_repetitions": trainee.wrong,
        "right_per_minute": 60.0 * trainee.right / where(time > 0, time, 1.0),
        "mean_pain": trainee.suffered / where(time > 0, time, 1.0),
        "exercises_done": trainee.done,
        "fatigue": trainee.told_fatigue,
        "following": trainee.following,
    }


def reach_of_muscles(reach: Reach) -> Reach:
    """Return what is left of a person's reach when muscles drive them."""
    low, high = reach.low.copy(), reach.high.copy()
    turn = MOTION_INDEX["neck_rotation_left"]
    low[turn], high[turn] = min(low[turn] + MUSCLES_NECK, 0.0), max(high[turn] - MUSCLES_NECK, 0.0)
    most = reach.front or (math.inf, math.inf)
    front = (min(most[0], MUSCLES_FRONT), min(most[1], MUSCLES_FRONT))
    return replace(reach, low=low, high=high, front=front)


def head_of(robot: Robot) -> Array:
    """Return where the head of a robot is in the world [m], shape [3]."""
    joints = robot.parts["head"].joints
    assert joints is not None
    return np.array(robot.body.link_pose(joints.indices[-1]).position)
