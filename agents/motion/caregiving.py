"""What a caregiver does with legs and hands: walk up, reach, grasp a limb or a thing, move it, let go.

Deeds are asked for one after the other and done in that order, over simulated time, by a policy that
gives one action a control step. Legs are a puppet's (`walk`): nobody is pushed over here. Arms move by
the person's own drive, so that they are as strong as the person is, and a grasp is a bond with a greatest
force: what pulls harder slips.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import rotate
from rcare_marl.world import World

from ..body.goal import Gaze, Goal, Point, Position
from ..body.ik import WholeBodyIk, arm_dofs, grip_point, present_angles
from ..body.skeleton import DOF_INDEX, DOFS, JOINT_INDEX, JOINTS, SIDES, forward_kinematics
from ..human import Human
from .deed import (
    GRIP_FORCE,
    HAND_SPEED,
    NEAR_LADEN,
    SLIPPED,
    STEERED,
    Deed,
    Grasping,
    Kneeling,
    Lowering,
    Reaching,
    Releasing,
    Walking,
)
from .walk import STEP_TIME

Array = npt.NDArray[np.float64]

# Our own choices.
STRIVING = 0.15  # of what a joint sags, learned in a control step
LARGEST_SAG = 0.5  # [rad] that is wished beside a joint's angle at most


class Caregiving:
    """A policy that does what is asked for, in the order of asking.

    Use it by itself as the policy of a role, or through `Do` as a leaf of a behaviour tree.

    Attributes:
        trouble: Why a deed could not be done; empty while all goes well. What was still to do is
            dropped then.
        strives: Whether joints that a load in the hand makes sag try harder, one by one: for heavy limbs.
            Else the hand as a whole aims beside its way.
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
            script: Asks for deeds at the beginning of each episode.

        Raises:
            UnknownNameError: If there is no such side.
            ConfigError: If no joint of that arm can move.
        """
        if side not in SIDES:
            raise UnknownNameError("side", side, SIDES)
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
        self._deeds: list[Deed] = []
        self._current: Deed | None = None
        self._held: Attachment | None = None
        self.angles = self._rest.copy()  # wished, of every DoF
        self.aside = np.zeros(3)  # how far beside its way the hand aims, against a load [m]
        self.strives = False
        self._sag: dict[str, float] = {}  # of joints under a load [rad]
        self.trouble, self.greatest_grip = "", 0.0

    def reset(self, rng: np.random.Generator) -> None:
        self.let_go()
        self._deeds.clear()
        self._current = None
        self.angles = present_angles(self.person)
        self.aside = np.zeros(3)
        self._sag.clear()
        self.trouble, self.greatest_grip = "", 0.0
        if self._script is not None:
            self._script(self)

    def act(self) -> Array:
        return self.person.action_towards(self.wish(), self.control_dt)

    @property
    def wrist(self) -> str:
        """The SMPL-X joint of the hand that works."""
        return self._wrist

    @property
    def is_idle(self) -> bool:
        """Whether everything asked for is done, or given up."""
        return self._current is None and not self._deeds

    @property
    def is_holding(self) -> bool:
        """Whether the hand holds something."""
        return self._held is not None and self._held.is_active

    def wish(self) -> dict[str, float]:
        """Return the wished angles [rad] for the coming control step, and go on with the deeds."""
        if self._held is not None:
            self.greatest_grip = max(self.greatest_grip, self._held.load())
            self._check_grasp(self._held)
        for _ in range(len(self._deeds) + 2):
            if self._current is not None:
                if not self._current.is_over():
                    return self._current.wish()
                self._current = None
            if self.trouble:
                self._deeds.clear()
            if not self._deeds:
                break
            self._current = self._deeds.pop(0)
            self._current.begin()
        return {}

    # What can be asked for.

    def walk_to(
        self,
        x: float,
        y: float,
        heading: float,
        *,
        via: Sequence[tuple[float, float]] = (),
        step_time: float = STEP_TIME,
    ) -> None:
        """Ask for a walk to (x, y) [m], facing `heading` [rad] from the x axis; see `Walk`."""
        self._deeds.append(Walking(self, [*via, (x, y)], heading, step_time))

    def kneel(self, knee: str = "left") -> None:
        """Ask for going down on one knee, of the side `knee`; see `Kneel`.

        Raises:
            UnknownNameError: If there is no such side.
        """
        self._deeds.append(Kneeling(self, knee))

    def reach(
        self,
        point: Point | Callable[[], Point],
        *,
        palm: Point | None = None,
        fingers: Point | None = None,
        speed: float = HAND_SPEED,
        near: float | None = None,
    ) -> None:
        """Ask for the hand to be brought straight to a point.

        Args:
            point: Where the palm goes, in the world [m], or what returns it when the deed begins.
            palm: Where the palm looks, a direction in the world; free if None.
            fingers: Where the fingers point, a direction in the world; free if None.
            speed: Of the hand at its quickest [m/s].
            near: Distance from the point that is near enough [m]; `NEAR`, or `NEAR_LADEN` while the
                hand holds something, if None.
        """
        self._deeds.append(Reaching(self, point, palm, fingers, speed, near))

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
        """
        body, link = _part(what, part)
        self._deeds.append(Grasping(self, body, link, force))

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
        self._deeds.append(Releasing(self))

    def lower_arm(self) -> None:
        """Ask for the arm to go back to where it hung at the start."""
        self._deeds.append(Lowering(self))

    # What deeds use.

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
            self._sag.clear()
            return
        person = self.person
        for dof in wish:
            i = person.movable.index(dof)
            sag, now = self._sag.get(dof, 0.0), person.drive.target[i] - person.angle(dof)
            sag += share * (float(now) - sag)
            self._sag[dof] = min(max(sag, -LARGEST_SAG), LARGEST_SAG)
            wish[dof] += self._sag[dof]

    def keep(self) -> dict[str, float]:
        """Return wished angles [rad] that keep the hand, and what it holds, where it is wished to be."""
        if self._held is not None:
            self.greatest_grip = max(self.greatest_grip, self._held.load())
            self._check_grasp(self._held)
        left = float(np.linalg.norm(self.wished_hand()[0] - self.hand()))
        return self.wished(is_near=left < NEAR_LADEN)

    def rest_wish(self) -> dict[str, float]:
        """Return the angles of arm, trunk and neck at the start [rad]."""
        dofs = self._ik.dofs + (() if self._looking is None else self._looking.dofs)
        return {dof: float(self._rest[DOF_INDEX[dof]]) for dof in dofs}

    def hold(self, body: Body, link: int, force: float) -> None:
        """Bond the hand to a link where it is now."""
        self.let_go()
        frame = self.person.frames[JOINT_INDEX[self._wrist]]
        hand, here = frame.link, self.person.body
        pivot = frame.rotation @ self.grip + frame.offset
        self._held = self.world.attach(
            here, here.link_names[hand], body, force=force, child_link=body.link_names[link],
            pivot=pivot,
        )  # fmt: skip

    def _check_grasp(self, bond: Attachment) -> None:
        """Lose what has slipped out of the hand."""
        links = (bond.link, bond.child_link)
        gap = self.world.separation(bond.parent, bond.child, within=1.0, links=links)
        if gap > SLIPPED:
            self.let_go()
            self._current = None
            self.trouble = f"{bond.child.name!r} slipped out of the hand: it holds {bond.force:g} N"

    def let_go(self) -> None:
        """Open the hand at once."""
        if self._held is not None:
            self.world.detach(self._held)
            self._held = None

    def pass_through(self, what: Human | Body, part: str | None = None) -> None:
        """Let the hand and a part that it will grasp pass through each other, for good.

        Fingers that do not move cannot close around what they grasp. Call it before
        `World.mark_start`: what collides must not change during an episode.

        Args:
            what: A person or a thing.
            part: As for `grasp`.
        """
        body, link = _part(what, part)
        hand = {
            frame.link
            for joint, frame in zip(JOINTS, self.person.frames, strict=True)
            if joint == self._wrist or (joint.startswith(self.side) and joint[-1].isdigit())
        }
        self.world.set_collision(
            self.person.body, body, False, links_a=sorted(hand), links_b=(link,)
        )


def _part(what: Human | Body, part: str | None) -> tuple[Body, int]:
    """Return the body and link of a person's segment or of a thing's link."""
    if isinstance(what, Human):
        if part not in JOINT_INDEX:
            raise UnknownNameError("joint", str(part), JOINTS)
        return what.body, what.frames[JOINT_INDEX[part]].link
    return what, -1 if part is None else what.link_index(part)


class Do(Behaviour):
    """A leaf that asks a caregiver for deeds, and runs until they are done; it fails with them."""

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
            ask: Asks for the deeds, called when the leaf begins.
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
