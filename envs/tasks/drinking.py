"""Drinking: bring a cup of water to the person's lips and tilt it, without spilling or pushing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.behaviour.behaviour_tree import BehaviourTree, eat_when_fed
from rcare_marl.pose import Array, Pose, Vector, matrix_from_quaternion
from rcare_marl.soft.fluid import Fluid, fill
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.world import World

from ..care_env import CareEnv
from ..devices import Cup
from ..reach import Trial
from ..registry import register_policy, register_task
from ..scenes.meal import MOUTH_RADIUS, Meal, MealOptions, Mouth
from ..scenes.refusal import Refusal, RefusalOptions, refusal_seen
from ..state import Seen, State, Values, clip, degrees, tolerance
from ..task import CHAIR_ROBOTS

Flags = npt.NDArray[np.bool_]

LEAST_DRUNK = 0.75  # share of the water: Assistive Gym, drinking
MOST_SPILLED = 0.10  # share of the water; our own choice
LOST_DISTANCE = 0.12  # [m] from the middle of the cup; water beyond is spilled; our own choice
COMFORT_FORCE = 10.0  # [N] free of penalty below: Assistive Gym, config.ini
WATER = 100e-6  # [m³], a few mouthfuls; our own choice
SPACING = 0.0058  # [m] of the particles: 513 of them; our own choice
START_GAP = (0.24, 0.32)  # [m] from mouth to rim at the start; our own choice
START_SPREAD = (0.0, 0.06, 0.05)  # [m] uniform, each way: along, across, up; our own choice
START_BELOW = 0.06  # [m] the rim starts below the mouth; our own choice
HEAD_TURN, HEAD_TILT = math.radians(15), math.radians(8)  # uniform, each way; our own choice
SETTLE_STEPS = 480  # physics steps that the water gets to come to rest, once
# Our own choices. Angles between the way from the handle to the cup and the way to the face that are
# tried, the best first: from the side one turn of the wrist tilts the cup.
HANDLES_DEG = (90.0, 70.0, 100.0, 110.0, 50.0, 130.0, 30.0, 150.0, 180.0, 0.0)
EMPTY = math.radians(85)  # tilt that a robot must reach at the lips
# On the way to the lips where it is tried: share of the way, tilt [rad]. A head that is turned or leans
# back is farther away by a tenth.
WAYPOINTS = ((0.0, 0.0), (0.35, 0.2), (0.7, 0.5), (1.0, 0.5), (1.1, 0.5), (1.1, 1.0), (1.0, EMPTY))
ROOM = 0.1  # [rad or m] that joints are from their limits on the way, if a hold leaves that; own choice
MISS, MISS_TURN = 0.02, 0.2  # [m] that it may miss them by, and of it per radian
CLEAR = 0.025  # [m] that it keeps from the person there


@dataclass(frozen=True)
class DrinkingOptions(RefusalOptions, MealOptions):
    """Settings of the drinking task.

    Attributes:
        reward: `paper` in the manner of the RCareWorld paper's feeding, which has no drinking; `shaped`
            adds comfort and an upright cup.
        mount: Side of the wheelchair that the robot is mounted on.
        force_limit: Force on the person that ends the episode as a failure [N].
    """

    SHAPED_WEIGHTS = {"water": 0.1, "approach": 0.4, "drunk": 0.5, "comfort": 0.5, "upright": 0.1}


@dataclass(frozen=True, eq=False)
class DrinkingState(State):
    """What drinking reads."""

    rim: Array  # the edge of the cup that leads to the face [m], shape [3]
    up: Array  # out of the cup, a unit vector, shape [3]
    turn: Array  # how the cup is turned, a quaternion, shape [4]
    tilt: float  # of the cup from upright [rad]
    mouth: Array  # the place to bring things to, in front of the lips [m], shape [3]
    face: Array  # where the face looks, a unit vector, shape [3]
    mouth_faced: Array  # where the mouth was when the face was last not turned away [m], shape [3]
    ahead_faced: Array  # where the face looked then, level, a unit vector, shape [3]
    jaw: float  # how far the jaw is open [rad]
    distance: float  # from rim to mouth [m]
    is_spilled: Flags  # of each particle of water, whether it was ever lost, shape [n]
    inside: float  # share of the water that is in the cup
    drunk: float  # share of it that was drunk
    spilled: float  # share of it that was spilled
    time_to_drink: float  # when enough was drunk [s]; -1 before
    refusal: Refusal  # what the recipient did not want


@register_task("drinking")
class Drinking(Meal):
    """A robot on the wheelchair gives the person who sits in it to drink from a cup of water.

    Goal: three quarters of the water drunk. A particle is drunk when it comes near the mouth while the
    mouth is open. Randomised at reset: where the cup starts, how the head is turned and tilted.
    Success and failure: enough is drunk, or refused for good and that respected; too much is spilled, a
    force above the limit on the person, or above 5 N after a no.
    Tolerance: the share that may be spilled; that to be drunk is divided by it.
    """

    reachable_by = CHAIR_ROBOTS - {"fetch", "stretch_re1"} | {"stretch_re1_dex"}
    least_success = 90
    use = "cup"
    hands_touch = False  # the cup does
    Options = DrinkingOptions
    options: DrinkingOptions
    state: DrinkingState

    def build(self, world: World) -> None:
        super().build(world)
        self.mouth = Mouth(self.recipient)
        self._mouth_at_rest = self.mouth.position
        self.cup = Cup()
        body = self.cup.spawn(world)
        world.set_collision(body, self.chair.body, False)
        self._find_hold(self._start_rim(np.zeros(4)), self._mouth_at_rest)
        self._set_cup(np.zeros(4))
        self.take_tool(self.robot, body, self.cup.in_tool)
        self.water = Fluid("water", fill(self.cup.vessel, WATER, SPACING), spacing=SPACING)
        SoftWorld.of(world).add(self.water)
        self.settle(SETTLE_STEPS)
        inside = self.cup.vessel.frame()
        turn = matrix_from_quaternion(inside.quaternion)
        self._water_in_cup = (self.water.positions - inside.position) @ turn

    def _find_hold(self, start: Array, lips: Array) -> None:
        """Find on which side of the cup the handle is: the robot has to empty the cup at the lips.

        It must not touch the person on the way; the cup may.

        Args:
            start: Where the rim starts [m], shape [3].
            lips: Where it has to come [m], shape [3].
        """
        level = (lips - start) * (1.0, 1.0, 0.0)
        way = level / np.linalg.norm(level)
        # The arm comes from the side where its base is.
        across = np.cross(way, np.subtract(self.robot.body.base_pose().position, lips))
        side = 1.0 if across[2] > 0 else -1.0
        trials = []
        for angle in HANDLES_DEG:
            self._handle = -side * math.radians(angle)
            cups = [self.cup_pose(start + s * (lips - start), way, tilt) for s, tilt in WAYPOINTS]
            poses = [pose @ self.cup.in_tool.inverse() for pose in cups]
            trials.append(Trial(poses, hold=self._handle))
        search = self.search(
            self.world,
            clear_of=[(self.recipient.body, CLEAR)],
            all_the_way=True,
            within=lambda found: found.distance + MISS_TURN * found.angle < MISS,
            room=ROOM,
        )
        found = search.find(trials, "the lips with the cup in its hand")
        self._handle, self.robot.arm.rest = found.trial.hold, found.posture

    def cup_pose(self, rim: Vector, way: Vector, tilt: float) -> Pose:
        """Return where the cup is when it is held as here; see `Cup.pouring`."""
        return self.cup.pouring(rim, way, tilt, self._handle)

    def _start_rim(self, offset: Vector) -> Array:
        """Return where the rim starts: in front of the face, below the mouth."""
        gap = START_GAP[0] + (START_GAP[1] - START_GAP[0]) * float(offset[3])
        return np.add(self._mouth_at_rest, (gap + offset[0], offset[1], offset[2] - START_BELOW))

    def _set_cup(self, offset: Vector) -> None:
        """Put the robot where the cup in its hand stands upright before the face."""
        pose = self.cup_pose(self._start_rim(offset), (-1.0, 0.0, 0.0), 0.0)
        self.robot.set_tool(pose @ self.cup.in_tool.inverse(), self.robot.arm.rest)
        self.cup.body.set_base(self.robot.tool_pose() @ self.cup.in_tool)

    def reset(self, rng: np.random.Generator) -> None:
        self.turn_head(rng, HEAD_TURN, HEAD_TILT)
        offset = np.append(rng.uniform(-1, 1, 3) * START_SPREAD, rng.uniform())
        self._set_cup(offset)
        frame = self.cup.vessel.frame()
        turned = self._water_in_cup @ matrix_from_quaternion(frame.quaternion).T
        self.water.place(turned + frame.position)
        self._drunk = np.zeros(self.water.size, np.bool_)

    def after_substep(self) -> None:
        if self.mouth.is_open:
            drunk = self.mouth.takes(self.water.positions)
            if drunk.any():
                self._drunk |= drunk
                self.water.take(drunk)

    def offered_position(self) -> Array:
        """Return where the rim that leads to the face is in the world [m], shape [3]."""
        return self.state.rim

    def read(self, now: State, before: DrinkingState | None) -> DrinkingState:
        mouth, vessel, positions = self.mouth, self.cup.vessel, self.water.positions
        mouth.sense()
        inside = vessel.holds(positions)
        apart = positions - np.array(self.cup.frame_in_world("middle").position)
        lost = np.einsum("na,na->n", apart, apart) > LOST_DISTANCE**2
        spilled = lost & ~inside & ~self._drunk
        if before is not None:
            spilled |= before.is_spilled
        rim, up = vessel.rim_point(-mouth.ahead), self.cup.up_in_world()
        drunk = float(np.mean(self._drunk))
        arrived = -1.0 if before is None else before.time_to_drink
        is_first = arrived < 0 and drunk * self.options.tolerance >= LEAST_DRUNK
        refusal = self.refused(now, before, mouth.face, rim - mouth.position)
        kept = before if refusal.turned else None
        return DrinkingState(
            **vars(now),
            rim=rim,
            up=up,
            turn=np.array(self.cup.pose.quaternion),
            tilt=math.acos(min(max(float(up[2]), -1.0), 1.0)),
            mouth=mouth.position,
            face=mouth.face,
            mouth_faced=mouth.position if kept is None else kept.mouth_faced,
            ahead_faced=mouth.ahead if kept is None else kept.ahead_faced,
            jaw=mouth.jaw,
            distance=float(np.linalg.norm(mouth.position - rim)),
            is_spilled=spilled,
            inside=float(np.mean(inside)),
            drunk=drunk,
            spilled=float(np.mean(spilled & ~self._drunk)),
            time_to_drink=now.time if is_first else arrived,
            refusal=refusal,
        )

    def observables(self, role: str) -> Sequence[Seen]:
        return [
            Seen("rim_position", "m", 3, lambda s: s.rim),
            Seen("rim_to_mouth", "m", 3, lambda s: s.mouth - s.rim),
            Seen("rim_to_mouth_faced", "m", 3, lambda s: s.mouth_faced - s.rim),
            Seen("ahead_faced", "1", 3, lambda s: s.ahead_faced),
            Seen("cup_up", "1", 3, lambda s: s.up),
            Seen("face_direction", "1", 3, lambda s: s.face),
            Seen("jaw_opening", "rad", 1, lambda s: s.jaw),
            Seen("water_in_cup", "1", 1, lambda s: s.inside),
            Seen("water_drunk", "1", 1, lambda s: s.drunk),
            Seen("water_spilled", "1", 1, lambda s: s.spilled),
            self.contact_force(),
            self.time_left(),
            *refusal_seen(self.options),
        ]

    def rewards(self, role: str, state: DrinkingState) -> Mapping[str, Values]:
        kept = 1.0 - state.spilled
        near = tolerance(state.distance, bounds=(0, MOUTH_RADIUS), margin=0.3)
        drunk = clip(state.drunk / LEAST_DRUNK, 0.0, 1.0)
        terms = {"water": kept * kept, "approach": kept * near, "drunk": kept * drunk}
        # An episode that ends well is paid as if it had gone on at its best: else to dawdle with the cup
        # at the lips would pay more than to give to drink.
        best = float(len(terms))
        if self.options.reward == "shaped":
            best = sum(self.options.weight(name) for name in terms)
            terms["comfort"] = -self.options.discomfort(state.force, COMFORT_FORCE)
            terms["upright"] = (state.up[..., 2] - 1.0) * (1.0 - near)
            terms = self.options.weighted(terms)
        return {**terms, "done": self.for_the_rest(state, self.succeeded(state), best)}

    def metrics(self, state: DrinkingState) -> Mapping[str, Values]:
        return {
            "distance_m": state.distance,
            "drunk_share": state.drunk,
            "spilled_share": state.spilled,
            "tilt_deg": degrees(state.tilt),
            "time_to_drink_s": state.time_to_drink,
            **state.refusal.metrics(),
        }

    def is_success(self, state: DrinkingState) -> Values:
        is_enough = state.drunk * self.options.tolerance >= LEAST_DRUNK
        return is_enough | state.refusal.is_respected

    def is_failure(self, state: DrinkingState) -> Values:
        return (state.spilled > MOST_SPILLED * self.options.tolerance) | state.refusal.is_hurt


@register_policy("drinking", "recipient", "cooperative")
def cooperative(env: CareEnv, role: str) -> BehaviourTree:
    """Return a recipient who looks at the cup and opens the mouth when it comes near."""
    assert isinstance(task := env.task, Drinking)
    return eat_when_fed(
        task.recipient, lambda: task.state.rim, lambda: task.state.distance, task.control_dt
    )
