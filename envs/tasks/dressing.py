"""Dressing: pull shorts up a leg that a caregiver lifts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcare_marl.agents.garment import tailor
from rcare_marl.agents.grasp import RELEASE
from rcare_marl.agents.human import Human
from rcare_marl.agents.motion.caregiving import Caregiving
from rcare_marl.agents.motion.walk import LEGS
from rcare_marl.agents.policies.go_along import GoAlong
from rcare_marl.agents.policies.leg_lifting import LegLift, LegLifting
from rcare_marl.agents.robot import Robot
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Array, Pose, quaternion_from_rpy
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..care_env import CareEnv
from ..devices.stand import add_stand
from ..devices.wheelchair import chair_for
from ..homes.rectangle import Rectangle
from ..registry import register_policy, register_task
from ..rewards import tolerance
from ..scenes.hanging_shorts import HOLD_START, hang, tip
from ..scenes.liftable_leg import LIFT_SPREAD, LiftableLeg, let_leg_stand
from ..scenes.pulling_posture import pulling_posture
from ..task import Role, Task
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

MOVABLE = ("right_hip_flexion", "right_knee_flexion")
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
        hem: Middle of the hem [m], shape [3].
        hem_along: How far from the ankle the leg goes through the hem [m].
        is_around: Whether the hem goes round the leg, once.
        is_held: Whether the robot still holds the waistband.
        stand: Where the caregiver kneels down: x, y [m] and heading [rad].
    """

    robot = Role(Robot, default="kinova_gen3", partner="scripted", gripper="commanded")
    recipient = Role(
        Human, default="daniel", posture="wheelchair_legs_free", movable=MOVABLE,
        partner="cooperative",
    )  # fmt: skip
    caregiver = Role(
        Human, default="caregiver", posture="standing", partner="lifts",
        movable=(*LEGS, "spine1", "spine2", "spine3", "neck", *(f"left_{dof}" for dof in ARM)),
    )  # fmt: skip

    Options = DressingOptions
    room_kinds = ("bedroom", "living", "lounge", "dining", "kitchen")
    footprint = Rectangle(-0.8, -1.1, 2.0, 1.1)  # [m] the chair, and a caregiver before it
    time_limit = TIME_LIMIT
    options: DressingOptions

    def furnish(self, world: World) -> dict[str, Pose]:
        self.side = self._moving_side()
        self.outward = -1.0 if self.side == "right" else 1.0
        mount = self.robot.mount_named(f"wheelchair_{self.side}")
        self.chair = chair_for(mount, self.side)
        self.chair.config = dataclasses.replace(self.chair.config, armrest_length=ARMREST)
        self._floor = self.lay_floor(world)
        soles = self.recipient.soles(self.chair.frame("seat_back"))
        self.chair.fit_footplates(soles["left"], soles["right"])
        self.chair.spawn(world).set_friction([-1], lateral=PLATE_FRICTION)
        base = self.robot.mount(f"wheelchair_{self.side}", self.chair.pose)
        if mount.stand:
            add_stand(world, base)
        x, y, _ = soles[self.side].tolist()
        self.stand = (x + STAND, y + ASIDE * self.outward, math.pi)
        facing = tuple(quaternion_from_rpy(0, 0, math.pi).tolist())
        return {
            "robot": base,
            "recipient": self.chair.frame_in_world("seat_back"),
            "caregiver": Pose((self.stand[0] + WALK, self.stand[1], 0.0), facing),
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

    def frame_of(self, mount: str) -> Pose:
        return self.chair.pose if mount.startswith("wheelchair") else Pose()

    def build(self, world: World) -> None:
        self._world, person = world, self.recipient
        self.caregiver.ignore(self.chair.body)
        world.set_collision(self.caregiver.body, self._floor, False)
        if self.chair.carries_robot:
            world.set_collision(self.robot.body, self.chair.body, False)
        let_leg_stand(world, person, self.chair, self.side)
        self._settle(STAND_STEPS)
        self.leg = LiftableLeg(person, self.side)
        start = tip(self.leg, HOLD_START)
        self.leg.lift()
        alongs = np.linspace(HOLD_START, self.leg.shank + REACH, 5)
        way = [start, *(tip(self.leg, float(along)) for along in alongs)]
        ahead = float(self.leg.stood[0]) + HELPER
        turn, posture = pulling_posture(self.robot, way, person.body, world, ahead=ahead)
        self.leg.stand()
        self.robot.arm.rest[:] = posture
        self.robot.set_posture(posture)
        self._hang(turn)
        robots = [a.body for a in self.cast.values() if isinstance(a, Robot)]
        self._safety = self.measure(person, world, robots)
        if world.contact_force(person.body, self.robot.body) > 0:
            raise ConfigError("the robot touches the person before the episode begins")

    def _settle(self, steps: int) -> None:
        for _ in range(steps):
            for agent in self.cast.values():
                agent.actuate()
            self._world.step()
        for agent in self.cast.values():
            agent.sense()

    def _hang(self, turn: Array) -> None:
        """Hang the shorts on the leg, in the robot's fingers, and let them come to rest."""
        garment = tailor(self.options.garment, self.recipient.model)
        self._hem = garment.rings[f"{self.side}_hem"]
        self.cloth = hang(
            self._world, self.recipient, self.options.garment, self.leg, self.robot, turn
        )
        self._settle(SETTLE_STEPS)
        gripper = self.robot.gripper
        self._open = math.inf
        if gripper is not None and gripper.is_movable:
            widest = gripper.width(gripper.config.opened)
            self._open = min(gripper.width(gripper.start) + RELEASE, widest)

    def reset(self, rng: np.random.Generator) -> None:
        self.target_along = self.leg.shank + float(rng.uniform(*TARGET))
        self.leg.plan(rng.uniform(-1, 1, 2) * LIFT_SPREAD)
        self._safety.reset()
        self._strain = self._cloth_peak = self._cloth_force = 0.0
        self.is_past = False

    def after_substep(self) -> None:
        self._safety.after_substep()
        pressing = [c.load for c in self.cloth.contacts if c.body is self.recipient.body]
        self._cloth_force = sum(pressing)
        self._cloth_peak = max(self._cloth_peak, self._cloth_force)

    def after_step(self) -> None:
        self._safety.after_step(self.control_dt)
        gripper = self.robot.gripper
        if self.cloth.grips and gripper is not None and gripper.is_movable:
            if gripper.width(gripper.position()) > self._open:
                self.cloth.release()
        self.is_held = bool(self.cloth.grips)
        self.leg.look()
        ring = self.cloth.positions[self._hem]
        winding, self.hem_along = self.leg.crossings(ring)
        self.is_around = abs(winding) == 1
        self.hem, self.target = ring.mean(axis=0), self.leg.at(self.target_along)
        self._gap = self.target - self.hem
        self._distance = math.sqrt(float(self._gap @ self._gap))
        self._strain = max(self._strain, float(self.cloth.strain.max()))
        self.is_past = self.is_past or (self.is_around and self._comes_to(self.target_along))

    def _comes_to(self, along: float) -> bool:
        """Return whether the hem is as far up the leg, as nearly as the tolerance allows."""
        return self.hem_along * self.options.tolerance >= along

    def observables(self, role: str) -> Sequence[Observable]:
        leg = self.leg.points
        return [
            Observable("hem_position", "m", 3, lambda: self.hem),
            Observable("hem_to_target", "m", 3, lambda: self._gap),
            Observable("hem_past_ankle", "m", 1, lambda: (self.hem_along,)),
            Observable("around_leg", "1", 1, lambda: (float(self.is_around),)),
            Observable("waistband_held", "1", 1, lambda: (float(self.is_held),)),
            Observable("grip_position", "m", 3, lambda: self.robot.tool_pose().position),
            Observable("ankle_position", "m", 3, lambda: leg[1]),
            Observable("knee_position", "m", 3, lambda: leg[2]),
            Observable("hip_position", "m", 3, lambda: leg[3]),
            Observable("foot_to_lifted", "m", 3, self.leg.to_lifted),
            Observable("contact_force", "N", 1, lambda: (self._safety.force,)),
            Observable("cloth_load", "N", 1, lambda: (self._cloth_force,)),
            Observable("time_left", "s", 1, lambda: (self.time_limit - self._world.time,)),
        ]

    def rewards(self, role: str) -> Mapping[str, float]:
        terms = {"distance": -self._distance}
        if self.options.reward == "shaped":
            excess = self.options.discomfort(self._safety.force, COMFORT_FORCE)
            near = tolerance(self.hem_along, (self.target_along, math.inf), margin=0.4)
            terms |= {"comfort": -excess, "held": float(self.is_held) - 1.0}
            terms |= {"around": (near if self.is_around else 0.0) - 1.0}
            terms = self.options.weighted(terms)
        # Every term is a cost, so that to end well ends the costs. An episode that ends badly is charged
        # as if it had stayed as it was: else to hurt somebody at once would cost least.
        left = max(self.time_limit - self._world.time, 0.0) / self.control_dt
        terms["failed"] = sum(terms.values()) * left if self.is_failure() else 0.0
        return terms

    def metrics(self) -> Mapping[str, float]:
        return {
            **self._safety.metrics(),
            "distance_m": self._distance,
            "hem_past_ankle_m": self.hem_along,
            "hem_past_knee_m": self.hem_along - self.leg.shank,
            "around_leg": float(self.is_around),
            "waistband_held": float(self.is_held),
            "cloth_load_n": self._cloth_force,
            "peak_cloth_load_n": self._cloth_peak,
            "peak_strain": self._strain,
        }

    def is_success(self) -> bool:
        """Return whether the hem is at its target, round the leg; or was, and the leg is down again."""
        if self.is_failure() or not self.is_around:
            return False
        if self.options.until == "target":
            return self._comes_to(self.target_along)
        is_down = math.dist(self.leg.foot_hold(), self.leg.stood) < LOWERED * self.options.tolerance
        return self.is_past and is_down and self._comes_to(self.leg.shank)

    def is_failure(self) -> bool:
        """Return whether the force on the person was above the limit."""
        return self._safety.peak_force > self.options.force_limit

    def camera(self) -> Camera:
        return Camera(eye=(1.15, -1.6 * self.outward, 1.4), target=(0.55, -0.1, 0.68), fov_deg=54)


@register_policy("dressing", "recipient", "cooperative")
def cooperative(env: CareEnv, role: str) -> GoAlong:
    """Return a recipient who relaxes and lets the leg go where it is taken."""
    assert isinstance(task := env.task, Dressing)
    return GoAlong(task.recipient, task.control_dt)


@register_policy("dressing", "caregiver", "lifts")
def lifts(env: CareEnv, role: str) -> LegLifting:
    """Return a caregiver who lifts the leg until the hem is past the target, and lowers it again."""
    assert isinstance(task := env.task, Dressing)
    side, out = ("left" if task.side == "right" else "right"), task.outward
    caregiving = Caregiving(task.caregiver, env.world, task.control_dt, side=side)
    caregiving.pass_through(task.recipient, f"{task.side}_ankle")
    beside = np.array((0.0, BESIDE * out, 0.0))
    lift = LegLift(
        person=task.recipient,
        part=f"{task.side}_ankle",
        stand=task.stand,
        knee=side,
        before=lambda: task.leg.foot_hold() + (0.12, 3 * BESIDE * out, 0.05),
        grip=lambda: task.leg.foot_hold() + beside,
        palm=(0.0, -out, 0.0),
        fingers=(-1.0, -0.5 * out, 0.0),
        way=lambda: task.leg.way,
        is_done=lambda: task.is_past,
    )
    return LegLifting(caregiving, lift, task.control_dt)
