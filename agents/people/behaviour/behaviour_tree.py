"""A person who follows a behaviour tree, and policies that are simpler than that."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from rcare_marl.errors import ConfigError
from rcare_marl.pose import conjugate, rotate

from ...agent import Array
from ..actuation.muscular import MuscleDrive
from ..body.ik import reach
from ..body.skeleton import DOF_INDEX, JOINT_INDEX, forward_kinematics
from ..human import Human
from .leaves import Actor, Condition, Deed, Intent, Pursue, Threshold, first_of, together, when

# All our own choices.
OPENING = 0.8  # share of the active range that an eating mouth opens
CHEWING, CHEWING_RATE = 0.07, 1.25  # [rad], [1/s] of the jaw with something in the mouth


class BehaviourTree:
    """A policy that ticks a tree once a control step and pursues the angles that its leaves wish."""

    def __init__(
        self,
        person: Human,
        intent: Intent,
        root: Behaviour,
        control_dt: float,
        deed: Deed | None = None,
    ) -> None:
        """Prepare the policy.

        Args:
            person: Who acts.
            intent: Wished angles [rad], written by the leaves.
            root: The tree.
            control_dt: Length of a control step [s].
            deed: What the leaves do beside; nothing if None.
        """
        self.root, self._deed = root, deed or Deed()
        self._person, self._intent = person, intent
        self._control_dt = control_dt

    def reset(self, rng: np.random.Generator) -> None:
        self.root.stop(Status.INVALID)
        for node in self.root.iterate():
            if isinstance(node, Threshold):
                node.forget()
        self._intent.clear()

    def act(self) -> Array:
        self._deed.clear()
        self.root.tick_once()
        action = self._moving()
        action[self._person.entries.get("speak", slice(0))] = self._deed.says_no
        return action

    def _moving(self) -> Array:
        if not self._intent and isinstance(self._person.drive, MuscleDrive):
            return self._person.slack_action(self._control_dt)  # who wishes nothing lets go
        return self._person.action_towards(self._intent, self._control_dt)


class StayStill:
    """A policy that never asks for any movement: a zero action in every control step."""

    def __init__(self, action_size: int) -> None:
        self._action = np.zeros(action_size)

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing to begin."""

    def act(self) -> Array:
        return self._action


class RandomPolicy:
    """A policy that knows nothing: every action is drawn uniformly from the whole action box."""

    def __init__(self, action_size: int, low: float = -1.0) -> None:
        """Take the number of action values and the least of each."""
        self._size, self._low = action_size, low
        self._rng = np.random.default_rng(0)

    def reset(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def act(self) -> Array:
        return self._rng.uniform(self._low, 1.0, self._size)


class GoAlong:
    """Relaxes: whoever moves the person meets the weight of the limb, and no will."""

    def __init__(self, person: Human, control_dt: float) -> None:
        """Take the person, and the length of a control step [s]."""
        self._person, self._control_dt = person, control_dt

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing to begin."""

    def act(self) -> Array:
        """Return the action that slackens the muscles: targets that give way, or no excitation."""
        return self._person.slack_action(self._control_dt)


class Reach:
    """A policy that brings a hand to a point, as far as the profile lets it, whatever drives the person.

    Inverse kinematics within the active range finds the posture, and `Human.action_towards` the action:
    with muscles the excitations that pursue it.

    Attributes:
        grasps: Returns whether the hands that can grasp are to close.
    """

    def __init__(
        self, person: Human, side: str, point: Callable[[], Array], *, control_dt: float
    ) -> None:
        """Prepare the policy.

        Args:
            person: Who reaches.
            side: `left` or `right`.
            point: Returns where the middle of the hand should be in the world [m], shape [3].
            control_dt: Length of a control step [s].
        """
        self._person, self._side, self._point = person, side, point
        self._control_dt = control_dt
        self.grasps: Callable[[], bool] = lambda: False
        self._wish: dict[str, float] = {}
        self._aim = np.full(3, np.nan)

    def reset(self, rng: np.random.Generator) -> None:
        self._aim[:] = np.nan

    def act(self) -> Array:
        aim = np.asarray(self._point(), np.float64)
        if not np.array_equal(aim, self._aim):  # a point that stays is solved for once
            self._aim[:] = aim
            found = reach(self._person, self._side, aim, trunk=False)
            if not found.success:  # who can reach it so does not lean
                found = reach(self._person, self._side, aim)
            self._wish = found.wish
        action = self._person.action_towards(self._wish, self._control_dt)
        action[self._person.entries.get("grasp", slice(0))] = self.grasps()
        return action


def look_at(
    person: Human, point: Callable[[], Array], *, beyond: float = 0.15
) -> Callable[[], dict[str, float]]:
    """Return the angles of neck and head that turn the mouth towards a point in the world [m].

    Within `beyond` [m] of the mouth the direction means nothing any more: then the head keeps still. Who
    leans or is bent in the posture that they begin in makes up for it.
    """
    halves = [
        (f"{joint}_{motion}", motion)
        for joint in ("neck", "head")
        for motion in ("rotation_left", "flexion")
        if f"{joint}_{motion}" in person.movable
    ]
    limits = {dof: person.active[person.movable.index(dof)] for dof, _ in halves}

    def turn_to(local: Array) -> dict[str, float]:  # a way in the frame of the pelvis
        return {
            "rotation_left": float(np.arctan2(local[0], local[2])),
            "flexion": float(np.arctan2(-local[1], np.hypot(local[0], local[2]))),
        }

    rotations, _ = forward_kinematics(person.model.joints, person.angles)
    lean = turn_to(rotations[JOINT_INDEX["head"]][:, 2])
    for dof, motion in halves:
        lean[motion] -= float(person.angles[DOF_INDEX[dof]])

    def wish() -> dict[str, float]:
        way = point() - person.mouth_position()
        if way @ way < beyond**2:
            return {}
        turn = turn_to(rotate(conjugate(person.body.base_pose().quaternion), way))
        return {
            dof: float(np.clip((turn[motion] - lean[motion]) / 2, *limits[dof]))
            for dof, motion in halves
        }

    return wish


def closed_or_chewing(is_full: Callable[[], bool], clock: Callable[[], float]) -> float:
    """Return where a jaw goes that takes nothing [rad]: closed, or up and down while it chews."""
    return CHEWING * math.sin(math.pi * CHEWING_RATE * clock()) ** 2 if is_full() else 0.0


def eat_when_fed(
    person: Human,
    spoon: Callable[[], Array],
    gap: Callable[[], float],
    control_dt: float,
    *,
    is_full: Callable[[], bool] = lambda: False,
    clock: Callable[[], float] = lambda: 0.0,
) -> BehaviourTree:
    """Return a person who watches the spoon, opens the mouth when it is near, and closes it again.

    With the mouth full they chew, and open it for nothing.

    Args:
        person: Who eats.
        spoon: Returns where the spoon's bowl is in the world [m].
        gap: Returns the distance from bowl to mouth [m].
        control_dt: Length of a control step [s].
        is_full: Returns whether something is in the mouth.
        clock: Returns the simulated time [s].

    Raises:
        ConfigError: If the jaw cannot move.
    """
    actor, jaw = Actor(person, clock=clock), "jaw_opening"
    if jaw not in person.movable:
        raise ConfigError(
            f"to eat, {person.name!r} needs {jaw!r} among the movable degrees of freedom"
        )
    widest = float(person.active[person.movable.index(jaw), 1]) * OPENING
    near = Condition("spoon is near", lambda: gap() < 0.20 and not is_full())
    opened = Pursue("open the mouth", actor, lambda: {jaw: widest})
    closed = Pursue(
        "close the mouth or chew", actor, lambda: {jaw: closed_or_chewing(is_full, clock)}
    )
    eating = first_of("eat", when("take the food", near, opened), closed)
    watched = Pursue("watch the spoon", actor, look_at(person, spoon))
    return BehaviourTree(person, actor.intent, together("be fed", watched, eating), control_dt)
