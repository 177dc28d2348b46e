"""A caregiver who kneels down before a seated person, lifts a leg, holds it and lowers it again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from py_trees import composites, decorators
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from rcare_marl.pose import Pose

from ...agent import Array
from ..human import Human
from ..motion.caregiving import Caregiving, Do
from ..motion.skill import HAND_SPEED
from .behaviour_tree import BehaviourTree
from .leaves import Intent

# Our own choices.
LIFT_SPEED, LOWER_SPEED = 0.15, 0.15  # [m/s] of the hand with a leg in it
AT_GRIP = 0.05  # [m] from the place on the foot, where the hand closes
GRASP = 200.0  # [N] that a hand holds a leg with, along each axis: a firm grip
TRIES = 2  # times that the hand goes to the foot
NEAR_LEG, PASSING = 0.06, 0.12  # [m] from where a hand with a leg has arrived, or may go on


@dataclass(frozen=True)
class LegLift:
    """What is to be done with a leg.

    Attributes:
        person: Whose leg it is.
        part: SMPL-X joint of the segment that is grasped, such as `right_knee` for the shank.
        stand: Returns where she kneels down, by where the leg is now: x, y [m] and heading [rad], shape [3].
        corners: Returns the corners of the way from where she is to a place on the floor [m].
        knee: The caregiver's knee that goes to the floor.
        before: Returns where the hand goes first, clear of the leg [m], shape [3].
        grip: Returns where the hand grasps [m], shape [3].
        palm: Where the palm looks then, a direction in the world.
        fingers: Where the fingers point then, a direction in the world.
        way: Returns the poses that the part is brought to, in turn; in the last it is held.
        is_done: Whether the leg may be lowered again.
    """

    person: Human
    part: str
    stand: Callable[[], Array]
    corners: Callable[[tuple[float, float]], Sequence[tuple[float, float]]]
    knee: str
    before: Callable[[], Array]
    grip: Callable[[], Array]
    palm: tuple[float, float, float]
    fingers: tuple[float, float, float]
    way: Callable[[], Sequence[Pose]]
    is_done: Callable[[], bool]


class Hold(Behaviour):
    """Holds what is in the hand, until something is so; fails if it slips."""

    def __init__(
        self, name: str, caregiving: Caregiving, intent: Intent, until: Callable[[], bool]
    ) -> None:
        super().__init__(name)
        self._caregiving, self._intent, self._until = caregiving, intent, until

    def update(self) -> Status:
        self._intent.update(self._caregiving.keep())
        if not self._caregiving.is_holding:
            return Status.FAILURE
        return Status.SUCCESS if self._until() else Status.RUNNING


class LegLifting(BehaviourTree):
    """Walks up, kneels, grasps, at the second try more slowly, lifts, holds, lowers, and lets go.

    A leg that goes no farther is held where it is. What goes wrong else ends in letting go.

    Attributes:
        caregiving: Who does it.
    """

    def __init__(self, caregiving: Caregiving, lift: LegLift, control_dt: float) -> None:
        """Prepare the tree.

        Args:
            caregiving: The caregiver, and the hand that works.
            lift: What is to be done.
            control_dt: Length of a control step [s].
        """
        self.caregiving = caregiving
        caregiving.strives = True
        intent: Intent = {}
        way: list[Array] = []  # of the hand, from where it took the leg
        tries = 0

        def corners() -> Sequence[tuple[float, float]]:
            x, y, _ = lift.stand().tolist()
            return lift.corners((x, y))

        def walk(do: Caregiving) -> None:
            for _ in range(2):  # by then the foot may stand elsewhere than when she looked last
                do.walk_along(corners, float(lift.stand()[2]))

        def kneel(do: Caregiving) -> None:
            nonlocal tries
            tries = 0
            do.kneel(lift.knee)

        def grasp(do: Caregiving) -> None:
            nonlocal tries
            if tries:  # aiming beside its way has swung it astray: begin anew, more slowly
                do.lower_arm()
                do.aside = np.zeros(3)
            tries += 1
            slow = HAND_SPEED / tries
            do.reach(lift.before, palm=lift.palm, fingers=lift.fingers, near=0.12, speed=slow)
            do.reach(lift.grip, palm=lift.palm, fingers=lift.fingers, near=AT_GRIP, speed=slow)
            do.grasp(lift.person, lift.part, force=GRASP)

        def raise_leg(do: Caregiving) -> None:
            # Where on the foot the hand is it stays.
            here = lift.person.joint_pose(lift.part)
            palm = here.inverse() @ Pose(tuple(do.hand().tolist()))
            do.aside = np.zeros(3)  # what it aimed beside to reach is no load
            way.clear()
            way.extend(np.array((pose @ palm).position) for pose in (here, *lift.way()))
            for place in way[1:-1]:
                do.move_to(place, speed=LIFT_SPEED, near=PASSING)
            do.move_to(way[-1], speed=LIFT_SPEED, near=NEAR_LEG)

        def lower_leg(do: Caregiving) -> None:
            for place in way[-2:0:-1]:
                do.move_to(place, speed=LOWER_SPEED, near=PASSING)
            do.move_to(way[0], speed=LOWER_SPEED, near=NEAR_LEG)

        def let_go(do: Caregiving) -> None:
            do.release()
            do.lower_arm()

        def leaf(name: str, ask: Callable[[Caregiving], None]) -> Do:
            return Do(name, caregiving, intent, ask)

        lifting = composites.Sequence(
            "lift the leg",
            memory=True,
            children=[
                leaf("walk up", walk),
                leaf("kneel", kneel),
                decorators.Retry("try", leaf("grasp the ankle", grasp), TRIES),
                decorators.FailureIsSuccess("as far as it goes", leaf("raise the leg", raise_leg)),
                Hold("hold it", caregiving, intent, lift.is_done),
                leaf("lower the leg", lower_leg),
                leaf("let go", let_go),
                Rest("rest"),
            ],
        )
        giving_up = composites.Sequence(
            "give up", memory=True, children=[leaf("let go at once", let_go), Rest("stay")]
        )
        root = composites.Selector("help", memory=True, children=[lifting, giving_up])
        super().__init__(caregiving.person, intent, root, control_dt)

    def reset(self, rng: np.random.Generator) -> None:
        super().reset(rng)
        self.caregiving.reset(rng)

    def act(self) -> Array:
        return self.caregiving.with_moves(super().act())


class Rest(Behaviour):
    """Does nothing, for good."""

    def update(self) -> Status:
        return Status.RUNNING
