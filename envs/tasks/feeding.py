"""Feeding: bring a spoonful of food to the person's mouth without spilling or pushing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.behaviour.behaviour_tree import BehaviourTree, eat_when_fed
from rcare_marl.agents.people.eating import Mouthful, Texture
from rcare_marl.pose import Array, Pose, Vector, rotate
from rcare_marl.world import World

from ..care_env import CareEnv
from ..devices import Spoon
from ..reach import Trial
from ..registry import register_policy, register_task
from ..scenes.hanging_bag import HangingBag, ObstacleOptions
from ..scenes.meal import MOUTH_IN_FRONT, MOUTH_RADIUS, OPEN_MOUTH, Meal, MealOptions
from ..scenes.refusal import Refusal, RefusalOptions, refusal_seen
from ..state import Seen, State, Values, negate, tolerance, where

Flags = npt.NDArray[np.bool_]

LOST_DISTANCE = 0.10  # [m] food farther than this from the spoon is spilled: Assistive Gym
COMFORT_FORCE = 10.0  # [N] free of penalty below: Assistive Gym, config.ini
FOOD_COUNT, FOOD_RADIUS, FOOD_MASS = 4, 0.005, 0.001  # size and mass of Assistive Gym's pieces
FOOD_RGBA = (0.85, 0.45, 0.15, 1.0)
START_GAP = (0.28, 0.36)  # [m] from mouth to spoon at the start; our own choice
START_SPREAD = (0.0, 0.06, 0.05)  # [m] uniform, each way: along, across, up; our own choice
HEAD_TURN, HEAD_TILT = math.radians(20), math.radians(8)  # uniform, each way; our own choice
SETTLE_STEPS = 240  # physics steps that the food gets to come to rest in the spoon, once
LOADED_FROM = 0.22  # [m] from mouth to bowl, where an empty spoon is filled again; our own choice
STILL, LEVEL = 0.05, 0.95  # [m/s], cosine of the tilt: a spoon that can be filled; our own choice
AT_LIPS = 0.05  # [m] from mouth to bowl: food is offered; our own choice
BETWEEN_BITES = 12.0  # [s] beside chewing, for each further bite; our own choice
COUGH = 10.0  # of the paper's reward, five control steps at best; our own choice
APART = (0.0, 0.0, -50.0)  # [m] where eaten food is parked: bodies can never be removed


@dataclass(frozen=True)
class FeedingOptions(RefusalOptions, ObstacleOptions, MealOptions):
    """Settings of the feeding task.

    Attributes:
        reward: `paper` as in the RCareWorld paper; `shaped` adds comfort and a level spoon.
        mount: Side of the wheelchair that the robot is mounted on.
        force_limit: Force on the person that ends the episode as a failure [N].
        bites: Spoonfuls that are eaten, one after the other; with more than one, chewing counts.
        texture: What they are of, `puree` or `solid`: how long each is chewed, see `Eating`.
        obstacle: `bag`: the spoon starts at its side, and an infusion bag hangs in the straight way.
    """

    SHAPED_WEIGHTS = {"food": 0.1, "approach": 0.9, "comfort": 0.5, "level": 0.1}  # our own choice

    bites: int = 1
    texture: Texture = "puree"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.bites <= 100:
            raise ValueError(f"bites must lie in 1..100, got {self.bites}")


@dataclass(frozen=True, eq=False)
class FeedingState(State):
    """What feeding reads."""

    bowl: Array  # middle of the spoon's bowl [m], shape [3]
    up: Array  # out of the bowl, a unit vector, shape [3]
    turn: Array  # how the spoon is turned, a quaternion, shape [4]
    mouth: Array  # where the spoon should go, just in front of the lips [m], shape [3]
    face: Array  # where the recipient looks, a unit vector, shape [3]
    distance: float  # from bowl to mouth [m]
    jaw: float  # how far the jaw is open [rad]
    is_eaten: Flags  # of each piece of food, shape [n]
    is_spilled: Flags  # likewise
    eaten: int  # how many of them are
    spilled: int  # likewise
    time_to_mouth: float  # when the last piece was eaten [s]; -1 before
    mouthful: Mouthful  # what is in the mouth
    refusal: Refusal  # what the recipient did not want


@register_task("feeding")
class Feeding(Meal):
    """A robot on the wheelchair feeds the person who sits in it.

    Goal: all food eaten. A piece is eaten when it comes near the mouth while the mouth is open.
    Of several bites each is chewed and swallowed; the spoon is filled again where it is drawn back.
    Randomised at reset: where the spoon starts, how the head is turned and tilted.
    Success and failure: all pieces eaten, or refused for good and that respected; one spilled, a force
    above the limit on the person, or above 5 N after a no.
    Tolerance: the radius about the mouth within which food is eaten.
    """

    Options = FeedingOptions
    options: FeedingOptions
    state: FeedingState

    def build(self, world: World) -> None:
        super().build(world)
        self._spoon = Spoon()
        self._spoon_body = self._spoon.spawn(world)
        world.set_collision(self._spoon_body, self.chair.body, False)
        in_spoon = self._spoon_body.in_centre_frame(self._spoon.frame("bowl"))
        self._bowl_in_spoon, turn = in_spoon.position, in_spoon.quaternion
        self._up_in_spoon = rotate(turn, self._spoon.up)
        self._mouth_at_rest = self.recipient.mouth_position()
        self.bag = HangingBag(world, self.options, self.options.mount)
        start = self._start_pose(np.zeros(4))
        self.search(world).find([Trial([self.tool_for(start)])], "the place before the face")
        self._set_spoon(start)
        self.take_tool(self.robot, self._spoon_body, self._spoon.in_tool)
        self._food = [
            world.add_sphere(
                FOOD_RADIUS,
                Pose((0, 0, 3 + 0.1 * i)),
                mass=FOOD_MASS,
                name=f"food_{i}",
                rgba=FOOD_RGBA,
            )
            for i in range(FOOD_COUNT)
        ]
        self._lay_food()
        self._eating = self.recipient.avatar.eating
        if self.options.bites > 1:
            further, busy = self.options.bites - 1, self._eating.time(self.options.texture)
            self.time_limit += further * (BETWEEN_BITES + busy) + busy

    def _lay_food(self) -> None:
        """Let the food come to rest in the spoon once, and remember where in the spoon it lies."""
        floor = self._spoon_body.base_pose() @ self._spoon.frame("floor")
        for i, piece in enumerate(self._food):
            angle, radius = 2 * math.pi * (i + 0.5) / FOOD_COUNT, 1.6 * FOOD_RADIUS
            offset = (radius * math.cos(angle), radius * math.sin(angle), 1.2 * FOOD_RADIUS)
            piece.set_friction([-1], lateral=0.5)
            piece.set_base(Pose(tuple(np.add(floor.position, offset).tolist())))
        self.settle(SETTLE_STEPS)
        spoon = self._spoon_body.base_pose().inverse()
        self._food_in_spoon = [spoon @ piece.base_pose() for piece in self._food]
        for i, piece in enumerate(self._food):  # nothing touches where episodes start from
            piece.set_base(Pose((0.0, 0.0, APART[2] - i)))

    def _start_pose(self, offset: Vector) -> Pose:
        """Return a start pose of the bowl: level, in front of the face, its tip towards it."""
        gap = START_GAP[0] + (START_GAP[1] - START_GAP[0]) * float(offset[3])
        away = (gap + offset[0], offset[1], offset[2] - 0.05)
        position = self._mouth_at_rest + away + self.bag.aside
        return Pose(tuple(position.tolist()), tuple(self._spoon.facing((-1.0, 0.0, 0.0)).tolist()))

    def tool_for(self, bowl: Pose) -> Pose:
        """Return the pose of the tool with the bowl of the spoon at a pose."""
        return bowl @ self._spoon.frame("bowl").inverse() @ self._spoon.in_tool.inverse()

    def _set_spoon(self, bowl: Pose) -> None:
        """Put the robot where the bowl of the spoon in its hand is at `bowl`."""
        self.robot.set_tool(self.tool_for(bowl))
        self._spoon_body.set_base(self.robot.tool_pose() @ self._spoon.in_tool)

    def reset(self, rng: np.random.Generator) -> None:
        self.turn_head(rng, HEAD_TURN, HEAD_TILT)
        offset = np.append(rng.uniform(-1, 1, 3) * START_SPREAD, rng.uniform())
        self._set_spoon(start := self._start_pose(offset))
        self.bag.hang(start.position, self.recipient.mouth_position(), rng)
        self._fill_spoon()

    def _fill_spoon(self) -> None:
        for piece, local in zip(self._food, self._food_in_spoon, strict=True):
            piece.set_base(self._spoon_body.base_pose() @ local)

    def mouth_is_full(self, role: str) -> bool:
        """Return whether who plays a role has something in the mouth."""
        return role == self.recipient.name and not self.state.mouthful.is_ready

    def chokes(self, role: str) -> bool:
        """Return whether food went the wrong way there in the last control step."""
        return role == self.recipient.name and bool(self.state.mouthful.coughs_now)

    def offered_position(self) -> Array:
        """Return where the middle of the spoon's bowl is in the world [m], shape [3]."""
        return self.state.bowl

    def read(self, now: State, before: FeedingState | None) -> FeedingState:
        position, quaternion = self._spoon_body.centre_pose()
        bowl = rotate(quaternion, self._bowl_in_spoon) + position
        lips, face = self.recipient.mouth_and_face()
        mouth, jaw = lips + MOUTH_IN_FRONT * face, self.recipient.angle("jaw_opening")
        gap, up = mouth - bowl, rotate(quaternion, self._up_in_spoon)
        distance = math.sqrt(float(gap @ gap))
        is_back = up[2] > LEVEL and distance > LOADED_FROM
        is_filled = is_back and before is not None and self._waits_for_food(before, bowl)
        if is_filled:
            self._fill_spoon()
        is_eaten, is_spilled = self._fates(None if is_filled else before, bowl, mouth, jaw)
        eaten = int(np.count_nonzero(is_eaten))
        mouthful = self._chew(now.time, before, eaten, distance)
        all_eaten = mouthful.taken == self.options.bites
        arrived = -1.0 if before is None else before.time_to_mouth
        return FeedingState(
            **vars(now),
            bowl=bowl,
            up=up,
            turn=np.array(self._spoon_body.base_pose().quaternion),
            mouth=mouth,
            face=face,
            distance=distance,
            jaw=jaw,
            is_eaten=is_eaten,
            is_spilled=is_spilled,
            eaten=eaten,
            spilled=int(np.count_nonzero(is_spilled)),
            time_to_mouth=now.time if arrived < 0 and all_eaten else arrived,
            mouthful=mouthful,
            refusal=self.refused(now, before, face, -gap),
        )

    def _waits_for_food(self, before: FeedingState, bowl: Array) -> bool:
        """Return whether the spoon is empty and still, and bites are left."""
        hungry = before.eaten == FOOD_COUNT and before.mouthful.taken < self.options.bites
        return hungry and math.dist(bowl, before.bowl) < STILL * self.control_dt

    def _chew(
        self, time: float, before: FeedingState | None, eaten: int, distance: float
    ) -> Mouthful:
        """Return what is in the mouth."""
        if before is None:
            return Mouthful()
        was_full = before.eaten == FOOD_COUNT
        more = eaten - (0 if was_full and eaten < FOOD_COUNT else before.eaten)
        return before.mouthful.after(
            time,
            self._eating,
            self.options.texture,
            is_offered=eaten < FOOD_COUNT and distance < AT_LIPS,
            enters=more > 0,
            is_emptied=eaten == FOOD_COUNT and not was_full,
        )

    def _fates(
        self, before: FeedingState | None, bowl: Array, mouth: Array, jaw: float
    ) -> tuple[Flags, Flags]:
        """Return which pieces have been eaten and which spilled; who eats takes them off the scene."""
        eaten, spilled = np.zeros((2, FOOD_COUNT), np.bool_)
        if before is not None:
            eaten, spilled = before.is_eaten.copy(), before.is_spilled.copy()
        radius = MOUTH_RADIUS * self.options.tolerance
        for i in np.flatnonzero(~(eaten | spilled)):
            place = self._food[i].centre_pose()[0]
            if jaw >= OPEN_MOUTH and math.dist(place, mouth) < radius:
                self._food[i].set_base(Pose(APART))
                eaten[i] = True
            elif math.dist(place, bowl) > LOST_DISTANCE:
                spilled[i] = True
        return eaten, spilled

    def observables(self, role: str) -> Sequence[Seen]:
        ready = Seen("mouth_ready", "1", 1, lambda s: s.mouthful.is_ready)
        left = Seen("bites_left", "1", 1, lambda s: self.options.bites - s.mouthful.swallowed)
        return [
            *((ready, left) if self.options.bites > 1 else ()),
            Seen("bowl_position", "m", 3, lambda s: s.bowl),
            Seen("bowl_to_mouth", "m", 3, lambda s: s.mouth - s.bowl),
            Seen("bowl_up", "1", 3, lambda s: s.up),
            Seen("face_direction", "1", 3, lambda s: s.face),
            Seen("jaw_opening", "rad", 1, lambda s: s.jaw),
            Seen("food_on_spoon", "1", 1, lambda s: 1 - (s.eaten + s.spilled) / FOOD_COUNT),
            Seen("food_eaten", "1", 1, lambda s: s.eaten / FOOD_COUNT),
            self.contact_force(),
            self.time_left(),
            *(*refusal_seen(self.options), *self.bag.seen()),
        ]

    def rewards(self, role: str, state: FeedingState) -> Mapping[str, Values]:
        # Food in the mouth counts as food on the spoon, or eating would cost reward.
        food = 1 - state.spilled / FOOD_COUNT
        near = tolerance(state.distance, bounds=(0, MOUTH_RADIUS), margin=0.3)
        if self.options.bites > 1:
            # An empty spoon belongs back, a full one before a mouth that is ready.
            back = tolerance(state.distance, bounds=(LOADED_FROM, 1.0), margin=0.3)
            waiting = tolerance(state.distance, bounds=(2 * AT_LIPS, 1.0), margin=0.3)
            is_full = negate(state.mouthful.is_ready)
            near = where(state.eaten == FOOD_COUNT, back, where(is_full, waiting, near))
        terms = {"food": food * food, "approach": food * near}
        best = 2.0  # what ends well is paid as if it went on: else to dawdle would pay more than to feed
        if self.options.reward == "shaped":
            excess = self.options.discomfort(state.force, COMFORT_FORCE)
            terms |= {"comfort": -excess, "level": state.up[..., 2] - 1.0}
            terms = self.options.weighted(terms)
            best = self.options.weight("food") + self.options.weight("approach")
        if self.options.bites > 1:
            share = COUGH / 2.0 * best
            terms["cough"] = where(state.mouthful.coughs_now, -share, 0.0)
        return {**terms, "eaten": self.for_the_rest(state, self.succeeded(state), best)}

    def literal(self, role: str, state: FeedingState) -> Mapping[str, Values]:
        food = where(state.spilled + state.eaten < FOOD_COUNT, 1.0, 0.0)
        return {"food": food, "near": where(state.distance <= MOUTH_RADIUS, food, 0.0)}

    def metrics(self, state: FeedingState) -> Mapping[str, Values]:
        return {
            "distance_m": state.distance,
            "spilled": state.spilled,
            "eaten_pieces": state.eaten,
            "bites_swallowed": state.mouthful.swallowed,
            "early_offers": state.mouthful.early,
            "coughs": state.mouthful.coughs,
            "aspiration_risk": state.mouthful.risk,
            "time_to_mouth_s": state.time_to_mouth,
            **state.refusal.metrics(),
        }

    def is_success(self, state: FeedingState) -> Values:
        several, swallowed = self.options.bites > 1, state.mouthful.swallowed
        is_fed = swallowed >= self.options.bites if several else state.eaten == FOOD_COUNT
        return is_fed | state.refusal.is_respected

    def is_failure(self, state: FeedingState) -> Values:
        return (state.spilled > 0) | state.refusal.is_hurt

    def spoon_facing(self, direction: Vector) -> Array:
        """Return how a level spoon is turned whose tip points along `direction`, shape [4]."""
        return self._spoon.facing(direction)


@register_policy("feeding", "recipient", "cooperative")
def cooperative(env: CareEnv, role: str) -> BehaviourTree:
    """Return a recipient who looks at the spoon and opens the mouth when it comes near."""
    assert isinstance(task := env.task, Feeding)
    return eat_when_fed(
        task.recipient,
        lambda: task.state.bowl,
        lambda: task.state.distance,
        task.control_dt,
        is_full=lambda: task.mouth_is_full(role),
        clock=lambda: env.world.time,
    )
