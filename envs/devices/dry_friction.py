"""Joints that stick where they come to rest, until their friction is overcome."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import pybullet as bullet

from rcare_marl.body import Body
from rcare_marl.contact import Contact
from rcare_marl.world import World

SLIP = 1e-3  # how far a joint gives before it slips [rad or m]; our own choice
_GAIN = 0.1  # share of that which the motor takes back in one physics step


class DryFriction:
    """Coulomb friction in joints, with a memory of where each sticks.

    A motor that is told to stand still has none: the solver stops before it has found all forces, and
    what is left moves a laden joint on in each step. This one pursues a place, by its friction at most,
    and a joint that is pulled further takes the place along: an elastoplastic model of friction with
    one state a joint. Implements `rcare_marl.world.SteppedMatter`.
    """

    def __init__(self, world: World, body: Body) -> None:
        """Take up work in a world; nothing sticks until `hold`."""
        self._body = body
        self._forces: dict[int, float] = {}
        self._places: dict[int, float] = {}
        self._marked: tuple[dict[int, float], dict[int, float]] = ({}, {})
        world.matter.append(self)

    def hold(self, forces: Mapping[int, float]) -> None:
        """Let joints, by index, stick where they stand with at most these forces [N or N·m]."""
        joints = list(forces)
        self._forces.update(forces)
        self._places.update(zip(joints, self._body.joint_states(joints)[0], strict=True))
        self._send(joints)

    def let_go(self, joints: Iterable[int]) -> None:
        """Leave joints to whoever drives them from now on."""
        for joint in joints:
            self._forces.pop(joint, None)
            self._places.pop(joint, None)

    def step(self) -> None:
        """Take along the places of joints that slip."""
        places = self._places
        if not places:
            return
        slipped = []
        positions = self._body.joint_states(list(places))[0]
        for (joint, place), position in zip(places.items(), positions, strict=True):
            if abs(position - place) > SLIP:
                slipped.append(joint)
                places[joint] = position + (SLIP if place > position else -SLIP)
        if slipped:
            self._send(slipped)

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return nothing: it touches nobody."""
        return []

    def mark(self) -> None:
        """Remember where joints stick."""
        self._marked = (dict(self._forces), dict(self._places))

    def rewind(self) -> None:
        """Let joints stick where they did: motors do not return with a snapshot."""
        self._forces, self._places = (dict(kept) for kept in self._marked)
        self._send(list(self._places))

    def _send(self, joints: list[int]) -> None:
        if joints:
            places, forces = ([kept[j] for j in joints] for kept in (self._places, self._forces))
            self._body.drive_positions(joints, places, forces, position_gain=_GAIN)


def grip(world: World, body: Body, links: Iterable[int], *, friction: float) -> None:
    """Give links a coefficient of friction, and let what they stand on hold them without creeping.

    Bullet then remembers where a contact began, and takes back what it slid while it should stick.
    """
    for link in links:
        bullet.changeDynamics(
            body.uid,
            link,
            lateralFriction=friction,
            frictionAnchor=1,
            physicsClientId=world.client,
        )
