"""All cloth of a world: what is near what, and the snapshot."""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pybullet as bullet

from ..body import Body
from ..pose import conjugate, multiply, rotation_vector
from ..world import GRAVITY, Contact, Skin, World
from .cloth import FASTEST, SHAPE_SPEED, Cloth
from .cloth_skin import ClothSkin
from .collider import Colliders, link_state
from .contact import CAPSULE

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

LOOK = 4  # physics steps between two looks around
NEAR = 0.02  # [m] beyond what particle and shape can move until the next look; our own choice
# Of capsules: half a length per radius from where one is a limb and not a trunk, and how much longer it
# is for cloth. Our own choices: then a straight leg has a neck of 2 mm at the knee.
SLENDER, JOINED = 0.8, 0.75
LEAP = 4.0  # [m/s] of a link that is set from pose to pose, from where it is a teleport
_AT_REST = 1e-6  # [m/s] and [rad/s], what Bullet says of a link that is set from pose to pose


class Wardrobe:
    """The cloths of one world; the world steps, marks and rewinds them.

    Attributes:
        cloths: The cloths, in the order in which they came.
    """

    def __init__(self, world: World) -> None:
        self._world: World = weakref.proxy(world)
        self.cloths: list[Cloth] = []
        self._ignored: list[Body] = []
        self._joined: list[Body] = []
        self._colliders: Colliders | None = None
        self._known = 0
        self._gravity = np.array((0.0, 0.0, -GRAVITY))
        self._before = np.zeros((0, 7))  # poses of links a step ago
        self._read = np.zeros(0, np.int64)  # the step in which they were read
        self._wanted: list[tuple[Body, list[int], Rows]] = []
        self._steps = 0
        self._until_look = 0
        self._marked: list[tuple[Any, ...]] = []

    @staticmethod
    def of(world: World) -> Wardrobe:
        """Return the wardrobe of a world; it comes into being when it is first asked for."""
        for matter in world.matter:
            if isinstance(matter, Wardrobe):
                return matter
        made = Wardrobe(world)
        world.matter.append(made)
        return made

    def add(
        self,
        cloth: Cloth,
        *,
        rgb: tuple[int, int, int] = (120, 150, 180),
        beneath: Sequence[Skin] = (),
    ) -> Cloth:
        """Put a cloth into the world and return it.

        Args:
            cloth: The cloth.
            rgb: Its colour.
            beneath: Skins of people that it is drawn outside of; the physics does not know them.
        """
        cloth.bind(self._world.client)
        self.cloths.append(cloth)
        # Renderers ask what a skin belongs to: a body that is nowhere and touches nothing.
        body = self._world.add_box((0.001,) * 3, collides=False, name=cloth.name)
        self._ignored.append(body)
        self._world.skins.append(ClothSkin(cloth, body, rgb, beneath))
        self._colliders = None
        return cloth

    def ignore(self, bodies: Iterable[Body]) -> None:
        """Let cloth pass through rigid bodies."""
        self._ignored.extend(bodies)
        self._colliders = None

    def join_limbs(self, body: Body) -> None:
        """Close the gaps between the limbs of a person, for cloth alone.

        Their capsules end round where a joint is: a hem would slip in between thigh and shank, and in there
        through the leg. So slender ones are longer for cloth, by `JOINED` of their radius at each end.
        """
        self._joined.append(body)
        self._colliders = None

    def step(self) -> None:
        """Simulate up to the end of the coming physics step and push the rigid bodies."""
        if not self.cloths:
            return
        self._steps += 1
        self._until_look -= 1
        if self._until_look <= 0:
            self._look()
        colliders, period = self._prepare(), self._world.physics_dt
        self._fetch(colliders, period)
        for cloth in self.cloths:
            tears = cloth.tears
            cloth.advance(colliders, self._gravity, period)
            if cloth.tears != tears:
                self._until_look = 0

    def mark(self) -> None:
        """Remember the present state as the one that `rewind` returns to."""
        self._marked = [cloth.save() for cloth in self.cloths]
        self._forget()

    def rewind(self) -> None:
        """Return to the marked state."""
        for cloth, snapshot in zip(self.cloths, self._marked, strict=True):
            cloth.restore(snapshot)
        self._forget()

    def _forget(self) -> None:
        self._until_look, self._read[:] = 0, -2

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return where cloth pressed on `a`, friction included; cloth belongs to no body, so not if `b`.

        The force of a contact is the size of the resultant on a link. See `Cloth.contacts` for the load
        of a sleeve that squeezes all round.
        """
        found = []
        for cloth in self.cloths if b is None else ():
            for touch in cloth.contacts:
                if touch.body is a:
                    size = float(np.linalg.norm(touch.force))
                    x, y, z = (touch.force / max(size, 1e-12)).tolist()
                    point = tuple(touch.point.tolist())
                    found.append(Contact(touch.link, -1, point, (x, y, z), 0.0, size))
        return found

    def _prepare(self) -> Colliders:
        """Read the shapes of all rigid bodies again if there are new ones."""
        world = self._world
        if self._colliders is None or self._known != len(world.bodies):
            self._known = len(world.bodies)
            chosen = [body for body in world.bodies if body not in self._ignored]
            self._colliders = Colliders(chosen, world.client)
            _lengthen(self._colliders, self._joined)
            self._before = np.zeros((len(self._colliders.links), 7))
            self._read = np.full(len(self._colliders.links), -2)
            self._until_look = 0
        return self._colliders

    def _look(self) -> None:
        """Find which shapes are near each cloth and which particles are near each other."""
        colliders = self._prepare()
        wait = LOOK * self._world.physics_dt
        reach = NEAR + (FASTEST + SHAPE_SPEED) * wait
        spheres = []
        for cloth in self.cloths:
            low, high = cloth.positions.min(axis=0), cloth.positions.max(axis=0)
            spheres.append(((low + high) / 2, float(np.linalg.norm(high - low)) / 2))
        fresh = np.zeros(len(colliders.links), np.bool_)
        for k, body in enumerate(colliders.bodies):
            if not colliders.rows_of[k]:
                continue
            at = body.centre_pose()[0]
            gap = min(math.dist(middle, at) - radius for middle, radius in spheres)
            if gap - colliders.reaches[k] < reach:
                colliders.fetch_body(k)
                fresh[colliders.rows_of[k]] = True
        rows = np.flatnonzero(fresh[colliders.shape_links])
        meetings = colliders.relate(_WORLD, rows, 1.0).astype(np.float64)
        wanted = {
            row for cloth in self.cloths for row in cloth.look(colliders, rows, meetings, wait)
        }
        self._wanted = _by_body(colliders, sorted(wanted))
        self._until_look = LOOK

    def _fetch(self, colliders: Colliders, period: float) -> None:
        """Read the states of all near links; let those set from pose to pose move there in the step."""
        client = self._world.client
        for body, links, rows in self._wanted:
            if links == [-1]:
                colliders.states[rows[0]] = link_state(body, -1, client)
            else:
                found = bullet.getLinkStates(body.uid, links, 1, 1, physicsClientId=client)
                states = [(*s[0], *s[1], *s[6], *s[7]) for s in found]
                colliders.states[rows] = states
            for row in rows.tolist():
                self._haul(colliders.states[row], row, period)

    def _haul(self, state: Array, row: int, period: float) -> None:
        """Let a link that is set from pose to pose move there within the step."""
        before, is_known = self._before[row].copy(), self._read[row] == self._steps - 1
        self._before[row], self._read[row] = state[:7], self._steps
        if not is_known or (state[:7] == before).all() or np.abs(state[7:]).max() > _AT_REST:
            return
        apart = state[:3] - before[:3]
        if float(apart @ apart) < (LEAP * period) ** 2:
            turn = rotation_vector(multiply(state[3:7], conjugate(before[3:])))
            state[:7], state[7:10], state[10:] = before, apart / period, turn / period


def _lengthen(colliders: Colliders, bodies: list[Body]) -> None:
    """Make the slender capsules of some bodies longer."""
    for row, link in enumerate(colliders.shape_links):
        shape = colliders._local[row]
        half, radius = shape[12:14]
        is_limb = colliders.kinds[row] == CAPSULE and half > SLENDER * radius
        if is_limb and any(colliders.links[link][0] is body for body in bodies):
            shape[12] += JOINED * radius
            colliders.radii[row] += JOINED * radius


def _by_body(colliders: Colliders, rows: list[int]) -> list[tuple[Body, list[int], Rows]]:
    """Return body, links and rows of links, those of one body that have joints together."""
    found: dict[tuple[int, bool], tuple[Body, list[int], list[int]]] = {}
    for row in rows:
        body, link = colliders.links[row]
        _, links, own = found.setdefault((id(body), link < 0), (body, [], []))
        links.append(link)
        own.append(row)
    return [(body, links, np.array(own)) for body, links, own in found.values()]


_WORLD = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


__all__ = ["Wardrobe"]
