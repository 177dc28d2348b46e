"""What cloth, fluids and soft bodies have in common: contacts, and the rigid shapes near them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..body import Body
from ..errors import ConfigError
from ..pose import Array, Pose
from .collider import NearShapes


@dataclass(frozen=True, eq=False)
class Carrier:
    """The link that a soft body rides on.

    Attributes:
        body: The body.
        link: Its link.
        pose: Frame of the soft body in the frame of the link.
    """

    body: Body
    link: int
    pose: Pose = Pose()


@dataclass(frozen=True, eq=False)
class SoftContact:
    """What a soft object pressed on a link with, in the last physics step, friction included.

    Attributes:
        body: The rigid body that is pressed.
        link: Its link.
        force: On that link, in the world [N], shape [3].
        point: A point on its line of action in the world [m], shape [3].
        load: Of cloth: sum of the sizes of all normal forces [N]. A tight sleeve squeezes an
            arm all round: its force is near zero and its load is not.
        area: Of a soft body: of the skin that touches [m²].
    """

    body: Body
    link: int
    force: Array
    point: Array
    load: float = 0.0
    area: float = 0.0


class SoftObject:
    """A soft object; a `SoftWorld` steps it.

    Attributes:
        name: Name.
        carrier: What it rides on; the world if None.
        ignored: Rigid bodies that it passes through, beside its carrier; see `SoftWorld.ignore`.
        contacts: What it pressed on in the last physics step.
        near: The rigid shapes that it may touch; none before its world has looked.
    """

    color: ClassVar[tuple[int, ...] | None] = None  # drawn in by default; not at all if None
    carrier: Carrier | None = None

    def __init__(self, name: str) -> None:
        """Begin with no contacts."""
        self.name = name
        self.ignored: list[Body] = []
        self.contacts: list[SoftContact] = []
        self.near: NearShapes | None = None

    @property
    def force(self) -> Array:
        """Summed force on all that it touches, in the world [N], shape [3]."""
        return np.sum([c.force for c in self.contacts], axis=0) if self.contacts else np.zeros(3)

    def force_on(self, body: Body, link: int | None = None) -> Array:
        """Return the force on a body, or on one of its links, in the world [N], shape [3]."""
        chosen = [
            c.force for c in self.contacts if c.body is body and (link is None or c.link == link)
        ]
        return np.sum(chosen, axis=0) if chosen else np.zeros(3)

    def save(self) -> tuple[Any, ...]:
        """Return a snapshot of everything that changes."""
        raise NotImplementedError

    def restore(self, snapshot: tuple[Any, ...]) -> None:
        """Return to a snapshot, bit for bit."""
        raise NotImplementedError

    def _push(self, touch: SoftContact) -> None:
        """Note a contact and push the link."""
        self.contacts.append(touch)
        if touch.body.is_movable or touch.body.joints:
            touch.body.apply_force(touch.link, touch.force.tolist(), touch.point.tolist())
        if self.carrier is not None:
            self.carrier.body.apply_force(self.carrier.link, -touch.force, touch.point)


class ParticleObject(SoftObject):
    """Particles in the frame of the world: a cloth or a fluid.

    Attributes:
        points: Positions [m] and inverse masses [1/kg], as the kernels know them, shape [n, 4].
        velocities: Present velocities [m/s], shape [n, 3].
    """

    points: Array
    velocities: Array

    @property
    def positions(self) -> Array:
        """Present positions of all particles in the world [m], shape [n, 3]."""
        return self.points[:, :3]

    def place(self, positions: Array) -> None:
        """Teleport all particles [m], shape [n, 3]; they stand still afterwards.

        Raises:
            ConfigError: If the shape is wrong or a value is not finite.
        """
        given = np.asarray(positions, np.float64)
        if given.shape != self.velocities.shape or not np.isfinite(given).all():
            raise ConfigError(f"positions must be finite and of the shape {self.velocities.shape}")
        self.points[:, :3], self.velocities[:] = given, 0
