"""A robot's arm: its driven joints, their limits, and their kinematics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rcare_marl.body import Body
from rcare_marl.model.urdf import Follow
from rcare_marl.pose import Array, Pose
from rcare_marl.world import World

from .joint_group import JointGroup
from .kinematics import Chain, IkResult

# Starts of inverse kinematics after the posture that it was given: around it, and anywhere.
_SEEDS, _FAR_SEEDS = 12, 24
NEAR = (0.03, 0.2)  # [m], [rad] that a start may miss; our own choice
TURN_WEIGHT = 0.3  # of a radian against a metre, in inverse kinematics
LEAST_ROOM = 0.1  # share of its effort that a motor keeps beside the weight; our own choice


class Arm(JointGroup):
    """The joints of an arm and the way from the robot's root to its tool.

    Attributes:
        chain: Kinematics from the root to the tool.
        rest: Posture preferred where a tool pose leaves a choice, shape [n].
        is_carried: Whether a torso or base moves the arm, or what the robot rides on.
        hand: Indices of all links beyond its last joint.
        counterbalanced: Whether springs carry its weight, so that its motors need not.
    """

    counterbalanced: bool = False

    def __init__(
        self,
        world: World,
        body: Body,
        chain: Chain,
        rest: Sequence[float],
        followers: Mapping[str, Follow] | None = None,
        root: str | None = None,
    ) -> None:
        """Take hold of the arm of a spawned body.

        Args:
            world: Where the body is.
            body: The body.
            chain: The arm's kinematics.
            rest: Posture that it starts from and prefers, shape [n].
            followers: How other joints follow those of the arm, by name.
            root: Link that carries the arm and moves; the base of the body if None.
        """
        super().__init__(world, body, chain.joints, rest, followers, chain.telescope)
        self.chain = chain
        self._root = -1 if root is None else body.link_index(root)
        self.is_carried = self._root >= 0 or body.is_movable
        self.hand = body.carried_by(self.indices[-1])
        self.track()

    def track(self) -> None:
        """Take note of where the body carries the arm now."""
        self.chain.place(self.body.link_pose(self._root))

    def payload(self) -> tuple[float, Array]:
        """Return mass [kg] of what the hand holds, and mass times place in the tool's frame [kg·m], [3]."""
        mass, moment = 0.0, np.zeros(3)
        for body in self.world.held_by(self.body, self.hand):
            for link in range(-1, body.link_count):
                own = body.mass(link)
                mass, moment = mass + own, moment + own * np.array(body.centre_state(link)[:3])
        if not mass:
            return 0.0, moment
        real = self.chain.tip_frame(self.positions())
        return mass, real[:, :3].T @ (moment - mass * real[:, 3])

    def room(self, weight: Array) -> Array:
        """Return what the motors have left beside carrying `weight` [N·m or N], shape [n].

        It is a tenth of the effort at least: what is then missing of the weight, the motors carry as
        they do what they are told.
        """
        if self.counterbalanced:
            return self.effort
        return np.maximum(self.effort - np.abs(weight), LEAST_ROOM * self.effort)

    def balance(self) -> None:
        """Carry its weight for a physics step, as springs do."""
        self.drive_torques(self.chain.gravity_torques(self.positions()).tolist())

    def carry(self, weight: Array, motors: Array, share: float = 1.0) -> Array:
        """Return as much of `weight` as the effort allows beside `motors` [N·m or N], shape [n].

        Args:
            weight: What is to be carried, shape [n].
            motors: What the motors do besides, shape [n].
            share: What `weight` is of that which counterbalancing springs carry.
        """
        if self.counterbalanced and share == 1.0:
            return weight
        sprung = weight / share if self.counterbalanced else 0.0
        room = np.maximum(self.effort - motors, 0.0)
        return np.asarray(sprung + np.minimum(np.maximum(weight - sprung, -room), room))

    def solve(self, goal: Pose, seed: Array, *, near: bool = False) -> IkResult:
        """Return the posture that puts the tool at `goal`: the first good one, else the best.

        The search starts at `seed`, then at the rest posture, then at postures around both, then
        anywhere within the limits; these are the same on every call. What is found there is bent another way
        and may reach across somebody. With `near` 3 cm and 0.2 rad may be missed rather than that.
        """
        others = []
        for found in self.solutions(goal, seed):
            if found.is_within(*(NEAR if near else ())):
                return found
            others.append(found)
        return min(others, key=lambda result: result.distance + TURN_WEIGHT * result.angle)

    def solutions(self, goal: Pose, seed: Array) -> Iterator[IkResult]:
        """Yield what the search of `solve` finds from each of its starts, good or not.

        A joint that turns without limit gets there by the shorter way from `seed`.
        """
        endless = np.isinf(self.upper)
        for start in self._seeds(seed):
            found = self.chain.solve(
                goal, start, self.lower, self.upper, rest=self.rest, turn_weight=TURN_WEIGHT
            )
            turns = endless * np.rint((found.posture - seed) / (2 * np.pi))
            yield replace(found, posture=found.posture - 2 * np.pi * turns)

    def _seeds(self, seed: Array) -> Iterator[Array]:
        yield seed
        yield self.rest
        rng = np.random.default_rng(0)
        for k in range(_SEEDS):
            yield (seed if k % 2 else self.rest) + rng.normal(0.0, 0.5, len(self))
        lower = np.where(np.isinf(self.lower), -np.pi, self.lower)
        upper = np.where(np.isinf(self.upper), np.pi, self.upper)
        for _ in range(_FAR_SEEDS):
            yield rng.uniform(lower, upper)
