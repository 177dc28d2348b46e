"""Feeding: bring a spoonful of food to the person's mouth without spilling or pushing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.policies.behaviour_tree import BehaviourTree, eat_when_fed
from rcare_marl.agents.robot import Robot
from rcare_marl.agents.robot_config import no_reach
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Array, Pose, Vector, rotate
from rcare_marl.world import World

from ..care_env import CareEnv
from ..devices.spoon import Spoon
from ..registry import register_policy, register_task
from ..rewards import tolerance
from ..scenes.meal import Meal, MealOptions

MOUTH_RADIUS = 0.03  # [m] food within this of the mouth is eaten: Assistive Gym, feeding.py
LOST_DISTANCE = 0.10  # [m] food farther than this from the spoon is spilled: Assistive Gym
COMFORT_FORCE = 10.0  # [N] free of penalty below: Assistive Gym, config.ini
OPEN_MOUTH = math.radians(10)  # of the jaw, before anything can be eaten; our own choice
MOUTH_IN_FRONT = 0.01  # [m] the target lies this far in front of the lips; our own choice
TIME_LIMIT = 20.0  # [s], 200 control steps, as in Assistive Gym
FOOD_COUNT, FOOD_RADIUS, FOOD_MASS = 4, 0.005, 0.001  # size and mass of Assistive Gym's pieces
START_GAP = (0.28, 0.36)  # [m] from mouth to spoon at the start; our own choice
START_SPREAD = (0.0, 0.06, 0.05)  # [m] uniform, each way: along, across, up; our own choice
HEAD_TURN, HEAD_TILT = math.radians(20), math.radians(8)  # uniform, each way; our own choice
SETTLE_STEPS = 240  # physics steps that the food gets to come to rest in the spoon, once
APART = (0.0, 0.0, -50.0)  # [m] where eaten food is parked: bodies can never be removed


@dataclass(frozen=True)
class FeedingOptions(MealOptions):
    """Settings of the feeding task.

    Attributes:
        reward: `paper` as in the RCareWorld paper; `shaped` adds comfort and a level spoon.
        mount: Side of the wheelchair that the robot is mounted on.
        force_limit: Force on the person that ends the episode as a failure [N].
    """

    SHAPED_WEIGHTS = {"food": 0.1, "approach": 0.9, "comfort": 0.5, "level": 0.1}  # our own choice


@register_task("feeding")
class Feeding(Meal):
    """A robot on the wheelchair feeds the person who sits in it.

    Goal: all food eaten. A piece is eaten when it comes near the mouth while the mouth is open.
    Randomised at reset: where the spoon starts, how the head is turned and tilted.
    Success and failure: all pieces eaten; one spilled, or a force above the limit on the person.
    Tolerance: the radius about the mouth within which food is eaten.
    """

    Options = FeedingOptions
    time_limit = TIME_LIMIT
    options: FeedingOptions

    def build(self, world: World) -> None:
        super().build(world)
        self._spoon = Spoon()
        self._spoon_body = self._spoon.spawn(world)
        world.set_collision(self._spoon_body, self._chair.body, False)
        in_spoon = self._spoon_body.in_centre_frame(Pose(self._spoon.bowl))
        self._bowl_in_spoon, turn = in_spoon.position, in_spoon.quaternion
        self._up_in_spoon = rotate(turn, self._spoon.up)
        self._mouth_at_rest = self.recipient.mouth_position()
        self._is_built = False
        self._set_spoon(self._start_pose(np.zeros(4)))
        self._is_built = True
        self.robot.grasp(self._spoon_body, self._spoon.in_tool)
        self._food = [
            world.add_sphere(
                FOOD_RADIUS, Pose((0, 0, 3 + 0.1 * i)), mass=FOOD_MASS, name=f"food_{i}",
                rgba=(0.85, 0.45, 0.15, 1),
            )
            for i in range(FOOD_COUNT)
        ]  # fmt: skip
        movers = [self._spoon_body, *(a.body for a in self.cast.values() if isinstance(a, Robot))]
        self._safety = self.measure(self.recipient, world, movers)
        self._settle()
        if world.contact_force(self.recipient.body) > 0:
            raise ConfigError("the robot or the spoon touches the person before the episode begins")

    def _settle(self) -> None:
        """Let the food come to rest in the spoon once, and remember where in the spoon it lies."""
        floor = self._spoon_body.base_pose() @ self._spoon.frame("floor")
        for i, piece in enumerate(self._food):
            angle, radius = 2 * math.pi * (i + 0.5) / FOOD_COUNT, 1.6 * FOOD_RADIUS
            offset = (radius * math.cos(angle), radius * math.sin(angle), 1.2 * FOOD_RADIUS)
            piece.set_friction([-1], lateral=0.5)
            piece.set_base(Pose(tuple(np.add(floor.position, offset).tolist())))
        for _ in range(SETTLE_STEPS):
            for agent in self.cast.values():
                agent.actuate()
            self._world.step()
        spoon = self._spoon_body.base_pose().inverse()
        self._food_in_spoon = [spoon @ piece.base_pose() for piece in self._food]
        for i, piece in enumerate(self._food):  # nothing touches where episodes start from
            piece.set_base(Pose((0.0, 0.0, APART[2] - i)))

    def _start_pose(self, offset: Vector) -> Pose:
        """Return a start pose of the bowl: level, in front of the face, its tip towards it."""
        gap = START_GAP[0] + (START_GAP[1] - START_GAP[0]) * float(offset[3])
        position = np.add(self._mouth_at_rest, (gap + offset[0], offset[1], offset[2] - 0.05))
        return Pose(tuple(position.tolist()), tuple(self._spoon.facing((-1.0, 0.0, 0.0)).tolist()))

    def _set_spoon(self, bowl: Pose) -> None:
        """Put the robot where the bowl of the spoon in its hand is at `bowl`."""
        base = bowl @ Pose(self._spoon.bowl).inverse()
        tool = base @ self._spoon.in_tool.inverse()
        found = self.robot.solve_ik(tool)
        if not self._is_built and not found.is_within(0.02, 0.1):
            robot, angle = self.robot, math.degrees(found.angle)
            raise ConfigError(
                f"{no_reach(robot.config, robot.files.model.name, robot.moves)}: it misses the spoon's "
                f"place in front of the face by {found.distance:.2f} m, {angle:.0f} degrees"
            )
        self.robot.set_posture(found.posture)
        self._spoon_body.set_base(self.robot.tool_pose() @ self._spoon.in_tool)

    def reset(self, rng: np.random.Generator) -> None:
        turn, tilt = rng.uniform(-HEAD_TURN, HEAD_TURN), rng.uniform(-HEAD_TILT, HEAD_TILT)
        start = {"neck_rotation_left": turn / 2, "head_rotation_left": turn / 2}
        start |= {"neck_flexion": tilt / 2, "head_flexion": tilt / 2}
        offset = np.append(rng.uniform(-1, 1, 3) * START_SPREAD, rng.uniform())
        self.recipient.set_angles({d: a for d, a in start.items() if d in self._head_dofs})
        self._set_spoon(self._start_pose(offset))
        for piece, local in zip(self._food, self._food_in_spoon, strict=True):
            piece.set_base(self._spoon_body.base_pose() @ local)
        self._fate = ["carried"] * FOOD_COUNT
        self._safety.reset()
        self._time_to_mouth = -1.0

    def after_substep(self) -> None:
        self._safety.after_substep()

    def after_step(self) -> None:
        self._safety.after_step(self.control_dt)
        position, quaternion = self._spoon_body.centre_pose()
        self._bowl = rotate(quaternion, self._bowl_in_spoon) + position
        self._up = rotate(quaternion, self._up_in_spoon)
        lips, self._face = self.recipient.mouth_and_face()
        self._mouth = lips + MOUTH_IN_FRONT * self._face
        self._gap = self._mouth - self._bowl
        self._distance = math.sqrt(float(self._gap @ self._gap))
        self._jaw = self.recipient.angle("jaw_opening")
        self._update_food()

    def _update_food(self) -> None:
        is_open, radius = self._jaw >= OPEN_MOUTH, MOUTH_RADIUS * self.options.tolerance
        for i, piece in enumerate(self._food):
            if self._fate[i] != "carried":
                continue
            place = piece.centre_pose()[0]
            if is_open and math.dist(place, self._mouth) < radius:
                piece.set_base(Pose(APART))
                self._fate[i] = "eaten"
            elif math.dist(place, self._bowl) > LOST_DISTANCE:
                self._fate[i] = "spilled"
        self._carried, self._eaten, self._spilled = (
            self._fate.count(fate) for fate in ("carried", "eaten", "spilled")
        )
        if self._time_to_mouth < 0 and self._eaten == FOOD_COUNT:
            self._time_to_mouth = self._world.time

    def observables(self, role: str) -> Sequence[Observable]:
        return [
            Observable("bowl_position", "m", 3, lambda: self._bowl),
            Observable("bowl_to_mouth", "m", 3, lambda: self._gap),
            Observable("bowl_up", "1", 3, lambda: self._up),
            Observable("face_direction", "1", 3, lambda: self._face),
            Observable("jaw_opening", "rad", 1, lambda: (self._jaw,)),
            Observable("food_on_spoon", "1", 1, lambda: (self._carried / FOOD_COUNT,)),
            Observable("food_eaten", "1", 1, lambda: (self._eaten / FOOD_COUNT,)),
            Observable("contact_force", "N", 1, lambda: (self._safety.force,)),
            Observable("time_left", "s", 1, lambda: (self.time_limit - self._world.time,)),
        ]

    def rewards(self, role: str) -> Mapping[str, float]:
        # Food in the mouth counts as food on the spoon, or eating would cost reward.
        food = (self._carried + self._eaten) / FOOD_COUNT
        near = tolerance(self._distance, bounds=(0, MOUTH_RADIUS), margin=0.3)
        terms = {"food": food * food, "approach": food * near}
        # An episode that ends well is paid as if it had gone on at its best: else to dawdle in
        # front of the mouth would pay more than to feed.
        best = 2.0
        if self.options.reward == "shaped":
            excess = self.options.discomfort(self._safety.force, COMFORT_FORCE)
            terms |= {"comfort": -excess, "level": float(self._up[2]) - 1.0}
            terms = self.options.weighted(terms)
            best = self.options.weight("food") + self.options.weight("approach")
        left = max(self.time_limit - self._world.time, 0.0) / self.control_dt
        terms["eaten"] = best * left if self.is_success() else 0.0
        return terms

    def metrics(self) -> Mapping[str, float]:
        return {
            **self._safety.metrics(),
            "distance_m": self._distance,
            "spilled": float(self._spilled),
            "eaten_pieces": float(self._eaten),
            "time_to_mouth_s": self._time_to_mouth,
        }

    def is_success(self) -> bool:
        return self._eaten == FOOD_COUNT and not self.is_failure()

    def is_failure(self) -> bool:
        return self._spilled > 0 or self._safety.peak_force > self.options.force_limit

    def bowl_position(self) -> Array:
        """Return where the middle of the spoon's bowl is in the world [m], shape [3]."""
        return self._bowl

    def mouth_position(self) -> Array:
        """Return where the spoon should go, just in front of the lips [m], shape [3]."""
        return self._mouth

    def face_direction(self) -> Array:
        """Return where the recipient looks, a unit vector, shape [3]."""
        return self._face

    def distance(self) -> float:
        """Return the distance from bowl to mouth [m]."""
        return self._distance

    def jaw_opening(self) -> float:
        """Return how far the jaw is open [rad]."""
        return self._jaw

    def spoon_quaternion(self) -> Array:
        """Return how the spoon is turned, shape [4]."""
        return np.asarray(self._spoon_body.base_pose().quaternion)

    def spoon_facing(self, direction: Vector) -> Array:
        """Return how a level spoon is turned whose tip points along `direction`, shape [4]."""
        return self._spoon.facing(direction)


@register_policy("feeding", "recipient", "cooperative")
def cooperative(env: CareEnv, role: str) -> BehaviourTree:
    """Return a recipient who looks at the spoon and opens the mouth when it comes near."""
    assert isinstance(task := env.task, Feeding)
    return eat_when_fed(task.recipient, task.bowl_position, task.distance, task.control_dt)
