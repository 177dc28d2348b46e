"""The coach's actions: what to do, what to say, and how fast, in ten numbers in [-1, 1]."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.agents.coaching.body import RobotBody
from rcare_marl.agents.coaching.session import ACTS, WORDS, Demonstration, Order
from rcare_marl.agents.robots.control import Control
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_part import Part
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Array

LIMBS = ("left_arm", "right_arm", "head")
SIZE = len(ACTS) + len(WORDS) + 1
NAMES = (*(f"do {act}" for act in ACTS), *(f"say {word}" for word in WORDS), "tempo [octaves]")


def encode(order: Order) -> Array:
    """Return the action that gives an order, shape [10]."""
    action = -np.ones(SIZE)
    action[ACTS.index(order.act)] = action[len(ACTS) + WORDS.index(order.word)] = 1.0
    action[-1] = min(max(math.log2(order.tempo), -1.0), 1.0)
    return action


def decode(action: Array) -> Order:
    """Return the order that an action, shape [10], gives: of each group the greatest wins."""
    act = ACTS[int(np.argmax(action[: len(ACTS)]))]
    word = WORDS[int(np.argmax(action[len(ACTS) : -1]))]
    return Order(act, word, 2.0 ** float(action[-1]))


class Led(Control):
    """Control of a limb that the coach leads: it takes no action of its own."""

    size = 0
    names: tuple[str, ...] = ()
    max = np.zeros(0)

    def __init__(self, control: Control) -> None:
        """Take what moves the limb."""
        self.control = control

    def reset(self) -> None:
        self.control.reset()

    def command(self, action: Array, duration: float) -> None:
        """Do nothing: the coach leads."""


class Orders(Control):
    """Control of a whole robot that coaches: an action is an `Order`, carried out with arms and head."""

    size = SIZE
    names = NAMES
    max = np.ones(SIZE)

    def __init__(self, robot: Robot, body: RobotBody, demonstration: Demonstration) -> None:
        """Take the reins of a robot that has been spawned.

        Raises:
            ConfigError: If arms or head do not move, or not by `joint_position`.
        """
        missing = [limb for limb in LIMBS if limb not in robot.parts]
        if missing:
            raise ConfigError(
                f"to coach, {robot.name!r} needs {', '.join(missing)} among its `moves`"
            )
        self._limbs: dict[str, Control] = {}
        for limb in LIMBS:
            control = robot.parts[limb].control
            if not hasattr(control, "action_for"):
                raise ConfigError(
                    f"to coach, {robot.name!r} needs the control mode 'joint_position', got "
                    f"{type(control).__name__}"
                )
            self._limbs[limb] = control
            robot.parts[limb].control = Led(control)
        self._body, self._demonstration = body, demonstration

    def reset(self) -> None:
        """Nothing to do: the task begins the session."""

    def command(self, action: Array, duration: float) -> None:
        self._demonstration.perform(decode(action), duration)
        for limb, control in self._limbs.items():
            wanted = self._body.target(limb, duration)
            control.command(control.action_for(wanted), duration)  # type: ignore[attr-defined]


class CoachPart(Part):
    """The coach as a part of the robot that actions move; it senses nothing of itself."""

    def __init__(self, orders: Orders) -> None:
        super().__init__("coach", orders)

    def observables(self) -> list[Observable]:
        return []
