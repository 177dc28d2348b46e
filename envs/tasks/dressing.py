"""Dressing: pull shorts up a leg that a caregiver lifts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcare_marl.agents.people.behaviour.behaviour_tree import GoAlong
from rcare_marl.agents.people.behaviour.leg_lifting import LegLift, LegLifting
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.garment import tailor
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.motion.caregiving import Caregiving
from rcare_marl.agents.people.motion.gait import LEGS
from rcare_marl.agents.robots.gripper import RELEASE
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, about_z
from rcare_marl.rendering.camera import Camera
from rcare_marl.separation import Near
from rcare_marl.world import World

from ..care_env import CareEnv
from ..devices import Wheelchair, chair_for
from ..rectangle import Rectangle
from ..registry import register_policy, register_task
from ..scenes.dressing_state import DressingState, headway, is_lifted
from ..scenes.hanging_shorts import hang, hold_start, tip
from ..scenes.leg_path import LIFT_SPREAD, LiftableLeg, fit_chair, let_leg_stand
from ..scenes.start_posture import pulling_search, pulling_trials
from ..state import Seen, State, Values, tolerance, where
from ..task import CHAIR_ROBOTS, Role, Task
from ..task_options import TaskOptions

# [N] on the person; own choice, a third of ISO/TS 15066 for a lower leg (130, from memory).
FORCE_LIMIT = 40.0
COMFORT_FORCE = 20.0  # [N] free of penalty in `shaped`: comfort of the user of the RCareWorld paper
TARGET = (0.0, 0.015)  # [m] past the knee, uniform; the paper randomises targets on the knee
TIME_LIMIT = 40.0  # [s]; own choice: half of it passes until the leg is up
LOWERED = 0.08  # [m] from where the foot stood, where it stands again; own choice
# Of the caregiver, all our own choices: the palm beside the foot's middle, where she kneels down before the
# foot and to the outside of it, and how far she walks up [m].
BESIDE, STAND, ASIDE, WALK = 0.065, 0.45, 0.03, 0.46
PLATE_FRICTION = 2.0  # of ribbed rubber: 1.2 together with a shoe's 0.6
ARMREST = 0.2  # [m], desk length: clothes pass beside
STAND_STEPS, SETTLE_STEPS = 240, 720  # physics steps in which leg and shorts come to rest, once
HELPER = 0.08  # [m] before the foot, where the room of the caregiver begins; own choice
REACH = 0.26  # [m] past the knee, as far as a hand has room before the belly
SEEN = 0.06  # [m] of room between robot and person that is observed, at most; own choice

MOVABLE = ("right_hip_flexion", "right_knee_flexion")
SEAT = "wheelchair_legs_free"
ARM = ("shoulder_flexion", "shoulder_abduction", "elbow_flexion")


@dataclass(frozen=True)
class DressingOptions(TaskOptions):
    """Settings of the dressing task.

    Attributes:
        reward: `paper` as in the RCareWorld paper; `shaped` adds comfort and keeping hold.
        until: When it is done: the hem at its `target`, or the leg `lowered` again after that.
        garment: Trousers by name or file (`assets/garments`); their spacing sets the particle count.
        force_limit: Force on the person that ends the episode as a failure [N].
    """

    SHAPED_WEIGHTS = {"distance": 1.0, "comfort": 0.3, "around": 0.5, "held": 0.3}  # our own choice

    until: Literal["target", "lowered"] = "target"
    garment: str = "running_shorts"
    force_limit: float = FORCE_LIMIT


@register_task("dressing")
class Dressing(Task):
    """A robot pulls shorts over the knee of a seated person, whose leg a caregiver lifts.

    Goal: the hem past the knee, at the target, and round the leg.
    Randomised at reset: the target, and how high the leg is lifted.
    Success and failure: see `is_success` and `is_failure`.
    Tolerance: how far from the ankle the hem has to come is divided by it; where the foot stands again.

    Attributes:
        side: Of the leg: the one that moves.
        leg: The middle line of the leg.
        cloth: The shorts.
        stand: Where the caregiver kneels down: x, y [m] and heading [rad].
    """

    robot = Role(Robot, default="kinova_gen3", partner="scripted", gripper="commanded")
    recipient = Role(Human, default="daniel", posture=SEAT, movable=MOVABLE, partner="cooperative")
    caregiver = Role(
        Human,
        default="caregiver",
        partner="lifts",
        movable=(*LEGS, "spine1", "spine2", "spine3", "neck", *(f"left_{dof}" for dof in ARM)),
        moves=("walk", "kneel", "grasp"),
    )

    reachable_by = CHAIR_ROBOTS - {"stretch_re1"} | {"stretch_re1_dex"}
    least_success = 85
    Options = DressingOptions
    room_kinds = ("bedroom", "living", "lounge", "dining", "kitchen")
    slack = 0.1
    paper_terms = ("distance",)
    footprint = Rectangle(-0.8, -1.1, 2.0, 1.1)  # [m] the chair, and a caregiver before it
    time_limit = TIME_LIMIT
    options: DressingOptions
    state: DressingState
    chair: Wheelchair

    def furnish(self, world: World) -> dict[str, Pose]:
        self.side = self._moving_side()
        self.outward = -1.0 if self.side == "right" else 1.0
        where = self.robot.config.mount_for(f"wheelchair_{self.side}", "leg")
        self.chair = chair_for(self.robot.mount_named(where), self.side)
        self.chair.fit_armrests(ARMREST)
        x, y, _ = fit_chair(self.chair, self.recipient, self.side)[self.side].tolist()
        self.chair.spawn(world).set_friction([-1], lateral=PLATE_FRICTION)
        self.stand = (x + STAND, y + ASIDE * self.outward, math.pi)
        return {
            "robot": self.mounted(self.robot, where),
            "recipient": self.chair.frame_in_world("seat_back"),
            "caregiver": Pose((self.stand[0] + WALK, self.stand[1], 0.0), about_z(math.pi)),
        }

    def _moving_side(self) -> Literal["left", "right"]:
        person, sides = self.recipient, ("right", "left")
        for side in sides:
            if {f"{side}_hip_flexion", f"{side}_knee_flexion"} <= set(person.movable):
                if person.posture.supported == "all":
                    break
                return "right" if side == "right" else "left"
        raise ConfigError(
            f"one leg that nothing holds moves in hip and knee flexion, but {person.name!r} is "
            f"{person.posture.description} and moves {', '.join(person.movable) or 'nothing'}"
        )

    def build(self, world: World) -> None:
        person = self.recipient
        self.let_overlap(self.chair.body)
        for hand in ("left", "right"):
            self.caregiver.may_take(person, f"{self.side}_ankle", hand=hand)
        world.set_collision(self.caregiver.body, self.place.floor, False)
        let_leg_stand(world, person, self.chair, self.side)
        self._rest(STAND_STEPS)
        self.leg = LiftableLeg(person, self.side)
        self._thigh = person.frames[JOINT_INDEX[f"{self.side}_hip"]].link
        held = hold_start(self.leg)
        way = [tip(self.leg, held)]
        self.leg.lift()
        way += [tip(self.leg, float(x)) for x in np.linspace(held, self.leg.shank + REACH, 5)]
        self.leg.stand()
        search, ahead = self.search(world), float(self.leg.stood[0]) + HELPER
        trials = search.starting(pulling_trials(self.robot, way))
        self.leg.lift()
        pulling = pulling_search(search, person.body, ahead=ahead)
        found = pulling.find(trials, "where it is to start")
        turn, posture = found.trial.hold, found.posture
        self.leg.stand()
        self.robot.arm.rest[:] = posture
        self.robot.set_posture(posture)
        self._hang(turn)

    def _rest(self, steps: int) -> None:
        self.settle(steps)
        for agent in self.cast.values():
            agent.sense()

    def _hang(self, turn: Array) -> None:
        """Hang the shorts on the leg, in the robot's fingers, and let them come to rest."""
        garment = tailor(self.options.garment, self.recipient.model)
        self._hem = garment.rings[f"{self.side}_hem"]
        self.cloth = hang(
            self.world, self.recipient, self.options.garment, self.leg, self.robot, turn
        )
        self._rest(SETTLE_STEPS)
        gripper = self.robot.gripper
        self._open = math.inf
        if gripper is not None and gripper.is_movable:
            widest = gripper.width(gripper.config.opened)
            self._open = min(gripper.width(gripper.start) + RELEASE, widest)

    def reset(self, rng: np.random.Generator) -> None:
        self._target_along = self.leg.shank + float(rng.uniform(*TARGET))
        self.leg.plan(rng.uniform(-1, 1, 2) * LIFT_SPREAD)
        self._cloth_peak = self._cloth_force = 0.0

    def after_substep(self) -> None:
        pressing = [c.load for c in self.cloth.contacts if c.body is self.recipient.body]
        self._cloth_force = sum(pressing)
        self._cloth_peak = max(self._cloth_peak, self._cloth_force)

    def read(self, now: State, before: DressingState | None) -> DressingState:
        gripper, leg = self.robot.gripper, self.leg
        if self.cloth.grips and gripper is not None and gripper.is_movable:
            if gripper.width(gripper.position()) > self._open:
                self.cloth.release()
        leg.look()
        ring = self.cloth.positions[self._hem]
        winding, along = leg.crossings(ring)
        is_around, target_along = abs(winding) == 1, self._target_along
        hem, target = ring.mean(axis=0), leg.at(target_along)
        gap, strain = target - hem, float(self.cloth.strain.max())
        begun = along if before is None else before.begun
        is_there = is_around and self._comes_to(target_along, along, begun)
        robot, person = self.robot.body, self.recipient.body
        self.robot.control.near = near = self.world.near(robot, person, within=SEEN)
        is_up = is_lifted(to_lifted := leg.to_lifted(), before, self.control_dt)
        stalled, stalls, reached = headway(along, before, self.control_dt if is_up else 0.0)
        return DressingState(
            **vars(now),
            hem=hem,
            gap=gap,
            distance=math.sqrt(float(gap @ gap)),
            along=along,
            target_along=target_along,
            begun=begun,
            is_around=is_around,
            is_held=bool(self.cloth.grips),
            is_past=is_there or (before is not None and before.is_past),
            tool=np.array(self.robot.tool_pose().position),
            joints=np.array(leg.points[1:4]),
            stalled=stalled,
            stalls=stalls,
            reached=reached,
            to_lifted=to_lifted,
            is_up=is_up,
            trunk_gap=_least(near, -1),
            thigh_gap=_least(near, self._thigh),
            raised=math.dist(leg.foot_hold(), leg.stood),
            cloth_force=self._cloth_force,
            cloth_peak=self._cloth_peak,
            strain=max(0.0 if before is None else before.strain, strain),
        )

    def _comes_to(self, goal: Values, along: Values, begun: Values) -> Values:
        """Return whether the hem has gone as far up the leg, as nearly as the tolerance allows."""
        return (along - begun) * self.options.tolerance >= goal - begun

    def observables(self, role: str) -> Sequence[Seen]:
        return [
            Seen("hem_position", "m", 3, lambda s: s.hem),
            Seen("hem_to_target", "m", 3, lambda s: s.gap),
            Seen("hem_past_ankle", "m", 1, lambda s: s.along),
            Seen("hem_stalled", "s", 1, lambda s: s.stalled),
            Seen("hem_stalls", "1", 1, lambda s: s.stalls),
            Seen("around_leg", "1", 1, lambda s: s.is_around),
            Seen("waistband_held", "1", 1, lambda s: s.is_held),
            Seen("grip_position", "m", 3, lambda s: s.tool),
            Seen("ankle_position", "m", 3, lambda s: s.joints[..., 0, :]),
            Seen("knee_position", "m", 3, lambda s: s.joints[..., 1, :]),
            Seen("hip_position", "m", 3, lambda s: s.joints[..., 2, :]),
            Seen("foot_to_lifted", "m", 3, lambda s: s.to_lifted),
            Seen("trunk_gap", "m", 1, lambda s: s.trunk_gap),
            Seen("thigh_gap", "m", 1, lambda s: s.thigh_gap),
            self.contact_force(),
            Seen("cloth_load", "N", 1, lambda s: s.cloth_force),
            self.time_left(),
        ]

    def rewards(self, role: str, state: DressingState) -> Mapping[str, Values]:
        terms = {"distance": -state.distance}
        if self.options.reward == "shaped":
            excess = self.options.discomfort(state.force, COMFORT_FORCE)
            near = tolerance(state.along, (state.target_along, math.inf), margin=0.4)
            terms |= {"comfort": -excess, "held": where(state.is_held, 0.0, -1.0)}
            terms |= {"around": where(state.is_around, near, 0.0) - 1.0}
            terms = self.options.weighted(terms)
        # Every term is a cost, so that to end well ends the costs. An episode that ends badly is charged
        # as if it had stayed as it was: else to hurt somebody at once would cost least.
        step = sum(terms.values())
        return {**terms, "failed": self.for_the_rest(state, self.failed(state), step)}

    def metrics(self, state: DressingState) -> Mapping[str, Values]:
        return {
            "distance_m": state.distance,
            "hem_past_ankle_m": state.along,
            "hem_past_knee_m": state.along - self.leg.shank,
            "around_leg": state.is_around,
            "waistband_held": state.is_held,
            "cloth_load_n": state.cloth_force,
            "peak_cloth_load_n": state.cloth_peak,
            "peak_strain": state.strain,
        }

    def is_success(self, state: DressingState) -> Values:
        """Return whether the hem is at its target, round the leg; or was, and the leg is down again."""
        if self.options.until == "target":
            return state.is_around & self._comes_to(state.target_along, state.along, state.begun)
        is_down = state.raised < LOWERED * self.options.tolerance
        is_on = state.is_around & self._comes_to(self.leg.shank, state.along, state.begun)
        return is_on & state.is_past & is_down

    def is_failure(self, state: DressingState) -> Values:
        """Return whether the waistband was let go before the hem was at its target: nobody takes it up."""
        return where(state.is_held | state.is_past, False, True)

    def camera(self) -> Camera:
        return Camera(eye=(1.15, -1.6 * self.outward, 1.4), target=(0.55, -0.1, 0.68), fov_deg=54)


def _least(near: Sequence[Near], link: int) -> float:
    return min((there.gap for there in near if there.other == link), default=SEEN)


@register_policy("dressing", "recipient", "cooperative")
def cooperative(env: CareEnv, role: str) -> GoAlong:
    """Return a recipient who relaxes and lets the leg go where it is taken."""
    assert isinstance(task := env.task, Dressing)
    return GoAlong(task.recipient, task.control_dt)


@register_policy("dressing", "caregiver", "lifts")
def lifts(env: CareEnv, role: str) -> LegLifting:
    """Return a caregiver who lifts the leg until the hem is past the target, and lowers it again."""
    from ..walkway import way_of  # homes take long to import

    assert isinstance(task := env.task, Dressing)
    side, out = ("left" if task.side == "right" else "right"), task.outward
    caregiving = Caregiving(task.caregiver, env.world, task.control_dt, side=side)
    lift = LegLift(
        person=task.recipient,
        part=f"{task.side}_ankle",
        stand=lambda: np.add(task.stand, (*task.leg.slid(), 0.0)),
        corners=lambda to: way_of(task.caregiver, to),
        knee=side,
        before=lambda: task.leg.foot_hold() + (0.12, 3 * BESIDE * out, 0.05),
        grip=lambda: task.leg.foot_hold() + (0.0, BESIDE * out, 0.0),
        palm=(0.0, -out, 0.0),
        fingers=(-1.0, -0.5 * out, 0.0),
        way=lambda: task.leg.way,
        is_done=lambda: task.state.is_past,
    )
    return LegLifting(caregiving, lift, task.control_dt)
