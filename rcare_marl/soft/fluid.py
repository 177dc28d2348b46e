"""A fluid: particles that keep their density, run, splash and lie in vessels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import ConfigError
from ..pose import Array, rotate
from . import cloth_contact as contact
from . import fluid_kernel as kernel
from .cloth_contact import Drift, Impact, Pairs
from .collider import Colliders, NearShapes
from .contact import Rows, plain
from .material import WATER, Liquid
from .soft_object import ParticleObject, SoftContact
from .vessel import DENSITY, FEELING, Vessel, find_outside, sum_up
from .vessel import OUTCOME as VESSEL_OUTCOME

SUBSTEPS, ITERATIONS = 1, 2  # in a physics step of 1/240 s; fewer boil, more cost in proportion
REACH = 2.0  # of the kernel, in spacings: about 30 neighbours
REST_SUM = 0.58  # sum of the kernel over neighbours at rest, times spacing³; measured
SOFTNESS = 1.0  # of the density constraint; quiet from 0.5 on
FASTEST = 8.0  # [m/s] of a particle
CONTACT = 0.5  # distance of a particle from a wall, in spacings
MARGIN = 1.2  # how far pairs are looked for, in reaches
HURRY = 1.0  # [m/s], speed that a particle may have before it is looked for again
SHAPE_REACH = 0.004  # [m] beyond what particle and shape move until the next look
SHAPE_SPEED = 2.0  # [m/s] of a shape: nothing in care moves faster for long
PARKED = (0.0, 0.0, -50.0)  # [m] where particles are that were taken away
_PAIRS = 60  # neighbours that one particle can have, on average
_TOUCHES = 8  # shapes that one particle can be near, on average


class Fluid(ParticleObject):
    """Particles of one liquid in the frame of the world.

    Attributes:
        spacing: Edge of the cube of liquid that a particle stands for [m].
        liquid: What it is made of.
        particle_mass: Mass of a particle [kg].
        is_active: Which particles there are, without those taken away, shape [n].
    """

    color = (70, 140, 215, 255)

    def __init__(
        self,
        name: str,
        positions: Array,
        *,
        spacing: float,
        liquid: Liquid = WATER,
    ) -> None:
        """Prepare a fluid that does not move.

        Args:
            name: Name.
            positions: Where its particles are in the world [m], shape [n, 3].
            spacing: Edge of the cube of liquid that a particle stands for [m].
            liquid: What it is made of.

        Raises:
            ConfigError: If there are no particles, or `spacing` is not positive.
        """
        given = np.asarray(positions, np.float64)
        if given.ndim != 2 or given.shape[1] != 3 or not len(given):
            raise ConfigError(f"positions must have the shape (n, 3), got {given.shape}")
        if not spacing > 0:
            raise ConfigError(f"spacing must be above 0, got {spacing}")
        super().__init__(name)
        self.spacing, self.liquid = spacing, liquid
        self.particle_mass = liquid.density_kg_m3 * spacing**3
        self._allocate(len(given))
        self.place(given)

    def _allocate(self, count: int) -> None:
        self.points = np.empty((count, 4))
        self.points[:, 3] = 1 / self.particle_mass
        self.velocities, self._previous, self._paired = (np.zeros((count, 3)) for _ in range(3))
        self.is_active = np.ones(count, np.bool_)
        self._active = np.arange(count)
        self._at_vessel, self._outside = (np.zeros(count, np.int64) for _ in range(2))
        # Without a sign an index needs no check whether it counts from the end.
        pairs, met = (np.zeros((_PAIRS * count, 2), np.uint32) for _ in range(2))
        weights = np.zeros((_PAIRS * count, 4), np.float32)
        feel = np.zeros((count, FEELING), np.float32)
        self._neighbours = kernel.Neighbours(pairs, -1, met, weights, feel)
        starts = np.zeros(2 + 2 ** math.ceil(math.log2(2 * count + 1)), np.int64)
        self._grid = kernel.Grid(starts, np.zeros(count, np.int64), np.zeros((count, 4), np.int64))
        self._touching = Pairs(np.zeros((_TOUCHES * count, 2), np.uint32), 0)

    @property
    def count(self) -> int:
        """How many particles there are, without those taken away."""
        return len(self._active)

    @property
    def size(self) -> int:
        """How many particles there were at first."""
        return len(self.points)

    @property
    def mass(self) -> float:
        """Mass of the particles that there are [kg]."""
        return self.count * self.particle_mass

    @property
    def densities(self) -> npt.NDArray[np.float32]:
        """Density at each particle in the last step, 1 at rest, shape [n]; of active ones only."""
        return self._neighbours.feel[:, DENSITY]

    def place(self, positions: Array) -> None:
        """Teleport all particles [m], shape [n, 3]; all are there again and stand still."""
        super().place(positions)
        self.is_active[:] = True
        self._active = np.arange(len(self.points))
        self._forget()

    def take(self, chosen: npt.NDArray[np.bool_] | npt.NDArray[np.integer]) -> None:
        """Take particles out of the world: a mask or their numbers."""
        self.is_active[chosen] = False
        self.points[chosen, :3], self.velocities[chosen] = PARKED, 0
        # Pairs with them are too far apart from now on: no need to find all pairs anew.
        self._active = np.flatnonzero(self.is_active)

    def _forget(self) -> None:
        self._neighbours = self._neighbours._replace(size=-1)
        self.ignore_shapes()

    def find_outside(self, vessels: Array) -> Rows:
        """Return the particles that are in no vessel, or near its rim."""
        count = find_outside(
            self.points, self._active, vessels, REACH * self.spacing, self._outside
        )
        return self._outside[:count].copy()

    def find_near(self, colliders: Colliders, rows: Rows, wait: float, outside: Rows) -> None:
        """Find what particles outside of vessels can meet within `wait` [s].

        Args:
            colliders: The rigid shapes.
            rows: Those whose poses are fresh.
            wait: Until the next look [s].
            outside: Those particles.
        """
        x, v = self.points[outside], self.velocities[outside]
        drift = Drift(CONTACT * self.spacing + SHAPE_REACH + SHAPE_SPEED * wait, HURRY, wait)
        found = np.zeros((_TOUCHES * max(len(outside), 1), 2), np.uint32)
        count, met = contact.find_pairs(x, v, colliders, rows, drift, found)
        touching = self._touching.rows
        touching[:count, 0], touching[:count, 1] = outside[found[:count, 0]], found[:count, 1]
        self._touching, self.near = Pairs(touching, count), NearShapes(colliders, rows[met])

    def ignore_shapes(self) -> None:
        """Meet no rigid shape until the next `find_near`."""
        self._touching, self.near = self._touching._replace(size=0), None

    def advance(
        self,
        colliders: Colliders,
        vessels: list[Vessel],
        table: Array,
        gravity: Array,
        period: float,
    ) -> None:
        """Simulate one physics step of `period` [s] and push what it met; links must be fresh."""
        self._find_pairs(period)
        step = self._step(gravity, period)
        near = self.near or colliders.none
        met = np.zeros((len(near.rows), contact.OUTCOME))
        is_touching = self._touching.size > 0
        shapes = near.in_world(self.liquid.friction) if is_touching else colliders.no_shapes
        impact = Impact(shapes, step.dt, step.radius, 1.0, met)
        outcome = np.zeros((len(table), VESSEL_OUTCOME))
        particles = (self.points, self.velocities, self._previous, self._active, self._at_vessel)
        inside = (table.copy(), table.copy(), outcome)
        tables = (particles, self._neighbours, inside, self._touching, impact, step)
        kernel.simulate(*plain(tables))
        self.contacts = []
        for vessel, row, got in zip(vessels, table, outcome, strict=True):
            if got.any():
                sums = np.empty(6)
                sum_up(got, row, period, sums)
                self._push(SoftContact(vessel.body, vessel.link, sums[:3], sums[3:]))
        if is_touching:
            for link, got in contact.forces_on(near, met, period):
                self._push(SoftContact(*colliders.links[link], got[:3], got[3:6], float(got[6])))

    def _find_pairs(self, period: float) -> None:
        """Find who can be neighbours, if those found before are too far from where they were."""
        reach = REACH * self.spacing
        ahead = (self.points, self.velocities, self._paired, self._active, period)
        if self._neighbours.size < 0 or 2 * kernel.drift(*ahead) > (MARGIN - 1) * reach:
            pairs = self._neighbours.pairs
            count = kernel.find_pairs(
                self.points, self._active, MARGIN * reach, tuple(self._grid), pairs
            )
            self._neighbours = self._neighbours._replace(size=count)
            self._paired[:] = self.points[:, :3]

    def _step(self, gravity: Array, period: float) -> kernel.Step:
        liquid, d, dt = self.liquid, self.spacing, period / SUBSTEPS
        return kernel.Step(
            substeps=SUBSTEPS,
            iterations=ITERATIONS,
            dt=dt,
            reach=REACH * d,
            target=d**3 / REST_SUM,
            softness=SOFTNESS,
            cohesion=liquid.cohesion,
            viscosity=1 - math.exp(-liquid.viscosity_per_s * dt),
            drag=1 - math.exp(-liquid.wall_drag_per_s * dt),
            radius=CONTACT * d,
            fastest=FASTEST,
            mass=self.particle_mass,
            field=gravity,
        )

    def save(self) -> tuple[Any, ...]:
        return (
            self.points.copy(),
            self.velocities.copy(),
            self.is_active.copy(),
            list(self.contacts),
        )

    def restore(self, snapshot: tuple[Any, ...]) -> None:
        self.points[:], self.velocities[:], self.is_active[:], contacts = snapshot
        self.contacts = list(contacts)
        self._active = np.flatnonzero(self.is_active)
        self._forget()


def fill(vessel: Vessel, volume: float, spacing: float) -> Array:
    """Return places in the world for the particles of a volume [m³] in an upright vessel [m], shape [n, 3].

    Raises:
        ConfigError: If the vessel holds less.
    """
    vessel.level(volume)
    frame, count = vessel.frame(), max(1, round(volume / spacing**3))
    slope = (vessel.rim_radius - vessel.bottom_radius) / vessel.depth
    layers: list[Array] = []
    up = 0.5 * spacing
    while sum(map(len, layers)) < count:
        wide = vessel.bottom_radius + slope * up - 0.5 * spacing
        ticks = np.arange(-math.floor(wide / spacing), math.floor(wide / spacing) + 1) * spacing
        x, y = (a.ravel() for a in np.meshgrid(ticks, ticks))
        kept = x * x + y * y <= wide * wide
        layers.append(np.column_stack((x, y, np.full(len(x), up)))[kept])
        up += spacing
    local = np.concatenate(layers)[:count]
    return np.array([rotate(frame.quaternion, p) for p in local]) + frame.position
