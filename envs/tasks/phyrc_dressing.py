"""PhyRC's dressing challenge: take the gown from its stand, and pull it over arms and shoulders."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.body.skeleton import JOINT_INDEX, JOINTS, SIDES
from rcare_marl.agents.body.skin import PersonSkin
from rcare_marl.agents.cloth_pinch import ClothPinch
from rcare_marl.agents.control import ToolDelta
from rcare_marl.agents.human import Human
from rcare_marl.agents.kinematics import IkResult
from rcare_marl.agents.robot import Robot
from rcare_marl.agents.robot_config import no_reach
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Array, Pose, quaternion_from_matrix
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..devices.stand import add_stand
from ..devices.wheelchair import Wheelchair
from ..homes.rectangle import Rectangle
from ..phyrc.arm_cover import ArmCover
from ..phyrc.dressing_score import DressingScore
from ..phyrc.gown_stand import GownStand
from ..phyrc.phyrc_score import FULL_SCORE
from ..registry import register_task
from ..task import Role, Task
from ..task_options import TaskOptions

POSITION_SPREAD = 0.05  # [m] along and across, uniform each way: the challenge's scene
# All our own choices.
FORCE_LIMIT = 40.0  # [N] on the person, as in dressing: a sleeve presses all along an arm
COMFORT_FORCE = 20.0  # [N] free of penalty in `shaped`
SUCCESS = 19  # points of 50: a short sleeve up to the shoulder; one arm can earn 21
TIME_LIMIT = 25.0  # [s]
BEFORE = 0.04  # [m] from the fist to the armhole
HAND = tuple(f"left_{part}" for part in ("wrist", "thumb", "index", "middle", "ring", "pinky"))
SETTLE_STEPS = 240  # of the cloth, before the first episode
# [m] of robots from the middle of the arm: away from it, and height of an arm's stand. The first that do.
PLACES = ((0.55, 0.70), (0.60, 0.60), (0.50, 0.80), (0.65, 0.75))
BACK = (0.05, -0.10, 0.20)  # [m] along the arm from its middle, towards the hand
# [m] from the middle of wrist, elbow and shoulder up to the fingers, as they pull
OVER = np.array(((0.0, 0.0, 0.07), (0.0, 0.0, 0.09), (0.0, 0.0, 0.11)))
ABOVE = 0.10  # [m] from the seam to the tool, at the start
START_SPREAD = 0.03  # [m] each way
NEAR, LEVEL = 0.03, 0.4  # [m], [rad] that count as reached
TILTS = tuple(math.radians(a) for a in (0, 30, 55))  # of the hand, away from straight down
PULL_FORCE = 60.0  # [N] from which `tool_delta` gives way, of 15 N else: a sleeve has to be pulled
HURT = 1.0  # points for each step that is left when someone was hurt


@dataclass(frozen=True)
class PhyrcDressingOptions(TaskOptions):
    """Settings of the dressing challenge.

    Attributes:
        reward: `paper`: what the score grew by; `shaped` adds the way to what is next, and comfort.
        force_limit: Force on the person that ends the episode as a failure [N].
        success_score: Points from which on an episode counts as a success, at its end.
    """

    SHAPED_WEIGHTS = {"score": 1.0, "reach": 0.1, "covered": 10.0, "comfort": 0.5}  # own choice

    force_limit: float = FORCE_LIMIT
    success_score: int = SUCCESS

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.success_score <= FULL_SCORE:
            raise ValueError(f"success_score must be 1 to {FULL_SCORE}, got {self.success_score}")


@register_task("phyrc_dressing")
class PhyrcDressing(Task):
    """A robot takes a hospital gown from a stand and pulls its sleeve over the arm of a seated person.

    Scored out of 50 as in the challenge, item by item. An episode lasts until its time is over.
    Success: the score is high enough then. Failure: a force above the limit on the person.
    Tolerance: the score that is high enough is divided by it.
    Randomised at reset: where the robot stands, and where its hand starts.

    Attributes:
        gown: The gown, on its stand.
        score: The score, and what it depends on.
        out: From the shoulder along the arm, level, a unit vector, shape [3].
        turn: How the hand is turned, a quaternion.
    """

    robot = Role(Robot, default="kinova_gen3", partner="scripted", gripper="commanded")
    recipient = Role(
        Human, default="natalia", posture="wheelchair_arm_forward", partner="still",
        movable=("left_shoulder", "left_elbow_flexion"),
    )  # fmt: skip
    caregiver = Role(
        Human, default=None, optional=True, posture="standing", partner="still",
        movable=("spine1_flexion", "right_shoulder", "right_elbow_flexion"),
    )  # fmt: skip

    Options = PhyrcDressingOptions
    room_kinds = ("bedroom", "living", "lounge", "dining")
    footprint = Rectangle(-0.8, -0.9, 1.6, 1.15)  # [m] chair, stand, and a robot at the left
    time_limit = TIME_LIMIT
    options: PhyrcDressingOptions

    def furnish(self, world: World) -> dict[str, Pose]:
        if (
            "left_shoulder" in self.recipient.posture.carried
            or self.recipient.posture.recline_deg > 45
        ):
            raise ConfigError(f"no arm is held out of who is {self.recipient.posture.description}")
        self.lay_floor(world)
        self.chair = Wheelchair(mounts="none")
        soles = self.recipient.soles(self.chair.frame("seat_back"))
        self.chair.fit_footplates(soles["left"], soles["right"])
        self.chair.spawn(world)
        self.recipient.use_arm_rests(None, self.chair.frame_in_world("armrest_right"))
        return {
            "robot": self.robot.mount("floor", Pose((0.0, 1.0, 0.0))),
            "recipient": self.chair.frame_in_world("seat_back"),
            "caregiver": Pose((0.1, -0.75, 0.0), (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))),
        }

    def build(self, world: World) -> None:
        self._world, person = world, self.recipient
        for each in (a for a in self.cast.values() if isinstance(a, Human)):
            each.ignore(self.chair.body)  # the posture already keeps them apart
        self._covers = {side: ArmCover(person, side) for side in SIDES}
        wrist, elbow, shoulder = self._covers["left"].ends
        out = (wrist - elbow) * (1, 1, 0)
        self.out = out / np.linalg.norm(out)
        self._aside = np.cross((0.0, 0.0, 1.0), self.out)
        before = self._before_hand(wrist)
        # Threads of 4 cm would hook on tubes and levers of the chair, as those of real cloth do not.
        hooks = [self.chair.body]
        self.gown = GownStand(world, person, before, self.out, ignored=hooks)
        self._way = np.array((wrist, elbow, shoulder)) + OVER
        self._find_place(world)
        if isinstance(control := self.robot.control, ToolDelta):
            control.contact_force = PULL_FORCE
        cloth = self.gown.cloth
        self._pinch = ClothPinch(self.robot, cloth)
        self.score = DressingScore(world, cloth, self.gown.gown, self._covers, self._pinch)
        robots = [a.body for a in self.cast.values() if isinstance(a, Robot)]
        self._safety = self.measure(person, world, robots)
        self._settle()

    def _before_hand(self, wrist: Array) -> Array:
        """Return the point before the middle of the left hand where the armhole goes [m], shape [3]."""
        person = self.recipient
        skin = next(
            s for s in self._world.skins if isinstance(s, PersonSkin) and s.body is person.body
        )
        parts = [JOINT_INDEX[j] for j in JOINTS if j.startswith(HAND)]
        hand = skin.vertices()[np.isin(person.model.owner, parts)] - wrist
        axes = np.column_stack((self.out, self._aside, (0.0, 0.0, 1.0)))
        low, high = (hand @ axes).min(axis=0), (hand @ axes).max(axis=0)
        middle = 0.5 * (low + high)
        return np.asarray(wrist + axes @ (high[0] + BEFORE, middle[1], middle[2]))

    def _find_place(self, world: World) -> None:
        """Find where the robot stands and how it turns its hand so that it reaches all of the way."""
        robot, misses = self.robot, []
        seam = self.gown.seam
        way = [seam + (0.0, 0.0, ABOVE), seam, *self._way]
        for place, tilt, half in itertools.product(self._places(), TILTS, (1.0, -1.0)):
            robot.place(place)
            self.turn = self._hand(tilt, half)
            found: list[IkResult] = []
            for point in way:
                seed = found[-1].posture if found else robot.arm.rest
                found.append(robot.solve_ik(Pose(tuple(point.tolist()), self.turn), seed=seed))
                if not found[-1].is_within(NEAR, LEVEL):
                    break
            misses.append(max(found, key=lambda each: each.distance + each.angle))
            if not misses[-1].is_within(NEAR, LEVEL):
                continue
            robot.arm.rest[:] = found[0].posture
            robot.set_posture(found[0].posture)
            if world.separation(robot.body, self.recipient.body, within=0.05) < 0.02:
                continue
            self._place, self._props = (
                place,
                add_stand(world, place) if place.position[2] > 0.1 else (),
            )
            return
        miss = min(misses, key=lambda each: each.distance + each.angle)
        raise ConfigError(
            f"{no_reach(robot.config, robot.files.model.name, robot.moves)}: it misses the gown or a place "
            f"over the arm by {miss.distance:.2f} m, {math.degrees(miss.angle):.0f} degrees"
        )

    def _places(self) -> list[Pose]:
        """Return where the root of the robot may go: beside the arm, looking at it."""
        config, middle = self.robot.config, self._way[1]
        is_arm = config.base is None and config.mounts["floor"].position[2] == 0
        found: list[Pose] = []
        for (aside, height), back in itertools.product(PLACES, BACK):
            at = middle + back * self.out + aside * self._aside
            turn = _facing(-self._aside)
            where = Pose((float(at[0]), float(at[1]), height if is_arm else 0.0), turn)
            found.append(self.robot.mount("floor", where, with_posture=False))
        return found

    def _hand(self, tilt: float, half: float) -> tuple[float, ...]:
        """Return how the hand is turned that points down, tilted in from the side of the robot."""
        down = np.array((0.0, 0.0, -math.cos(tilt))) - math.sin(tilt) * self._aside
        closing = half * self.out
        columns = np.column_stack((np.cross(closing, down), closing, down))
        return tuple(quaternion_from_matrix(columns).tolist())

    def _settle(self) -> None:
        """Let the gown hang before the first episode."""
        agents = self.cast.values()
        for _ in range(SETTLE_STEPS):
            for agent in agents:
                agent.actuate()
            self._world.step()

    def reset(self, rng: np.random.Generator) -> None:
        shift = rng.uniform(-POSITION_SPREAD, POSITION_SPREAD, 2)
        hand = rng.uniform(-START_SPREAD, START_SPREAD, 3)
        robot, gripper = self.robot, self.robot.gripper
        assert gripper is not None  # or nothing could be taken
        x, y, z = self._place.position
        robot.place(Pose((x + shift[0], y + shift[1], z), self._place.quaternion))
        gripper.drive(gripper.config.opened, teleport=True)
        self.gown.reset()
        above = self.gown.seam + (0.0, 0.0, ABOVE) + hand
        start = Pose(tuple(above.tolist()), self.turn)
        robot.set_posture(robot.solve_ik(start, seed=robot.arm.rest).posture)
        self._pinch.reset()
        self._safety.reset()
        self.score.reset()

    def after_substep(self) -> None:
        self._safety.after_substep()

    def after_step(self) -> None:
        self._safety.after_step(self.control_dt)
        self._pinch.update()
        self.gown.after_step()
        self.score.after_step(self.control_dt)

    def observables(self, role: str) -> Sequence[Observable]:
        arm = self._covers["left"]
        tool = self.robot.tool_pose
        return [
            Observable("seam_position", "m", 3, lambda: self.gown.seam),
            Observable(
                "tool_to_seam", "m", 3, lambda: np.subtract(self.gown.seam, tool().position)
            ),
            Observable("cuff_position", "m", 3, lambda: self.score.cuff),
            Observable("wrist_elbow_shoulder", "m", 9, lambda: arm.ends.ravel()),
            Observable("is_held", "1", 1, lambda: (float(self._pinch.is_held),)),
            Observable("pull", "N", 1, lambda: (self._pinch.pull,)),
            Observable("contact_force", "N", 1, lambda: (self._safety.force,)),
            Observable("covered", "1", 2, lambda: tuple(self.score.covered.values())),
            Observable("items_earned", "1", 1, lambda: (float(self.score.sheet.stage),)),
            Observable("time_left", "s", 1, lambda: (self.time_limit - self._world.time,)),
        ]

    def rewards(self, role: str) -> Mapping[str, float]:
        terms = {"score": float(self.score.scored)}
        if self.options.reward == "shaped":
            goal = self.gown.seam if not self._pinch.is_held else self._covers["left"].ends[2]
            way = math.dist(goal, self.robot.tool_pose().position)
            terms |= {"reach": -min(way, 1.0), "covered": self.score.gained}
            terms["comfort"] = -self.options.discomfort(self._safety.force, COMFORT_FORCE)
            terms = self.options.weighted(terms)
        # Else a robot that scores nothing any more would hurt to end its losses.
        left = max(self.time_limit - self._world.time, 0.0) / self.control_dt
        terms["hurt"] = -HURT * left if self.is_failure() else 0.0
        return terms

    def metrics(self) -> Mapping[str, float]:
        return {**self._safety.metrics(), **self.score.metrics(), "pull_n": self._pinch.pull}

    def is_success(self) -> bool:
        """Return whether the time is over and the score is high enough."""
        is_over = self._world.time >= self.time_limit - 1e-9
        is_enough = self.score.sheet.total * self.options.tolerance >= self.options.success_score
        return is_over and is_enough and not self.is_failure()

    def is_failure(self) -> bool:
        return self._safety.peak_force > self.options.force_limit

    def way(self) -> Array:
        """Return where the fingers go over wrist, elbow and shoulder [m], shape [3, 3]."""
        return np.asarray(self._covers["left"].ends + OVER)

    def camera(self) -> Camera:
        return Camera(eye=(1.75, 1.75, 1.75), target=(0.2, 0.3, 0.85), fov_deg=46)


def _facing(way: Array) -> tuple[float, float, float, float]:
    """Return the turn about z of what faces a level direction."""
    yaw = math.atan2(way[1], way[0])
    return (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))
