"""All soft matter of a world: who is awake, what presses on what, and the snapshot."""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..body import Body
from ..errors import ConfigError
from ..pose import conjugate, multiply, rotation_vector
from ..world import GRAVITY, Contact, World
from . import kernel
from .collider import Colliders
from .soft_body import SETTLED, Encounter, SoftBody, SoftContact

Array = npt.NDArray[np.float64]

# Our own choices. Nothing in care moves faster than MAX_SPEED: a soft body looks around again before
# anything could have come near.
MAX_SPEED = 4.0  # [m/s]
WAKE = 0.01  # [m] between skin and shape
NEAR = 0.08  # [m], shapes that an awake body watches
LOOK_AWAKE = 4  # physics steps between two looks of an awake body
LOOK_ASLEEP = 96  # at most, of a sleeping one


class Matter:
    """The soft bodies of one world; the world steps, marks and rewinds them.

    Attributes:
        bodies: The soft bodies, in the order in which they came.
    """

    def __init__(self, world: World) -> None:
        self._world: World = weakref.proxy(world)
        self.bodies: list[SoftBody] = []
        self._ignored: list[Body] = []
        self._colliders: Colliders | None = None
        self._known = 0
        self._candidates: list[npt.NDArray[np.int64]] = []
        self._near: list[Encounter] = []
        self._wanted: list[int] = []
        self._centres: dict[int, tuple[float, ...]] = {}  # of bodies that were looked at
        self._gravity = np.array((0.0, 0.0, -GRAVITY))
        self._pushes: dict[
            int, Array
        ] = {}  # force and moment on each link in this step, by its row
        self._pushed: dict[int, Array] = {}  # in the last step
        self._masses: dict[int, tuple[float, Array]] = {}
        self._beds: dict[tuple[int, int], float] = {}  # by body and link
        self._fetched: set[int] = set()  # bodies whose poses were read once
        self._hauled: set[int] = set()  # rows of links of immovable bodies
        self._stands: dict[int, tuple[int, Array, Array]] = {}  # step, their pose, state made of it
        self._answers: dict[int, tuple[int, Array, Array]] = {}  # step, state, state foreseen
        self._steps = 0
        self._until_look = 0
        self._seen = -1
        self._marked: list[tuple[Any, ...]] = []
        self._marked_pushes: dict[int, Array] = {}

    @staticmethod
    def of(world: World) -> Matter:
        """Return the soft matter of a world; it comes into being when it is first asked for."""
        for matter in world.matter:
            if isinstance(matter, Matter):
                return matter
        made = Matter(world)
        world.matter.append(made)
        return made

    def add(self, body: SoftBody) -> None:
        """Put a soft body into the world."""
        self.bodies.append(body)
        self._colliders = None

    def ignore(self, bodies: Iterable[Body]) -> None:
        """Let soft matter pass through rigid bodies, such as the chair that a person sits on."""
        self._ignored.extend(bodies)
        self._colliders = None

    def spare(self, soft: SoftBody, bodies: Iterable[Body]) -> None:
        """Let one soft body pass through rigid bodies, such as the hand that holds a sponge."""
        soft.spared.extend(bodies)
        self._colliders = None

    def bed(self, body: Body, link: int, stiffness: float) -> None:
        """Let soft matter sink into a link as into flesh: an elastic foundation.

        Args:
            body: The body.
            link: Its link.
            stiffness: Pressure for each depth [Pa/m]; 0 makes it rigid again.

        Raises:
            ConfigError: If it is negative.
        """
        if not stiffness >= 0:
            raise ConfigError(f"the stiffness of flesh must not be negative, got {stiffness}")
        self._beds[id(body), link] = stiffness
        self._colliders = None

    def step(self) -> None:
        """Simulate up to the end of the coming physics step and push the rigid bodies."""
        self._steps += 1
        self._until_look -= 1
        self._pushed, self._pushes = self._pushes, {}
        if self._until_look <= 0 or self._world.teleports != self._seen:
            self._look()
        for place, body in enumerate(self.bodies):
            if body.is_awake:
                self._advance(place, body)

    def mark(self) -> None:
        """Remember the present state as the one that `rewind` returns to."""
        self._marked = [body.save() for body in self.bodies]
        self._marked_pushes = dict(self._pushes)
        self._stands.clear()
        self._answers.clear()
        self._until_look, self._seen = 0, -1

    def rewind(self) -> None:
        """Return to the marked state."""
        for body, snapshot in zip(self.bodies, self._marked, strict=True):
            body.restore(snapshot)
        self._pushes = dict(self._marked_pushes)
        self._stands.clear()
        self._answers.clear()
        self._until_look, self._seen = 0, -1

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return what flesh on `a` pressed on `b` with, and `a` on flesh of `b`; on anything if None.

        A soft body counts as part of its carrier. The force is all of it, friction included, and the
        distance is zero.
        """
        found = []
        for soft in self.bodies:
            if not soft.contacts or soft.carrier is None:
                continue
            own, own_link = soft.carrier.body, soft.carrier.link
            for touch in soft.contacts:
                if own is not a and touch.body is not a:
                    continue
                x, y, z = touch.force.tolist()
                size = math.sqrt(x * x + y * y + z * z)
                unit = 1.0 / max(size, 1e-12)
                along, point = (x * unit, y * unit, z * unit), tuple(touch.point.tolist())
                if own is a and b in (None, touch.body):
                    out = (-along[0], -along[1], -along[2])
                    found.append(Contact(own_link, touch.link, point, out, 0.0, size))
                if touch.body is a and b in (None, own):
                    out = along
                    found.append(Contact(touch.link, own_link, point, out, 0.0, size))
        return found

    def force_on(self, body: Body, link: int | None = None) -> Array:
        """Return the force of all soft bodies on a rigid one [N], shape [3]."""
        return np.sum([soft.force_on(body, link) for soft in self.bodies], axis=0) + np.zeros(3)

    def _prepare(self) -> Colliders:
        """Read the shapes of all rigid bodies again if there are new ones."""
        world = self._world
        if self._colliders is None or self._known != len(world.bodies):
            self._known = len(world.bodies)
            chosen = [body for body in world.bodies if body not in self._ignored]
            self._colliders = Colliders(chosen, world.client)
            carried = [self._colliders.links[row] for row in self._colliders.shape_links]
            owners = [owner for owner, _ in carried]
            beds = [self._beds.get((id(owner), link), 0.0) for owner, link in carried]
            self._colliders.beds[:] = beds
            passed = [
                {
                    id(body)
                    for body in (*soft.spared, *([soft.carrier.body] if soft.carrier else ()))
                }
                for soft in self.bodies
            ]
            self._candidates = [
                np.array([i for i, owner in enumerate(owners) if id(owner) not in own], np.int64)
                for own in passed
            ]
            self._wanted = [  # bodies that some soft body can meet
                k
                for k, body in enumerate(chosen)
                if self._colliders.rows_of[k] and not all(id(body) in own for own in passed)
            ]
            self._near = [Encounter.of(self._colliders, np.zeros(0, np.int64)) for _ in self.bodies]
            self._hauled = {
                row
                for k, _ in enumerate(chosen)
                if self._colliders.is_still[k]
                for row in self._colliders.rows_of[k]
            }
            self._masses = {
                row: body.mass_and_inertia(-1)
                for row, (body, _) in enumerate(self._colliders.links)
                if body.is_movable and not body.link_count
            }
            self._seen, self._fetched = -1, set()
        return self._colliders

    def _look(self) -> None:
        """Find what is near each soft body, wake and put to sleep, and say when to look again."""
        colliders = self._prepare()
        frames = [soft.frame(self._world.client) for soft in self.bodies]
        fresh, beyond = self._fetch_near(colliders, frames)
        least = beyond  # gap of any sleeping body
        for place, (soft, frame) in enumerate(zip(self.bodies, frames, strict=True)):
            rows = self._candidates[place]
            rows = rows[fresh[rows]]
            gap = beyond
            if len(rows):
                gaps = colliders.gaps(frame, rows, soft.middle, soft.radius, soft.points, soft.skin)
                gap = min(float(gaps.min()), beyond)
                rows, gaps = rows[gaps < NEAR], gaps[gaps < NEAR]
            if not np.array_equal(rows, self._near[place].shapes):
                self._near[place] = Encounter.of(colliders, rows)
            if gap < WAKE:
                soft.is_awake = True
                soft.attend(frame, colliders, rows[gaps < WAKE])
            elif soft.is_awake and not soft.falls and soft.deviation() < SETTLED:
                soft.sleep()
            if not soft.is_awake:
                least = min(least, gap)
        wait = LOOK_AWAKE if any(soft.is_awake for soft in self.bodies) else LOOK_ASLEEP
        if least < math.inf:
            wait = min(wait, int((least - WAKE) / (MAX_SPEED * self._world.physics_dt)))
        self._until_look = max(wait, 1)
        self._seen = self._world.teleports

    def _fetch_near(
        self, colliders: Colliders, frames: list[Array]
    ) -> tuple[npt.NDArray[np.bool_], float]:
        """Read the poses of all bodies that may be near.

        Returns:
            Which shapes have fresh poses, and how far away all others are at least [m].
        """
        moved = self._world.teleports != self._seen
        fresh = np.zeros(len(colliders.links), np.bool_)
        middles = [
            (colliders.place_of(frame, soft.middle), soft.radius)
            for soft, frame in zip(self.bodies, frames, strict=True)
        ]
        beyond = math.inf
        for k in self._wanted:
            is_still = colliders.is_still[k]
            if moved or not is_still:
                self._centres[k] = colliders.bodies[k].centre_pose()[0]
            at = self._centres[k]
            gap = min([math.dist(middle, at) - radius for middle, radius in middles])
            gap -= colliders.reaches[k]
            if gap > 2 * NEAR:
                beyond = min(beyond, gap)
                continue
            if moved or not is_still or k not in self._fetched:
                colliders.fetch_body(k)
                self._fetched.add(k)
            fresh[colliders.rows_of[k]] = True
        return fresh[colliders.shape_links], beyond

    def _advance(self, place: int, soft: SoftBody) -> None:
        """Simulate one soft body and push what it touches, and its carrier the other way."""
        colliders, near = self._prepare(), self._near[place]
        client, period = self._world.client, self._world.physics_dt
        for row in near.links:
            colliders.fetch_link(row)
            if row in self._hauled:
                self._haul(colliders.states[row], row, period)
            if row in self._masses:
                self._foresee(colliders.states[row], row, period)
        frame = soft.frame(client)
        outcome = soft.advance(frame, colliders, near, self._gravity, period, client)
        soft.contacts = []
        for c in np.flatnonzero(outcome[:, kernel.COUNT]).tolist():
            row = int(colliders.shape_links[near.shapes[c]])
            self._push(soft, row, *colliders.links[row], outcome[c])
        for body, link, force, point in soft.pin_loads():
            if body.is_movable or body.joints:
                body.apply_force(link, force, point)

    def _foresee(self, state: Array, row: int, period: float) -> None:
        """Let a link without joints answer weight and push within the step, as far as it is free to.

        How far it is, the last step has shown: one that is bonded to a gripper did not answer at all.
        """
        step, before, used = self._answers.get(row, _NOWHERE)
        if step == self._steps:  # another soft body has asked before
            state[:] = used
            return
        mass, inertia = self._masses[row]
        push, now, share = self._pushed.get(row, _NO_PUSH), state.copy(), 1.0
        if step == self._steps - 1:
            share = kernel.answer(before, now, mass, push, self._gravity, period)
        kernel.foresee(state, mass, inertia, push, self._gravity, share * period)
        self._answers[row] = (self._steps, now, state.copy())

    def _haul(self, state: Array, row: int, period: float) -> None:
        """Let an immovable body that is set from pose to pose move there within the step."""
        step, pose, used = self._stands.get(row, _NOWHERE)
        if step == self._steps:  # another soft body has asked before
            state[:] = used
            return
        now = state[:7].copy()
        apart = now[:3] - pose[:3]
        if step == self._steps - 1 and float(apart @ apart) < (MAX_SPEED * period) ** 2:
            state[:7], state[7:10] = pose, apart / period
            state[10:] = rotation_vector(multiply(now[3:], conjugate(pose[3:]))) / period
        self._stands[row] = (self._steps, now, state.copy())

    def _push(self, soft: SoftBody, row: int, body: Body, link: int, outcome: Array) -> None:
        """Push a link, in its row of the colliders' table, and the carrier against it."""
        force, point = outcome[:3], outcome[3:6]
        soft.contacts.append(SoftContact(body, link, force, point, float(outcome[kernel.AREA])))
        if row in self._masses:
            (ax, ay, az), (fx, fy, fz) = point - self._prepare().states[row, :3], force
            moment = (ay * fz - az * fy, az * fx - ax * fz, ax * fy - ay * fx)
            self._pushes[row] = self._pushes.get(row, _NO_PUSH) + (fx, fy, fz, *moment)
        if body.is_movable or body.joints:
            body.apply_force(link, force, point)
        if soft.carrier is not None:
            soft.carrier.body.apply_force(soft.carrier.link, -force, point)


_NO_PUSH = np.zeros(6)
_NOWHERE = (-2, np.zeros(7), np.zeros(13))


__all__ = ["Matter"]
