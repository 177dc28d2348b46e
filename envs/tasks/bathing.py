"""Bathing: wipe the upper arm of a person who lies in bed, from shoulder to elbow, without pushing."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.human import Human
from rcare_marl.agents.robot import Robot
from rcare_marl.agents.robot_config import no_reach
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Array, Pose, quaternion_from_matrix, quaternion_from_rpy
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..devices.cushion import lay_under
from ..devices.hospital_bed import HospitalBed
from ..devices.sponge import Sponge
from ..devices.stand import add_stand
from ..homes.rectangle import Rectangle
from ..registry import register_task
from ..scenes.wiped_skin import WipedSkin, pad
from ..task import Role, Task
from ..task_options import FORCE_LIMIT, TaskOptions

COMFORT_FORCE = 12.0  # [N] above it PhyRC's bathing takes points; used by the shaped reward
REACHED = 0.025  # [m] from target to the middle of the sponge's face: Assistive Gym, bed_bathing.py
LEAST_FORCE = 0.3  # [N] with which a sponge wipes; own choice
STROKE_FROM = 0.5  # of the way to the elbow: where a stroke must have begun at most; own choice
LEAST_COVERAGE = 0.3  # share of the skin that must be wiped: success of Assistive Gym's bathing
# Of the way from shoulder to elbow, where wiping begins, and about the arm: as near to the shoulder as
# the sponge keeps off the chest; own choice.
START_SHARE, START_ANGLE = 0.38, math.radians(-12)
TARGET_SHARE = (0.85, 0.95)  # of the way to the elbow: randomised, as the paper says; own choice
TARGET_ANGLE = math.radians(15)  # about the arm, uniform each way; own choice
START_GAP = (0.10, 0.18)  # [m] from skin to sponge at the start; own choice
START_SPREAD = 0.04  # [m] along and across, uniform each way; own choice
# How the arm lies, uniform each way. What holds a weak arm takes half of it back; own choice.
ARM_TURN, ELBOW_BEND = math.radians(8), math.radians(12)
LEVEL, STRAIGHTER = 0.25, 0.02  # [rad] that a sponge may lie askew; worth another hold; own choice
BED_RAISE = 0.27  # [m] of the platform over its lowest: a height to work at; own choice
ROBOT_RADIUS = 0.35  # [m] of a robot on the floor; own choice
TIME_LIMIT = 20.0  # [s], 200 control steps, as in Assistive Gym
FORCE_WEIGHT = 0.01  # [1/N] of force against metres: Assistive Gym, config.ini
HURT = 1.0 + FORCE_WEIGHT * FORCE_LIMIT  # a step that is left when someone was hurt: own choice

SIDE = "left"  # of the arm: that of the paper's trial
MOVABLE = (f"{SIDE}_shoulder", f"{SIDE}_elbow_flexion")


@dataclass(frozen=True)
class BathingOptions(TaskOptions):
    """Settings of the bathing task.

    Attributes:
        reward: `paper` as in the RCareWorld paper; `shaped` adds what was wiped, and comfort.
        force_limit: Force on the person that ends the episode as a failure [N].
        least_coverage: Share of the upper arm's upper side that must be wiped for success.
    """

    SHAPED_WEIGHTS = {"distance": 1.0, "wiped": 10.0, "comfort": 0.5, "reached": 10.0}  # own choice

    least_coverage: float = LEAST_COVERAGE

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.least_coverage <= 1:
            raise ValueError(f"least_coverage must lie in 0..1, got {self.least_coverage}")


@register_task("bathing")
class Bathing(Task):
    """A robot beside the bed wipes the upper arm of the person who lies in it with a wet sponge.

    Success: the sponge comes to a target on the elbow in one stroke from the shoulder's half of the upper
    arm, and enough of its upper side was wiped. Failure: a force above the limit on the person.
    Randomised at reset: target, start of the sponge, how the arm lies.
    Tolerance: how close to the target is close enough; the share to be wiped is divided by it.
    """

    robot = Role(Robot, default="kinova_gen2", partner="scripted")
    recipient = Role(
        Human, default="natalia", posture="bed_supine", movable=MOVABLE, partner="still"
    )
    caregiver = Role(
        Human,
        default=None,
        optional=True,
        posture="standing",
        movable=("spine1_flexion", "right_shoulder", "right_elbow_flexion"),
        partner="still",
    )

    Options = BathingOptions
    room_kinds = ("bedroom", "living", "lounge", "dining")
    footprint = Rectangle(-1.15, -1.1, 1.15, 0.55)  # [m] the bed, and a robot at its side
    time_limit = TIME_LIMIT
    options: BathingOptions

    def free_floor(self) -> Rectangle:
        low, base = self.footprint, self.robot.mount_named("bed_side").pose.position
        far = 1.2 if "caregiver" in self.cast else low.y1
        return Rectangle(low.x0, min(low.y0, base[1] - ROBOT_RADIUS), low.x1, far)

    def furnish(self, world: World) -> dict[str, Pose]:
        if (posture := self.recipient.posture).recline_deg != 90:
            raise ConfigError(f"one is bathed who lies on the back, not {posture.description}")
        self.lay_floor(world)
        self._bed = HospitalBed()
        half = 0.5 * self._bed.config.mattress_length + self._bed.config.end
        turn = quaternion_from_rpy(0, 0, math.pi)  # mounts beside a bed have its head at +x
        self._bed.spawn(world, Pose((half, 0.0, 0.0), tuple(turn.tolist())))
        self._bed.set_position("height", BED_RAISE)
        mount = self.robot.mount("bed_side")
        if self.robot.mount_named("bed_side").stand:
            add_stand(world, mount)
        beside = quaternion_from_rpy(0, 0, -math.pi / 2)
        return {
            "robot": mount,
            "recipient": self._bed.frame_in_world("mattress"),
            "caregiver": Pose((0.35, 0.85, 0.0), tuple(beside.tolist())),
        }

    def build(self, world: World) -> None:
        self._world = world
        for person in (a for a in self.cast.values() if isinstance(a, Human)):
            person.ignore(self._bed.body)  # the posture already keeps them apart
        self.recipient.supports.append(self._bed.body)
        self.skin = WipedSkin(self.recipient, world, f"{SIDE}_shoulder", f"{SIDE}_elbow")
        pad(self.recipient, world, [f"{SIDE}_{part}" for part in ("shoulder", "elbow")])
        under = float(min(self.skin.place(share, math.pi)[0][2] for share in (0.5, 0.9)))
        lay_under(world, self.recipient, SIDE, base=self._bed.mattress_height(), under=under)
        self.sponge = Sponge()
        sponge = self.sponge.spawn(world)
        self.sponge.spare(self.robot.body)
        self._find_hold()
        self._set_sponge(self._over(START_SHARE, START_GAP[1]))
        self.robot.grasp(sponge, self._grip)
        movers = [sponge, *(a.body for a in self.cast.values() if isinstance(a, Robot))]
        self._safety = self.measure(self.recipient, world, movers)
        if world.contact_force(self.recipient.body, self.robot.body) > 0:
            raise ConfigError("the robot touches the person before the episode begins")

    def _find_hold(self) -> None:
        """Find how the sponge is held so that the robot reaches both ends of the upper arm."""
        best, misses = LEVEL, []
        for grip, flip in itertools.product(self.sponge.grips, (1.0, -1.0)):
            self._grip, self._flip = grip, flip
            over = [self._over(share, START_GAP[0]) for share in (START_SHARE, TARGET_SHARE[1])]
            found = [self.robot.solve_ik(self._tool_for(pose)) for pose in over]
            angle = max(each.angle for each in found)
            if all(each.is_within(0.02, LEVEL) for each in found) and angle <= best:
                best, hold = angle - STRAIGHTER, (grip, flip)
            misses.append(max(found, key=lambda each: each.distance + each.angle))
        if best < LEVEL:
            self._grip, self._flip = hold
            return
        robot, miss = self.robot, min(misses, key=lambda each: each.distance + each.angle)
        raise ConfigError(
            f"{no_reach(robot.config, robot.files.model.name, robot.moves)}: it misses a place over the "
            f"upper arm by {miss.distance:.2f} m, {math.degrees(miss.angle):.0f} degrees"
        )

    def _over(self, share: float, gap: float, offset: Sequence[float] = (0.0, 0.0)) -> Pose:
        """Return a pose of the sponge's face over the arm, facing it; offset along and across [m]."""
        point, out = self.skin.place(share, START_ANGLE)
        way = self.skin.direction()
        at = point + gap * out + offset[0] * way + offset[1] * np.cross(out, way)
        return Pose(tuple(at.tolist()), tuple(self.wiping_quaternion(out, way).tolist()))

    def _tool_for(self, face: Pose) -> Pose:
        return face @ self.sponge.frame("face").inverse() @ self._grip.inverse()

    def _set_sponge(self, face: Pose) -> None:
        """Put the robot where the face of the sponge in its hand is at `face`."""
        self.robot.set_posture(self.robot.solve_ik(self._tool_for(face)).posture)
        self.sponge.body.set_base(self.robot.tool_pose() @ self._grip)

    def reset(self, rng: np.random.Generator) -> None:
        self._bed.reset()
        turn, bend = rng.uniform(-ARM_TURN, ARM_TURN), rng.uniform(0.0, ELBOW_BEND)
        spread = rng.uniform(-START_SPREAD, START_SPREAD, 2)
        gap = rng.uniform(*START_GAP)
        self._target_at = rng.uniform(*TARGET_SHARE), rng.uniform(-TARGET_ANGLE, TARGET_ANGLE)
        dofs = {f"{SIDE}_shoulder_abduction": turn, f"{SIDE}_elbow_flexion": bend}
        moving = self.recipient.movable
        here = {d: self.recipient.angle(d) + a for d, a in dofs.items() if d in moving}
        self.recipient.set_angles(here)
        self.skin.follow()
        self._set_sponge(self._over(START_SHARE, gap, spread.tolist()))
        self.skin.reset()
        self._safety.reset()
        self._is_reached, self._gained, self._covered = False, 0.0, 0.0
        self._stroke_from = math.inf  # where the present stroke began

    def after_substep(self) -> None:
        self._safety.after_substep()

    def after_step(self) -> None:
        self._safety.after_step(self.control_dt)
        self.skin.follow()
        points = self.sponge.face_points()
        self._face = points.mean(axis=0)
        self._target = self.skin.place(*self._target_at)[0]
        self._gap = self._target - self._face
        self._distance = math.sqrt(float(self._gap @ self._gap))
        self._push = self.sponge.force_on(self.recipient.body)
        presses = float(self._push @ self._push) > LEAST_FORCE**2
        self.skin.wipe(points if presses else points[:0], self.control_dt)
        self._gained, self._covered = self.skin.coverage - self._covered, self.skin.coverage
        here = self.skin.progress(self._face)
        self._stroke_from = min(self._stroke_from, here) if presses else math.inf
        ease = self.options.tolerance
        is_there = self._stroke_from < STROKE_FROM and self._distance < REACHED * ease
        self._is_reached |= is_there and self._covered * ease >= self.options.least_coverage
        self._shoulder, self._elbow = (
            np.array(self.recipient.joint_pose(f"{SIDE}_{j}").position)
            for j in ("shoulder", "elbow")
        )

    def observables(self, role: str) -> Sequence[Observable]:
        return [
            Observable("sponge_position", "m", 3, lambda: self._face),
            Observable("sponge_to_target", "m", 3, lambda: self._gap),
            Observable("shoulder_position", "m", 3, lambda: self._shoulder),
            Observable("elbow_position", "m", 3, lambda: self._elbow),
            Observable("sponge_force", "N", 3, lambda: self._push),
            Observable("contact_force", "N", 1, lambda: (self._safety.force,)),
            Observable("coverage", "1", 1, lambda: (self._covered,)),
            Observable("in_stroke", "1", 1, lambda: (float(self._stroke_from < STROKE_FROM),)),
            Observable("time_left", "s", 1, lambda: (self.time_limit - self._world.time,)),
        ]

    def rewards(self, role: str) -> Mapping[str, float]:
        terms = {"distance": -self._distance, "force": -FORCE_WEIGHT * self._safety.force}
        if self.options.reward == "shaped":
            excess = self.options.discomfort(self._safety.force, COMFORT_FORCE)
            reached = float(self.is_success())
            terms = {"distance": -self._distance, "wiped": self._gained, "reached": reached}
            terms |= {"comfort": -excess}
            terms = self.options.weighted(terms)
        # All terms of a step are losses: without this, to hurt would end them and pay.
        left = max(self.time_limit - self._world.time, 0.0) / self.control_dt
        terms["hurt"] = -HURT * left if self.is_failure() else 0.0
        return terms

    def metrics(self) -> Mapping[str, float]:
        return {
            **self._safety.metrics(),
            "distance_m": self._distance,
            "coverage": self._covered,
            "sponge_force_n": float(np.linalg.norm(self._push)),
        }

    def is_success(self) -> bool:
        return self._is_reached and not self.is_failure()

    def is_failure(self) -> bool:
        return self._safety.peak_force > self.options.force_limit

    def face_position(self) -> Array:
        """Return the middle of the sponge's face in the world [m], shape [3]."""
        return self._face

    def target_position(self) -> Array:
        """Return the target on the elbow in the world [m], shape [3]."""
        return self._target

    def target_on_arm(self) -> tuple[float, float]:
        """Return how far along the upper arm the target is, as a share, and at which angle [rad]."""
        return self._target_at

    def sponge_force(self) -> Array:
        """Return the force of the sponge on the recipient in the last physics step [N], shape [3]."""
        return self._push

    def coverage(self) -> float:
        """Return the share of the skin to be wiped that was."""
        return self._covered

    def wiping_quaternion(self, out: Array, way: Array) -> Array:
        """Return how the sponge is turned that lies across the arm, shape [4].

        Args:
            out: Out of the arm, a unit vector in the world, shape [3].
            way: Along the arm, at right angles to it.
        """
        across = self._flip * np.cross(out, way)
        return quaternion_from_matrix(np.column_stack((across, np.cross(-out, across), -out)))

    def camera(self) -> Camera:
        return Camera(eye=(-0.5, -0.6, 1.45), target=(0.45, -0.22, 0.78), fov_deg=42)
