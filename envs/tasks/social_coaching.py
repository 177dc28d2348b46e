"""Social coaching: a robot leads a seated person through exercises of the upper body."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from rcare_marl.agents.body.skeleton import DOF_INDEX, JOINTS, SIDES
from rcare_marl.agents.coaching.body import RobotBody
from rcare_marl.agents.coaching.exercise import load_exercises
from rcare_marl.agents.coaching.joints_source import JointsSource
from rcare_marl.agents.coaching.reach import raised_sides, reach_of
from rcare_marl.agents.coaching.recogniser import ERRORS
from rcare_marl.agents.coaching.retarget import Retarget
from rcare_marl.agents.coaching.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.session import WORDS, Demonstration, Session, programme
from rcare_marl.agents.coaching.upper_body import MOTIONS
from rcare_marl.agents.human import Human
from rcare_marl.agents.physiology_model import REGIONS
from rcare_marl.agents.robot import Robot
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Array, Pose, quaternion_from_rpy
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..care_env import CareEnv
from ..coaching.action import LIMBS, CoachPart, Orders
from ..coaching.chair import ExerciseChair
from ..coaching.learner import Learner
from ..coaching.option import SocialCoachingOptions
from ..homes.rectangle import Rectangle
from ..registry import register_policy, register_task
from ..task import Role, Task

MOVABLE = (
    "spine1", "neck", "head",
    *(f"{side}_{part}" for side in SIDES for part in ("shoulder", "elbow_flexion", "elbow_pronation")),
)  # fmt: skip
SPEED = (
    1.2  # [rad/s] of an arm in what is shown: people here go at 0.8 and catch up; our own choice
)
DISTANCE = 1.35  # [m] from the middle of the chair to the robot; our own choice
TABLE = (0.46, 0.60, 0.72)  # [m] depth, width, height, under a small robot; our own choice
HELPER_AT = (0.15, 0.95)  # [m] beside the chair, where a caregiver stands; our own choice
LOOKS = math.radians(30)  # of the face from the coach, to count as looking there; our own choice
HEAD_TURN = math.radians(15)  # uniform, each way, at the start; our own choice
EXPLAINING = 8.0  # [s] of the time limit for each exercise; our own choice
GENEROUS = 3.0  # time limit over the duration of all right repetitions as shown; our own choice
TIRING = ("neck", "left_arm", "right_arm")  # regions whose fatigue people tell of


@register_task("social_coaching")
class SocialCoaching(Task):
    """A robot leads the person in the wheelchair through exercises of arms and head.

    Goal: every exercise of this person's programme done rightly, as often as asked. Randomised at reset: how
    the head is turned; a partner draws more.
    Success and failure: all done; an exercise left undone, or a force above the limit on the person.
    Tolerance: the repetitions asked for are divided by it.
    """

    robot = Role(Robot, default="nao", partner="scripted", control="joint_position", moves=LIMBS)
    recipient = Role(
        Human, default="daniel", posture="wheelchair_exercise", movable=MOVABLE, partner="learner"
    )
    caregiver = Role(
        Human, default=None, optional=True, posture="standing", partner="still",
        movable=("spine1_flexion", "right_shoulder", "right_elbow_flexion"),
    )  # fmt: skip

    Options = SocialCoachingOptions
    room_kinds = ("living", "lounge", "gym", "bedroom", "dining")
    footprint = Rectangle(-0.8, -0.9, 1.7, 0.9)
    options: SocialCoachingOptions

    def furnish(self, world: World) -> dict[str, Pose]:
        Retarget(self.robot.config)  # refuses a robot without arms and head like a person's
        person = self.recipient
        if person.posture.arms != "armrests":
            raise ConfigError(
                f"who exercises sits in the wheelchair, not {person.posture.description}"
            )
        self._free = raised_sides(person.avatar.profile)
        self._chair = ExerciseChair(self._free)
        self.lay_floor(world)
        self._let_arms_hang(person)
        soles = person.soles(self._chair.frame("seat_back"))
        self._chair.fit_footplates(soles["left"], soles["right"])
        self._chair.spawn(world)
        rests = {
            side: None if side in self._free else self._chair.frame_in_world(f"armrest_{side}")
            for side in SIDES
        }
        person.use_arm_rests(rests["left"], rests["right"])
        back, away = (tuple(quaternion_from_rpy(0, 0, a).tolist()) for a in (math.pi, -math.pi / 2))
        place, mount = Pose((DISTANCE, 0.0, 0.0), back), self._mount()
        if mount == "table":
            self._add_table(world, place)
        return {
            "robot": self.robot.mount(mount, place),
            "recipient": self._chair.frame_in_world("seat_back"),
            "caregiver": Pose((*HELPER_AT, 0.0), away),
        }

    def _mount(self) -> str:
        """Return the mount: one that is bolted down stands on a table, to be seen from a chair."""
        chosen = self.robot.chosen_mount
        if chosen is not None:
            return chosen if isinstance(chosen, str) else "floor"
        return "table" if self.robot.config.base is None else "floor"

    def _let_arms_hang(self, person: Human) -> None:
        """Let nothing hold the arms that exercise; what the person cannot raise lies on its armrest."""
        held = person.posture.supported
        free = {
            f"{side}_{joint}" for side in self._free for joint in ("shoulder", "elbow", "wrist")
        }
        kept = tuple(joint for joint in (JOINTS if held == "all" else held) if joint not in free)
        person.posture = dataclasses.replace(person.posture, supported=kept)

    def _add_table(self, world: World, place: Pose) -> None:
        depth, width, height = TABLE
        for name, size, z in (
            ("coach_table", (depth, width, 0.03), height - 0.015),
            ("coach_table_column", (0.1, 0.1, height - 0.06), 0.5 * height),
            ("coach_table_foot", (0.36, 0.46, 0.03), 0.015),
        ):
            at = place @ Pose((0.0, 0.0, z))
            world.add_box(size, at, name=name, rgba=(0.80, 0.70, 0.56, 1.0))

    def build(self, world: World) -> None:
        self._world = world
        for agent in self.cast.values():
            if isinstance(agent, Human):
                agent.ignore(self._chair.body)  # the posture keeps them apart
        person, options = self.recipient, self.options
        self._order = [DOF_INDEX[dof] for dof in person.movable]
        self._source = JointsSource(person.model.joints)
        self._look(0.0)
        reach = reach_of(person.avatar.profile, self.seen)
        exercises = load_exercises(options.exercises)
        found = programme(exercises, reach, speed=SPEED)
        # Made once, and copied for each episode: what it has seen of a person changes a recogniser.
        self._unused = RuleRecogniser(known=found)
        recogniser = copy.deepcopy(self._unused)
        self.session = Session(found, recogniser, repetitions=options.repetitions)
        self.body = RobotBody(self.robot)
        self.demonstration = Demonstration(self.session, self.body)
        orders = Orders(self.robot, self.body, self.demonstration)
        self.robot.parts["coach"] = CoachPart(orders)
        shown = sum(exercise.duration for exercise in found) * options.repetitions
        steps = math.ceil((GENEROUS * shown + EXPLAINING * len(found)) / self.control_dt)
        self.time_limit = steps * self.control_dt
        movers = [a.body for a in self.cast.values() if isinstance(a, Robot)]
        self._safety = self.measure(person, world, movers)
        self._slots = [options.exercises.index(exercise.name) for exercise in found]
        if world.contact_force(person.body) > 0:
            raise ConfigError("something touches the person before the episode begins")

    def _look(self, time: float) -> None:
        """See the person: all joint angles, as the simulator knows them."""
        person = self.recipient
        angles = person.angles.copy()
        angles[self._order] = person.positions
        frame = self._source.update(angles, time)
        assert frame is not None  # the simulator knows them all
        self._frame, self.seen = frame, np.nan_to_num(frame.angles)

    def reset(self, rng: np.random.Generator) -> None:
        turn = rng.uniform(-HEAD_TURN, HEAD_TURN)
        halves = [dof for dof in ("neck_rotation_left", "head_rotation_left")
                  if dof in self.recipient.movable]  # fmt: skip
        self.recipient.set_angles(dict.fromkeys(halves, turn / 2))
        self.session.wanted = [
            math.ceil(self.options.repetitions / self.options.tolerance)
            for _ in self.session.exercises
        ]
        self.session.reset(copy.deepcopy(self._unused))
        self._source = JointsSource(self.recipient.model.joints)
        self.demonstration.reset()
        rest = self.session.exercise.angles(0.0)
        self.body.reset(rest)
        self.body.take(rest)
        self._safety.reset()
        self._before = (0, 0)
        self._new = (0, 0)

    def after_substep(self) -> None:
        self._safety.after_substep()

    def after_step(self) -> None:
        self._safety.after_step(self.control_dt)
        session, physiology = self.session, self.recipient.physiology
        session.fatigue = max(
            physiology.fatigue_of(region) for region in REGIONS if region in TIRING
        )
        self._look(self._world.time)
        session.see(self._frame, self._world.time)
        counts = self.right_count, sum(session.wrong)
        self._new = counts[0] - self._before[0], counts[1] - self._before[1]
        self._before = counts
        mouth, face = self.recipient.mouth_and_face()
        way = self.coach_position() - mouth
        self._gaze = float(face @ way / np.linalg.norm(way))

    @property
    def right_count(self) -> int:
        """Right repetitions so far, of each exercise no more than asked for."""
        pairs = zip(self.session.right, self.session.wanted, strict=True)
        return sum(min(right, wanted) for right, wanted in pairs)

    def coach_position(self) -> Array:
        """Return where the head of the robot is in the world [m], shape [3]."""
        joints = self.robot.parts["head"].joints
        assert joints is not None
        return np.array(self.robot.body.link_pose(joints.indices[-1]).position)

    def observables(self, role: str) -> Sequence[Observable]:
        session, shown = self.session, self.demonstration
        count = len(self.options.exercises)
        return [
            Observable("exercise", "1", count, self._which),
            Observable("shown_angles", "rad", len(MOTIONS), lambda: shown.angles),
            Observable("shown_phase", "1", 1, lambda: (shown.phase,)),
            Observable("said", "1", len(WORDS), self._said),
            Observable("seen_angles", "rad", len(MOTIONS), lambda: self.seen),
            Observable("following", "1", 1, lambda: (float(session.judgement.following),)),
            Observable("progress", "1", 1, lambda: (session.judgement.progress,)),
            Observable("last_error", "1", len(ERRORS), self._error),
            Observable("repetitions_left", "1", 1, lambda: (self._left(),)),
            Observable("since_right", "s", 1, lambda: (session.since_right,)),
            Observable("gaze_at_coach", "1", 1, lambda: (self._gaze,)),
            Observable("told_fatigue", "1", 1, lambda: (session.fatigue,)),
            Observable("contact_force", "N", 1, lambda: (self._safety.force,)),
            Observable("time_left", "s", 1, lambda: (self.time_limit - self._world.time,)),
        ]

    def _which(self) -> Array:
        out = np.zeros(len(self.options.exercises))
        if self.session.index < len(self._slots):
            out[self._slots[self.session.index]] = 1.0
        return out

    def _said(self) -> Array:
        word = self.demonstration.word if self.demonstration.is_speaking else "nothing"
        return np.array([float(word == known) for known in WORDS])

    def _error(self) -> Array:
        found = self.session.repetitions[-1:]
        errors = found[0].errors if found else ()
        return np.array([float(error in errors) for error in ERRORS])

    def _left(self) -> float:
        session = self.session
        k = session.index
        return 0.0 if k >= len(session.wanted) else float(session.wanted[k] - session.right[k])

    def rewards(self, role: str) -> Mapping[str, float]:
        terms = {"repetition": float(self._new[0])}
        if self.options.reward == "paper":
            return terms
        physiology, session = self.recipient.physiology, self.session
        terms["wrong"] = -float(self._new[1])
        looks = 0.5 if self._gaze > math.cos(LOOKS) else 0.0
        terms["engagement"] = 1.0 if session.judgement.following else looks
        terms["pain"] = -physiology.pain / 10.0
        terms["fatigue"] = -session.fatigue
        terms["talk"] = -float(self.demonstration.is_speaking)
        terms = self.options.weighted(terms)
        # An episode that ends well is paid as if it had gone on so: else to dawdle would pay more.
        left = max(self.time_limit - self._world.time, 0.0) / self.control_dt
        terms["done"] = self.options.weight("engagement") * left if self.is_success() else 0.0
        return terms

    def metrics(self) -> Mapping[str, float]:
        session = self.session
        return {
            **self._safety.metrics(),
            "right_repetitions": float(self.right_count),
            "wanted_repetitions": float(sum(session.wanted)),
            "wrong_repetitions": float(sum(session.wrong)),
            "exercises_done": float(
                sum(r >= w for r, w in zip(session.right, session.wanted, strict=True))
            ),
            "fatigue": session.fatigue,
            "following": float(session.judgement.following),
        }

    def is_success(self) -> bool:
        return self.session.is_complete and not self.is_failure()

    def is_failure(self) -> bool:
        is_left = self.session.is_over and not self.session.is_complete
        return is_left or self._safety.peak_force > self.options.force_limit

    def camera(self) -> Camera:
        return Camera(eye=(1.3, -2.45, 1.6), target=(0.5, 0.0, 0.82), fov_deg=40)


@register_policy("social_coaching", "recipient", "learner")
def learner(env: CareEnv, role: str) -> Learner:
    """Return a recipient who imitates what the coach shows, with human shortcomings."""
    assert isinstance(task := env.task, SocialCoaching)
    return Learner(task.recipient, task, task.control_dt)
