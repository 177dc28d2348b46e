"""PhyRC's bathing challenge: take the sponge, wet it, bring it to the person in bed, and wash."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.people.body.skeleton import SIDES
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.pose import Array, Pose, about_z
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..devices import add_stand
from ..phyrc.bath_scene import BathScene, WashedLimbs
from ..phyrc.bath_score import EXCEEDED, ITEMS, SEEN, BathScore, BathState
from ..phyrc.phyrc_score import Challenge, ChallengeOptions
from ..reach import Trial
from ..rectangle import Rectangle
from ..registry import register_task
from ..state import Seen, State, Values, flat
from ..task import CHAIR_ROBOTS, Role

# All our own choices; what the challenge says is in `bath_score` and `bath_scene`.
SUCCESS = 35  # points of 50
TIME_LIMIT = 90.0  # [s]
SHIFT = -0.25  # [m] of robots along the bed, from where their mounts `bed_side` are to the table
ASIDES = (0.10, 0.05, 0.0)  # [m] closer to the bed, the first where a robot is clear of it
CLEAR = 0.01  # [m] between robot and bed
BEFORE, ABOVE = 0.08, 0.10  # [m] from the handle to the tool at the start, back and up
START_SPREAD = 0.03  # [m] each way
NEAR, LEVEL = 0.02, 0.25  # [m], [rad] that count as reached

MOVABLE = tuple(
    f"{side}_{dof}" for dof in ("hip_abduction", "shoulder", "elbow_flexion") for side in SIDES
)


@dataclass(frozen=True)
class PhyrcBathingOptions(ChallengeOptions):
    """Settings of the bathing challenge.

    Attributes:
        reward: `paper`: what the score grew by; `shaped` adds the way to what is next, and comfort.
        force_limit: Force on the person that ends the episode as a failure [N].
        success_score: Points from which on an episode counts as a success, at its end.
    """

    SHAPED_WEIGHTS = {"score": 1.0, "reach": 0.1, "covered": 50.0, "comfort": 0.5}  # own choice

    success_score: int = SUCCESS


@register_task("phyrc_bathing")
class PhyrcBathing(Challenge):
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

    reachable_by = CHAIR_ROBOTS - {"pr2"} | {"hsr", "stretch_re1_dex"}
    Options = PhyrcBathingOptions
    footprint = Rectangle(-1.15, -1.15, 1.15, 0.7)  # [m] bed and table, and a robot at their side
    time_limit, items, comfort = TIME_LIMIT, ITEMS, EXCEEDED
    options: PhyrcBathingOptions
    state: BathState

    def free_floor(self) -> Rectangle:
        low = self.footprint
        return Rectangle(low.x0, low.y0, low.x1, 1.2 if "caregiver" in self.cast else low.y1)

    def furnish(self, world: World) -> dict[str, Pose]:
        posture = self.recipient.posture
        self.need(posture, posture.recline_deg == 90, "lie on the back")
        self.scene = BathScene(world)
        return {
            "robot": self._robot_place(ASIDES[-1]),
            "recipient": self.scene.bed.frame_in_world("mattress"),
            "caregiver": Pose((0.45, 0.85, 0.0), about_z(-math.pi / 2)),
        }

    def _robot_place(self, aside: float) -> Pose:
        return self.robot.mount("bed_side", Pose((SHIFT, aside, 0.0)))

    def build(self, world: World) -> None:
        person, robot = self.recipient, self.robot
        self.scene.lower(person)
        self.let_overlap(self.scene.bed.body, self.scene.table.body)
        person.supports.append(self.scene.bed.body)
        self.limbs = WashedLimbs(person, world)
        self.scene.lay_cushions(person, self.limbs, world)
        self.scene.sponge.spare(robot.body)
        self.tools.append(self.scene.sponge.body)
        self.score = BathScore(world, self.scene, person, robot, self.limbs)
        self._find_place(world)

    def _find_place(self, world: World) -> None:
        """Find where the robot stands and how it holds the sponge so that it reaches all that matters."""
        robot, trials = self.robot, []
        for grip, flip in itertools.product(self.scene.sponge.grips, (0.0, math.pi)):
            self.hold = grip @ Pose((0.0, 0.0, 0.0), about_z(flip))
            trials.append(Trial(self._places(), hold=self.hold))
        bases = [self._robot_place(aside) for aside in ASIDES]
        search = self.search(
            world,
            clear_of=[(self.scene.bed.body, CLEAR)],
            within=lambda found: found.is_within(NEAR, LEVEL),
        )
        found = search.find(
            [dataclasses.replace(trial, base=base) for base in bases for trial in trials],
            "sponge, water and arm",
        )
        self.hold = found.trial.hold
        robot.arm.rest[:] = found.posture
        robot.set_posture(found.posture)
        if robot.mount_named("bed_side").stand:
            add_stand(world, found.base)

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
        robot.set_tool(start, robot.arm.rest)
        self.score.reset()

    def after_substep(self) -> None:
        self.score.after_substep()

    def read(self, now: State, before: BathState | None) -> BathState:
        return self.score.read(now, self.control_dt)

    def observables(self, role: str) -> Sequence[Seen]:
        return [
            Seen("sponge_position", "m", 3, lambda s: s.face),
            Seen("tool_to_sponge", "m", 3, lambda s: s.to_sponge),
            Seen("water_position", "m", 3, lambda s: s.water),
            Seen("limb_joint_positions", "m", 3 * len(SEEN), lambda s: flat(s.joints)),
            Seen("sponge_force", "N", 1, lambda s: s.push),
            self.contact_force(),
            Seen("is_held", "1", 1, lambda s: s.is_held),
            Seen("wetness", "1", 1, lambda s: s.wetness),
            Seen("covered", "1", len(self.limbs.limbs), lambda s: s.coverages),
            Seen("items_earned", "1", 1, lambda s: s.earned),
            self.time_left(),
        ]

    def metrics(self, state: BathState) -> Mapping[str, Values]:
        return {
            **super().metrics(state),
            "coverage": state.coverage,
            "gentle_share": state.gentleness,
            "sponge_force_n": state.push,
            "wetness": state.wetness,
            "basin_tipped": state.is_tipped,
        }

    def camera(self) -> Camera:
        return Camera(eye=(-1.35, -1.35, 1.75), target=(0.1, -0.12, 0.75), fov_deg=46)
