"""What coaching one person and coaching a group have in common."""

from __future__ import annotations

import abc
import math
from collections.abc import Mapping, Sequence

import numpy as np

from rcare_marl.agents.coaching.body import RobotBody
from rcare_marl.agents.coaching.exercise import Exercise
from rcare_marl.agents.coaching.retarget import Retarget
from rcare_marl.agents.coaching.session import Demonstration, Lesson
from rcare_marl.agents.human import Human
from rcare_marl.agents.robot import Robot
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.world import World

from ..task import Role, Task
from .action import LIMBS, CoachPart, Orders
from .option import SocialCoachingOptions
from .seat import Seat, stand
from .trainee import Trainee, head_of, shown_observables

EXPLAINING = 8.0  # [s] of the time limit for each exercise of each person; our own choice
GENEROUS = 3.0  # time limit over the duration of all right repetitions as shown; our own choice


class CoachingTask(Task):
    """A robot leads people in wheelchairs through exercises of arms and head.

    Attributes:
        seats: The wheelchair of each person, by role.
        trainees: The people, by role, in the same order.
        session: The lesson.
        demonstration: What the robot shows and says.
        body: The robot's, as the coach moves it.
    """

    robot = Role(Robot, default="nao", partner="scripted", control="joint_position", moves=LIMBS)

    Options = SocialCoachingOptions
    room_kinds = ("living", "lounge", "gym", "bedroom", "dining")
    options: SocialCoachingOptions
    session: Lesson

    @property
    @abc.abstractmethod
    def recipients(self) -> Mapping[str, Human]:
        """The people who are coached, by role."""

    def seat(self, world: World, chairs: Mapping[str, Pose], coach: Pose) -> dict[str, Pose]:
        """Add the floor, chairs and what the robot stands on; return where robot and recipients start.

        Args:
            world: The world.
            chairs: Where the chair of each recipient stands, by role.
            coach: Where the robot stands.

        Raises:
            ConfigError: If the robot cannot show exercises, or somebody does not sit in a wheelchair.
        """
        Retarget(self.robot.config)  # refuses a robot without arms and head like a person's
        self.seats = {role: Seat(person) for role, person in self.recipients.items()}
        self.lay_floor(world)
        places = {
            role: seat.spawn(world, chairs[role], name="" if len(chairs) == 1 else f"chair_{role}")
            for role, seat in self.seats.items()
        }
        return {"robot": stand(world, self.robot, coach), **places}

    @abc.abstractmethod
    def plan(self) -> Lesson:
        """Ask every trainee what they can do, and return the lesson."""

    def build(self, world: World) -> None:
        self._world = world
        for agent in self.cast.values():
            if isinstance(agent, Human):
                for seat in self.seats.values():
                    agent.ignore(seat.chair.body)  # the posture keeps them apart
        movers = [a.body for a in self.cast.values() if isinstance(a, Robot)]
        self.trainees = {
            role: Trainee(person, self.measure(person, world, movers))
            for role, person in self.recipients.items()
        }
        self.session = self.plan()
        self.body = RobotBody(self.robot)
        self.demonstration = Demonstration(self.session, self.body)
        self.robot.parts["coach"] = CoachPart(Orders(self.robot, self.body, self.demonstration))
        shown: Sequence[Exercise] = self.session.exercises
        time = sum(exercise.duration for exercise in shown) * self.options.repetitions
        asked = sum(len(trainee.session.exercises) for trainee in self.trainees.values())
        steps = math.ceil((GENEROUS * time + EXPLAINING * asked) / self.control_dt)
        self.time_limit = steps * self.control_dt
        for role, person in self.recipients.items():
            if world.contact_force(person.body) > 0:
                raise ConfigError(f"something touches {role!r} before the episode begins")

    def reset(self, rng: np.random.Generator) -> None:
        repetitions = math.ceil(self.options.repetitions / self.options.tolerance)
        for trainee in self.trainees.values():
            trainee.reset(rng, repetitions)
        self.begin()
        self.demonstration.reset()
        rest = self.session.exercise.angles(0.0)
        self.body.reset(rest)
        self.body.take(rest)

    def begin(self) -> None:
        """Begin the lesson; those of the trainees have begun."""

    def after_substep(self) -> None:
        for trainee in self.trainees.values():
            trainee.safety.after_substep()

    def after_step(self) -> None:
        time = self._world.time
        for trainee in self.trainees.values():
            trainee.after_step(time, self.control_dt)
        self.see(time)
        coach = head_of(self.robot)
        for trainee in self.trainees.values():
            trainee.tally(coach)

    @abc.abstractmethod
    def see(self, time: float) -> None:
        """Let the lesson see the frames of the trainees."""

    def shown(self) -> list[Observable]:
        """Return what everybody sees and hears of the coach."""
        return shown_observables(self.session, self.demonstration, self.options.exercises)

    def time_left(self) -> Observable:
        """Return how long there is still to go."""
        return Observable("time_left", "s", 1, lambda: (self.time_limit - self._world.time,))

    def rewards_of(self, role: str) -> dict[str, float]:
        """Return what the last control step was worth to the trainee in a role."""
        left = max(self.time_limit - self._world.time, 0.0) / self.control_dt
        return self.trainees[role].rewards(
            self.options,
            is_speaking=self.demonstration.is_speaking,
            steps_left=left if self.is_success() else 0.0,
        )

    def is_success(self) -> bool:
        return self.session.is_complete and not self.is_failure()

    def is_failure(self) -> bool:
        is_left = self.session.is_over and not self.session.is_complete
        hardest = max(trainee.safety.peak_force for trainee in self.trainees.values())
        return is_left or hardest > self.options.force_limit


def facing(place: tuple[float, float], yaw: float) -> Pose:
    """Return the pose of what stands at a place on the floor [m], turned by `yaw` [rad]."""
    return Pose((*place, 0.0), tuple(quaternion_from_rpy(0, 0, yaw).tolist()))


__all__ = ["CoachingTask", "facing"]
