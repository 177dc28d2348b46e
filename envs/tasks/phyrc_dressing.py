"""PhyRC's dressing challenge: take the gown from its stand, and pull it over arms and shoulders."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.people.avatar import seated
from rcare_marl.agents.people.body.posture import levelled
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX, JOINTS, SIDES
from rcare_marl.agents.people.body.skin import PersonSkin
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.pinch import ClothPinch
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.pose import Array, Pose, about_z, quaternion_from_matrix
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..devices import Wheelchair, add_stand, needs_stand
from ..feasibility import FEASIBLE, Feasibility, girth_along
from ..phyrc.arm_cover import ArmCover
from ..phyrc.dressing_score import ITEMS, DressingScore, GownState
from ..phyrc.gown_stand import GownStand
from ..phyrc.phyrc_score import Challenge, ChallengeOptions
from ..reach import Trial
from ..rectangle import Rectangle
from ..registry import register_task
from ..state import Seen, State, Values, flat
from ..task import CHAIR_ROBOTS, Role

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
CLEAR = 0.02  # [m] between robot and recipient at the start
SLACK = 1.05  # of the hand's girth that a cuff needs; our own choice
TILTS = tuple(math.radians(a) for a in (0, 30, 55))  # of the hand, away from straight down
PULL_FORCE = 60.0  # [N] from which `tool_delta` gives way, of 15 N else: a sleeve has to be pulled


@dataclass(frozen=True)
class PhyrcDressingOptions(ChallengeOptions):
    """Settings of the dressing challenge.

    Attributes:
        reward: `paper`: what the score grew by; `shaped` adds the way to what is next, and comfort.
        force_limit: Force on the person that ends the episode as a failure [N].
        success_score: Points from which on an episode counts as a success, at its end.
    """

    SHAPED_WEIGHTS = {"score": 1.0, "reach": 0.1, "covered": 10.0, "comfort": 0.5}  # own choice

    force_limit: float = FORCE_LIMIT
    success_score: int = SUCCESS


@register_task("phyrc_dressing")
class PhyrcDressing(Challenge):
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

    robot = Role(
        Robot,
        default="kinova_gen3",
        partner="scripted",
        gripper="commanded",
        contact_force=PULL_FORCE,
    )
    recipient = Role(
        Human,
        default="natalia",
        posture="wheelchair_arm_forward",
        partner="still",
        movable=("left_shoulder", "left_elbow_flexion"),
    )

    reachable_by = CHAIR_ROBOTS - {"stretch_re1"} | {"hsr"}
    Options = PhyrcDressingOptions
    footprint = Rectangle(-0.8, -0.9, 1.6, 1.15)  # [m] chair, stand, and a robot at the left
    time_limit, items, comfort = TIME_LIMIT, ITEMS, COMFORT_FORCE
    options: PhyrcDressingOptions
    state: GownState
    chair: Wheelchair

    def furnish(self, world: World) -> dict[str, Pose]:
        posture = self.recipient.posture
        fits = "left_shoulder" not in posture.carried and posture.recline_deg <= 45
        self.need(posture, fits, "sit and hold the left arm out")
        self.chair = Wheelchair(mounts="none")
        back = self.chair.frame("seat_back")
        sitting = seated(self.recipient.avatar, posture, back)
        limb = "left_elbow", "left_wrist"
        self.recipient.posture = levelled(*sitting, "left_shoulder_flexion", limb)
        soles = self.recipient.soles(back)
        self.chair.fit_footplates(soles["left"], soles["right"])
        self.chair.spawn(world)
        self.recipient.use_arm_rests(None, self.chair.frame_in_world("armrest_right"))
        return {
            "robot": self.robot.mount("floor", Pose((0.0, 1.0, 0.0))),
            "recipient": self.chair.frame_in_world("seat_back"),
            "caregiver": Pose((0.1, -0.75, 0.0), (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))),
        }

    def build(self, world: World) -> None:
        person = self.recipient
        self.let_overlap(self.chair.body)
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
        self.feasible = self._fits()
        self._find_place(world)
        self._pinch = ClothPinch(self.robot, self.gown.cloth)
        self.score = DressingScore(self.robot, self.gown, self._covers, self._pinch)
        self.settle(SETTLE_STEPS)

    def _fits(self) -> Feasibility:
        """Return whether the left hand, held as it is, goes through the cuff."""
        cuff = self.gown.cloth.positions[self.gown.gown.cuffs["left"]]
        around = float(np.linalg.norm(cuff - np.roll(cuff, 1, axis=0), axis=1).sum())
        girth = girth_along(self._hand_points(self._covers["left"].ends[0]) @ self._axes())
        if girth * SLACK <= around:
            return FEASIBLE
        hand, hole = (round(100 * length) for length in (girth, around))
        return Feasibility(
            False,
            f"a hand of {hand} cm around, held as it is, does not go through a cuff of {hole} cm",
        )

    def _axes(self) -> Array:
        return np.column_stack((self.out, self._aside, (0.0, 0.0, 1.0)))

    def _hand_points(self, wrist: Array) -> Array:
        """Return the skin of the left hand from the wrist [m], shape [n, 3]."""
        person = self.recipient
        skin = next(
            s for s in self.world.skins if isinstance(s, PersonSkin) and s.body is person.body
        )
        parts = [JOINT_INDEX[j] for j in JOINTS if j.startswith(HAND)]
        return np.asarray(skin.vertices()[np.isin(person.model.owner, parts)] - wrist)

    def _before_hand(self, wrist: Array) -> Array:
        """Return the point before the middle of the left hand where the armhole goes [m], shape [3]."""
        hand, axes = self._hand_points(wrist), self._axes()
        low, high = (hand @ axes).min(axis=0), (hand @ axes).max(axis=0)
        middle = 0.5 * (low + high)
        return np.asarray(wrist + axes @ (high[0] + BEFORE, middle[1], middle[2]))

    def _find_place(self, world: World) -> None:
        """Find where the robot stands and how it turns its hand so that it reaches all of the way."""
        robot, seam = self.robot, self.gown.seam
        points = [seam + (0.0, 0.0, ABOVE), seam, *self._way]
        hands = [self._hand(tilt, half) for tilt in TILTS for half in (1.0, -1.0)]
        ways = [[Pose(tuple(at.tolist()), hand) for at in points] for hand in hands]
        search = self.search(
            world,
            clear_of=[(self.recipient.body, CLEAR)],
            within=lambda found: found.is_within(NEAR, LEVEL),
        )
        found = search.find(
            [
                Trial(way, place, robot.arm.rest, way[0].quaternion)
                for place in self._places()
                for way in ways
            ],
            "the gown and all of the arm",
        )
        self._place, self.turn = found.base, found.trial.hold
        robot.arm.rest[:] = found.posture
        robot.set_posture(found.posture)
        if needs_stand(self.robot):
            add_stand(world, self._place)

    def _places(self) -> list[Pose]:
        """Return where the root of the robot may go: beside the arm, looking at it."""
        middle, is_arm = self._way[1], needs_stand(self.robot)
        found, turn = list[Pose](), about_z(math.atan2(-self._aside[1], -self._aside[0]))
        for (aside, height), back in itertools.product(PLACES, BACK):
            at = middle + back * self.out + aside * self._aside
            where = Pose((float(at[0]), float(at[1]), height if is_arm else 0.0), turn)
            found.append(self.robot.mount("floor", where, with_posture=False))
        return found

    def _hand(self, tilt: float, half: float) -> tuple[float, ...]:
        """Return how the hand is turned that points down, tilted in from the side of the robot."""
        down = np.array((0.0, 0.0, -math.cos(tilt))) - math.sin(tilt) * self._aside
        closing = half * self.out
        columns = np.column_stack((np.cross(closing, down), closing, down))
        return tuple(quaternion_from_matrix(columns).tolist())

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
        robot.set_tool(start, robot.arm.rest)
        self._pinch.reset()
        self.score.reset()

    def read(self, now: State, before: GownState | None) -> GownState:
        self._pinch.update()
        self.gown.after_step()
        return self.score.read(now, self.control_dt)

    def observables(self, role: str) -> Sequence[Seen]:
        return [
            Seen("seam_position", "m", 3, lambda s: s.seam),
            Seen("tool_to_seam", "m", 3, lambda s: s.seam - s.tool),
            Seen("cuff_position", "m", 3, lambda s: s.cuff),
            Seen("wrist_elbow_shoulder", "m", 9, lambda s: flat(s.arm)),
            Seen("is_held", "1", 1, lambda s: s.is_held),
            Seen("pull", "N", 1, lambda s: s.pull),
            self.contact_force(),
            Seen("covered", "1", 2, lambda s: s.covered),
            Seen("items_earned", "1", 1, lambda s: s.earned),
            self.time_left(),
        ]

    def metrics(self, state: GownState) -> Mapping[str, Values]:
        return {
            **super().metrics(state),
            **{f"covered_{side}": state.covered[..., k] for k, side in enumerate(SIDES)},
            "near_left_shoulder": state.near_left,
            "peak_strain": state.strain,
            "pull_n": state.pull,
        }

    def way(self) -> Array:
        """Return where the fingers go over wrist, elbow and shoulder [m], shape [3, 3]."""
        return np.asarray(self.state.arm + OVER)

    def camera(self) -> Camera:
        return Camera(eye=(1.75, 1.75, 1.75), target=(0.2, 0.3, 0.85), fov_deg=46)
