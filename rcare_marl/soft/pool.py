"""All fluids of a world: the vessels they lie in, what they meet outside, and the snapshot."""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..body import Body
from ..contact import Contact
from ..world import GRAVITY, World
from . import vessel_kernel as kernel
from .collider import Colliders
from .fluid import HURRY, SHAPE_SPEED, Fluid
from .fluid_skin import FluidSkin
from .vessel import Vessel

LOOK = 4  # physics steps between two looks around
NEAR = 0.02  # [m] beyond what particle and shape can move until the next look; our own choice


class Pool:
    """The fluids of one world; the world steps, marks and rewinds them.

    Attributes:
        fluids: The fluids, in the order in which they came.
        vessels: What they lie in.
    """

    def __init__(self, world: World) -> None:
        self._world: World = weakref.proxy(world)
        self.fluids: list[Fluid] = []
        self.vessels: list[Vessel] = []
        self._ignored: list[Body] = []
        self._colliders: Colliders | None = None
        self._known = 0
        self._gravity = np.array((0.0, 0.0, -GRAVITY))
        self._wanted: list[int] = []
        self._steps = self._until_look = 0
        self._marked: list[tuple[Any, ...]] = []

    @staticmethod
    def of(world: World) -> Pool:
        """Return the pool of a world; it comes into being when it is first asked for."""
        for matter in world.matter:
            if isinstance(matter, Pool):
                return matter
        made = Pool(world)
        world.matter.append(made)
        return made

    def add(self, fluid: Fluid, *, rgba: tuple[int, int, int, int] = (70, 140, 215, 255)) -> Fluid:
        """Put a fluid into the world, of that colour, and return it."""
        self.fluids.append(fluid)
        # Renderers ask what a skin belongs to: a body that is nowhere and touches nothing.
        body = self._world.add_box((0.001,) * 3, collides=False, name=fluid.name)
        self._ignored.append(body)
        self._world.skins.append(FluidSkin(fluid, body, rgba))
        self._colliders = None
        return fluid

    def add_vessel(self, vessel: Vessel) -> Vessel:
        """Let fluids lie in a vessel; its body then counts for them as that alone."""
        self.vessels.append(vessel)
        self.ignore([vessel.body])
        return vessel

    def ignore(self, bodies: Iterable[Body]) -> None:
        """Let fluids pass through rigid bodies."""
        self._ignored.extend(bodies)
        self._colliders = None

    def step(self) -> None:
        """Simulate up to the end of the coming physics step and push the rigid bodies."""
        if not any(fluid.count for fluid in self.fluids):
            return
        self._steps += 1
        self._until_look -= 1
        colliders, world = self._prepare(), self._world
        table = np.empty((len(self.vessels), kernel.VESSEL))
        for row, vessel in zip(table, self.vessels, strict=True):
            vessel.write(row, world.client, self._steps, world.physics_dt)
        if self._until_look <= 0:
            self._look(colliders, table)
        for link in self._wanted:
            colliders.fetch_link(link)
        for fluid in self.fluids:
            if fluid.count:
                fluid.advance(colliders, self.vessels, table, self._gravity, world.physics_dt)

    def mark(self) -> None:
        """Remember the present state as the one that `rewind` returns to."""
        self._marked = [fluid.save() for fluid in self.fluids]
        self._forget()

    def rewind(self) -> None:
        """Return to the marked state."""
        for fluid, snapshot in zip(self.fluids, self._marked, strict=True):
            fluid.restore(snapshot)
        self._forget()

    def _forget(self) -> None:
        self._until_look, self._wanted = 0, []
        for vessel in self.vessels:
            vessel.forget()

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return where fluids pressed on `a`; a fluid belongs to no body, so not if `b`."""
        found = []
        for fluid in self.fluids if b is None else ():
            for touch in fluid.contacts:
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
            self._until_look, self._wanted = 0, []
        return self._colliders

    def _look(self, colliders: Colliders, table: npt.NDArray[np.float64]) -> None:
        """Find which shapes particles outside of vessels are near."""
        self._until_look, wait = LOOK, LOOK * self._world.physics_dt
        reach = NEAR + (HURRY + SHAPE_SPEED) * wait
        wanted: set[int] = set()
        for fluid in self.fluids:
            outside = fluid.find_outside(table)
            if not len(outside):
                fluid.ignore_shapes()
                continue
            points = fluid.positions[outside]
            speed = float(np.abs(fluid.velocities[outside]).max())
            middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
            radius = float(np.linalg.norm(points - middle, axis=1).max()) + wait * speed
            rows = self._fetch_near(colliders, middle, radius + reach)
            meetings = colliders.relate(_WORLD, rows, 1.0).astype(np.float64)
            wanted.update(fluid.look(colliders, rows, meetings, wait, outside))
        self._wanted = sorted(wanted)

    @staticmethod
    def _fetch_near(
        colliders: Colliders, middle: npt.NDArray[np.float64], reach: float
    ) -> npt.NDArray[np.int64]:
        """Read the poses of all bodies that can be near a place, and return their shapes."""
        fresh = np.zeros(len(colliders.links), np.bool_)
        for k, body in enumerate(colliders.bodies):
            if not colliders.rows_of[k]:
                continue
            if math.dist(middle, body.centre_pose()[0]) - colliders.reaches[k] < reach:
                colliders.fetch_body(k)
                fresh[colliders.rows_of[k]] = True
        return np.flatnonzero(fresh[colliders.shape_links])


_WORLD = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


__all__ = ["Pool"]
