"""PhyRC's bathing challenge: take the sponge, wet it, bring it to the person in bed, and wash."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.body.skeleton import SIDES
from rcare_marl.agents.human import Human
from rcare_marl.agents.robot import Robot
from rcare_marl.agents.robot_config import no_reach
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Array, Pose, quaternion_from_rpy
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..devices.stand import add_stand
from ..homes.rectangle import Rectangle
from ..phyrc.bath_scene import BathScene
from ..phyrc.bath_score import EXCEEDED, BathScore
from ..phyrc.phyrc_score import FULL_SCORE
from ..phyrc.washed_limbs import WashedLimbs
from ..registry import register_task
from ..task import Role, Task
from ..task_options import TaskOptions

# All our own choices; what the challenge says is in `bath_score` and `bath_scene`.
SUCCESS = 35  # points of 50
TIME_LIMIT = 90.0  # [s]
SHIFT = -0.25  # [m] of robots along the bed, from where their mounts `bed_side` are to the table
ASIDES = (0.10, 0.05, 0.0)  # [m] closer to the bed, the first where a robot is clear of it
CLEAR = 0.01  # [m] between robot and bed
BEFORE, ABOVE = 0.08, 0.10  # [m] from the handle to the tool at the start, back and up
START_SPREAD = 0.03  # [m] each way
NEAR, LEVEL = 0.02, 0.25  # [m], [rad] that count as reached
HURT = 1.0  # points for each step that is left when someone was hurt
FAR = 1.0  # [m] from what is next, where the reward does not get less any more
SEEN = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")  # joints of each side

MOVABLE = tuple(
    f"{side}_{dof}" for dof in ("hip_abduction", "shoulder", "elbow_flexion") for side in SIDES
)


@dataclass(frozen=True)
class PhyrcBathingOptions(TaskOptions):
    """Settings of the bathing challenge.

    Attributes:
        reward: `paper`: what the score grew by; `shaped` adds the way to what is next, and comfort.
        force_limit: Force on the person that ends the episode as a failure [N].
        success_score: Points from which on an episode counts as a success, at its end.
    """

    SHAPED_WEIGHTS = {"score": 1.0, "reach": 0.1, "covered": 50.0, "comfort": 0.5}  # own choice

    success_score: int = SUCCESS

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.success_score <= FULL_SCORE:
            raise ValueError(f"success_score must be 1 to {FULL_SCORE}, got {self.success_score}")


@register_task("phyrc_bathing")
class PhyrcBathing(Task):
    """A robot beside the bed takes a sponge from the table, wets it in a basin, and washes arms and legs.

    Scored out of 50 as in the challenge, item by item. An episode lasts until its time is over.
    Success: the score is high enough then. Failure: a force above the limit on the person.
    Tolerance: the score that is high enough is divided by it.
    Randomised at reset: where the person lies, shoulders, hips, elbows, and where the hand starts.

    Attributes:
        limbs: The skin that is to be washed.
        scene: Sponge, basin, table and bed.
        score: The score, and what it depends on.
        hold: The sponge in the frame of the tool, where it is held well.
    """

    robot = Role(Robot, default="stretch_re1", partner="scripted", gripper="commanded")
    recipient = Role(
        Human, default="natalia", posture="bed_supine", movable=MOVABLE, partner="still"
    )
    caregiver = Role(
        Human, default=None, optional=True, posture="standing", partner="still",
        movable=("spine1_flexion", "right_shoulder", "right_elbow_flexion"),
    )  # fmt: skip

    Options = PhyrcBathingOptions
    room_kinds = ("bedroom", "living", "lounge", "dining")
    footprint = Rectangle(-1.15, -1.15, 1.15, 0.7)  # [m] bed and table, and a robot at their side
    time_limit = TIME_LIMIT
    options: PhyrcBathingOptions

    def free_floor(self) -> Rectangle:
        low = self.footprint
        return Rectangle(low.x0, low.y0, low.x1, 1.2 if "caregiver" in self.cast else low.y1)

    def furnish(self, world: World) -> dict[str, Pose]:
        if (posture := self.recipient.posture).recline_deg != 90:
            raise ConfigError(f"one is bathed who lies on the back, not {posture.description}")
        self.lay_floor(world)
        self.scene = BathScene(world)
        beside = quaternion_from_rpy(0, 0, -math.pi / 2)
        return {
            "robot": self._robot_place(ASIDES[-1]),
            "recipient": self.scene.bed.frame_in_world("mattress"),
            "caregiver": Pose((0.45, 0.85, 0.0), tuple(beside.tolist())),
        }

    def _robot_place(self, aside: float) -> Pose:
        return self.robot.mount("bed_side", Pose((SHIFT, aside, 0.0)))

    def build(self, world: World) -> None:
        self._world, person, robot = world, self.recipient, self.robot
        for each in (a for a in self.cast.values() if isinstance(a, Human)):
            each.ignore(self.scene.bed.body)  # the posture already keeps them apart
            each.ignore(self.scene.table.body)
        person.supports.append(self.scene.bed.body)
        self.limbs = WashedLimbs(person, world)
        self.scene.lay_cushions(person, self.limbs, world)
        self.scene.sponge.spare(robot.body)
        robots = [a.body for a in self.cast.values() if isinstance(a, Robot)]
        self._safety = self.measure(person, world, [self.scene.sponge.body, *robots])
        self.score = BathScore(world, self.scene, person, robot, self._safety, self.limbs)
        self._find_place(world)
        if world.contact_force(person.body, robot.body) > 0:
            raise ConfigError("the robot touches the person before the episode begins")

    def _find_place(self, world: World) -> None:
        """Find where the robot stands and how it holds the sponge so that it reaches all that matters."""
        robot, bed, misses = self.robot, self.scene.bed.body, []
        for aside, grip, flip in itertools.product(ASIDES, self.scene.sponge.grips, (0.0, math.pi)):
            robot.place(self._robot_place(aside))
            turned = tuple(quaternion_from_rpy(0, 0, flip).tolist())
            self.hold = grip @ Pose((0.0, 0.0, 0.0), turned)
            found = [robot.solve_ik(pose) for pose in self._places()]
            misses.append(max(found, key=lambda each: each.distance + each.angle))
            if not misses[-1].is_within(NEAR, LEVEL):
                continue
            robot.set_posture(found[0].posture)
            if world.separation(robot.body, bed, within=CLEAR) < CLEAR:
                continue
            robot.arm.rest[:] = found[0].posture
            if robot.mount_named("bed_side").stand:
                add_stand(world, self._robot_place(aside))
            return
        miss = min(misses, key=lambda each: each.distance + each.angle)
        raise ConfigError(
            f"{no_reach(robot.config, robot.files.model.name, robot.moves)}: it misses sponge, water or "
            f"arm by {miss.distance:.2f} m, {math.degrees(miss.angle):.0f} degrees"
        )

    def _places(self) -> list[Pose]:
        """Return poses of the tool: at the start, at the sponge, in the water, and over the forearm."""
        arm = self.limbs.limbs["left_elbow"]
        over = [self.scene.over(arm.place(share)[0]) for share in (0.1, 0.7)]
        places = (self.scene.sponge_at, self.scene.dipped(), *over)
        return [self._start(np.zeros(3)), *(self.tool_for(place) for place in places)]

    def tool_for(self, sponge: Pose) -> Pose:
        """Return the pose of the tool that holds the sponge where it is to be."""
        return sponge @ self.hold.inverse()

    def _start(self, offset: Array) -> Pose:
        """Return a pose of the tool before the sponge, and over it."""
        back = self.tool_for(self.scene.sponge_at) @ Pose((0.0, 0.0, -BEFORE))
        at = np.add(back.position, (0.0, 0.0, ABOVE)) + offset
        return Pose(tuple(at.tolist()), back.quaternion)

    def reset(self, rng: np.random.Generator) -> None:
        self.scene.bed.reset()
        self.scene.lay_person(self.recipient, rng)
        gripper, robot = self.robot.gripper, self.robot
        assert gripper is not None  # or there were no score
        gripper.drive(gripper.config.opened, teleport=True)
        start = self._start(rng.uniform(-START_SPREAD, START_SPREAD, 3))
        robot.set_posture(robot.solve_ik(start, seed=robot.arm.rest).posture)
        self._safety.reset()
        self.score.reset()

    def after_substep(self) -> None:
        self._safety.after_substep()
        self.score.after_substep()

    def after_step(self) -> None:
        self._safety.after_step(self.control_dt)
        self.score.after_step(self.control_dt)

    def observables(self, role: str) -> Sequence[Observable]:
        score, scene = self.score, self.scene
        return [
            Observable("sponge_position", "m", 3, lambda: score.face),
            Observable("tool_to_sponge", "m", 3, self._to_sponge),
            Observable("water_position", "m", 3, scene.water),
            Observable("limb_joint_positions", "m", 6 * len(SEEN), self._joints),
            Observable("sponge_force", "N", 1, lambda: (score.force,)),
            Observable("contact_force", "N", 1, lambda: (self._safety.force,)),
            Observable("is_held", "1", 1, lambda: (float(score.is_held),)),
            Observable("wetness", "1", 1, lambda: (score.wetness,)),
            Observable("covered", "1", len(self.limbs.limbs), self.limbs.coverages),
            Observable("items_earned", "1", 1, lambda: (float(score.sheet.stage),)),
            Observable("time_left", "s", 1, lambda: (self.time_limit - self._world.time,)),
        ]

    def _to_sponge(self) -> Array:
        return np.subtract(self.scene.sponge.pose.position, self.robot.tool_pose().position)

    def _joints(self) -> list[float]:
        """Return where the joints of the limbs are, left ones first [m]."""
        person = self.recipient
        places = [person.joint_pose(f"{side}_{j}").position for side in SIDES for j in SEEN]
        return [value for place in places for value in place]

    def rewards(self, role: str) -> Mapping[str, float]:
        terms = {"score": float(self.score.scored)}
        if self.options.reward == "shaped":
            terms |= {"reach": -self._way(), "covered": self.score.gained}
            terms["comfort"] = -self.options.discomfort(self._safety.force, EXCEEDED)
            terms = self.options.weighted(terms)
        # Else a robot that scores nothing any more would hurt to end its losses.
        left = max(self.time_limit - self._world.time, 0.0) / self.control_dt
        terms["hurt"] = -HURT * left if self.is_failure() else 0.0
        return terms

    def _way(self) -> float:
        """Return how far it is to what is next [m]: to sponge, water or the nearest limb."""
        if not self.score.is_held:
            way = float(np.linalg.norm(self._to_sponge()))
        elif self.score.wetness < 1.0:
            way = math.dist(self.score.face, self.scene.water())
        else:
            limbs = self.limbs.limbs.values()
            way = min(math.dist(self.score.face, limb.place(0.5)[0]) for limb in limbs)
        return min(way, FAR)

    def metrics(self) -> Mapping[str, float]:
        return {**self._safety.metrics(), **self.score.metrics()}

    def is_success(self) -> bool:
        """Return whether the time is over and the score is high enough."""
        is_over = self._world.time >= self.time_limit - 1e-9
        is_enough = self.score.sheet.total * self.options.tolerance >= self.options.success_score
        return is_over and is_enough and not self.is_failure()

    def is_failure(self) -> bool:
        return self._safety.peak_force > self.options.force_limit

    def camera(self) -> Camera:
        return Camera(eye=(-1.35, -1.35, 1.75), target=(0.1, -0.12, 0.75), fov_deg=46)
