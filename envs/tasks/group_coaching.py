"""Group coaching: a robot leads two to four seated people through exercises at once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rcare_marl.agents.coaching.exercise import load_exercises
from rcare_marl.agents.coaching.group_session import GroupSession, group_programme
from rcare_marl.agents.coaching.session import Demonstration, Word
from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Array, Pose
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
from ..state import Seen, Values, greatest
from ..task import Role

RECIPIENTS = ("recipient", "second_recipient", "third_recipient", "fourth_recipient")
RADIUS = 2.3  # [m] of the arc on which chairs stand, about the robot; our own choice
APART = 1.9  # [m] from chair to chair: room for two arms raised to the side; our own choice
COACH_AT = (1.3, 0.0)  # [m] on the floor, so that the arc lies about the origin
CHAIR_OUT, ARM_OUT = 0.3, 0.5  # [m] half a chair's width, and an arm beyond it; our own choice
ACROSS = 0.53  # half the width that a camera of 44 degrees sees, over its distance, in a picture of 4 to 3
CHAIR_ROOM, COACH_ROOM = 0.8, 0.4  # [m] about a chair and about the robot; our own choice
TOGETHER = frozenset(
    "right_repetitions wanted_repetitions wrong_repetitions right_per_minute exercises_done following".split()
)  # metrics that are summed over all people; of the others the greatest is told


class GroupView:
    """What the coach of a group shows and says to one person, for a `Learner`.

    What is shown is as far as this person goes; who has nothing to do sees them at rest. Words to somebody
    else are not heard.

    Attributes:
        session: The session of this person.
        demonstration: The view itself.
    """

    def __init__(
        self, group: GroupSession, name: str, shown: Demonstration, trainee: Trainee
    ) -> None:
        """Take the lesson, who looks at it, and what is shown to all."""
        self.session, self._trainee = group.members[name], trainee
        self._group, self._name, self._shown = group, name, shown
        self.demonstration = self

    @property
    def kind(self) -> LearnerKind:
        """Which kind of learner this episode asks for."""
        return self._trainee.kind

    @property
    def angles(self) -> Array:
        """What is shown now, as far as this person goes [rad], shape [16]."""
        is_busy = self._group.is_busy(self._name)
        return self.session.exercise.angles(self._shown.shown_for if is_busy else 0.0)

    @property
    def count(self) -> int:
        """Repetitions that have been shown to their end, of the present exercise of this person."""
        return self._shown.count if self._group.takes_part(self._name) else 0

    @property
    def word(self) -> Word:
        """What is being said, or was said last."""
        return self._shown.word

    @property
    def is_speaking(self) -> bool:
        """Whether something is being said that this person is to hear."""
        return self._shown.is_speaking and self._shown.spoken_to in (None, self._name)


def place(default: str | None, *, optional: bool = False) -> Role[Human]:
    """Return the part of one more person in the group."""
    return Role(
        Human,
        default=default,
        optional=optional,
        posture="wheelchair_exercise",
        movable=MOVABLE,
        partner="learner",
    )


@register_task("group_coaching")
class GroupCoaching(CoachingTask):
    """A robot leads two to four people in wheelchairs through exercises of arms and head, all at once.

    Goal: everybody's own programme done rightly, as often as asked. Randomised at reset: how each head is
    turned; partners draw more.
    Success and failure: all done; an exercise left that somebody had not done, or a force above the limit on
    anybody. Tolerance: the repetitions asked for are divided by it.
    """

    recipient = place("daniel")
    second_recipient = place("kim")
    third_recipient = place(None, optional=True)
    fourth_recipient = place(None, optional=True)

    session: GroupSession

    @property
    def recipients(self) -> Mapping[str, Human]:
        people = {role: self.cast[role] for role in RECIPIENTS if role in self.cast}
        return {role: person for role, person in people.items() if isinstance(person, Human)}

    def chairs(self) -> dict[str, Pose]:
        """Return where the chair of each recipient stands: on an arc before the robot, facing it."""
        people = list(self.recipients)
        step = 2 * math.asin(APART / (2 * RADIUS))
        out = {}
        for k, role in enumerate(people):
            yaw = step * (k - 0.5 * (len(people) - 1))
            x, y = COACH_AT
            out[role] = facing((x - RADIUS * math.cos(yaw), y - RADIUS * math.sin(yaw)), yaw)
        return out

    def free_floor(self) -> Rectangle:
        spots = [(pose.position, CHAIR_ROOM) for pose in self.chairs().values()]
        spots.append(((*COACH_AT, 0.0), COACH_ROOM))
        low, high = (
            [edge(p[i] + sign * room for p, room in spots) for i in (0, 1)]
            for edge, sign in ((min, -1), (max, 1))
        )
        return Rectangle(*low, *high)

    def furnish(self, world: World) -> dict[str, Pose]:
        return self.seat(world, self.chairs(), facing(COACH_AT, math.pi))

    def plan(self) -> GroupSession:
        self.names = _call_names(self.recipients)
        reaches = {self.names[role]: trainee.reach for role, trainee in self.trainees.items()}
        exercises = load_exercises(self.options.exercises)
        slowest = min(trainee.speed for trainee in self.trainees.values())
        shown, own = group_programme(exercises, reaches, speed=slowest)
        for role, trainee in self.trainees.items():
            trainee.ask(own[self.names[role]], self.options.repetitions)
        members = {self.names[role]: trainee.session for role, trainee in self.trainees.items()}
        return GroupSession(shown, members)

    def begin_lesson(self) -> None:
        self.session.reset()

    def see(self, time: float) -> None:
        frames = {self.names[role]: trainee.frame for role, trainee in self.trainees.items()}
        self.session.see(frames, time)

    def is_asked(self, role: str) -> bool:
        return self.session.is_busy(self.names[role])

    def is_told(self, role: str) -> bool:
        shown = self.demonstration
        return shown.is_speaking and shown.spoken_to in (None, self.names[role])

    def observables(self, role: str) -> Sequence[Seen]:
        """Return what a role sees: a recipient of themselves, the robot of everybody, by role."""
        people = {role: ""} if role in self.trainees else {r: f"{r}_" for r in self.trainees}
        seen = [thing for known, prefix in people.items() for thing in _seen(known, prefix)]
        return [*self.shown(), *seen, self.time_left()]

    def rewards(self, role: str, state: LessonState) -> Mapping[str, Values]:
        """Return a recipient's own terms; for the robot the mean of everybody's."""
        if role in self.trainees:
            return self.rewards_of(role, state)
        everybody = [self.rewards_of(known, state) for known in self.trainees]
        return {
            name: sum(terms[name] for terms in everybody) / len(everybody) for name in everybody[0]
        }

    def metrics(self, state: LessonState) -> Mapping[str, Values]:
        found = [trainee_metrics(trainee, state.time) for trainee in state.trainees.values()]
        return {
            name: (sum if name in TOGETHER else greatest)([metrics[name] for metrics in found])
            for name in found[0]
        }

    def camera(self) -> Camera:
        places = [pose.position for pose in self.chairs().values()]
        # Everybody across the picture, as on a class photo; who sits aside stretches an arm ahead.
        wide = max(abs(y) + CHAIR_OUT + ARM_OUT * (COACH_AT[0] - x) / RADIUS for x, y, _ in places)
        front = max(x for x, _, _ in places)
        middle = 0.5 * (front + min(x for x, _, _ in places))
        eye = max(front + wide / ACROSS, COACH_AT[0] + 1.8)
        return Camera(
            eye=(eye, 0.0, 1.0 + 0.3 * (eye - middle)), target=(middle, 0.0, 0.7), fov_deg=44
        )


def _seen(role: str, prefix: str) -> list[Seen]:
    told = Seen(f"{prefix}spoken_to", "1", 1, lambda state: state.trainees[role].is_told)
    return [*trainee_seen(role, prefix), told]


def _call_names(people: Mapping[str, Human]) -> dict[str, str]:
    """Return what each person is called, by role; the second of a name gets a number."""
    out: dict[str, str] = {}
    for role, person in people.items():
        count = sum(known.avatar.name == person.avatar.name for known in people.values())
        before = sum(people[known].avatar.name == person.avatar.name for known in out)
        is_alone = count == 1 or before == 0
        out[role] = person.avatar.name if is_alone else f"{person.avatar.name} {before + 1}"
    return out


def learner(env: CareEnv, role: str) -> Learner:
    """Return a recipient who imitates what the coach shows, with human shortcomings."""
    assert isinstance(task := env.task, GroupCoaching)
    view = GroupView(task.session, task.names[role], task.demonstration, task.trainees[role])
    return Learner(task.recipients[role], view, task.control_dt)


for _role in RECIPIENTS:
    register_policy("group_coaching", _role, "learner")(learner)
