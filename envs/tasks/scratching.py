"""Scratching: relieve an itch on arm, hand or cheek with a tool, by gentle strokes where the person says."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from rcare_marl.agents.people.human import Human
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, quaternion_from_matrix, turn_to
from rcare_marl.world import World

from ..devices import Device
from ..reach import Trial
from ..registry import register_task
from ..scenes.meal import MOVABLE, Meal, MealOptions
from ..scenes.refusal import Refusal, RefusalOptions, refusal_seen
from ..scenes.skin_spot import SkinSpot, averted, cheek_spot, free_side, limb_spot
from ..state import Seen, State, Values, clip, tolerance
from ..task import CHAIR_ROBOTS, Role

Site = Literal["forearm", "hand", "cheek"]
Hold = tuple[float, float, float]
SITES: tuple[Site, ...] = get_args(Site)

# [m] from the itch, where a stroke helps: Assistive Gym, scratch_itch.py (from memory).
NEAR = 0.025
PRESS = (0.5, 5.0)  # [N] with which it does: felt, and gentle to skin; our own choice
# [m/s] along the skin at least: a tool that rests there does not scratch; our own choice.
STROKE = 0.01
RELIEF = 3.0  # [s] of scratching until the itch is gone; our own choice
COMFORT_FORCE = 5.0  # [N] free of penalty; our own choice
# [m] from skin to tip: within offered, beyond no more; our own choices.
OFFERED, TAKEN_AWAY = 0.05, 0.065
START_GAP = (0.09, 0.14)  # [m] from skin to tip at the start; our own choice
START_SPREAD = 0.03  # [m] along the skin, uniform each way; our own choice
# Where it itches, uniform, our own choices: along forearm and hand, about them, on the cheek each way.
ALONG = {"forearm": (0.35, 0.65), "hand": (0.4, 0.8)}
ABOUT, ON_CHEEK = math.radians(15), 0.008
SAID = 0.008  # [m] by which the person misses it who says where, uniform each way; our own choice
# Our own choices, tried in turn: how far and which way round the tool leans, how it is rolled [rad]; and what
# of the way may be missed [m], also per radian.
LEANS, ROUND = (0.0, 0.4, 0.8), tuple(math.radians(a) for a in range(0, 360, 60))
ROLLS = tuple(math.radians(a) for a in range(0, 360, 45))
MISS, MISS_TURN = 0.01, 0.15
# [rad] by which a joint differs where the arm is bent in another way; our own choice.
OTHER_WAY = 1.0
# [m] from the skin, on the way that a robot must reach.
GAPS = (START_GAP[1], START_GAP[0], 0.03, 0.002)
# Side, hold and posture, or why not, by who, which robot and which site: the search is long, and people of
# a population come again.
_FOUND: dict[str, tuple[str, Hold, Array] | ConfigError] = {}


@dataclass(frozen=True)
class ScratchingOptions(RefusalOptions, MealOptions):
    """Settings of the scratching task.

    Attributes:
        reward: `paper` in the manner of the RCareWorld paper's bathing, which has no scratching; `shaped`
            adds comfort.
        site: Where it itches, `forearm`, `hand` or `cheek`; if `any` drawn in each episode from those that
            the robot reaches.
    """

    SHAPED_WEIGHTS = {"distance": 1.0, "scratched": 10.0, "comfort": 0.5, "relieved": 10.0}

    site: Literal["any", "forearm", "hand", "cheek"] = "any"


@dataclass(frozen=True, eq=False)
class ScratchingState(State):
    """What scratching reads."""

    tip: Array  # of the tool [m], shape [3]
    to_turn: Array  # by how much it is to be turned to point into the skin [rad], shape [3]
    itch: Array  # where it itches [m], shape [3]
    said: Array  # where the person says that it does [m], shape [3]
    out: Array  # out of the skin there, a unit vector, shape [3]
    site: Array  # which of `SITES`, ones and zeros, shape [n]
    distance: float  # from tip to itch [m]
    press: float  # of the tool on the person, the mean of the control step [N]
    speed: float  # of the tip along the skin [m/s]
    scratched: float  # how long the itch was scratched [s]
    gained: float  # of that in this control step
    local: Array  # the tip as the segment sees it [m], shape [3]
    refusal: Refusal  # what the recipient did not want


@register_task("scratching")
class Scratching(Meal):
    """A robot on the wheelchair scratches the person who sits in it where they say that it itches.

    Success: three seconds of strokes over the itch with 0.5 to 5 N; or the person refused for good, and that
    was respected. Failure: a force above the limit on the person, or above 5 N after a no.
    Randomised at reset: where it itches, how well the person says so, where the tool starts.
    Tolerance: the radius within which a stroke helps; the time of scratching is divided by it.
    """

    recipient = Role(
        Human, default="jose", posture="wheelchair", movable=MOVABLE, partner="still", speaks=True
    )
    reachable_by = CHAIR_ROBOTS - {"stretch_re1"} | {"stretch_re1_dex"}
    least_success = 90
    Options = ScratchingOptions
    options: ScratchingOptions
    state: ScratchingState

    def build(self, world: World) -> None:
        super().build(world)
        self.tool = Device("scratcher")
        body = self.tool.spawn(world)
        world.set_collision(body, self.chair.body, False)
        self._side: dict[Site, str] = {}
        self._up: dict[tuple[Site, str], float] = {}  # see `free_side`
        self._near: dict[Site, Array] = {}  # postures of the arm before each site
        wanted = SITES if self.options.site == "any" else (self.options.site,)
        self._holds: dict[Site, Hold] = {}
        refusals = []
        for site in wanted:
            try:
                self._holds[site] = self._find_hold(world, site)
            except ConfigError as refusal:
                refusals.append(refusal)
        if not self._holds:  # it itches where the robot reaches, but somewhere it must
            raise refusals[0]
        self._site = next(iter(self._holds))
        self._draw(np.random.default_rng(0))
        self._set_tip(START_GAP[1], np.zeros(2))
        self.take_tool(self.robot, body, self._grip)
        self._force, self._steps = 0.0, 0

    @property
    def _grip(self) -> Pose:
        return Pose()

    def _spot(self, site: Site, along: float, about: float, shift: Array) -> SkinSpot:
        """Return a spot where it may itch, on the side where the robot reaches that site."""
        side = self._side[site]
        if site == "cheek":
            return cheek_spot(self.recipient, side, shift)
        joint, end = ("elbow", "wrist") if site == "forearm" else ("wrist", "middle1")
        limb = self.recipient, f"{side}_{joint}", f"{side}_{end}"
        if (site, side) not in self._up:
            self._up[site, side] = free_side(*limb, ALONG[site], ABOUT, GAPS)
        return limb_spot(*limb, along, self._up[site, side] + about)

    def _find_hold(self, world: World, site: Site) -> Hold:
        """Find how the robot brings the tool to a site, clear of people: on its own side, or the other.

        Raises:
            ConfigError: If it can on neither side.
        """
        person, robot, own = self.recipient, self.robot, self.options.mount
        who = (person.avatar, person.posture, person.movable, robot.config, robot.body.base_pose())
        is_bare = self.place.room is None
        key = repr((*who, own, site, is_bare))
        if key not in _FOUND or not is_bare:  # furniture is in the way as well
            for self._side[site] in (own, "left" if own == "right" else "right"):
                try:
                    hold = self._hold_there(world, site)
                    _FOUND[key] = self._side[site], hold, self._near[site]
                    break
                except ConfigError as refusal:
                    _FOUND[key] = refusal
        found = _FOUND[key]
        if isinstance(found, ConfigError):
            raise found.with_traceback(None)
        self._side[site], hold, self._near[site] = found
        return hold

    def _hold_there(self, world: World, site: Site) -> Hold:
        """Find how the tool leans and is rolled for a site on the side that is set."""
        spot = self._spot(site, sum(ALONG.get(site, (0.0, 0.0))) / 2, 0.0, np.zeros(2))
        ways: dict[Hold, list[Pose]] = {h: [] for h in itertools.product(LEANS, ROUND, ROLLS)}
        ends = []
        for is_averted in averted(self.recipient, self._head_dofs if site == "cheek" else ()):
            (place, out), gaps = spot.in_world(), GAPS[1:3] if is_averted else GAPS
            for turn, way in ways.items():
                way += [self._tool_for(place + gap * out, out, turn) for gap in gaps]
            ends.append(len(way))
        trials = [Trial(way, hold=turn) for turn, way in ways.items()]
        search = self.search(
            world,
            all_the_way=True,
            roams=False,
            within=lambda found: found.distance + MISS_TURN * found.angle < MISS,
            cost=lambda before, after: float(np.abs(after.posture - before.posture).max()),
            crowding=self.crowding,
            rests=True,
        )
        found = search.find_most(trials, ends, f"the {site}")
        self._near[site], hold = found.posture, found.trial.hold
        return hold

    def tool_quaternion(self, out: Array, hold: Hold | None = None) -> Array:
        """Return how the tool is turned that points into the skin, shape [4].

        Args:
            out: Out of the skin, a unit vector in the world, shape [3].
            hold: How it leans, which way round from the robot, and is rolled [rad]; as found for the
                site of the episode if None.
        """
        lean, way, roll = hold or self._holds[self._site]
        base = np.array(self.robot.body.base_pose().position) - self.recipient.mouth_position()
        base = base - (base @ out) * out
        base = base / max(float(np.linalg.norm(base)), 1e-9)
        base = math.cos(way) * base + math.sin(way) * np.cross(out, base)
        into = -(math.cos(lean) * out + math.sin(lean) * base)
        x = np.cross(np.cross(out, base), into)
        x = math.cos(roll) * x + math.sin(roll) * np.cross(into, x)
        return quaternion_from_matrix(np.column_stack((x, np.cross(into, x), into)))

    def _tool_for(self, tip: Array, out: Array, hold: Hold | None = None) -> Pose:
        """Return the pose of the robot's tool with the tip of what it holds at a place [m]."""
        at = Pose(tuple(tip.tolist()), tuple(self.tool_quaternion(out, hold).tolist()))
        return at @ self.tool.frame("tip").inverse() @ self._grip.inverse()

    def _set_tip(self, gap: float, offset: Array) -> None:
        """Put the robot where the tip is over the itch, aside by an offset along the skin [m], [2]."""
        place, out = self._itch.in_world()
        first = np.cross(out, (0.0, 1.0, 0.0))
        first = first / np.linalg.norm(first)
        at = place + gap * out + offset[0] * first + offset[1] * np.cross(out, first)
        self.robot.arm.rest = near = self._near[self._site]
        found = self.robot.solve_ik(self._tool_for(at, out), seed=near, near=True).posture
        turned = np.abs(np.angle(np.exp(1j * (found - near))))  # whole turns are none
        # Another way to bend the arm may sweep over the person: then it starts over the middle.
        self.robot.set_posture(found if turned.max() < OTHER_WAY else near)
        self.tool.body.set_base(self.robot.tool_pose() @ self._grip)

    def _draw(self, rng: np.random.Generator) -> None:
        """Draw where it itches on the site, and where the person says so."""
        along = rng.uniform(*ALONG.get(self._site, (0.0, 0.0)))
        about, shift = rng.uniform(-ABOUT, ABOUT), rng.uniform(-ON_CHEEK, ON_CHEEK, 2)
        self._itch = self._spot(self._site, along, about, shift)
        miss = rng.uniform(-SAID, SAID, 3)
        self._said = miss - (miss @ self._itch.out) * self._itch.out

    def reset(self, rng: np.random.Generator) -> None:
        gap, offset = rng.uniform(*START_GAP), rng.uniform(-START_SPREAD, START_SPREAD, 2)
        self._site = list(self._holds)[int(len(self._holds) * rng.random())]
        self._draw(rng)
        self._set_tip(gap, offset)
        self._force, self._steps = 0.0, 0

    def after_substep(self) -> None:
        self._force += self.world.contact_force(self.recipient.body, self.tool.body)
        self._steps += 1

    def read(self, now: State, before: ScratchingState | None) -> ScratchingState:
        tip = np.array(self.tool.frame_in_world("tip").position)
        itch, out = self._itch.in_world()
        local, gap = self._itch.seen_from(tip), itch - tip
        press = self._force / max(self._steps, 1)
        self._force, self._steps = 0.0, 0
        speed = 0.0
        if before is not None:
            moved = local - before.local
            moved = moved - (moved @ self._itch.out) * self._itch.out
            speed = float(np.linalg.norm(moved)) / self.control_dt
        ease, distance = self.options.tolerance, math.sqrt(float(gap @ gap))
        helps = distance < NEAR * ease and PRESS[0] <= press <= PRESS[1] and speed >= STROKE
        gained = self.control_dt if helps else 0.0
        return ScratchingState(
            **vars(now),
            tip=tip,
            to_turn=turn_to(self.tool_quaternion(out), self.tool.pose.quaternion),
            itch=itch,
            said=itch + self._said_in_world(),
            out=out,
            site=np.array([float(site == self._site) for site in SITES]),
            distance=distance,
            press=press,
            speed=speed,
            scratched=gained + (0.0 if before is None else before.scratched),
            gained=gained,
            local=local,
            refusal=(Refusal() if before is None else before.refusal).after(
                says_no=self.recipient.says_no,
                is_offered=distance < OFFERED,
                is_away=distance > TAKEN_AWAY,
                force=float(now.force),
            ),
        )

    def _said_in_world(self) -> Array:
        """Return by how much the person misses the itch who says where it is, in the world [m], [3]."""
        moved = SkinSpot(
            self.recipient, self._itch.joint, self._itch.place + self._said, self._said
        )
        return moved.in_world()[0] - self._itch.in_world()[0]

    def observables(self, role: str) -> Sequence[Seen]:
        return [
            Seen("tip_position", "m", 3, lambda s: s.tip),
            Seen("tip_to_itch", "m", 3, lambda s: s.said - s.tip),
            Seen("itch_out", "1", 3, lambda s: s.out),
            Seen("tool_to_turn", "rad", 3, lambda s: s.to_turn),
            Seen("itch_site", "1", len(SITES), lambda s: s.site),
            Seen("tool_force", "N", 1, lambda s: s.press),
            Seen("tool_speed", "m/s", 1, lambda s: s.speed),
            Seen("scratched", "s", 1, lambda s: s.scratched),
            self.contact_force(),
            self.time_left(),
            *refusal_seen(self.options),
        ]

    def rewards(self, role: str, state: ScratchingState) -> Mapping[str, Values]:
        near = tolerance(state.distance, bounds=(0, NEAR), margin=0.2)
        terms = {"near": near, "scratched": state.gained / self.control_dt}
        best = 2.0  # what ends well is paid as if it went on
        if self.options.reward == "shaped":
            excess = self.options.discomfort(state.force, COMFORT_FORCE)
            relieved = self.succeeded(state) * 1.0
            terms = {"distance": -state.distance, "scratched": state.gained, "relieved": relieved}
            terms = self.options.weighted(terms | {"comfort": -excess})
            best = self.options.weight("scratched") * self.control_dt
        return {**terms, "done": self.for_the_rest(state, self.succeeded(state), best)}

    def metrics(self, state: ScratchingState) -> Mapping[str, Values]:
        return {
            "distance_m": state.distance,
            "scratched_s": state.scratched,
            "relief": clip(state.scratched / RELIEF, 0.0, 1.0),
            "tool_force_n": state.press,
            **state.refusal.metrics(),
        }

    def is_success(self, state: ScratchingState) -> Values:
        is_gone = state.scratched * self.options.tolerance >= RELIEF - 1e-9
        return is_gone | state.refusal.is_respected

    def is_failure(self, state: ScratchingState) -> Values:
        return state.refusal.is_hurt
