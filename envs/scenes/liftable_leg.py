"""A leg of a seated person that stands on its footplate and can be lifted."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Array, Pose
from rcare_marl.world import World

from ..devices import Wheelchair
from .leg_path import LegPath

# How it is lifted, all our own choices. Hip flexion beside that at rest, and knee flexion: straight enough
# that the knee does not buckle, the thigh hardly off the seat.
LIFT = ((math.radians(-8), math.radians(35)), (math.radians(-10), math.radians(6)))
LIFT_SPREAD = (math.radians(1), math.radians(3))  # of both, uniform, each way
FOOT_HOLD = 0.07  # [m] from the ankle to the toes, where it is grasped


class LiftableLeg(LegPath):
    """The middle line of a leg, and the poses of the foot while it is lifted.

    Attributes:
        rest: Angles of the moving DoFs where the leg stands [rad], by name.
        stood: Where the foot is held when it stands [m], shape [3].
        way: Poses of the foot while it is lifted, in turn.
    """

    def __init__(self, person: Human, side: str) -> None:
        """Take a spawned person who has come to rest, and a side, `left` or `right`."""
        super().__init__(person, side)
        self.rest = dict(zip(person.movable, person.positions, strict=True))
        self.stood = self.foot_hold()
        self.way: Sequence[Pose] = ()
        self.plan(np.zeros(2))

    def plan(self, shift: Array) -> None:
        """Say how the leg will be lifted, and put it back to where it stands.

        Args:
            shift: Added to hip and knee flexion [rad], shape [2].
        """
        self.way = [self.put(*np.add(angles, shift).tolist()) for angles in LIFT]
        self.stand()

    def put(self, hip: float, knee: float) -> Pose:
        """Teleport the leg to a hip flexion beside that at rest, and a knee flexion [rad].

        Returns:
            The pose of the foot.
        """
        flexed = f"{self.side}_hip_flexion"
        self._person.set_angles(
            {flexed: self.rest[flexed] + hip, f"{self.side}_knee_flexion": knee}
        )
        self.look()
        return self._person.joint_pose(f"{self.side}_ankle")

    def lift(self) -> None:
        """Teleport the leg to where it is held."""
        self.put(*LIFT[-1])

    def stand(self) -> None:
        """Teleport the leg to where it stands."""
        self._person.set_angles(self.rest)
        self.look()

    def foot_hold(self) -> Array:
        """Return the middle of the foot where it is grasped [m], shape [3]."""
        toes, ankle = self.points[:2]
        return np.asarray(ankle + FOOT_HOLD * (toes - ankle) / np.linalg.norm(toes - ankle))

    def to_lifted(self) -> Array:
        """Return the way from the ankle to where it is when the leg is up [m], shape [3]."""
        return np.subtract(self.way[-1].position, self.points[1])


def let_leg_stand(world: World, person: Human, chair: Wheelchair, side: str) -> None:
    """Let a leg stand on its footplate and lie on the seat; the posture keeps the rest off the chair.

    Args:
        world: Where they are.
        person: Who sits there.
        chair: The chair.
        side: Of the leg.
    """
    person.ignore(chair.body)
    thigh, shank = (person.frames[JOINT_INDEX[f"{side}_{j}"]].link for j in ("hip", "knee"))
    below = person.body.carried_by(shank)
    world.set_collision(person.body, chair.body, True, links_a=below)
    # The thigh, which the armrest is not to touch, has a seat of its own inside the cushion.
    f, seat = chair.model.figure, chair.frame_in_world("seat")
    size = (f("seat_depth") - 0.01, f("seat_width") - 0.03, 0.5 * f("cushion"))
    top = world.add_box(size, seat @ Pose((0, 0, -0.5 * size[2] - 0.001)), name="seat")
    others = [k for k in range(-1, person.body.link_count) if k not in (thigh, *below)]
    world.set_collision(person.body, top, False, links_a=others)
    for body in world.bodies:
        if body not in (person.body, top) and (body.joints or body.is_movable):
            world.set_collision(body, top, False)
