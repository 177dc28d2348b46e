"""A caregiver who is asked for one thing after the other: walk up, reach, grasp, move, let go, kneel.

Skills are asked for in order and used over simulated time, by a policy that gives one action a control step
and does nothing else: it walks, kneels and grasps by the values of the action that do (`Human.moves`). Arms
move by the person's own drive, so that they are as strong as the person is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array, rotate
from rcare_marl.world import World

from ..body.goal import Gaze, Goal, Point, Position
from ..body.ik import WholeBodyIk, arm_dofs, grip_point, present_angles
from ..body.skeleton import DOF_INDEX, DOFS, JOINT_INDEX, SIDES, forward_kinematics
from ..hand import Hand
from ..human import Human, part_of
from .legs import Legs
from .skill import (
    GRIP_FORCE,
    HAND_SPEED,
    NEAR_LADEN,
    STEERED,
    Grasp,
    Kneel,
    LowerArm,
    Reach,
    Release,
    Skill,
    WalkTo,
    Way,
)

# Our own choices.
STRIVING = 0.15  # of what a joint sags, learned in a control step
LARGEST_SAG = 0.5  # [rad] that is wished beside a joint's angle at most


class Striving:
    """Wishes more of joints that a load in the hand keeps from where they are wished to be, one by one."""

    def __init__(self, person: Human) -> None:
        self._person = person
        self._sag: dict[str, float] = {}  # of joints under a load [rad]

    def forget(self) -> None:
        """Begin anew, as without a load."""
        self._sag.clear()

    def add(self, wish: dict[str, float], share: float = STRIVING) -> None:
        """Change wished angles by DoF [rad], after a share of what joints sag now is learned."""
        person = self._person
        for dof in wish:
            i = person.movable.index(dof)
            sag, now = self._sag.get(dof, 0.0), person.drive.target[i] - person.angle(dof)
            sag += share * (float(now) - sag)
            self._sag[dof] = min(max(sag, -LARGEST_SAG), LARGEST_SAG)
            wish[dof] += self._sag[dof]


class Caregiving:
    """A policy that does what is asked for, in the order of asking.

    Use it by itself as the policy of a role, or through `Do` as a leaf of a behaviour tree.

    Attributes:
        walk: Shares of the greatest speeds that it walks with: forward, left, turning left.
        knee: The side of the knee that it goes down on, or stays on; empty to stand.
        closing: Share of its strength that the hand closes with; below zero it opens.
        trouble: Why a skill failed; empty while all goes well. What was still to do is
            dropped then.
        strives: Whether joints that a load in the hand makes sag try harder, one by one: for heavy limbs.
            Else the hand as a whole aims beside its way.
        planning_s: Processor time that it took to find ways since the episode began [s].
        greatest_grip: Greatest force that the hand's grasp has borne at the end of a control step
            since the episode began [N].
    """

    def __init__(
        self,
        person: Human,
        world: World,
        control_dt: float,
        *,
        side: str = "right",
        script: Callable[[Caregiving], None] | None = None,
    ) -> None:
        """Prepare a spawned person.

        Args:
            person: The caregiver.
            world: Where they are.
            control_dt: Length of a control step [s].
            side: The hand that works, `left` or `right`.
            script: Asks for skills at the beginning of each episode.

        Raises:
            UnknownNameError: If there is no such side.
            ConfigError: If no joint of that arm can move.
        """
        check_name("side", side, SIDES)
        dofs = arm_dofs(person, side)
        if not dofs:
            raise ConfigError(f"{person.name!r} has no movable joint in the {side} arm")
        self.person, self.world, self.side = person, world, side
        self.control_dt, self._script = control_dt, script
        self._ik = WholeBodyIk.of(person, movable=dofs)
        self._wrist = f"{side}_wrist"
        neck = [d for d in person.movable if DOFS[DOF_INDEX[d]].joint in ("neck", "head")]
        self._looking = WholeBodyIk.of(person, movable=neck) if neck else None
        self.grip = grip_point(person, side)
        self._rest = person.angles.copy()
        self._skills: list[Skill] = []
        self._current: Skill | None = None
        self._has_grasped = False
        self.angles = self._rest.copy()  # wished, of every DoF
        self.aside = np.zeros(3)  # how far beside its way the hand aims, against a load [m]
        self.strives = False
        self._striving = Striving(person)
        self.trouble, self.greatest_grip, self.planning_s = "", 0.0, 0.0
        self.walk, self.knee, self.closing = (0.0, 0.0, 0.0), "", -1.0

    def reset(self, rng: np.random.Generator) -> None:
        self.walk, self.knee, self.closing = (0.0, 0.0, 0.0), "", -1.0
        self._has_grasped = False
        self._skills.clear()
        self._current = None
        self.angles = present_angles(self.person)
        self.aside = np.zeros(3)
        self._striving.forget()
        self.trouble, self.greatest_grip, self.planning_s = "", 0.0, 0.0
        if self._script is not None:
            self._script(self)

    def act(self) -> Array:
        return self.with_moves(self.person.action_towards(self.wish(), self.control_dt))

    def with_moves(self, action: Array) -> Array:
        """Return an action with the values that walk, kneel and grasp, as the skills want them now."""
        entries, hands = self.person.entries, self.person.hands
        if "walk" in entries:
            action[entries["walk"]] = self.walk
        if "kneel" in entries:
            action[entries["kneel"]] = [1.0 if side == self.knee else -1.0 for side in SIDES]
        if "grasp" in entries:
            action[entries["grasp"]] = [self.closing if s == self.side else -1.0 for s in hands]
        return action

    @property
    def able_hand(self) -> Hand:
        """The hand that works. ConfigError if it cannot grasp."""
        if self.side not in self.person.hands:
            raise ConfigError(
                f"the {self.side} hand of {self.person.name!r} cannot grasp: its moves are "
                f"{', '.join(self.person.moves) or 'none'}"
            )
        return self.person.hands[self.side]

    def _legs(self, move: str) -> Legs:
        if self.person.legs is None or move not in self.person.moves:
            raise ConfigError(
                f"{self.person.name!r} cannot {move}: its moves are "
                f"{', '.join(self.person.moves) or 'none'}"
            )
        return self.person.legs

    @property
    def wrist(self) -> str:
        """The SMPL-X joint of the hand that works."""
        return self._wrist

    @property
    def is_idle(self) -> bool:
        """Whether everything asked for is done, or given up."""
        return self._current is None and not self._skills

    @property
    def is_holding(self) -> bool:
        """Whether the hand holds something."""
        return self.side in self.person.hands and self.able_hand.held is not None

    def wish(self) -> dict[str, float]:
        """Return the wished angles [rad] for the coming control step, and go on with the skills."""
        self._watch_grasp()
        for _ in range(len(self._skills) + 2):
            if self._current is not None:
                if not self._current.is_over():
                    return self._current.wish()
                self._current = None
            if self.trouble:
                self._skills.clear()
            if not self._skills:
                break
            self._current = self._skills.pop(0)
            self._current.begin()
        return {}

    # What can be asked for.

    def walk_to(
        self, x: float, y: float, heading: float, *, via: Sequence[tuple[float, float]] = ()
    ) -> None:
        """Ask for a walk to (x, y) [m], facing `heading` [rad] from the x axis; nothing sees obstacles.

        Raises:
            ConfigError: If the person cannot walk, or numbers are not finite.
        """
        self.walk_along([*via, (x, y)], heading)

    def walk_along(self, way: Way, heading: float) -> None:
        """Ask for a walk from corner to corner, facing `heading` [rad] from the x axis at the end.

        Args:
            way: The corners [m], or what returns those from here and is asked once a second, such as
                `envs.walkway.way_of`.
            heading: Where it looks at the end [rad].

        Raises:
            ConfigError: If the person cannot walk, or numbers are not finite.
        """
        self._skills.append(WalkTo(self, self._legs("walk"), way, heading))

    def kneel(self, knee: str = "left") -> None:
        """Ask for going down on one knee, of the side `knee`.

        Raises:
            UnknownNameError: If there is no such side.
            ConfigError: If the person cannot kneel.
        """
        check_name("side", knee, SIDES)
        self._skills.append(Kneel(self, self._legs("kneel"), knee))

    def rise(self) -> None:
        """Ask for standing up from the knee. ConfigError if the person cannot kneel."""
        self._skills.append(Kneel(self, self._legs("kneel"), ""))

    def reach(
        self,
        point: Point | Callable[[], Point],
        *,
        palm: Point | None = None,
        fingers: Point | None = None,
        speed: float = HAND_SPEED,
        near: float | None = None,
        follow: bool = False,
    ) -> None:
        """Ask for the hand to be brought straight to a point.

        Args:
            point: Where the palm goes, in the world [m], or what returns it when the skill begins.
            palm: Where the palm looks, a direction in the world; free if None.
            fingers: Where the fingers point, a direction in the world; free if None.
            speed: Of the hand at its quickest [m/s].
            near: Distance from the point that is near enough [m]; `NEAR`, or `NEAR_LADEN` while the
                hand holds something, if None.
            follow: Whether the hand follows a point that moves on, as a limb does that nobody holds yet.
        """
        self._skills.append(Reach(self, point, palm, fingers, speed, near, follows=follow))

    def grasp(
        self, what: Human | Body, part: str | None = None, *, force: float = GRIP_FORCE
    ) -> None:
        """Ask for a grasp of what is at the hand: it is held at one point and may turn about it.

        Args:
            what: A person or a thing.
            part: SMPL-X joint of the person, such as `left_elbow` for the forearm; or a link of the
                thing, its base if None.
            force: Greatest force of the grasp along each axis [N].

        Raises:
            UnknownNameError: If there is no such part.
            ConfigError: If the hand cannot grasp, or not with that force.
        """
        body, link = part_of(what, part)
        self._skills.append(Grasp(self, body, link, force))

    def move_by(
        self, offset: Point, *, speed: float = HAND_SPEED, near: float | None = None
    ) -> None:
        """Ask for the hand, with what it holds, to be moved by an offset in the world [m]."""
        step = np.asarray(offset, np.float64)
        self.move_to(lambda: self.wished_hand()[0] - self.aside + step, speed=speed, near=near)

    def move_to(
        self,
        point: Point | Callable[[], Point],
        *,
        speed: float = HAND_SPEED,
        near: float | None = None,
    ) -> None:
        """Ask for the hand, with what it holds, to be moved straight to a point in the world [m]."""
        self.reach(point, speed=speed, near=near)

    def release(self) -> None:
        """Ask for the hand to let go."""
        self._skills.append(Release(self))

    def lower_arm(self) -> None:
        """Ask for the arm to go back to where it hung at the start."""
        self._skills.append(LowerArm(self))

    # What skills use.

    def hand(self) -> Array:
        """Return where the palm is in the world [m], shape [3]."""
        wrist = self.person.joint_pose(self._wrist)
        return np.asarray(rotate(wrist.quaternion, self.grip) + wrist.position)

    def wished_hand(self) -> tuple[Array, Array]:
        """Return where the palm is wished to be [m], and the wrist's frame [3, 3], in the world."""
        rotations, positions = forward_kinematics(self.person.model.joints, self.angles)
        base, wrist = self.person.body.base_pose().matrix(), JOINT_INDEX[self._wrist]
        place = positions[wrist] + rotations[wrist] @ self.grip
        return base[:3, :3] @ place + base[:3, 3], base[:3, :3] @ rotations[wrist]

    def can_reach(self, point: Array, near: float) -> bool:
        """Return whether the arm comes within `near` [m] of a point in the world [m] from here."""
        goal = Position(self._wrist, point, self.grip, tolerance=near)
        return self._ik.solve([goal], self.angles, self.person.body.base_pose()).success

    def towards(self, goals: Sequence[Goal], rest: Array) -> None:
        """Move the wished angles to what meets goals of the hand.

        Args:
            goals: What is wanted.
            rest: Posture that is preferred where there is a choice [rad], shape [112].
        """
        base = self.person.body.base_pose()
        self.angles = self._ik.solve(goals, self.angles, base, rest=rest, fallback=False).angles

    def wished(self, *, is_near: bool = False) -> dict[str, float]:
        """Return the wished angles of the arm and trunk [rad], and of a neck that looks at the hand.

        Args:
            is_near: Whether the hand is near enough to where it is wished to be to try no harder.
        """
        out = {dof: float(self.angles[DOF_INDEX[dof]]) for dof in self._ik.dofs}
        self._strive(out, 0.0 if is_near else STRIVING)
        if self._looking is not None:
            gaze = Gaze(self.hand(), tolerance=STEERED)
            base = self.person.body.base_pose()
            out |= self._looking.solve(
                [gaze], self.angles, base, rest=self._rest, fallback=False
            ).wish
        return out

    def _strive(self, wish: dict[str, float], share: float) -> None:
        """Wish more of joints that a load in the hand keeps from where they are wished to be."""
        if not self.is_holding or not self.strives:
            self._striving.forget()
            return
        self._striving.add(wish, share)

    def keep(self) -> dict[str, float]:
        """Return wished angles [rad] that keep the hand, and what it holds, where it is wished to be."""
        self._watch_grasp()
        left = float(np.linalg.norm(self.wished_hand()[0] - self.hand()))
        return self.wished(is_near=left < NEAR_LADEN)

    def rest_wish(self) -> dict[str, float]:
        """Return the angles of arm, trunk and neck at the start [rad]."""
        dofs = self._ik.dofs + (() if self._looking is None else self._looking.dofs)
        return {dof: float(self._rest[DOF_INDEX[dof]]) for dof in dofs}

    def _watch_grasp(self) -> None:
        """Notice what the grasp bears, and that it has slipped."""
        if self.side not in self.person.hands:
            return
        self.greatest_grip = max(self.greatest_grip, self.able_hand.load())
        if self._has_grasped and not self.is_holding and self.closing > 0:
            force = self.closing * self.able_hand.force
            self.closing, self._current = -1.0, None
            self.trouble = f"what was held slipped out of the hand: it holds {force:g} N"
        self._has_grasped = self.is_holding


class Do(Behaviour):
    """A leaf that asks a caregiver for skills, and runs until they are done; it fails with them."""

    def __init__(
        self,
        name: str,
        caregiving: Caregiving,
        intent: dict[str, float],
        ask: Callable[[Caregiving], None],
    ) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            caregiving: Who does it.
            intent: Wished angles [rad], shared with the policy; this leaf writes into it.
            ask: Asks for the skills, called when the leaf begins.
        """
        super().__init__(name)
        self._caregiving, self._intent, self._ask = caregiving, intent, ask

    def initialise(self) -> None:
        self._caregiving.trouble = ""
        self._ask(self._caregiving)

    def update(self) -> Status:
        self._intent.update(self._caregiving.wish())
        self.feedback_message = self._caregiving.trouble
        if self._caregiving.trouble:
            return Status.FAILURE
        return Status.SUCCESS if self._caregiving.is_idle else Status.RUNNING
