"""The skills of a caregiver, one by one; see `caregiving.Caregiving`, which uses them in order."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, PlanningError

from ..body.goal import Direction, Goal, Point, Position
from ..body.ik import present_angles
from ..body.skeleton import DOF_INDEX, SIDES
from ..hand import GRIP_GAP
from ..hand import LEAST as LEAST_GRIP
from .gait import STEP_LENGTH, Station, sizes
from .legs import LEAST, Legs
from .trajectory import PEAK, Trajectory, minimum_jerk

if TYPE_CHECKING:
    from .caregiving import Caregiving

# Corners on the floor [m], the goal last, or what returns those from here.
Way: TypeAlias = Sequence[tuple[float, float]] | Callable[[], Sequence[tuple[float, float]]]

# Our own choices.
HAND_SPEED = 0.35  # [m/s] of a hand at its quickest
GRIP_FORCE = 80.0  # [N] that a hand holds a limb with, along each axis: careful, not firm
NEAR, NEAR_LADEN = 0.015, 0.03  # [m] from its goal at which a hand has arrived, free and holding
PATIENCE = (
    2.0  # [s] that a hand is given to arrive after its movement should be over, and to come nearer
)
NEARER = 0.005  # [m] that is headway
CORRECTION, LARGEST_CORRECTION = 1.5, 0.3  # [1/s] of what is left, to aim beside; [m] in all
STEER = 0.15  # weight of a wished direction of palm or fingers, a radian against a metre
STEERED = math.radians(30)  # that counts as well enough directed; only the place decides
LOOKING = 1.0  # [s] after which somebody on the way looks again where it goes
ARM_SWING = math.radians(14)  # of a shoulder at a full step, each way; the elbow bends half as much


class Skill:
    """One thing to do. `begin` once, then `wish` once a control step until it is over."""

    def __init__(self, owner: Caregiving) -> None:
        self._owner = owner

    def begin(self) -> None:
        """Start."""

    def wish(self) -> dict[str, float]:
        """Return wished angles [rad] for the coming control step."""
        return {}

    def is_over(self) -> bool:
        """Return whether it is done."""
        return True


class WalkTo(Skill):
    """A walk over the floor, from corner to corner: turning on the spot, walking, turning."""

    def __init__(
        self,
        owner: Caregiving,
        legs: Legs,
        way: Way,
        heading: float,
    ) -> None:
        points = () if callable(way) else way
        if not np.isfinite([heading, *(value for point in points for value in point)]).all():
            raise ConfigError(
                f"a walk needs points [m] and a heading [rad], all finite; got {list(points)}, {heading}"
            )
        self._owner, self._legs, self._way, self._heading = owner, legs, way, heading

    def begin(self) -> None:
        self._look()

    def _look(self) -> None:
        """See where the way goes."""
        owner, begin = self._owner, time.thread_time()
        self._asked = owner.world.time
        try:
            points = self._way() if callable(self._way) else self._way
        except PlanningError as error:
            owner.trouble = str(error)
            return
        owner.planning_s += time.thread_time() - begin
        self._corners = [Station(x, y, 0.0) for x, y in points]

    def wish(self) -> dict[str, float]:
        if callable(self._way) and self._owner.world.time > self._asked + LOOKING:
            self._look()
        self._owner.walk = self._shares()
        return {} if self._owner.is_holding else self._arms()

    def _shares(self) -> tuple[float, float, float]:
        """Return the shares of the greatest speeds that the next step is to have."""
        here = self._legs.station
        while self._corners:
            forward, left = self._corners[0].seen_from(here)
            distance, bearing = math.hypot(forward, left), math.atan2(left, forward)
            if distance < LEAST * STEP_LENGTH:
                del self._corners[0]
                continue
            # Shorter ways need no turn: a step aside does.
            if distance > 0.5 * STEP_LENGTH and abs(self._share(2, bearing)) >= LEAST:
                return 0.0, 0.0, self._share(2, bearing)
            return self._share(0, forward), self._share(1, left), 0.0
        return 0.0, 0.0, self._share(2, math.remainder(self._heading - here.heading, 2 * math.pi))

    def _share(self, axis: int, way: float) -> float:
        """Return the share with which the fewest steps, all alike, go a way [m or rad] along an axis."""
        wanted, gone, share = [0.0, 0.0, 0.0], 0.0, 0.0
        wanted[axis] = way
        side = self._legs.next_side or ("left" if way > 0 or axis == 0 else "right")
        while gone < abs(way) - 1e-9:
            gone += sizes(side, wanted)[axis]
            side = SIDES[1 - SIDES.index(side)]
            share = way / gone if gone else 0.0
        return share

    def _arms(self) -> dict[str, float]:
        """Return how arms swing against the legs, about where they hung at the start [rad]."""
        person, rest = self._owner.person, self._owner.rest_wish()
        here = Station.below(person.pelvis)
        ahead = {}
        for side in SIDES:
            x, y, _ = person.joint_pose(f"{side}_ankle").position
            ahead[side] = Station(x, y, 0.0).seen_from(here)[0]
        for side, other in zip(SIDES, SIDES[::-1], strict=True):
            share = max(-1.0, min((ahead[other] - ahead[side]) / (2 * STEP_LENGTH), 1.0))
            for dof, swing in (("shoulder_flexion", share), ("elbow_flexion", max(share, 0.0) / 2)):
                if f"{side}_{dof}" in rest:
                    rest[f"{side}_{dof}"] += ARM_SWING * swing
        return rest

    def is_over(self) -> bool:
        owner = self._owner
        is_there = not owner.trouble and max(map(abs, self._shares())) < LEAST
        if not (is_there or owner.trouble) or not self._legs.stands:
            return False
        owner.walk = (0.0, 0.0, 0.0)
        owner.angles, owner.aside = present_angles(owner.person), np.zeros(3)
        return True


class Kneel(Skill):
    """Going down on one knee, or rising again."""

    def __init__(self, owner: Caregiving, legs: Legs, knee: str) -> None:
        self._owner, self._legs, self._knee = owner, legs, knee

    def begin(self) -> None:
        self._owner.knee = self._knee

    def is_over(self) -> bool:
        if not (self._legs.kneeling[self._knee] == 1.0 if self._knee else self._legs.stands):
            return False
        self._owner.angles, self._owner.aside = present_angles(self._owner.person), np.zeros(3)
        return True


class Reach(Skill):
    """A straight way of the hand, with or without something in it."""

    def __init__(
        self,
        owner: Caregiving,
        point: Point | Callable[[], Point],
        palm: Point | None,
        fingers: Point | None,
        speed: float,
        near: float | None,
        *,
        follows: bool = False,
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
        self._follows = follows
        if not callable(point):
            Position(owner.wrist, point)  # complains now about what could never be reached

    def begin(self) -> None:
        owner = self._owner
        usual = NEAR_LADEN if owner.is_holding else NEAR
        self._near = usual if self._wanted is None else self._wanted
        aim, turn = owner.wished_hand()
        self._start = aim - owner.aside
        self._from = [turn @ np.asarray(d.local) for d in self._steer]
        self._find_goal()
        way = float(np.linalg.norm(self._goal - self._start))
        self._duration = max(PEAK * way / self._speed, owner.control_dt)
        self._since, self._rest = owner.world.time, owner.angles.copy()
        self._least, self._patient = math.inf, self._since + self._duration + PATIENCE
        if not owner.can_reach(self._goal, self._near):
            owner.trouble = (
                f"the {owner.side} arm does not reach {np.round(self._goal, 2)} from here"
            )

    def _passed(self) -> float:
        return self._owner.world.time - self._since

    def _find_goal(self) -> None:
        self._goal = np.asarray(self._point() if callable(self._point) else self._point, np.float64)

    def wish(self) -> dict[str, float]:
        owner = self._owner
        if self._follows:
            self._find_goal()
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
            if np.linalg.norm(between) > 0.1:  # else opposite ends: wait until past the middle
                goals.append(Direction(owner.wrist, between, goal.local, STEER, STEERED))
        owner.towards(goals, self._rest)
        return owner.wished()

    def is_over(self) -> bool:
        if self._owner.trouble:
            return True
        left = float(np.linalg.norm(self._goal - self._owner.hand()))
        if self._passed() >= self._duration and left < self._near:
            return True
        if left < self._least - NEARER:
            self._least = left
            self._patient = max(self._patient, self._owner.world.time + PATIENCE)
        if self._owner.world.time < self._patient:
            return False
        self._owner.trouble = (
            f"the hand stays {left:.2f} m from {np.round(self._goal, 2)}: something holds it back"
        )
        return True


class Grasp(Skill):
    """A grasp of what is at the hand."""

    def __init__(self, owner: Caregiving, body: Body, link: int, force: float) -> None:
        least, most = LEAST_GRIP * owner.able_hand.force, owner.able_hand.force
        if not least <= force <= most:
            raise ConfigError(
                f"the force of a grasp must be from {least:g} to {most:g} N, got {force} N"
            )
        self._owner, self._body, self._link = owner, body, link
        self._share = force / most

    def begin(self) -> None:
        owner = self._owner
        self._tries = 0
        gap = owner.able_hand.gap(self._body, self._link)
        if gap > GRIP_GAP:
            owner.trouble = (
                f"{self._body.name!r} is {gap:.2f} m from the hand, too far to grasp: within "
                f"{GRIP_GAP} m it can be"
            )
            return
        owner.closing = self._share

    def is_over(self) -> bool:
        owner = self._owner
        if owner.trouble or owner.able_hand.holds(self._body, self._link):
            return True
        self._tries += 1
        if self._tries > 1:
            owner.closing = -1.0
            owner.trouble = f"the hand did not get hold of {self._body.name!r}: may it take that?"
        return bool(owner.trouble)


class Release(Skill):
    """Letting go."""

    def begin(self) -> None:
        self._owner.closing = -1.0
        self._owner.aside = np.zeros(3)

    def is_over(self) -> bool:
        return not self._owner.is_holding


class LowerArm(Skill):
    """The arm goes back to where it hung at the start."""

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
