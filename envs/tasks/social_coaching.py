"""Social coaching: a robot leads a seated person through exercises of the upper body."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rcare_marl.agents.coaching.exercise import load_exercises
from rcare_marl.agents.coaching.session import Session, programme
from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Pose
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..care_env import CareEnv
from ..coaching.coaching_task import CoachingTask, LessonState, facing
from ..coaching.learner import Learner
from ..coaching.learner_kind import LearnerKind
from ..coaching.seat import MOVABLE
from ..coaching.trainee import Trainee, trainee_metrics, trainee_seen
from ..rectangle import Rectangle
from ..registry import register_policy, register_task
from ..state import Seen, Values
from ..task import STANDING_CAREGIVER, Role

DISTANCE = 1.35  # [m] from the middle of the chair to the robot; our own choice
HELPER_AT = (0.15, 0.95)  # [m] beside the chair, where a caregiver stands; our own choice


@register_task("social_coaching")
class SocialCoaching(CoachingTask):
    """A robot leads the person in the wheelchair through exercises of arms and head.

    Goal: every exercise of this person's programme done rightly, as often as asked. Randomised at reset: how
    the head is turned; a partner draws more.
    Success and failure: all done; an exercise left undone, or a force above the limit on the person.
    Tolerance: the repetitions asked for are divided by it.
    """

    recipient = Role(
        Human, default="daniel", posture="wheelchair_exercise", movable=MOVABLE, partner="learner"
    )
    caregiver = STANDING_CAREGIVER

    footprint = Rectangle(-0.8, -0.9, 1.7, 0.9)
    slack = 0.1
    session: Session

    @property
    def recipients(self) -> Mapping[str, Human]:
        return {"recipient": self.recipient}

    @property
    def trainee(self) -> Trainee:
        """The person who is coached."""
        return self.trainees["recipient"]

    @property
    def kind(self) -> LearnerKind:
        """Which kind of learner this episode asks for."""
        return self.trainee.kind

    def furnish(self, world: World) -> dict[str, Pose]:
        coach = facing((DISTANCE, 0.0), math.pi)
        places = self.seat(world, {"recipient": Pose()}, coach)
        return {**places, "caregiver": facing(HELPER_AT, -math.pi / 2)}

    def plan(self) -> Session:
        exercises = load_exercises(self.options.exercises)
        found = programme(exercises, self.trainee.reach, speed=self.trainee.speed)
        self.trainee.ask(found, self.options.repetitions)
        return self.trainee.session

    def see(self, time: float) -> None:
        self.session.see(self.trainee.frame, time)

    def observables(self, role: str) -> Sequence[Seen]:
        return [*self.shown(), *trainee_seen("recipient"), self.time_left()]

    def rewards(self, role: str, state: LessonState) -> Mapping[str, Values]:
        return self.rewards_of("recipient", state)

    def metrics(self, state: LessonState) -> Mapping[str, Values]:
        return trainee_metrics(state.trainees["recipient"], state.time)

    def camera(self) -> Camera:
        return Camera(eye=(1.3, -2.45, 1.6), target=(0.48, 0.0, 0.92), fov_deg=44)


@register_policy("social_coaching", "recipient", "learner")
def learner(env: CareEnv, role: str) -> Learner:
    """Return a recipient who imitates what the coach shows, with human shortcomings."""
    assert isinstance(task := env.task, SocialCoaching)
    return Learner(task.recipient, task, task.control_dt)
