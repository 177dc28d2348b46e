"""A bond between two bodies, owned by the world."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING

import numpy as np

from rcare_marl.bullet import bullet

from .body import Body
from .pose import Pose

if TYPE_CHECKING:
    from .world import World


class Attachment:
    """A bond between a link and another body, or a link of it, owned by the world."""

    def __init__(
        self,
        world: World,
        parent: Body,
        link: int,
        child: Body,
        child_link: int,
        child_in_link: Pose,
        force: float,
        pivot: tuple[float, ...] | None,
    ) -> None:
        self.parent, self.link, self.child, self.child_link = parent, link, child, child_link
        self.child_in_link, self.force, self.pivot = child_in_link, force, pivot
        self._world = weakref.proxy(world)
        self._uid: int | None = None

    @property
    def is_active(self) -> bool:
        """Whether the bond holds at present."""
        return self._uid is not None

    def _make(self) -> None:
        client = self._world.client
        in_parent, in_child = self.child_in_link, Pose()
        if self.pivot is not None:  # the same point of both
            in_parent, in_child = Pose(self.pivot), in_parent.inverse() @ Pose(self.pivot)
        # Bullet's frames are relative to centres of mass.
        in_parent = self.parent.inertial_pose(self.link).inverse() @ in_parent
        in_child = self.child.inertial_pose(self.child_link).inverse() @ in_child
        self._uid = bullet.createConstraint(
            self.parent.uid,
            self.link,
            self.child.uid,
            self.child_link,
            bullet.JOINT_FIXED if self.pivot is None else bullet.JOINT_POINT2POINT,
            (0, 0, 0),
            in_parent.position,
            in_child.position,
            in_parent.quaternion,
            in_child.quaternion,
            physicsClientId=client,
        )
        bullet.changeConstraint(self._uid, maxForce=self.force, physicsClientId=client)

    def load(self) -> float:
        """Return the force that the bond bore in the last physics step [N]; 0 where it is broken."""
        if self._uid is None:
            return 0.0
        rows = bullet.getConstraintState(self._uid, physicsClientId=self._world.client)
        return float(np.linalg.norm(rows[:3]))

    def set_force(self, force: float) -> None:
        """Let the bond bear at most `force` [N] along each axis from now on."""
        if force == self.force:
            return
        self.force = force
        if self._uid is not None:
            bullet.changeConstraint(self._uid, maxForce=force, physicsClientId=self._world.client)

    def _break(self) -> None:
        if self._uid is not None:
            bullet.removeConstraint(self._uid, physicsClientId=self._world.client)
            self._uid = None
