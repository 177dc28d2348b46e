"""What coaching one person and coaching a group have in common: the coach's actions, and the task."""

from __future__ import annotations

import abc
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.coaching.body import RobotBody
from rcare_marl.agents.coaching.exercise import Exercise, load_exercises
from rcare_marl.agents.coaching.retarget import Retarget
from rcare_marl.agents.coaching.session import ACTS, WORDS, Demonstration, Lesson, Order
from rcare_marl.agents.coaching.style import STYLES, Style
from rcare_marl.agents.coaching.upper_body import MOTIONS
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.control import Control
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_part import Part
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Array, Pose, about_z
from rcare_marl.world import World

from ..state import Seen, State, Values, negate
from ..task import Role, Task
from .learner_kind import load_learner_kind
from .seat import Seat, stand
from .trainee import SocialCoachingOptions, Trainee, TraineeState, head_of, trainee_rewards

EXPLAINING = 8.0  # [s] of the time limit for each exercise of each person; our own choice
RESTING = 30.0  # likewise, of each person whose strength ends how far an arm rises; our own choice
GENEROUS = 3.0  # time limit over the duration of all right repetitions as shown; our own choice


LIMBS = ("left_arm", "right_arm", "head")
TEMPO = len(ACTS) + len(WORDS)
SIZE = TEMPO + 1 + len(STYLES)
NAMES = (
    *(f"do {act}" for act in ACTS),
    *(f"say {word}" for word in WORDS),
    "tempo [octaves]",
    *(f"style {name}" for name in STYLES),
)


def encode(order: Order, style: Style = Style()) -> Array:
    """Return the action that gives an order and sets a style, shape [17]."""
    action = -np.ones(SIZE)
    action[ACTS.index(order.act)] = action[len(ACTS) + WORDS.index(order.word)] = 1.0
    action[TEMPO] = min(max(math.log2(order.tempo), -1.0), 1.0)
    action[TEMPO + 1 :] = style.values()
    return action


def decode(action: Array) -> tuple[Order, Style]:
    """Return the order and the style that an action, shape [17], gives: of each group the greatest wins."""
    act = ACTS[int(np.argmax(action[: len(ACTS)]))]
    word = WORDS[int(np.argmax(action[len(ACTS) : TEMPO]))]
    return Order(act, word, 2.0 ** float(action[TEMPO])), Style.of(action[TEMPO + 1 :])


class Led(Control):
    """Control of a limb that the coach leads: it takes no action of its own."""

    size = 0
    names: tuple[str, ...] = ()
    max = np.zeros(0)

    def __init__(self, control: Control) -> None:
        """Take what moves the limb."""
        self.control = control

    def reset(self) -> None:
        self.control.reset()

    def command(self, action: Array, duration: float) -> None:
        """Do nothing: the coach leads."""


class Orders(Control):
    """Control of a whole robot that coaches: an action is an `Order`, carried out with arms and head."""

    size = SIZE
    names = NAMES
    max = np.ones(SIZE)

    def __init__(
        self, robot: Robot, body: RobotBody, lesson: Lesson, demonstration: Demonstration
    ) -> None:
        """Take the reins of a robot that has been spawned.

        Raises:
            ConfigError: If arms or head do not move, or not by `joint_position`.
        """
        missing = [limb for limb in LIMBS if limb not in robot.parts]
        if missing:
            raise ConfigError(
                f"to coach, {robot.name!r} needs {', '.join(missing)} among its `moves`"
            )
        self._limbs: dict[str, Control] = {}
        for limb in LIMBS:
            control = robot.parts[limb].control
            if not hasattr(control, "action_for"):
                raise ConfigError(
                    f"to coach, {robot.name!r} needs the control mode 'joint_position', got "
                    f"{type(control).__name__}"
                )
            self._limbs[limb] = control
            robot.parts[limb].control = Led(control)
        self._body, self._lesson, self._demonstration = body, lesson, demonstration

    def reset(self) -> None:
        """Nothing to do: the task begins the session."""

    def command(self, action: Array, duration: float) -> None:
        order, self._lesson.style = decode(action)
        self._demonstration.perform(order, duration)
        for limb, control in self._limbs.items():
            wanted = self._body.target(limb, duration)
            control.command(control.action_for(wanted), duration)  # type: ignore[attr-defined]


class CoachPart(Part):
    """The coach as a part of the robot that actions move; it senses nothing of itself."""

    def __init__(self, orders: Orders) -> None:
        super().__init__("coach", orders)

    def observables(self) -> list[Observable]:
        return []


@dataclass(frozen=True, eq=False)
class LessonState(State):
    """What is read of a lesson."""

    exercise: Array  # which of all exercises is on, shape [n]
    angles: Array  # what is shown now [rad], shape [16]
    phase: float  # how far the repetition is that is being shown, 0 to 1
    said: Array  # which of `WORDS` is being said, shape [5]
    is_speaking: bool  # whether anything is
    is_over: bool  # whether all exercises are done or left
    is_complete: bool  # whether everything was done as often as it was asked for
    trainees: Mapping[str, TraineeState]  # the people, by role


class CoachingTask(Task):
    """A robot leads people in wheelchairs through exercises of arms and head.

    Attributes:
        seats: The wheelchair of each person, by role.
        trainees: The people, by role, in the same order.
        kinds: Kinds of learners, of which each person is one in each episode.
        session: The lesson.
        demonstration: What the robot shows and says.
        body: The robot's, as the coach moves it.
    """

    robot = Role(Robot, default="nao", partner="scripted", control="joint_position", moves=LIMBS)

    reachable_by = ("nao", "pepper")
    Options = SocialCoachingOptions
    room_kinds = ("living", "lounge", "gym", "bedroom", "dining")
    options: SocialCoachingOptions
    session: Lesson
    state: LessonState

    @property
    @abc.abstractmethod
    def recipients(self) -> Mapping[str, Human]:
        """The people who are coached, by role."""

    def seat(self, world: World, chairs: Mapping[str, Pose], coach: Pose) -> dict[str, Pose]:
        """Add chairs and what the robot stands on; return where robot and recipients start.

        Args:
            world: The world.
            chairs: Where the chair of each recipient stands, by role.
            coach: Where the robot stands.

        Raises:
            ConfigError: If the robot cannot show exercises, or somebody does not sit in a wheelchair.
        """
        Retarget(self.robot.config)  # refuses a robot without arms and head like a person's
        self.seats = {role: Seat(person) for role, person in self.recipients.items()}
        places = {
            role: seat.spawn(world, chairs[role], name="" if len(chairs) == 1 else f"chair_{role}")
            for role, seat in self.seats.items()
        }
        return {"robot": stand(world, self.robot, coach), **places}

    @abc.abstractmethod
    def plan(self) -> Lesson:
        """Ask every trainee what they can do, and return the lesson."""

    def build(self, world: World) -> None:
        for agent in self.cast.values():
            if isinstance(agent, Human):
                for seat in self.seats.values():
                    agent.ignore(seat.chair.body)  # the posture keeps them apart
        self._asked = [exercise.name for exercise in load_exercises(self.options.exercises)]
        self.kinds = [load_learner_kind(name) for name in self.options.learners]
        self.trainees = {role: Trainee(person) for role, person in self.recipients.items()}
        self.session = self.plan()
        self.body = RobotBody(self.robot)
        self.demonstration = Demonstration(self.session, self.body)
        self.robot.parts["coach"] = CoachPart(
            Orders(self.robot, self.body, self.session, self.demonstration)
        )
        shown: Sequence[Exercise] = self.session.exercises
        time = sum(exercise.duration for exercise in shown) * self.options.repetitions
        allowed = GENEROUS * time
        for trainee in self.trainees.values():
            extra = EXPLAINING + RESTING * trainee.tires
            allowed += extra * len(trainee.session.exercises)
        steps = math.ceil(allowed / self.control_dt)
        self.time_limit = steps * self.control_dt

    def reset(self, rng: np.random.Generator) -> None:
        repetitions = math.ceil(self.options.repetitions / self.options.tolerance)
        for trainee in self.trainees.values():
            trainee.reset(rng, repetitions, self.kinds)
        self.begin_lesson()
        self.demonstration.reset()
        rest = self.session.exercise.angles(0.0)
        self.body.reset(rest)
        self.body.take(rest)

    def begin_lesson(self) -> None:
        """Begin the lesson; those of the trainees have begun."""

    def read(self, now: State, before: LessonState | None) -> LessonState:
        for trainee in self.trainees.values():
            trainee.tell_fatigue()
            trainee.look(now.time)
            trainee.feel(self.control_dt)
        self.see(now.time)
        lesson, shown, coach = self.session, self.demonstration, head_of(self.robot)
        on = "" if lesson.index >= len(lesson.exercises) else lesson.exercise.name
        word = shown.word if shown.is_speaking else "nothing"
        return LessonState(
            **vars(now),
            exercise=np.array([float(name == on) for name in self._asked]),
            angles=shown.angles,
            phase=shown.phase,
            said=np.array([float(word == known) for known in WORDS]),
            is_speaking=shown.is_speaking,
            is_over=lesson.is_over,
            is_complete=lesson.is_complete,
            trainees={
                role: trainee.read(
                    coach,
                    None if before is None else before.trainees[role],
                    is_asked=self.is_asked(role),
                    is_told=self.is_told(role),
                )
                for role, trainee in self.trainees.items()
            },
        )

    def is_asked(self, role: str) -> bool:
        """Return whether a person has a part in the exercise that is on."""
        return True

    def is_told(self, role: str) -> bool:
        """Return whether what is being said is said to a person."""
        return self.demonstration.is_speaking

    @abc.abstractmethod
    def see(self, time: float) -> None:
        """Let the lesson see the frames of the trainees."""

    def shown(self) -> list[Seen]:
        """Return what everybody sees and hears of the coach."""
        return [
            Seen("exercise", "1", len(self.options.exercises), lambda s: s.exercise),
            Seen("shown_angles", "rad", len(MOTIONS), lambda s: s.angles),
            Seen("shown_phase", "1", 1, lambda s: s.phase),
            Seen("said", "1", len(WORDS), lambda s: s.said),
        ]

    def rewards_of(self, role: str, state: LessonState) -> dict[str, Values]:
        """Return what the last control step was worth to the trainee in a role."""
        terms = trainee_rewards(self.options, state.trainees[role], state.is_speaking)
        if self.options.reward == "shaped":  # to dawdle would pay more
            best = self.options.weight("engagement")
            terms["done"] = self.for_the_rest(state, self.succeeded(state), best)
        return terms

    def is_success(self, state: LessonState) -> Values:
        return state.is_complete

    def is_failure(self, state: LessonState) -> Values:
        return state.is_over & negate(state.is_complete)


def facing(place: tuple[float, float], yaw: float) -> Pose:
    """Return the pose of what stands at a place on the floor [m], turned by `yaw` [rad]."""
    return Pose((*place, 0.0), about_z(yaw))
