"""A cloth: a mesh of particles that stretches, shears, bends, falls, and lies on rigid bodies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..body import Body
from ..errors import ConfigError, WorldError
from ..pose import Vector
from . import cloth_contact as contact
from . import cloth_kernel as kernel
from .collider import Colliders, link_state
from .contact import BOX, CAPSULE, SIZE, SPHERE
from .fabric import Fabric
from .grip import FORCE, STIFFNESS, Grip
from .tear import torn
from .weave import SOFTNESS, Weave, vertex_masses

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]
Unsigned = npt.NDArray[np.uint32]

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
_PAIRS = 16  # shapes that one particle can be near, on average
_SHARP = 4  # sharp shapes that the middle of a thread can be near, on average
_BROAD = 0.5  # [m], half an edge of a box from where it is furniture, whose edges need no care
_CELLS = 16  # of the grid for finding them, per particle
_CLOSE = 12  # particles of the cloth that one can be near, on average


@dataclass(frozen=True, eq=False)
class ClothContact:
    """What a cloth pressed on a link with, in the last physics step, friction included.

    Attributes:
        body: The rigid body.
        link: Its link.
        force: On that link, in the world [N], shape [3].
        point: A point on its line of action in the world [m], shape [3].
        load: Sum of the sizes of all normal forces [N]. A tight sleeve squeezes an arm all round: its
            force is near zero and its load is not.
    """

    body: Body
    link: int
    force: Array
    point: Array
    load: float


@dataclass(frozen=True, eq=False)
class _Neighbours:
    """The shapes that a cloth may touch: rows, kinds, runs of planes, rows of links, and whose each is."""

    shapes: npt.NDArray[np.int64]
    kinds: npt.NDArray[np.int64]
    runs: npt.NDArray[np.int64]
    links: tuple[int, ...]
    owners: npt.NDArray[np.intp]

    @classmethod
    def of(cls, colliders: Colliders, shapes: npt.NDArray[np.int64]) -> _Neighbours:
        """Return these shapes as neighbours."""
        links, owners = np.unique(colliders.shape_links[shapes], return_inverse=True)
        kinds, runs = colliders.kinds[shapes], colliders.runs[shapes]
        return cls(shapes, kinds, runs, tuple(links.tolist()), owners.ravel())


class Cloth:
    """A mesh of particles in the frame of the world. Its `Wardrobe` steps it.

    Attributes:
        name: Name.
        rest: Positions in cloth at rest [m], shape [n, 3].
        faces: Shape [m, 3].
        grain: Direction of the warp at each particle at rest, shape [n, 3].
        fabric: What it is made of.
        substeps: Small steps in a physics step.
        grips: What holds it.
        contacts: What it pressed on in the last physics step.
        tears: How often it has torn.
        spacing: Usual length of its threads [m].
        gap: Least distance of particles that are no neighbours [m].
    """

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
        self_collision: bool = True,
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
            self_collision: Whether it stays out of itself.

        Raises:
            ConfigError: If `substeps` is below 1, a face has no area, a particle belongs to no face,
                or shapes do not fit.
        """
        if substeps < 1:
            raise ConfigError(f"substeps must be at least 1, got {substeps}")
        self.name, self.fabric, self.substeps = name, fabric, substeps
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
        self.contacts: list[ClothContact] = []
        self.tears = 0
        self._avoids_itself = self_collision
        self._client = -1
        self._mesh(given, np.zeros((count, 3)))

    def _mesh(self, positions: Array, velocities: Array) -> None:
        """Make everything that depends on the mesh."""
        count = len(self.rest)
        masses = vertex_masses(self.rest, self.faces, self.fabric)
        self.weave = Weave(self.rest, self.faces, self.grain, self.fabric)
        self._x = np.empty((count, 4))
        self._x[:, :3], self._x[:, 3] = positions, 1 / masses
        self._v = np.ascontiguousarray(velocities)
        self._previous = np.zeros((count, 3))
        self._air = np.zeros((count, 4))
        # Without a sign an index needs no check whether it counts from the end: a fifth of the time.
        self._threads = self.weave.threads.astype(np.uint32)
        self._folds = self.weave.folds.astype(np.uint32)
        self._pairs, self._near = (np.zeros((_PAIRS * count, 2), np.uint32) for _ in range(2))
        self._near_count, self._neighbours = 0, _NOBODY
        threads = len(self._threads)
        self._sharp, self._near_sharp = (
            np.zeros((_SHARP * threads, 2), np.uint32) for _ in range(2)
        )
        self._sharp_count = 0
        ends = self.weave.threads.T.ravel()  # of both ends: which threads are at each particle
        self._around = np.argsort(ends, kind="stable") % max(threads, 1)
        self._thread_starts = np.searchsorted(np.sort(ends), np.arange(count + 1))
        self._stamps = np.zeros(threads, np.int64)
        self._middles, self._drift = np.zeros((threads, 3)), np.zeros((threads, 3))
        self._close = np.zeros((_CLOSE * count, 2), np.uint32)
        self._gaps = np.zeros(_CLOSE * count)
        self._close_count = 0
        self._starts = np.zeros(max(_CELLS * count, 64) + 1, np.int64)
        self._cells, self._members = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self.spacing = float(np.median(self.weave.thread_table[:, 0]))
        self.gap = CLOSENESS * self.spacing

    @property
    def positions(self) -> Array:
        """Present positions in the world [m], shape [n, 3]."""
        return self._x[:, :3]

    @property
    def velocities(self) -> Array:
        """Present velocities [m/s], shape [n, 3]."""
        return self._v

    @property
    def points(self) -> Array:
        """Positions [m] and inverse masses [1/kg], as the kernels know them, shape [n, 4]."""
        return self._x

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float((1 / self._x[:, 3]).sum())

    @property
    def strain(self) -> Array:
        """Present strain of each thread, in the order of the weave, shape [t]."""
        ends = self._x[self.weave.threads, :3]
        return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / self.weave.thread_table[:, 0] - 1

    def bind(self, client: int) -> None:
        """Say which physics client it lives in; its wardrobe does."""
        self._client = client

    def place(self, positions: Array) -> None:
        """Teleport all particles [m], shape [n, 3]; they stand still afterwards.

        Raises:
            ConfigError: If the shape is wrong or a value is not finite.
        """
        given = np.asarray(positions, np.float64)
        if given.shape != self._v.shape or not np.isfinite(given).all():
            raise ConfigError(f"positions must be finite and of the shape {self._v.shape}")
        self._x[:, :3] = given
        self._v[:] = 0
        self._close_count = 0

    def nearest(self, point: Vector, radius: float) -> Indices:
        """Return the particles within `radius` [m] of a point in the world [m]."""
        apart = self._x[:, :3] - np.asarray(point, np.float64)
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
            WorldError: If the cloth is in no wardrobe.
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
        if self._client < 0:
            raise WorldError(
                f"the cloth {self.name!r} is in no wardrobe: Wardrobe.of(world).add it"
            )
        if not force > 0 or not stiffness > 0:
            raise ConfigError(f"force and stiffness must be above 0, got {force}, {stiffness}")
        index = body.link_index(link) if isinstance(link, str) else link
        chosen = np.asarray(particles, np.int32)
        state = np.array(link_state(body, index, self._client))
        points = self._x[chosen, :3].copy()
        grip = Grip(body, index, chosen, points, state, force=force, stiffness=stiffness)
        self.grips.append(grip)
        return grip

    def release(self, grip: Grip | None = None) -> None:
        """Let go of one hold, or of all; letting go twice does no harm."""
        for held in self.grips if grip is None else [grip]:
            held.let_go()
        self.grips = [held for held in self.grips if held.is_active]

    def force_on(self, body: Body, link: int | None = None) -> Array:
        """Return the force of contacts on a body, or on one of its links, in the world [N], shape [3]."""
        chosen = [
            c.force for c in self.contacts if c.body is body and (link is None or c.link == link)
        ]
        return np.sum(chosen, axis=0) if chosen else np.zeros(3)

    def look(
        self, colliders: Colliders, rows: npt.NDArray[np.int64], meetings: Array, wait: float
    ) -> tuple[int, ...]:
        """Find what can meet within `wait` [s]: particles and shapes, and particles each other.

        Args:
            colliders: The rigid shapes.
            rows: Those whose poses are fresh.
            meetings: Their table as seen from the world.
            wait: Until the next look [s].

        Returns:
            Rows of the links that it can touch.
        """
        tables = (colliders.kinds[rows], colliders.planes, colliders.runs[rows])
        radii, reach = colliders.radii[rows], self.fabric.thickness_m + REACH + SHAPE_SPEED * wait
        low, high = self._x[:, :3].min(axis=0), self._x[:, :3].max(axis=0)
        count = self._near_count = contact.find_near(
            self._x, self._v, low, high, meetings, *tables, radii, reach, HURRY, wait, self._near
        )
        met = np.zeros(len(rows), np.bool_)
        met[self._near[:count, 1]] = True
        self._near[:count, 1] = (np.cumsum(met) - 1)[self._near[:count, 1]]
        sharp = is_sharp(tables[0][met], meetings[met], self.spacing)
        self._sharp_count = contact.find_threads(
            self._near, count, sharp, self._thread_starts, self._around, self._stamps,
            self._near_sharp,
        )  # fmt: skip
        self._neighbours = _Neighbours.of(colliders, rows[met])
        kernel.feel_air(self._x, self.faces, AIR, self._air)
        self._close_count = 0
        if self._avoids_itself:
            drift = self._v - self._v.mean(axis=0)
            speed = math.sqrt(float(np.einsum("na,na->n", drift, drift).max()))
            reach = self.gap + min(2 * speed * wait, self.gap)
            self._close_count = kernel.find_close(
                self._x, self.rest, self.gap, reach, self._starts, self._cells, self._members,
                self._close, self._gaps,
            )  # fmt: skip
        return self._neighbours.links

    def advance(self, colliders: Colliders, gravity: Array, period: float) -> None:
        """Simulate one physics step of `period` [s] and push what it met; links must be fresh."""
        fabric, weave, near = self.fabric, self.weave, self._neighbours
        dt = period / self.substeps
        constants = np.empty(kernel.CONSTANTS)
        constants[: kernel.FIELD] = (
            dt, math.exp(-fabric.damping_per_s * dt), FASTEST, EMERGENCE, fabric.own_friction,
            fabric.thickness_m, fabric.lock_strain, fabric.lock_factor,
        )  # fmt: skip
        constants[kernel.FIELD :] = gravity
        pinned, pins = self._lead_pins(period)
        meetings = colliders.relate(_WORLD, near.shapes, fabric.friction).astype(np.float64)
        outcome = np.zeros((len(near.shapes), contact.OUTCOME))
        shapes, count, few = (near.kinds, colliders.planes, near.runs), 0, 0
        if self._near_count:
            rest = (*shapes, colliders.radii[near.shapes], fabric.thickness_m + REACH, period)
            count = contact.narrow(
                self._x, self._v, self._near, self._near_count, meetings, *rest, self._pairs
            )
            if self._sharp_count:
                contact.find_middles(self._x, self._v, self._threads, self._middles, self._drift)
                few = contact.narrow(
                    self._middles, self._drift, self._near_sharp, self._sharp_count, meetings,
                    *rest, self._sharp,
                )  # fmt: skip
        kernel.simulate(
            self._x, self._v, self._previous, self._air, constants, self.substeps, self._threads,
            weave.thread_table, self._folds, weave.fold_table, pinned, pins, self._close,
            self._gaps, self._close_count, self._pairs, count, self._sharp, few, meetings, *shapes,
            outcome,
        )  # fmt: skip
        self._settle_pins(pins, period)
        if fabric.tear_strain is not None:
            self._tear(fabric.tear_strain)
        self._read_contacts(colliders, near, outcome, period)

    def _lead_pins(self, period: float) -> tuple[Indices, Array]:
        if not self.grips:
            return _NO_PINS
        tables = []
        for grip in self.grips:
            state = np.array(link_state(grip.body, grip.link, self._client))
            tables.append(grip.lead(state, period, self.substeps))
        return np.concatenate([grip.particles for grip in self.grips]), np.concatenate(tables)

    def _settle_pins(self, pins: Array, period: float) -> None:
        first = 0
        for grip in self.grips:
            last = first + len(grip.particles)
            point = grip.settle(pins[first:last], self._x, period)
            first = last
            if point is not None and (grip.body.is_movable or grip.body.joints):
                grip.body.apply_force(grip.link, grip.pull, point)
        if first and not all(grip.is_active for grip in self.grips):
            self.grips = [grip for grip in self.grips if grip.is_active]

    def _read_contacts(
        self, colliders: Colliders, near: _Neighbours, outcome: Array, period: float
    ) -> None:
        """Sum up by link what the shapes got, note it in `contacts`, and push the links."""
        self.contacts = []
        sums = np.empty((len(near.links), 7))
        contact.sum_by_link(outcome, near.owners, period, _FAR, sums)
        for place, row in enumerate(sums.tolist()):
            if row[6] <= 0:
                continue
            body, link = colliders.links[near.links[place]]
            force, point = sums[place, :3], sums[place, 3:6]
            self.contacts.append(ClothContact(body, link, force, point, row[6]))
            if body.is_movable or body.joints:
                body.apply_force(link, row[:3], row[3:6])

    def _tear(self, limit: float) -> None:
        """Tear where threads are stretched by more than the limit."""
        strain = self.strain
        if strain.max() <= limit:
            return
        worst = np.argsort(-strain, kind="stable")[: int((strain > limit).sum())]
        tension = strain / self.weave.thread_table[:, SOFTNESS]
        held = np.concatenate([g.particles for g in self.grips] or [np.zeros(0, np.int32)])
        found = torn(self._x[:, :3], self.faces, self.weave.threads, worst, tension, held)
        if found is None:
            return
        self.faces, parents = found
        self.tears += len(parents)
        chosen = np.concatenate((np.arange(len(self.rest)), parents))
        self.rest, self.grain = self.rest[chosen], self.grain[chosen]
        self._mesh(self._x[chosen, :3], self._v[chosen])

    def save(self) -> tuple[Any, ...]:
        """Return a snapshot of everything that changes."""
        grips = [(grip, grip.save()) for grip in self.grips]
        mesh = (self.rest, self.faces, self.grain, self.tears)
        return (self._x.copy(), self._v.copy(), mesh, grips, list(self.contacts))

    def restore(self, snapshot: tuple[Any, ...]) -> None:
        """Return to a snapshot, bit for bit."""
        x, v, mesh, grips, contacts = snapshot
        is_mended = mesh[1] is not self.faces
        self.rest, self.faces, self.grain, self.tears = mesh
        if is_mended:
            self._mesh(x[:, :3], v.copy())
        self._x[:], self._v[:] = x, v
        for held in self.grips:
            held.let_go()
        for grip, saved in grips:
            grip.restore(saved)
        self.grips, self.contacts = [grip for grip, _ in grips], list(contacts)
        self._close_count = 0


def is_sharp(
    kinds: npt.NDArray[np.int64], meetings: Array, spacing: float
) -> npt.NDArray[np.bool_]:
    """Return which shapes could come through a mesh of that spacing [m], shape [m]."""
    size = meetings[:, SIZE : SIZE + 3]
    is_round = (kinds == SPHERE) | (kinds == CAPSULE)
    radius = np.where(kinds == CAPSULE, size[:, 1], size[:, 0])
    is_broad = (kinds == BOX) & (size.max(axis=1) > _BROAD)
    return np.where(is_round, radius < spacing, ~is_broad)


_FAR = 0.5  # [m]
_NOBODY = _Neighbours(
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
    np.zeros((0, 2), np.int64),
    (),
    np.zeros(0, np.intp),
)
_WORLD = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
_NO_PINS = (np.zeros(0, np.int32), np.zeros((0, kernel.PIN)))


__all__ = ["FASTEST", "SHAPE_SPEED", "SUBSTEPS", "Cloth", "ClothContact"]
