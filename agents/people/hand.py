"""A hand as a part that actions move: it takes what is at the palm, holds it and lets go.

A grasp is a bond at one point of the palm, about which what is held may turn. It has a greatest force along
each axis, a share of the hand's strength: what pulls harder slips.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.observable import Observable
from rcare_marl.pose import Array, rotate
from rcare_marl.world import World

from .body.ik import grip_point
from .body.skeleton import JOINT_INDEX, JOINTS
from .strength import strength_share

if TYPE_CHECKING:
    from .human import Human

# Our own choices.
GRIP_FORCE = 200.0  # [N] of a firm grip of a healthy hand, along each axis
GRIP_GAP = 0.05  # [m] between hand and what it takes, at most
SLIPPED = 0.10  # [m] between them at which a grasp is lost
LEAST = 0.1  # share of its strength from which on a hand closes, or opens; else it stays as it is


class Hand:
    """One hand of a person.

    Attributes:
        side: `left` or `right`.
        force: Greatest force of a grasp along each axis [N].
        held: What it holds; None if it is empty.
    """

    def __init__(self, person: Human, side: str, world: World) -> None:
        """Take a spawned person and the side of the hand."""
        self._person, self._world, self.side = person, world, side
        self._wrist = f"{side}_wrist"
        self._frame = person.frames[JOINT_INDEX[self._wrist]]
        self._grip = grip_point(person, side)
        grade = person.avatar.profile.side(side).mmt.get("finger_flexors", 5.0)
        self.force = GRIP_FORCE * strength_share(grade, "linear")
        self._may_take: list[tuple[Body, int]] = []
        self.held: Attachment | None = None

    @property
    def action_name(self) -> str:
        """What its action value does, with its unit."""
        return f"grasp {self.side} [{self.force:g} N]"

    def may_take(self, body: Body, link: int) -> None:
        """Let it take a link, and pass through it for good; see `Human.may_take`."""
        self._may_take.append((body, link))
        hand = {
            frame.link
            for joint, frame in zip(JOINTS, self._person.frames, strict=True)
            if joint == self._wrist or (joint.startswith(self.side) and joint[-1].isdigit())
        }
        self._world.set_collision(
            self._person.body, body, False, links_a=sorted(hand), links_b=(link,)
        )

    def gap(self, body: Body, link: int) -> float:
        """Return the distance of a link from the hand [m], 1 at most."""
        links = (self._frame.link, link)
        return self._world.separation(self._person.body, body, within=1.0, links=links)

    def holds(self, body: Body, link: int) -> bool:
        """Return whether it holds that link."""
        held = self.held
        return held is not None and (held.child, held.child_link) == (body, link)

    def palm(self) -> Array:
        """Return where the palm is in the world [m], shape [3]."""
        wrist = self._person.joint_pose(self._wrist)
        return np.asarray(rotate(wrist.quaternion, self._grip) + wrist.position)

    def load(self) -> float:
        """Return the force that the grasp bore in the last physics step [N]; 0 for an empty hand."""
        return 0.0 if self.held is None else self.held.load()

    def command(self, value: float) -> None:
        """Close with a share of the strength, open where it is negative, stay as it is near zero."""
        held = self.held
        if held is not None and self.gap(held.child, held.child_link) > SLIPPED:
            self.open()
        elif value <= -LEAST:
            self.open()
        elif value >= LEAST and held is not None:
            held.set_force(value * self.force)
        elif value >= LEAST:
            self._close(value * self.force)

    def _close(self, force: float) -> None:
        """Take the nearest of what may be taken and is near enough."""
        near = [(self.gap(body, link), k) for k, (body, link) in enumerate(self._may_take)]
        gap, k = min(near, default=(1.0, -1))
        if gap > GRIP_GAP or not force > 0:
            return
        (body, link), frame, here = self._may_take[k], self._frame, self._person.body
        self.held = self._world.attach(
            here,
            here.link_names[frame.link],
            body,
            force=force,
            child_link=body.link_names[link],
            pivot=frame.rotation @ self._grip + frame.offset,
        )

    def open(self) -> None:
        """Let go at once."""
        if self.held is not None:
            self._world.detach(self.held)
            self.held = None

    def observables(self) -> list[Observable]:
        """Return what the person senses of it."""
        return [
            Observable(f"{self.side}_hand_position", "m", 3, self.palm),
            Observable(f"{self.side}_hand_holds", "1", 1, lambda: (float(self.held is not None),)),
            Observable(f"{self.side}_hand_load", "N", 1, lambda: (self.load(),)),
        ]
