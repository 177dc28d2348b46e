"""A soft body: particles, what holds them together, and what they press on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import ConfigError
from ..pose import Array, matrix_from_quaternion
from . import contact, kernel
from .collider import STATE, Colliders, NearShapes, carry
from .constraint import face_areas, summed
from .contact import Floats, Indices, Rows
from .material import Material
from .soft_object import Carrier, SoftContact, SoftObject
from .tetrahedron import SPARE, Tetrahedra, add_elastic_forces, boundary, solve_tetrahedra

SUBSTEPS = 5  # in a physics step of 1/240 s: 20 in a frame of 1/60 s
REACH = 0.004  # [m] from a shape at rest; more for a fast one
SETTLED = 1e-4  # [m] from rest, the deviation that nobody can see or feel
FOCUS_MARGIN = 0.02  # [m] that a contact may move before more is simulated
_PAIRS = 4  # shapes that one particle can be near, on average


class SoftBody(SoftObject):
    """Particles in the frame of a carrier, held together by XPBD constraints.

    It moves with the carrier by itself: motion of that shakes nothing. The carrier has its mass and weight
    already, as a bone has those of the flesh.

    Attributes:
        rest: Positions at rest in the frame of the body [m], shape [n, 3].
        faces: Surface, shape [m, 3].
        material: What it is made of.
        is_awake: Whether it is being simulated.
        points: Positions [m] and inverse masses [1/kg] in its frame, as kernels know them, shape
            [n + SPARE, 4].
        skin: Particles of the surface that can move, shape [s].
        areas: Area of the surface around each particle at rest [m²], shape [n]; zero inside.
        normals: The way out of what each particle touches, in the frame of the body, shape [n, 3].
        pressure: On each particle [Pa], shape [n]; zero inside.
        carrier: What it rides on.
        middle: Of a sphere around it at rest [m], shape [3].
        radius: Of that sphere [m].
    """

    carrier: Carrier

    def __init__(
        self,
        name: str,
        rest: Array,
        *,
        material: Material,
        tetrahedra: Indices,
        carrier: Carrier,
        faces: Indices | None = None,
        held: Sequence[int] | npt.NDArray[np.integer] = (),
        substeps: int = SUBSTEPS,
        mass_factor: float = 1.0,
        focus: float | None = None,
    ) -> None:
        """Prepare a body at rest.

        Args:
            name: Name.
            rest: Positions at rest in the frame of the carrier [m], shape [n, 3].
            material: What it is made of.
            tetrahedra: Elastic tetrahedra, shape [t, 4].
            carrier: What it rides on.
            faces: Surface; that of the tetrahedra if None.
            held: Particles that are fixed in the frame of the body.
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
        if focus is not None and not focus > 0:
            raise ConfigError(f"focus must be above 0, got {focus}")
        super().__init__(name)
        self.material = material
        self.rest = np.ascontiguousarray(rest, np.float64)
        count = len(self.rest)
        self.tetrahedra = Tetrahedra(self.rest, tetrahedra, material)
        self.faces = boundary(self.tetrahedra.members) if faces is None else faces
        mass = mass_factor * self.tetrahedra.lumped_masses(count)
        free = np.ones(count, np.bool_)
        free[np.asarray(held, np.int64)] = False
        if (mass[free] <= 0).any():
            raise ConfigError(f"particle {int(np.argmax(free & (mass <= 0)))} has no mass")
        self.substeps, self.focus = substeps, focus
        self._lightness = np.zeros(count, np.float32)  # inverse masses of all that can move
        self._lightness[free] = 1 / mass[free]
        self._make_state(count, free)
        self.is_awake = False
        middle = (self.rest.min(axis=0) + self.rest.max(axis=0)) / 2
        self.middle, self.radius = middle, float(np.linalg.norm(self.rest - middle, axis=1).max())
        pose = carrier.body.inertial_pose(carrier.link).inverse() @ carrier.pose
        self.carrier, self._place = carrier, np.array((*pose.position, *pose.quaternion))

    def _make_state(self, count: int, free: npt.NDArray[np.bool_]) -> None:
        """Make the arrays that change, for particles that are `free` to move or not."""
        self._rest = self.rest.astype(np.float32)
        self.points = np.zeros((count + SPARE, 4), np.float32)
        self.points[:count, :3] = self._rest
        self.points[count + 1 :, :3] = np.eye(3)  # the tetrahedron that fills unused lanes
        self._active = np.zeros(count, np.bool_)
        self._run = np.zeros(0, np.int64)
        if self.focus is None:
            self._active[:] = True
            self._attend_to_active()
        self._v, previous, self._start = (np.zeros((count, 3), np.float32) for _ in range(3))
        self._forces = np.zeros((count + SPARE, 3), np.float32)
        self._motion = kernel.Motion(self.points, self._v, previous, self._start, self._forces)
        skin = np.unique(self.faces)
        self.skin, self.areas = (
            skin[free[skin]].astype(np.int32),
            vertex_areas(self.rest, self.faces),
        )
        self.normals = np.zeros((count, 3), np.float32)
        touch = np.zeros(count, np.int32)
        self._surface = contact.Surface(self.skin, self.areas, touch, self.normals)
        self._pairs = np.zeros((_PAIRS * len(self.skin) + 1, 2), np.int32)
        self.pressure = np.zeros(count, np.float32)
        self._last = np.zeros((0, 7))  # of each shape in the last step, see `kernel.smooth`

    def _attend_to_active(self) -> None:
        """Let active particles move, hold all others, and run the tetrahedra around them."""
        count = len(self.rest)
        self.points[:count, 3] = np.where(self._active, self._lightness, 0)
        padded = np.append(self._active & (self._lightness > 0), [False] * SPARE)
        self._run = np.flatnonzero(padded[self.tetrahedra.packed.particles].any(axis=1))

    def wake(self, frame: Array, touching: NearShapes) -> None:
        """Be simulated from now on, within the focus of shapes that touch or soon will."""
        self.is_awake = True
        if self.focus is None or not len(touching.rows):
            return
        inner, outer = np.float32(self.focus - FOCUS_MARGIN), np.float32(self.focus)
        if contact.widen(self.points, tuple(touching.seen_from(frame)), inner, outer, self._active):
            self._attend_to_active()

    @property
    def positions(self) -> Floats:
        """Present positions in the frame of the body [m], shape [n, 3]."""
        return self.points[: len(self.rest), :3]

    def held_load(self) -> Array:
        """Return the elastic force on all held particles in the frame of the body [N], shape [3].

        At rest it is what the carrier bears.
        """
        self._read_elastic(0.0)
        held = self.points[: len(self.rest), 3] == 0
        return self._forces[: len(self.rest)][held].astype(np.float64).sum(axis=0)

    def least_volume_ratio(self) -> float:
        """Return the least det F of all tetrahedra: below 0 one is inside out."""
        return float(self.tetrahedra.determinants(self.positions.astype(np.float64)).min())

    def deviation(self) -> float:
        """Return how far any particle is from rest [m]."""
        return float(kernel.farthest_from(self.points, self._rest))

    def frame(self) -> Array:
        """Return the state of the body's frame, as that of a link in `collider`, shape [13]."""
        out = np.empty(STATE)
        carry(np.array(self.carrier.body.centre_state(self.carrier.link)), self._place, out)
        return out

    def in_world(self, frame: Array) -> Array:
        """Return present positions in the world [m], shape [n, 3], for a state of its frame."""
        turn = matrix_from_quaternion(frame[3:7])
        return self.positions @ turn.T + frame[:3]

    def advance(self, colliders: Colliders, period: float, frame: Array) -> None:
        """Simulate one physics step of `period` [s] and push what it met, and its carrier the other way.

        Args:
            colliders: The rigid shapes; links must be fresh.
            period: Length of the physics step [s].
            frame: State of its frame.
        """
        near = self.near or colliders.none
        shapes = near.seen_from(frame, self.material.friction)
        tables, motion, surface = tuple(shapes), tuple(self._motion), tuple(self._surface)
        dt = np.float32(period / self.substeps)
        keep = np.float32(math.exp(-self.material.damping_per_s * period / self.substeps))
        self._start[:] = self._v
        self._surface.touch[:] = 0
        x, previous, count = self.points, self._motion.previous, 0
        if len(near.rows):
            count = contact.find_pairs(x, self.skin, tables, np.float32(REACH), self._pairs)
        for _ in range(self.substeps):
            kernel.predict(motion, dt)
            solve_tetrahedra(x, self._run, tuple(self.tetrahedra.packed), dt)
            if count:
                contact.move_meetings(shapes.meetings, dt)
                contact.solve_contacts(x, previous, self._pairs, count, tables, dt, surface)
            kernel.finish(motion, keep, dt)
        self._read_elastic(self.material.damping_s)
        outcome = self._conclude(frame, near.rows, len(colliders.kinds), period)
        self.contacts = []
        for c in np.flatnonzero(outcome[:, kernel.COUNT]).tolist():
            (body, link), row = colliders.links[colliders.shape_links[near.rows[c]]], outcome[c]
            area = float(row[kernel.AREA])
            self._push(SoftContact(body, link, row[:3], row[3:6], area=area))

    def _conclude(self, frame: Array, rows: Rows, shape_count: int, period: float) -> Array:
        """Find force, point and pressure from the elastic forces at the end of a step."""
        outcome = np.zeros((len(rows), kernel.OUTCOME))
        motion, surface = tuple(self._motion), tuple(self._surface)
        if len(self._last) != shape_count:
            self._last = np.zeros((shape_count, 7))
        if not kernel.find_touching(motion, surface, outcome):
            self.pressure[:] = 0
            self._last[:] = 0
            return outcome
        damping = self.material.damping_per_s
        kernel.share_out(motion, self._surface.touch, damping, period, outcome)
        kernel.smooth(outcome, rows, self._last)
        kernel.spread_pressure(self._forces, surface, outcome, self.pressure)
        kernel.to_world(outcome, frame)
        return outcome

    def _read_elastic(self, ahead: float) -> None:
        """Read the forces where the particles will be after `ahead` [s] at their present velocities."""
        at = self.points
        if ahead > 0:
            at = self.points.copy()
            at[: len(self.rest), :3] += np.float32(ahead) * self._v
        self._forces[:] = 0
        add_elastic_forces(at, self._run, tuple(self.tetrahedra.packed), self._forces)

    def sleep(self) -> None:
        """Come to rest at once; from here on the body rides with its carrier and costs nothing."""
        self.points[: len(self.rest), :3] = self._rest
        self._v[:] = 0
        self._surface.touch[:] = 0
        self.pressure[:] = 0
        self.contacts, self._last = [], np.zeros((0, 7))
        self.is_awake = False
        if self.focus is not None:
            self._active[:] = False
            self._attend_to_active()

    def _changing(self) -> tuple[npt.NDArray[Any], ...]:
        _, _, touch, normals = self._surface
        return self.points, self._v, self._forces, touch, normals, self.pressure, self._active

    def save(self) -> tuple[Any, ...]:
        copies = (array.copy() for array in self._changing())
        return (*copies, self._last.copy(), list(self.contacts), self.is_awake)

    def restore(self, snapshot: tuple[Any, ...]) -> None:
        for array, saved in zip(self._changing(), snapshot, strict=False):
            array[:] = saved
        self._attend_to_active()
        self._last = snapshot[-3].copy()
        self.contacts, self.is_awake = list(snapshot[-2]), snapshot[-1]


def vertex_areas(positions: Array, faces: Indices) -> Floats:
    """Return a third of the area of all faces around each vertex [m²], shape [n]."""
    return summed(faces, face_areas(positions, faces) / 3, len(positions)).astype(np.float32)
