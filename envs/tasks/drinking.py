"""Drinking: bring a cup of water to the person's lips and tilt it, without spilling or pushing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.policies.behaviour_tree import BehaviourTree, eat_when_fed
from rcare_marl.agents.robot import Robot
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import (
    Array,
    Pose,
    Vector,
    matrix_from_quaternion,
)
from rcare_marl.soft.fluid import Fluid, fill
from rcare_marl.soft.pool import Pool
from rcare_marl.world import World

from ..care_env import CareEnv
from ..devices.cup import Cup
from ..registry import register_policy, register_task
from ..rewards import tolerance
from ..scenes.cup_hold import CupHold
from ..scenes.meal import Meal, MealOptions
from ..scenes.mouth import RADIUS, Mouth

LEAST_DRUNK = 0.75  # share of the water: Assistive Gym, drinking
MOST_SPILLED = 0.10  # share of the water; our own choice
LOST_DISTANCE = 0.12  # [m] from the middle of the cup; water beyond is spilled; our own choice
COMFORT_FORCE = 10.0  # [N] free of penalty below: Assistive Gym, config.ini
TIME_LIMIT = 20.0  # [s], 200 control steps, as in Assistive Gym
WATER = 100e-6  # [m³], a few mouthfuls; our own choice
SPACING = 0.0058  # [m] of the particles: 513 of them; our own choice
START_GAP = (0.24, 0.32)  # [m] from mouth to rim at the start; our own choice
START_SPREAD = (0.0, 0.06, 0.05)  # [m] uniform, each way: along, across, up; our own choice
START_BELOW = 0.06  # [m] the rim starts below the mouth; our own choice
HEAD_TURN, HEAD_TILT = math.radians(15), math.radians(8)  # uniform, each way; our own choice
SETTLE_STEPS = 480  # physics steps that the water gets to come to rest, once


@dataclass(frozen=True)
class DrinkingOptions(MealOptions):
    """Settings of the drinking task.

    Attributes:
        reward: `paper` in the manner of the RCareWorld paper's feeding, which has no drinking; `shaped`
            adds comfort and an upright cup.
        mount: Side of the wheelchair that the robot is mounted on.
        force_limit: Force on the person that ends the episode as a failure [N].
    """

    SHAPED_WEIGHTS = {"water": 0.1, "approach": 0.4, "drunk": 0.5, "comfort": 0.5, "upright": 0.1}


@register_task("drinking")
class Drinking(Meal):
    """A robot on the wheelchair gives the person who sits in it to drink from a cup of water.

    Goal: three quarters of the water drunk. A particle is drunk when it comes near the mouth while the
    mouth is open. Randomised at reset: where the cup starts, how the head is turned and tilted.
    Success and failure: enough is drunk; too much is spilled, or a force above the limit on the person.
    Tolerance: the share that may be spilled; that to be drunk is divided by it.
    """

    Options = DrinkingOptions
    time_limit = TIME_LIMIT
    options: DrinkingOptions

    def build(self, world: World) -> None:
        super().build(world)
        self.mouth = Mouth(self.recipient)
        self._mouth_at_rest = self.mouth.position
        self.cup = Cup()
        body = self.cup.spawn(world)
        world.set_collision(body, self._chair.body, False)
        self._hold = CupHold(
            world, self.robot, self.cup, self.recipient,
            start=self._start_rim(np.zeros(4)), lips=self._mouth_at_rest,
        )  # fmt: skip
        self._set_cup(np.zeros(4))
        self.robot.grasp(body, self.cup.in_tool)
        self.water = Fluid("water", fill(self.cup.vessel, WATER, SPACING), spacing=SPACING)
        Pool.of(world).add(self.water)
        movers = [body, *(a.body for a in self.cast.values() if isinstance(a, Robot))]
        self._safety = self.measure(self.recipient, world, movers)
        for _ in range(SETTLE_STEPS):
            for agent in self.cast.values():
                agent.actuate()
            world.step()
        inside = self.cup.vessel.frame()
        turn = matrix_from_quaternion(inside.quaternion)
        self._water_in_cup = (self.water.positions - inside.position) @ turn
        if world.contact_force(self.recipient.body) > 0:
            raise ConfigError("the robot or the cup touches the person before the episode begins")

    def cup_pose(self, rim: Vector, way: Vector, tilt: float) -> Pose:
        """Return where the cup is when it is held as here; see `Cup.pouring`."""
        return self._hold.pose(rim, way, tilt)

    def _start_rim(self, offset: Vector) -> Array:
        """Return where the rim starts: in front of the face, below the mouth."""
        gap = START_GAP[0] + (START_GAP[1] - START_GAP[0]) * float(offset[3])
        return np.add(self._mouth_at_rest, (gap + offset[0], offset[1], offset[2] - START_BELOW))

    def _set_cup(self, offset: Vector) -> None:
        """Put the robot where the cup in its hand stands upright before the face."""
        pose = self.cup_pose(self._start_rim(offset), (-1.0, 0.0, 0.0), 0.0)
        self.robot.set_posture(self.robot.solve_ik(pose @ self.cup.in_tool.inverse()).posture)
        self.cup.body.set_base(self.robot.tool_pose() @ self.cup.in_tool)

    def reset(self, rng: np.random.Generator) -> None:
        turn, tilt = rng.uniform(-HEAD_TURN, HEAD_TURN), rng.uniform(-HEAD_TILT, HEAD_TILT)
        start = {"neck_rotation_left": turn / 2, "head_rotation_left": turn / 2}
        start |= {"neck_flexion": tilt / 2, "head_flexion": tilt / 2}
        offset = np.append(rng.uniform(-1, 1, 3) * START_SPREAD, rng.uniform())
        self.recipient.set_angles({d: a for d, a in start.items() if d in self._head_dofs})
        self._set_cup(offset)
        frame = self.cup.vessel.frame()
        turned = self._water_in_cup @ matrix_from_quaternion(frame.quaternion).T
        self.water.place(turned + frame.position)
        self._drunk = np.zeros(self.water.size, np.bool_)
        self._is_spilled = self._drunk.copy()
        self._time_to_drink = -1.0
        self._safety.reset()

    def after_substep(self) -> None:
        self._safety.after_substep()
        if self.mouth.is_open:
            drunk = self.mouth.takes(self.water.positions)
            if drunk.any():
                self._drunk |= drunk
                self.water.take(drunk)

    def after_step(self) -> None:
        self._safety.after_step(self.control_dt)
        self.mouth.sense()
        vessel, positions = self.cup.vessel, self.water.positions
        self._inside = vessel.holds(positions)
        apart = positions - np.array(self.cup.frame_in_world("middle").position)
        lost = np.einsum("na,na->n", apart, apart) > LOST_DISTANCE**2
        self._is_spilled |= lost & ~self._inside & ~self._drunk
        self.drunk_share = float(np.mean(self._drunk))
        self.spilled_share = float(np.mean(self._is_spilled & ~self._drunk))
        self._up = self.cup.up_in_world()
        self.rim = vessel.rim_point(-self.mouth.ahead)
        self._gap = self.mouth.position - self.rim
        self._distance = float(np.linalg.norm(self._gap))
        self._is_enough = self.drunk_share * self.options.tolerance >= LEAST_DRUNK
        if self._time_to_drink < 0 and self._is_enough:
            self._time_to_drink = self._world.time

    def observables(self, role: str) -> Sequence[Observable]:
        mouth = self.mouth
        return [
            Observable("rim_position", "m", 3, lambda: self.rim),
            Observable("rim_to_mouth", "m", 3, lambda: self._gap),
            Observable("cup_up", "1", 3, lambda: self._up),
            Observable("face_direction", "1", 3, lambda: mouth.face),
            Observable("jaw_opening", "rad", 1, lambda: (mouth.jaw,)),
            Observable("water_in_cup", "1", 1, lambda: (float(np.mean(self._inside)),)),
            Observable("water_drunk", "1", 1, lambda: (self.drunk_share,)),
            Observable("water_spilled", "1", 1, lambda: (self.spilled_share,)),
            Observable("contact_force", "N", 1, lambda: (self._safety.force,)),
            Observable("time_left", "s", 1, lambda: (self.time_limit - self._world.time,)),
        ]

    def rewards(self, role: str) -> Mapping[str, float]:
        kept = 1.0 - self.spilled_share
        near = tolerance(self._distance, bounds=(0, RADIUS), margin=0.3)
        drunk = min(self.drunk_share / LEAST_DRUNK, 1.0)
        terms = {"water": kept * kept, "approach": kept * near, "drunk": kept * drunk}
        # An episode that ends well is paid as if it had gone on at its best: else to dawdle with the cup
        # at the lips would pay more than to give to drink.
        best = float(len(terms))
        if self.options.reward == "shaped":
            best = sum(self.options.weight(name) for name in terms)
            terms["comfort"] = -self.options.discomfort(self._safety.force, COMFORT_FORCE)
            terms["upright"] = (float(self._up[2]) - 1.0) * (1.0 - near)
            terms = self.options.weighted(terms)
        left = max(self.time_limit - self._world.time, 0.0) / self.control_dt
        terms["done"] = best * left if self.is_success() else 0.0
        return terms

    def metrics(self) -> Mapping[str, float]:
        return {
            **self._safety.metrics(),
            "distance_m": self._distance,
            "drunk_share": self.drunk_share,
            "spilled_share": self.spilled_share,
            "tilt_deg": math.degrees(math.acos(min(max(float(self._up[2]), -1.0), 1.0))),
            "time_to_drink_s": self._time_to_drink,
        }

    def is_success(self) -> bool:
        return self._is_enough and not self.is_failure()

    def is_failure(self) -> bool:
        if self.spilled_share > MOST_SPILLED * self.options.tolerance:
            return True
        return self._safety.peak_force > self.options.force_limit

    def rim_position(self) -> Array:
        """Return where the edge of the cup is that leads to the face [m], shape [3]."""
        return self.rim

    def distance(self) -> float:
        """Return the distance from that edge to the mouth [m]."""
        return self._distance


@register_policy("drinking", "recipient", "cooperative")
def cooperative(env: CareEnv, role: str) -> BehaviourTree:
    """Return a recipient who looks at the cup and opens the mouth when it comes near."""
    assert isinstance(task := env.task, Drinking)
    return eat_when_fed(task.recipient, task.rim_position, task.distance, task.control_dt)
