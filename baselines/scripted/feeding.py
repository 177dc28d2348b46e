"""A hand-written robot that feeds: level the spoon, come in front of the mouth, wait, go in.

Between bites it draws back until the spoon is filled, and waits until the mouth is empty. From who does not
want it, it draws back at once. Where something hangs in the way, it plans a way round it first.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np

from rcare_marl.agents.agent import Agent
from rcare_marl.body import Body
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.meal import OPEN_MOUTH, TAKEN_AWAY
from rcare_marl.envs.scenes.refusal import Refusal
from rcare_marl.envs.tasks.feeding import FOOD_COUNT, LOADED_FROM, Feeding, FeedingState
from rcare_marl.errors import ConfigError, PlanningError
from rcare_marl.observable import VECTOR
from rcare_marl.pose import Array, Pose, about_z, quaternion_from_axis_angle, rotate

from .offering import BACK, PAUSE, Offering
from .tool_script import Detour, ToolScript, limited, turning, unit

# All our own choices.
WAIT_IN_FRONT = 0.09  # [m] from mouth to bowl while the mouth is closed
ASK = 0.20  # [m] from mouth to bowl, where it is offered to who just said no
CLEAR = 0.03  # [m] beyond where the spoon is filled, or was taken away
FACING = 0.5  # of the turn of a face off the way of the chair: farther some arms do not reach
GAIN, TURN_GAIN = 2.5, 2.5  # [1/s]
FAST, SLOW = 0.20, 0.06  # [m/s] far from the mouth, and near it
NEAR = 0.12  # [m]
ACCELERATION = 0.6  # [m/s²] that keeps food on the spoon
FROM_PERSON, FROM_BAG = 0.02, 0.02  # [m] that it keeps on the way round
ROUND = 0.12, 0.16  # [m] from mouth to bowl, to where a way round an obstacle may lead
TURNED = 0.0, 0.3, -0.3, 0.6, -0.6  # [rad] from ahead of the face, likewise
TILT = 0.15  # [rad] that the spoon may lean on it
LOOKING = 0.5  # [s] after which it looks again whether that is still free


@register_policy("feeding", "robot", "scripted")
class ScriptedFeeding(ToolScript[Feeding]):
    """Levels the spoon, waits before the mouth until it opens, and goes in; sees everything."""

    KIND = Feeding

    def _begin(self) -> None:
        self._velocity, self._offering = np.zeros(3), Offering()
        self._mouth: Array | None = None
        self._detour: Detour | None = None
        self._again, self._look, self._plans, self._left = 0.0, 0.0, 0, 0
        self._face = np.array((1.0, 0.0, 0.0))

    def _seen(self) -> FeedingState:
        """Return what it goes by."""
        return self._task.state

    def act(self) -> Array:
        task, seen = self._task, self._seen()
        offers = self._offering.once_back(seen.refusal, seen.distance > BACK)
        if self._mouth is None or (offers and not seen.refusal.turned):  # nobody is chased
            self._mouth, self._face = seen.mouth, seen.face
        turned = FACING * math.atan2(self._face[1], self._face[0])
        level = np.array((math.cos(turned), math.sin(turned), 0.0))
        goes_in = seen.jaw > OPEN_MOUTH and seen.mouthful.is_ready
        away = 0.0 if goes_in else WAIT_IN_FRONT
        if seen.eaten == FOOD_COUNT:
            away = LOADED_FROM + CLEAR
        goal = self._mouth + away * self._face
        if (
            not offers or seen.refusal.is_no
        ):  # straight back: ahead of a face it may be out of reach
            goal = seen.mouth + (ASK if offers else TAKEN_AWAY + CLEAR) * unit(
                seen.bowl - seen.mouth
            )
        planned = self._round(self._mouth, level) if task.bag.bodies else None
        if planned is not None:
            goal = planned[0]
        error = goal - seen.bowl
        wished = limited(GAIN * error, SLOW if offers and seen.distance < NEAR else FAST)
        step = ACCELERATION * task.control_dt
        self._velocity = self._velocity + limited(wished - self._velocity, step)
        turn = turning(task.spoon_facing(-level), seen.turn, TURN_GAIN)
        if seen.refusal.turned:  # it asks from where it is, and does not go round the head
            turn = np.zeros(3)
        if planned is not None:
            turn = turning(planned[1], self._robot.tool_pose().quaternion, TURN_GAIN)
        return self._about(seen.bowl, self._velocity, turn)  # so that turning does not move food

    def _round(self, mouth: Array, level: Array) -> tuple[Array, tuple[float, ...]] | None:
        """Return the next place of the bowl on a planned way before the face, and how the tool is turned.

        None from its end on. Where it gets no further, or there is none, it waits and plans again; where
        somebody has come into it, it plans at once.
        """
        task, seen = self._task, self._task.state
        stay = seen.bowl, self._robot.tool_pose().quaternion
        if self._detour is None:
            if seen.time < self._again:
                return stay
            self._plans += 1
            self._again = seen.time + PAUSE
            ends = []
            for away, turn in itertools.product(ROUND, TURNED):
                facing = rotate(about_z(turn), -level)
                place = tuple((mouth - away * facing).tolist())
                bowl = Pose(place, tuple(task.spoon_facing(facing).tolist()))
                ends.append(task.tool_for(bowl))
            try:
                seed = 100 * self._plans
                detour = Detour(self._robot, ends, seen.bowl, self._kept(), TILT, seed)
            except PlanningError:
                return stay
            self._detour, self._left, self._look = detour, detour.left, seen.time + LOOKING
        if seen.time > self._look:
            self._look = seen.time + LOOKING
            if not self._detour.is_clear():
                self._detour, self._again = None, seen.time
                return stay
        step = self._detour.next(seen.bowl)
        if self._detour.left < self._left:
            self._left, self._again = self._detour.left, seen.time + PAUSE
        elif step is not None and seen.time > self._again:
            self._detour = None
            return stay
        return step

    def _kept(self) -> dict[Agent | Body, float]:
        """Return how far to keep from whom [m]."""
        return {self._task.recipient: FROM_PERSON, **dict.fromkeys(self._task.bag.bodies, FROM_BAG)}


@register_policy("feeding", "robot", "observing")
class ObservingFeeding(ScriptedFeeding):
    """The same by what the robot observes alone: with its noise, its bias and its gaps.

    How the spoon lies in the hand it knows. Of one spoonful, with nothing in the way.
    """

    def __init__(self, env: CareEnv, role: str) -> None:
        """Take the environment and the robot's role.

        Raises:
            ConfigError: As the script; or if there are several bites or an obstacle, or a no is not observed.
        """
        super().__init__(env, role)
        told = self._task.options
        if told.bites > 1 or told.obstacle != "none" or not told.refusals_observed:
            raise ConfigError(
                "the observing script of Feeding needs bites 1, no obstacle and refusals_observed"
            )
        self._env, self._role = env, role
        self._places = {name: at for at, name, _ in env.describe(role)}
        self._tool = np.zeros(3)

    def _seen(self) -> FeedingState:
        told = self._env.observe(self._role)
        vector = told[VECTOR] if isinstance(told, dict) else told
        see = {name: np.asarray(vector[at], np.float64) for name, at in self._places.items()}
        self._tool, way = see["tool_position"], see["bowl_to_mouth"]
        spin = see["tool_rotation"]
        angle = max(float(np.linalg.norm(spin)), 1e-9)
        tool = Pose(
            (0.0, 0.0, 0.0), tuple(quaternion_from_axis_angle(spin / angle, angle).tolist())
        )
        is_no = bool(see["says_no"][0] > 0.5)
        return dataclasses.replace(
            self._task.state,
            bowl=see["bowl_position"],
            turn=np.array((tool @ self._task.tool_for(Pose()).inverse()).quaternion),
            mouth=see["bowl_position"] + way,
            face=unit(see["face_direction"]),
            distance=float(np.linalg.norm(way)),
            jaw=float(see["jaw_opening"][0]),
            eaten=round(FOOD_COUNT * float(see["food_eaten"][0])),
            refusal=Refusal(  # a face that turns away counts once it is observed as a no
                is_no=is_no,
                turned=int(is_no),
                count=round(float(see["refusals"][0])),
                stands=bool(see["no_stands"][0] > 0.5),
            ),
        )

    def _about(self, point: Array, linear: Array, spin: Array) -> Array:
        lever = self._tool - point
        return self._robot.tool_action(linear + np.cross(spin, lever), spin)
