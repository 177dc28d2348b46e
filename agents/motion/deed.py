"""The deeds of a caregiver, one by one; see `caregiving.Caregiving`, which does them in order."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, UnknownNameError

from ..body.goal import Direction, Goal, Point, Position
from ..body.ik import present_angles
from ..body.skeleton import DOF_INDEX, JOINT_INDEX, SIDES
from .kneel import Kneel
from .playback import Puppet
from .trajectory import PEAK, Trajectory, minimum_jerk
from .walk import Walk

if TYPE_CHECKING:
    from .caregiving import Caregiving

# Our own choices.
HAND_SPEED = 0.35  # [m/s] of a hand at its quickest
GRIP_FORCE = 80.0  # [N] that a hand holds a limb with, along each axis: careful, not firm
GRIP_GAP = 0.05  # [m] between hand and what it grasps, at most
SLIPPED = 0.10  # [m] between them at which a grasp is lost
NEAR, NEAR_LADEN = 0.015, 0.03  # [m] from its goal at which a hand has arrived, free and holding
PATIENCE = 2.0  # [s] that a hand is given to arrive after its movement should be over
CORRECTION, LARGEST_CORRECTION = 1.5, 0.3  # [1/s] of what is left, to aim beside; [m] in all
STEER = 0.15  # weight of a wished direction of palm or fingers, a radian against a metre
STEERED = math.radians(30)  # that counts as well enough directed; only the place decides


class Deed:
    """One thing to do. `begin` once, then `wish` once a control step until it is over."""

    def begin(self) -> None:
        """Start."""

    def wish(self) -> dict[str, float]:
        """Return wished angles [rad] for the coming control step."""
        return {}

    def is_over(self) -> bool:
        """Return whether it is done."""
        return True


class Walking(Deed):
    """A walk over the floor."""

    def __init__(
        self,
        owner: Caregiving,
        points: Sequence[tuple[float, float]],
        heading: float,
        step_time: float,
    ) -> None:
        self._owner, self._points, self._heading = owner, points, heading
        self._step_time = step_time

    def begin(self) -> None:
        person, world = self._owner.person, self._owner.world
        walk = Walk(
            person,
            self._points,
            self._heading,
            step_time=self._step_time,
            swings_arms=not self._owner.is_holding,
        )
        person.course = Puppet(person, walk.motion, lambda: world.time)

    def is_over(self) -> bool:
        if self._owner.person.course is not None:
            return False
        self._owner.angles, self._owner.aside = present_angles(self._owner.person), np.zeros(3)
        return True


class Kneeling(Deed):
    """Going down on one knee."""

    def __init__(self, owner: Caregiving, knee: str) -> None:
        if knee not in SIDES:
            raise UnknownNameError("side", knee, SIDES)
        self._owner, self._knee = owner, knee

    def begin(self) -> None:
        person, world = self._owner.person, self._owner.world
        motion = Kneel(person, knee=self._knee).motion
        person.course = Puppet(person, motion, lambda: world.time)

    def is_over(self) -> bool:
        if self._owner.person.course is not None:
            return False
        self._owner.angles, self._owner.aside = present_angles(self._owner.person), np.zeros(3)
        return True


class Reaching(Deed):
    """A straight way of the hand, with or without something in it."""

    def __init__(
        self,
        owner: Caregiving,
        point: Point | Callable[[], Point],
        palm: Point | None,
        fingers: Point | None,
        speed: float,
        near: float | None,
    ) -> None:
        for name, value in (("speed", speed), ("tolerance", NEAR if near is None else near)):
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"the {name} of a hand must be positive, got {value}")
        sign = 1.0 if owner.side == "left" else -1.0
        self._owner, self._point, self._speed, self._wanted = owner, point, speed, near
        # In the T-pose palms look down, and the fingers of the left hand point left.
        wished = ((palm, (0.0, -1.0, 0.0)), (fingers, (sign, 0.0, 0.0)))
        self._steer = [
            Direction(owner.wrist, target, local, STEER, STEERED)
            for target, local in wished
            if target is not None
        ]
        if not callable(point):
            Position(owner.wrist, point)  # complains now about what could never be reached

    def begin(self) -> None:
        owner = self._owner
        usual = NEAR_LADEN if owner.is_holding else NEAR
        self._near = usual if self._wanted is None else self._wanted
        aim, turn = owner.wished_hand()
        self._start = aim - owner.aside
        self._from = [turn @ np.asarray(d.local) for d in self._steer]
        self._goal = np.asarray(self._point() if callable(self._point) else self._point, np.float64)
        way = float(np.linalg.norm(self._goal - self._start))
        self._duration = max(PEAK * way / self._speed, owner.control_dt)
        self._since, self._rest = owner.world.time, owner.angles.copy()
        if not owner.can_reach(self._goal, self._near):
            owner.trouble = (
                f"the {owner.side} arm does not reach {np.round(self._goal, 2)} from here"
            )

    def _passed(self) -> float:
        return self._owner.world.time - self._since

    def wish(self) -> dict[str, float]:
        owner = self._owner
        # A load draws the hand down: aim beside the way by as much as it takes.
        here = minimum_jerk(self._passed() / self._duration)
        gap = self._start + here * (self._goal - self._start) - owner.hand()
        aside = owner.aside
        if not (owner.is_holding and owner.strives):  # else joints try harder themselves
            aside = aside + CORRECTION * owner.control_dt * gap
        aside *= min(1.0, LARGEST_CORRECTION / max(float(np.linalg.norm(aside)), 1e-9))
        owner.aside = aside
        share = minimum_jerk((self._passed() + owner.control_dt) / self._duration)
        point = self._start + share * (self._goal - self._start) + aside
        goals: list[Goal] = [Position(owner.wrist, point, owner.grip, tolerance=NEAR)]
        for goal, now in zip(self._steer, self._from, strict=True):
            between = (1 - share) * now + share * np.asarray(goal.target)
            if (
                float(np.linalg.norm(between)) > 0.1
            ):  # else opposite ends: wait until past the middle
                goals.append(Direction(owner.wrist, between, goal.local, STEER, STEERED))
        owner.towards(goals, self._rest)
        return owner.wished()

    def is_over(self) -> bool:
        if self._owner.trouble:
            return True
        left = float(np.linalg.norm(self._goal - self._owner.hand()))
        if self._passed() >= self._duration and left < self._near:
            return True
        if self._passed() < self._duration + PATIENCE:
            return False
        self._owner.trouble = (
            f"the hand stays {left:.2f} m from {np.round(self._goal, 2)}: something holds it back"
        )
        return True


class Grasping(Deed):
    """A grasp of what is at the hand."""

    def __init__(self, owner: Caregiving, body: Body, link: int, force: float) -> None:
        if not (math.isfinite(force) and force > 0):
            raise ConfigError(f"the force of a grasp must be positive, got {force} N")
        self._owner, self._body, self._link, self._force = owner, body, link, force

    def begin(self) -> None:
        owner = self._owner
        hand = owner.person.frames[JOINT_INDEX[owner.wrist]].link
        gap = owner.world.separation(
            owner.person.body, self._body, within=1.0, links=(hand, self._link)
        )
        if gap > GRIP_GAP:
            owner.trouble = (
                f"{self._body.name!r} is {gap:.2f} m from the hand, too far to grasp: within "
                f"{GRIP_GAP} m it can be"
            )
            return
        owner.hold(self._body, self._link, self._force)


class Releasing(Deed):
    """Letting go."""

    def __init__(self, owner: Caregiving) -> None:
        self._owner = owner

    def begin(self) -> None:
        self._owner.let_go()
        self._owner.aside = np.zeros(3)


class Lowering(Deed):
    """The arm goes back to where it hung at the start."""

    def __init__(self, owner: Caregiving) -> None:
        self._owner = owner

    def begin(self) -> None:
        owner = self._owner
        rest = owner.rest_wish()
        self._way = Trajectory.through({dof: owner.person.angle(dof) for dof in rest}, [rest])
        self._since = owner.world.time

    def _passed(self) -> float:
        return self._owner.world.time - self._since

    def wish(self) -> dict[str, float]:
        wish = self._way.sample(self._passed() + self._owner.control_dt)
        for dof, angle in wish.items():
            self._owner.angles[DOF_INDEX[dof]] = angle
        return wish

    def is_over(self) -> bool:
        return self._passed() >= self._way.duration
