"""A cloth: particles that stretch, shear, bend, fall, lie on rigid bodies and are held by them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..body import Body
from ..errors import ConfigError, WorldError
from ..pose import Array, Vector, matrix_from_quaternion
from . import cloth_contact as contact
from . import cloth_kernel as kernel
from .cloth_contact import Drift, Impact, Pairs
from .collider import Colliders, NearShapes
from .constraint import SOFTNESS, make_constraints, torn, vertex_masses
from .contact import BOX, CAPSULE, SIZE, SPHERE, Indices, Rows, Shapes, plain
from .kernel import line_point
from .material import Fabric
from .soft_object import ParticleObject, SoftContact

SUBSTEPS = 10  # in a physics step of 1/240 s
# A particle goes no faster: with 5 mm a small step it passes through no limb. Less would cut the force with
# which taut cloth can hold something up.
FASTEST = 12.0  # [m/s]
EMERGENCE = 4.0  # [m/s], how fast what has got into a body comes out
AIR = 0.5 * 1.2 * 1.1  # [kg/m³]: half the density of air times the drag coefficient of a plate
CLOSENESS = 0.6  # least distance of particles of a cloth, as a share of the length of its threads
REACH = 0.003  # [m] beyond what a particle and a shape move in a step
HURRY = 1.0  # [m/s], speed that a particle may have before cloth looks around again
SHAPE_SPEED = 2.0  # [m/s] of a shape, from pose to pose: nothing in care moves faster for long
STIFFNESS = 2000.0  # [N/m] of a whole hold: a light finger at 1/240 s stays at rest; our own choice
FORCE = 60.0  # [N] of a whole hold: a firm grip, our own choice
_MORE = 1.5
SLIP = 0.03  # [m] beyond what its spring yields, where a particle has slipped out; our own choice
_PAIRS = 16  # shapes that one particle can be near, on average
_SHARP = 4  # sharp shapes that the middle of a thread can be near, on average
_BROAD = 0.5  # [m], half an edge of a box from where it is furniture, whose edges need no care
_CELLS = 16  # of the grid for finding them, per particle
_CLOSE = 12  # particles of the cloth that one can be near, on average


class Grip:
    """Particles of a cloth that a link holds by springs, which together pull no harder than a hold can.

    Attributes:
        body: What holds.
        link: Index of the link that holds.
        particles: What is held, shape [p]; fewer when cloth has slipped out.
        force: Greatest force of the whole hold [N].
        pull: Force on the link in the last physics step, in the world [N], shape [3].
    """

    def __init__(
        self,
        body: Body,
        link: int,
        particles: Indices,
        points: Array,
        state: Array,
        *,
        force: float,
        stiffness: float,
    ) -> None:
        """Hold particles where they are.

        Args:
            body: What holds.
            link: Index of its link.
            particles: What is held, shape [p].
            points: Where they are in the world [m], shape [p, 3].
            state: Of the link, see `collider`.
            force: Greatest force [N].
            stiffness: Of the whole hold [N/m].
        """
        self.body, self.link, self.force = body, link, force
        self.particles = particles
        self.pull = np.zeros(3)
        self._local = (points - state[:3]) @ matrix_from_quaternion(state[3:7])
        self._pins = np.zeros((len(particles), kernel.PIN))
        self._pins[:, :3] = points
        self._pins[:, kernel.PIN_SOFTNESS] = max(len(particles), 1) / stiffness
        self._pins[:, kernel.PIN_LIMIT] = force / max(len(particles), 1)

    @property
    def is_active(self) -> bool:
        """Whether it still holds anything."""
        return len(self.particles) > 0

    @property
    def load(self) -> float:
        """Size of the force on the link in the last physics step [N]."""
        return float(np.linalg.norm(self.pull))

    def lead(self, state: Array, period: float, substeps: int) -> Array:
        """Return the pins, on their way to where the link will be at the end of the step."""
        arms = self._local @ matrix_from_quaternion(state[3:7]).T
        turn = state[10:]
        spun = arms[:, [2, 0, 1]] * turn[[1, 2, 0]] - arms[:, [1, 2, 0]] * turn[[2, 0, 1]]
        ahead = state[:3] + arms + period * (state[7:10] + spun)
        self._pins[:, kernel.WAY : kernel.WAY + 3] = (ahead - self._pins[:, :3]) / substeps
        self._pins[:, kernel.PULL :] = 0
        return self._pins

    def settle(self, pins: Array, x: Array, period: float) -> Array | None:
        """Take the pins back after a step and let go of what slipped.

        Returns:
            A point of the line of action of `pull` [m], shape [3]; None if there is no pull.
        """
        self._pins[:] = pins
        forces, points = -pins[:, kernel.PULL :] / period, x[self.particles, :3]
        self.pull = forces.sum(axis=0)
        point = None
        if self.pull @ self.pull > 1e-18:
            point, moment = np.empty(3), np.cross(points, forces).sum(axis=0)
            line_point(self.pull, moment, points.mean(axis=0), point)
        sizes = np.linalg.norm(forces, axis=1)
        self._share_out(sizes)
        beyond = np.linalg.norm(points - pins[:, :3], axis=1) - sizes * pins[:, kernel.PIN_SOFTNESS]
        kept = beyond < SLIP
        if not kept.all():
            self.particles, self._pins = self.particles[kept], self._pins[kept]
            self._local = self._local[kept]
        if not len(self.particles):
            self.let_go()
        return point

    def _share_out(self, sizes: Array) -> None:
        """Let each particle pull a little harder than it does, and all together as hard as they can.

        Fingers press on all of it: what one corner does not need, another may have.
        """
        total = max(float(sizes.sum()), 1e-9)
        limits = sizes * min(_MORE, self.force / total)
        self._pins[:, kernel.PIN_LIMIT] = np.maximum(
            limits, self.force / max(len(sizes), 1) / _MORE
        )

    def let_go(self) -> None:
        """Hold nothing any more."""
        self.particles, self._pins = self.particles[:0], self._pins[:0]
        self._local, self.pull = self._local[:0], np.zeros(3)

    def save(self) -> tuple[Any, ...]:
        """Return a snapshot of everything that changes."""
        return (self.particles, self._pins.copy(), self._local, self.pull)

    def restore(self, snapshot: tuple[Any, ...]) -> None:
        """Return to a snapshot, bit for bit."""
        particles, pins, local, pull = snapshot
        self.particles, self._pins = particles, pins.copy()
        self._local, self.pull = local, pull


class Cloth(ParticleObject):
    """A mesh of particles in the frame of the world.

    Attributes:
        constraints: Its threads and folds.
        rest: Positions in cloth at rest [m], shape [n, 3].
        faces: Shape [m, 3].
        grain: Direction of the warp at each particle at rest, shape [n, 3].
        fabric: What it is made of.
        substeps: Small steps in a physics step.
        grips: What holds it.
        tears: How often it has torn.
        spacing: Usual length of its threads [m].
        gap: Least distance of particles that are no neighbours [m].
    """

    color = (120, 150, 180)

    def __init__(
        self,
        name: str,
        rest: Array,
        faces: Indices,
        *,
        fabric: Fabric,
        grain: Array | Vector = (0.0, 0.0, 1.0),
        positions: Array | None = None,
        substeps: int = SUBSTEPS,
    ) -> None:
        """Prepare a cloth that does not move.

        Args:
            name: Name.
            rest: Positions in cloth at rest [m], shape [n, 3]; they give lengths, not a place.
            faces: Shape [m, 3].
            fabric: What it is made of.
            grain: Direction of the warp at rest, one for all or one a particle, shape [3] or [n, 3].
            positions: Where it is in the world [m], shape [n, 3]; as at rest if None.
            substeps: Small steps in a physics step.

        Raises:
            ConfigError: If `substeps` is below 1, a face has no area, a particle belongs to no face,
                or shapes do not fit.
        """
        if substeps < 1:
            raise ConfigError(f"substeps must be at least 1, got {substeps}")
        super().__init__(name)
        self.fabric, self.substeps = fabric, substeps
        self.rest = np.ascontiguousarray(rest, np.float64)
        self.faces = np.ascontiguousarray(faces, np.int32)
        count = len(self.rest)
        given = self.rest if positions is None else np.asarray(positions, np.float64)
        if given.shape != (count, 3):
            raise ConfigError(f"positions must have the shape {(count, 3)}, got {given.shape}")
        lone = np.setdiff1d(np.arange(count), self.faces)
        if len(lone):
            raise ConfigError(f"particle {lone[0]} of the cloth {name!r} belongs to no face")
        self.grain = np.array(np.broadcast_to(np.asarray(grain, np.float64), (count, 3)))
        self.grips: list[Grip] = []
        self.tears = 0
        self._is_bound = False
        self._mesh(given, np.zeros((count, 3)))

    def _mesh(self, positions: Array, velocities: Array) -> None:
        """Make everything that depends on the mesh."""
        count = len(self.rest)
        masses = vertex_masses(self.rest, self.faces, self.fabric)
        self.constraints = make_constraints(self.rest, self.faces, self.grain, self.fabric)
        threads = len(self.constraints.threads)
        self.points = np.empty((count, 4))
        self.points[:, :3], self.points[:, 3] = positions, 1 / masses
        self.velocities = np.ascontiguousarray(velocities)
        self._particles = kernel.Particles(
            self.points, self.velocities, np.zeros((count, 3)), np.zeros((count, 4))
        )
        self._near, self._touching = (_pairs(_PAIRS * count) for _ in range(2))
        self._near_sharp, self._touching_sharp = (_pairs(_SHARP * threads) for _ in range(2))
        ends = self.constraints.threads.T.ravel()  # which threads are at each particle
        around = np.argsort(ends, kind="stable") % max(threads, 1)
        self._threads_at = (around, np.searchsorted(np.sort(ends), np.arange(count + 1)))
        self._stamps = np.zeros(threads, np.int64)
        self._middles, self._drift = np.zeros((threads, 3)), np.zeros((threads, 3))
        self._close = kernel.ClosePairs(_pairs(_CLOSE * count).rows, np.zeros(_CLOSE * count), 0)
        starts = np.zeros(max(_CELLS * count, 64) + 1, np.int64)
        self._grid = kernel.Grid(starts, *(np.zeros(count, np.int64) for _ in range(2)))
        self.near = None
        self.spacing = float(np.median(self.constraints.thread_table[:, 0]))
        self.gap = CLOSENESS * self.spacing

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float((1 / self.points[:, 3]).sum())

    @property
    def strain(self) -> Array:
        """Present strain of each thread, shape [t]."""
        ends = self.points[self.constraints.threads, :3]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        return np.asarray(lengths / self.constraints.thread_table[:, 0] - 1)

    def bind(self) -> None:
        """Say that it is in a world; its `SoftWorld` does."""
        self._is_bound = True

    def place(self, positions: Array) -> None:
        super().place(positions)
        self._close = self._close._replace(size=0)

    def nearest(self, point: Vector, radius: float) -> Indices:
        """Return the particles within `radius` [m] of a point in the world [m]."""
        apart = self.points[:, :3] - np.asarray(point, np.float64)
        return np.flatnonzero(np.einsum("na,na->n", apart, apart) <= radius**2).astype(np.int32)

    def grasp(
        self,
        body: Body,
        link: str | int,
        radius: float,
        *,
        point: Vector | None = None,
        force: float = FORCE,
        stiffness: float = STIFFNESS,
    ) -> Grip:
        """Let a link hold what is near it; a hold of nothing if there is nothing.

        Args:
            body: What holds.
            link: Its link.
            radius: How far from the point cloth is caught [m].
            point: Where in the world [m], shape [3]; the frame of the link if None.
            force: Greatest force of the hold [N]: beyond it cloth slips.
            stiffness: Of the hold [N/m].

        Raises:
            ConfigError: If radius, force or stiffness is not above 0.
            WorldError: If the cloth is in no world.
        """
        index = body.link_index(link) if isinstance(link, str) else link
        at = body.link_pose(index).position if point is None else point
        return self.hold(self.nearest(at, radius), body, index, force=force, stiffness=stiffness)

    def hold(
        self,
        particles: Sequence[int] | npt.NDArray[np.integer],
        body: Body,
        link: str | int,
        *,
        force: float = FORCE,
        stiffness: float = STIFFNESS,
    ) -> Grip:
        """Let a link hold given particles where they are; see `grasp`."""
        if not self._is_bound:
            raise WorldError(f"the cloth {self.name!r} is in no world: SoftWorld.of(world).add it")
        if not force > 0 or not stiffness > 0:
            raise ConfigError(f"force and stiffness must be above 0, got {force}, {stiffness}")
        index = body.link_index(link) if isinstance(link, str) else link
        chosen = np.asarray(particles, np.int32)
        state = np.array(body.centre_state(index))
        points = self.points[chosen, :3].copy()
        grip = Grip(body, index, chosen, points, state, force=force, stiffness=stiffness)
        self.grips.append(grip)
        return grip

    def release(self, grip: Grip | None = None) -> None:
        """Let go of one hold, or of all; letting go twice does no harm."""
        for held in self.grips if grip is None else [grip]:
            held.let_go()
        self.grips = [held for held in self.grips if held.is_active]

    def find_near(self, colliders: Colliders, rows: Rows, wait: float) -> None:
        """Find what can meet within `wait` [s]: particles and shapes, and particles each other.

        Args:
            colliders: The rigid shapes.
            rows: Those whose poses are fresh.
            wait: Until the next look [s].
        """
        drift = Drift(self.fabric.thickness_m + REACH + SHAPE_SPEED * wait, HURRY, wait)
        near = self._near.rows
        count, met = contact.find_pairs(self.points, self.velocities, colliders, rows, drift, near)
        self._near, self.near = Pairs(near, count), NearShapes(colliders, rows[met])
        shapes = self.near.in_world()
        sharp = is_sharp(shapes.kinds, shapes.meetings, self.spacing)
        found = self._near_sharp.rows
        self._near_sharp = Pairs(
            found,
            contact.find_threads(tuple(self._near), sharp, self._threads_at, self._stamps, found),
        )
        kernel.feel_air(self.points, self.faces, AIR, self._particles.air)
        close, way = self._close, self.velocities - self.velocities.mean(axis=0)
        speed = math.sqrt(float(np.einsum("na,na->n", way, way).max()))
        reach = self.gap + min(2 * speed * wait, self.gap)
        count = kernel.find_close(
            self.points, self.rest, self.gap, reach, tuple(self._grid), close.rows, close.gaps
        )
        self._close = close._replace(size=count)

    def advance(self, colliders: Colliders, gravity: Array, period: float) -> None:
        """Simulate one physics step of `period` [s] and push what it met; links must be fresh."""
        fabric, near = self.fabric, self.near or colliders.none
        dt = period / self.substeps
        step = kernel.Step(
            substeps=self.substeps,
            dt=dt,
            keep=math.exp(-fabric.damping_per_s * dt),
            furthest=FASTEST * dt,
            rub=fabric.own_friction,
            lock=fabric.lock_strain,
            factor=fabric.lock_factor,
            field=gravity,
        )
        shapes = near.in_world(fabric.friction)
        outcome = np.zeros((len(near.rows), contact.OUTCOME))
        impact = Impact(shapes, dt, fabric.thickness_m, EMERGENCE * dt, outcome)
        pins = self._lead_pins(period)
        touching = self._find_touching(shapes, period)
        tables = (self._particles, self.constraints, pins, self._close, touching, impact, step)
        kernel.simulate(*plain(tables))
        self._settle_pins(pins.table, period)
        if fabric.tear_strain is not None:
            self._tear(fabric.tear_strain)
        self.contacts = []
        for row, got in contact.forces_on(near, outcome, period):
            self._push(SoftContact(*colliders.links[row], got[:3], got[3:6], load=float(got[6])))

    def _find_touching(self, shapes: Shapes, period: float) -> kernel.Touching:
        """Return what may touch in the coming step."""
        drift = (self.fabric.thickness_m + REACH, HURRY, period)
        tables = tuple(shapes)
        rows, threads = self._touching.rows, self._touching_sharp.rows
        count = few = 0
        if self._near.size:
            count = contact.narrow(
                self.points, self.velocities, tuple(self._near), tables, drift, rows
            )
            if self._near_sharp.size:
                middles = (self._middles, self._drift)
                contact.find_middles(
                    self.points, self.velocities, self.constraints.threads, *middles
                )
                few = contact.narrow(*middles, tuple(self._near_sharp), tables, drift, threads)
        return kernel.Touching(Pairs(rows, count), Pairs(threads, few))

    def _lead_pins(self, period: float) -> kernel.Pins:
        if not self.grips:
            return _NO_PINS
        tables = []
        for grip in self.grips:
            state = np.array(grip.body.centre_state(grip.link))
            tables.append(grip.lead(state, period, self.substeps))
        held = np.concatenate([grip.particles for grip in self.grips])
        return kernel.Pins(held, np.concatenate(tables))

    def _settle_pins(self, pins: Array, period: float) -> None:
        first = 0
        for grip in self.grips:
            last = first + len(grip.particles)
            point = grip.settle(pins[first:last], self.points, period)
            first = last
            if point is not None and (grip.body.is_movable or grip.body.joints):
                grip.body.apply_force(grip.link, grip.pull, point)
        if first and not all(grip.is_active for grip in self.grips):
            self.grips = [grip for grip in self.grips if grip.is_active]

    def _tear(self, limit: float) -> None:
        """Tear where threads are stretched by more than the limit."""
        strain = self.strain
        if strain.max() <= limit:
            return
        worst = np.argsort(-strain, kind="stable")[: int((strain > limit).sum())]
        tension = strain / self.constraints.thread_table[:, SOFTNESS]
        held = np.concatenate([g.particles for g in self.grips] or [np.zeros(0, np.int32)])
        found = torn(self.points[:, :3], self.faces, self.constraints.threads, worst, tension, held)
        if found is None:
            return
        self.faces, parents = found
        self.tears += len(parents)
        chosen = np.concatenate((np.arange(len(self.rest)), parents))
        self.rest, self.grain = self.rest[chosen], self.grain[chosen]
        self._mesh(self.points[chosen, :3], self.velocities[chosen])

    def save(self) -> tuple[Any, ...]:
        grips = [(grip, grip.save()) for grip in self.grips]
        mesh = (self.rest, self.faces, self.grain, self.tears)
        return (self.points.copy(), self.velocities.copy(), mesh, grips, list(self.contacts))

    def restore(self, snapshot: tuple[Any, ...]) -> None:
        x, v, mesh, grips, contacts = snapshot
        is_mended = mesh[1] is not self.faces
        self.rest, self.faces, self.grain, self.tears = mesh
        if is_mended:
            self._mesh(x[:, :3], v.copy())
        self.points[:], self.velocities[:] = x, v
        for held in self.grips:
            held.let_go()
        for grip, saved in grips:
            grip.restore(saved)
        self.grips, self.contacts = [grip for grip, _ in grips], list(contacts)
        self._close = self._close._replace(size=0)


def is_sharp(
    kinds: npt.NDArray[np.int64], meetings: npt.NDArray[Any], spacing: float
) -> npt.NDArray[np.bool_]:
    """Return which shapes could come through a mesh of that spacing [m], shape [m]."""
    size = meetings[:, SIZE : SIZE + 3]
    is_round = (kinds == SPHERE) | (kinds == CAPSULE)
    radius = np.where(kinds == CAPSULE, size[:, 1], size[:, 0])
    is_broad = (kinds == BOX) & (size.max(axis=1) > _BROAD)
    return np.where(is_round, radius < spacing, ~is_broad)


def _pairs(size: int) -> Pairs:
    """Return room for pairs; numbers without a sign, as in `constraint`."""
    return Pairs(np.zeros((size, 2), np.uint32), 0)


_NO_PINS = kernel.Pins(np.zeros(0, np.int32), np.zeros((0, kernel.PIN)))
