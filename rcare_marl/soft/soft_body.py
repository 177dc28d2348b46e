"""A soft body: particles, what holds them together, and what they press on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..body import Body
from ..errors import ConfigError
from ..pose import Pose, matrix_from_quaternion
from . import contact, kernel
from .collider import Colliders, carry, link_state
from .hinge import Hinges, add_hinge_forces, solve_hinges
from .material import Material
from .spring import Springs, add_spring_forces, solve_springs
from .tetrahedron import (
    SPARE,
    Tetrahedra,
    add_elastic_forces,
    boundary,
    make_scratch,
    solve_tetrahedra,
)

Array = npt.NDArray[np.float64]
Floats = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int32]

SUBSTEPS = 5  # in a physics step of 1/240 s: 20 in a frame of 1/60 s
REACH = 0.004  # [m] from a shape at rest; more for a fast one
SETTLED = 1e-4  # [m] from rest, the deviation that nobody can see or feel
FOCUS_MARGIN = 0.02  # [m] that a contact may move before more is simulated
_PAIRS = 4  # shapes that one particle can be near, on average


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
    """What a soft body pressed on a link with, in the last physics step.

    Attributes:
        body: The rigid body that is pressed.
        link: Its link.
        force: On that link, in the world [N], shape [3].
        point: A point on its line of action in the world [m], shape [3].
        area: Of the skin that touches [m²].
    """

    body: Body
    link: int
    force: Array
    point: Array
    area: float


@dataclass(frozen=True, eq=False)
class Encounter:
    """The shapes that a soft body may touch.

    Attributes:
        shapes: Rows in the table of all shapes, shape [m].
        kinds: Their kinds, shape [m].
        runs: Runs of the planes of hulls, shape [m, 2].
        links: Rows of the links that carry them, each once.
        beds: Stiffness of the flesh on them, zero where they are rigid [Pa/m], shape [m].
    """

    shapes: npt.NDArray[np.int64]
    kinds: npt.NDArray[np.int64]
    runs: npt.NDArray[np.int64]
    links: tuple[int, ...]
    beds: Floats = field(default_factory=lambda: np.zeros(0, np.float32))

    @classmethod
    def of(cls, colliders: Colliders, shapes: npt.NDArray[np.int64]) -> Encounter:
        """Return the encounter with these shapes."""
        links = tuple(np.unique(colliders.shape_links[shapes]).tolist())
        return cls(
            shapes, colliders.kinds[shapes], colliders.runs[shapes], links, colliders.beds[shapes]
        )


class SoftBody:
    """Particles in the frame of a carrier, or of the world, held together by XPBD constraints.

    A body on a carrier moves with it by itself: motion of the carrier shakes nothing. That is meant for
    flesh, whose mass and weight the carrier has already.

    Attributes:
        name: Name.
        rest: Positions at rest in the frame of the body [m], shape [n, 3].
        faces: Surface, shape [m, 3].
        material: What it is made of.
        carrier: What it rides on; the world if None.
        spared: Rigid bodies that it passes through, beside its carrier; see `Matter.spare`.
        is_awake: Whether it is being simulated.
        pressure: On each particle [Pa], shape [n]; zero inside.
        contacts: What it pressed on in the last physics step.
    """

    def __init__(
        self,
        name: str,
        rest: Array,
        *,
        material: Material,
        tetrahedra: Indices | None = None,
        springs: Springs | None = None,
        hinges: Hinges | None = None,
        faces: Indices | None = None,
        masses: Array | None = None,
        held: Sequence[int] | npt.NDArray[np.integer] = (),
        carrier: Carrier | None = None,
        falls: bool = False,
        substeps: int = SUBSTEPS,
        mass_factor: float = 1.0,
        focus: float | None = None,
    ) -> None:
        """Prepare a body at rest.

        Args:
            name: Name.
            rest: Positions at rest in the frame of the carrier, or in the world [m], shape [n, 3].
            material: What it is made of.
            tetrahedra: Elastic tetrahedra, shape [t, 4].
            springs: Distance constraints.
            hinges: Bending constraints.
            faces: Surface; that of the tetrahedra if None.
            masses: Of the particles [kg], shape [n]; from the tetrahedra if None.
            held: Particles that are fixed in the frame of the body.
            carrier: What it rides on; the world if None.
            falls: Whether gravity pulls at it.
            substeps: Small steps in a physics step.
            mass_factor: Factor of the masses that the solver sees. Where inertia does not matter, as
                in flesh that is pressed slowly, more of it brings one iteration closer to balance.
            focus: How far from what touches it a body is simulated [m]; the rest stays at rest. The
                whole body if None.

        Raises:
            ConfigError: If `substeps` is below 1, `mass_factor` or `focus` is not above 0, a
                tetrahedron has no volume, or a particle that is free has no mass.
        """
        if substeps < 1:
            raise ConfigError(f"substeps must be at least 1, got {substeps}")
        if not mass_factor > 0:
            raise ConfigError(f"mass_factor must be above 0, got {mass_factor}")
        if focus is not None and (not focus > 0 or falls):
            raise ConfigError(f"focus must be above 0, and is for what does not fall; got {focus}")
        self.name, self.material, self.carrier = name, material, carrier
        self.rest = np.ascontiguousarray(rest, np.float64)
        count = len(self.rest)
        self.tetrahedra = Tetrahedra(
            self.rest, np.zeros((0, 4), np.int32) if tetrahedra is None else tetrahedra, material
        )
        self.springs = springs or Springs(self.rest, np.zeros((0, 2), np.int32), stiffness=1.0)
        self.hinges = hinges or Hinges(self.rest, np.zeros((0, 4), np.int32), stiffness=1.0)
        self.faces = boundary(self.tetrahedra.members) if faces is None else faces
        mass = self.tetrahedra.lumped_masses(count) if masses is None else masses
        mass = mass_factor * np.asarray(mass, np.float64)
        free = np.ones(count, np.bool_)
        free[np.asarray(held, np.int64)] = False
        if (mass[free] <= 0).any():
            raise ConfigError(f"particle {int(np.argmax(free & (mass <= 0)))} has no mass")
        self.falls, self.substeps, self.focus = falls, substeps, focus
        self._lightness = np.zeros(count, np.float32)  # inverse masses of all that can move
        self._lightness[free] = 1 / mass[free]
        self._make_state(count)
        skin = np.unique(self.faces)
        self._skin = skin[free[skin]].astype(np.int32)
        self._pairs = np.zeros((_PAIRS * len(self._skin) + 1, 2), np.int32)
        self._areas = vertex_areas(self.rest, self.faces)
        self._pins: list[tuple[Indices, Body, int, Array]] = []
        self.is_awake, self.spared = falls, list[Body]()
        middle = (self.rest.min(axis=0) + self.rest.max(axis=0)) / 2
        self.middle, self.radius = middle, float(np.linalg.norm(self.rest - middle, axis=1).max())
        self._place = np.array((*Pose().position, *Pose().quaternion))
        if carrier is not None:
            pose = carrier.body.inertial_pose(carrier.link).inverse() @ carrier.pose
            self._place[:] = (*pose.position, *pose.quaternion)

    def _make_state(self, count: int) -> None:
        """Make the arrays that change."""
        self._rest = self.rest.astype(np.float32)
        self._x = np.zeros((count + SPARE, 4), np.float32)
        self._x[:count, :3] = self._rest
        self._x[count + 1 :, :3] = np.eye(3)  # the tetrahedron that fills unused lanes
        self._active = np.zeros(count, np.bool_)
        self._run = np.zeros(0, np.int64)
        if self.focus is None:
            self._active[:] = True
            self._attend_to_active()
        self._v, self._previous, self._start = (np.zeros((count, 3), np.float32) for _ in range(3))
        self._forces = np.zeros((count + SPARE, 3), np.float32)
        self._touch, self._normals = np.zeros(count, np.int32), np.zeros((count, 3), np.float32)
        self.pressure = np.zeros(count, np.float32)
        self._scratch, self._gradient = make_scratch(), np.zeros((4, 3))
        self.contacts: list[SoftContact] = []
        self._last = np.zeros((0, 7))  # of each shape in the last step, see `kernel.smooth`

    def _attend_to_active(self) -> None:
        """Let active particles move, hold all others, and run the tetrahedra around them."""
        count = len(self.rest)
        self._x[:count, 3] = np.where(self._active, self._lightness, 0)
        padded = np.append(self._active & (self._lightness > 0), [False] * SPARE)
        self._run = np.flatnonzero(padded[self.tetrahedra.particles].any(axis=1))

    def attend(self, frame: Array, colliders: Colliders, shapes: npt.NDArray[np.int64]) -> None:
        """Simulate from now on what lies within the focus of shapes that touch or soon will."""
        if self.focus is None or not len(shapes):
            return
        meetings = colliders.relate(frame, shapes, 1.0)
        is_wider = contact.widen(
            self._x, meetings, colliders.kinds[shapes], colliders.planes, colliders.runs[shapes],
            np.float32(self.focus - FOCUS_MARGIN), np.float32(self.focus), self._active,
        )  # fmt: skip
        if is_wider:
            self._attend_to_active()

    @property
    def positions(self) -> Floats:
        """Present positions in the frame of the body [m], shape [n, 3]."""
        return self._x[: len(self.rest), :3]

    @property
    def points(self) -> Floats:
        """Positions [m] and inverse masses [1/kg], as the kernels know them, shape [n + SPARE, 4]."""
        return self._x

    @property
    def skin(self) -> Indices:
        """Particles of the surface that can move, shape [s]."""
        return self._skin

    @property
    def areas(self) -> Floats:
        """Area of the surface around each particle at rest [m²], shape [n]; zero inside."""
        return self._areas

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

    def held_load(self) -> Array:
        """Return the elastic force on all held particles in the frame of the body [N], shape [3].

        At rest it is what the carrier bears.
        """
        self._read_elastic(0.0)
        held = self._x[: len(self.rest), 3] == 0
        return self._forces[: len(self.rest)][held].astype(np.float64).sum(axis=0)

    def least_volume_ratio(self) -> float:
        """Return the least det F of all tetrahedra: below 0 one is inside out."""
        return float(self.tetrahedra.determinants(self.positions.astype(np.float64)).min())

    def deviation(self) -> float:
        """Return how far any particle is from rest [m]."""
        return float(kernel.farthest_from(self._x, self._rest))

    def pin(self, particles: Sequence[int], body: Body, link: int, client: int) -> None:
        """Fix particles to a link of another body, where they are; the world must be their frame."""
        if self.carrier is not None:
            raise ConfigError("only a body in the frame of the world can be pinned to links")
        chosen = np.asarray(particles, np.int32)
        state = np.array(link_state(body, link, client))
        turn = matrix_from_quaternion(state[3:7])
        local = (self.positions[chosen].astype(np.float64) - state[:3]) @ turn
        self._lightness[chosen] = 0
        self._attend_to_active()
        self._v[chosen] = 0
        self._skin = np.setdiff1d(self._skin, chosen).astype(np.int32)
        self._pins.append((chosen, body, link, local))

    def frame(self, client: int) -> Array:
        """Return the state of the body's frame, as that of a link in `collider`, shape [13]."""
        out = np.zeros(13)
        out[6] = 1.0
        if self.carrier is not None:
            state = np.array(link_state(self.carrier.body, self.carrier.link, client))
            carry(state, self._place, out)
        return out

    def in_world(self, frame: Array) -> Array:
        """Return present positions in the world [m], shape [n, 3], for a state of its frame."""
        turn = matrix_from_quaternion(frame[3:7])
        return self.positions @ turn.T + frame[:3]

    def advance(
        self, frame: Array, colliders: Colliders, near: Encounter, gravity: Array, period: float,
        client: int,
    ) -> Array:  # fmt: skip
        """Simulate one physics step of `period` [s] and find what was pressed.

        Args:
            frame: State of its frame.
            colliders: The rigid shapes.
            near: Those that may be touched.
            gravity: In the world [m/s²], shape [3].
            period: Length of the physics step [s].
            client: Id of the physics client.

        Returns:
            What each near shape got, shape [m, OUTCOME]: see `kernel.to_world`.
        """
        field = _WEIGHTLESS
        if self.falls:
            field = (matrix_from_quaternion(frame[3:7]).T @ gravity).astype(np.float32)
        meetings = colliders.relate(frame, near.shapes, self.material.friction)
        dt = np.float32(period / self.substeps)
        keep = np.float32(math.exp(-self.material.damping_per_s * period / self.substeps))
        self._start[:] = self._v
        pinned, steps = self._pin_paths(period, client)
        self._touch[:] = 0
        shapes, pairs = (near.kinds, colliders.planes, near.runs), 0
        if len(meetings):
            pairs = contact.find_pairs(
                self._x, self._skin, meetings, *shapes, np.float32(REACH), self._pairs
            )
        for _ in range(self.substeps):
            kernel.predict(self._x, self._v, self._previous, field, dt, pinned, steps)
            self._solve(dt)
            if pairs:
                contact.move_meetings(meetings, dt)
                contact.solve_contacts(
                    self._x, self._previous, self._pairs, pairs, meetings, *shapes, dt,
                    self._touch, self._normals, near.beds, self._areas,
                )  # fmt: skip
            kernel.finish(self._x, self._v, self._previous, keep, dt)
        self._read_elastic(self.material.damping_s)
        return self._conclude(frame, near.shapes, len(colliders.kinds), field, period)

    def _conclude(
        self, frame: Array, shapes: npt.NDArray[np.int64], shape_count: int, field: Floats,
        period: float,
    ) -> Array:  # fmt: skip
        """Find force, point and pressure from the elastic forces at the end of a step."""
        outcome = np.zeros((len(shapes), kernel.OUTCOME))
        if len(self._last) != shape_count:
            self._last = np.zeros((shape_count, 7))
        if not kernel.find_touching(
            self._x, self._forces, self._touch, self._normals, self._areas, outcome
        ):
            self.pressure[:] = 0
            self._last[:] = 0
            return outcome
        kernel.share_out(
            self._x, self._v, self._start, self._forces, self._touch, field,
            self.material.damping_per_s, period, outcome,
        )  # fmt: skip
        kernel.smooth(outcome, shapes, self._last)
        kernel.spread_pressure(
            self._forces, self._touch, self._normals, self._areas, outcome, self.pressure
        )
        kernel.to_world(outcome, frame)
        return outcome

    def pin_loads(self) -> list[tuple[Body, int, Array, Array]]:
        """Return body, link, force [N] and a point of its line [m] for each group of pins."""
        out = []
        for particles, body, link, _ in self._pins:
            forces = self._forces[particles].astype(np.float64)
            points = self._x[particles, :3].astype(np.float64)
            total = forces.sum(axis=0)
            if total @ total > 0:
                moment, point = np.cross(points, forces).sum(axis=0), np.empty(3)
                kernel.line_point(total, moment, points.mean(axis=0), point)
                out.append((body, link, total, point))
        return out

    def _read_elastic(self, ahead: float) -> None:
        """Read the forces where the particles will be after `ahead` [s] at their present velocities."""
        at = self._x
        if ahead > 0:
            at = self._x.copy()
            at[: len(self.rest), :3] += np.float32(ahead) * self._v
        self._forces[:] = 0
        flesh, threads, folds = self.tetrahedra, self.springs, self.hinges
        if len(flesh.particles):
            add_elastic_forces(
                at, self._run, flesh.particles, flesh.table, flesh.ratio, self._scratch,
                self._forces,
            )  # fmt: skip
        if len(threads.members):
            add_spring_forces(at, threads.members, threads.table, self._forces)
        if len(folds.members):
            add_hinge_forces(at, folds.members, folds.table, self._gradient, self._forces)

    def _solve(self, dt: np.float32) -> None:
        """Solve every constraint once."""
        flesh, threads, folds = self.tetrahedra, self.springs, self.hinges
        if len(flesh.particles):
            solve_tetrahedra(
                self._x, self._run, flesh.particles, flesh.table, flesh.ratio, dt, self._scratch
            )
        if len(threads.members):
            solve_springs(self._x, threads.members, threads.table, dt)
        if len(folds.members):
            solve_hinges(self._x, folds.members, folds.table, dt, self._gradient)

    def _pin_paths(self, period: float, client: int) -> tuple[Indices, Floats]:
        """Return the pinned particles and their displacement in a small step [m]."""
        if not self._pins:
            return _NO_PINS
        rows, steps = [], []
        for particles, body, link, local in self._pins:
            state = np.array(link_state(body, link, client))
            arms = local @ matrix_from_quaternion(state[3:7]).T
            ahead = state[:3] + arms + period * (state[7:10] + np.cross(state[10:], arms))
            rows.append(particles)
            steps.append((ahead - self._x[particles, :3]) / self.substeps)
        return np.concatenate(rows), np.concatenate(steps).astype(np.float32)

    def sleep(self) -> None:
        """Come to rest at once; from here on the body rides with its carrier and costs nothing."""
        self._x[: len(self.rest), :3] = self._rest
        self._v[:] = 0
        self._touch[:] = 0
        self.pressure[:] = 0
        self.contacts, self._last = [], np.zeros((0, 7))
        self.is_awake = False
        if self.focus is not None:
            self._active[:] = False
            self._attend_to_active()

    def _changing(self) -> tuple[npt.NDArray[Any], ...]:
        return (
            self._x, self._v, self._forces, self._touch, self._normals, self.pressure, self._active,
        )  # fmt: skip

    def save(self) -> tuple[Any, ...]:
        """Return a snapshot of everything that changes."""
        copies = (array.copy() for array in self._changing())
        return (*copies, self._last.copy(), list(self.contacts), self.is_awake)

    def restore(self, snapshot: tuple[Any, ...]) -> None:
        """Return to a snapshot, bit for bit."""
        for array, saved in zip(self._changing(), snapshot, strict=False):
            array[:] = saved
        self._attend_to_active()
        self._last = snapshot[-3].copy()
        self.contacts, self.is_awake = list(snapshot[-2]), snapshot[-1]


_WEIGHTLESS = np.zeros(3, np.float32)
_NO_PINS = (np.zeros(0, np.int32), np.zeros((0, 3), np.float32))


def vertex_areas(positions: Array, faces: Indices) -> Floats:
    """Return a third of the area of all faces around each vertex [m²], shape [n]."""
    corners = positions[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1) / 6
    out = np.zeros(len(positions))
    for k in range(3):
        np.add.at(out, faces[:, k], area)
    return out.astype(np.float32)


__all__ = ["Carrier", "Encounter", "SoftBody", "SoftContact", "vertex_areas"]
