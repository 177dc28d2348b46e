"""The rigid shapes of a world as tables: read once, then only the poses of links are fetched."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from functools import cached_property

import numba
import numpy as np
import numpy.typing as npt

from ..body import Body
from ..body_part import State
from ..pose import Array, matrix_from_quaternion
from . import contact
from .contact import Floats, Rows, Shapes
from .rigid_shape import reach_of, read_shapes

Skin = npt.NDArray[np.int32]
Links = tuple[Body, list[int], list[int]]  # links of a body, and their rows

STATE = 13  # of a link: centre of mass [m], quaternion, velocity [m/s], rate of turning [rad/s]
EXACT = 0.2  # [m] between bounding spheres, from where the shape itself is looked at
FINE = 0.08  # [m] from shape to bounding sphere, from where that of the skin itself is found
WORLD_FRAME = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


class Colliders:
    """All rigid shapes that soft matter can meet.

    Attributes:
        bodies: Whose they are.
        links: (body, link) of each row of states.
        row_of: Row of each link.
        shape_links: Row of the link of each shape, shape [s].
        shape_bodies: Place of the body of each shape in `bodies`, shape [s].
        is_for_cloth: Which shapes cloth meets, shape [s].
        is_for_others: Which shapes fluids and soft bodies meet, shape [s].
        kinds: Kind of each shape, shape [s].
        runs: First and last plus one of the planes of each hull, shape [s, 2].
        planes: Planes of all hulls, shape [p, 4].
        radii: Bounding radius of each shape [m], shape [s].
        local: Place, turn, size and friction of each shape on its link, shape [s, 16].
        states: State of each link at the last fetch, shape [l, 13].
        foundations: Stiffness of the flesh on each shape, see `SoftWorld.set_foundation` [Pa/m], shape [s].
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        client: int,
        *,
        joined: Collection[Body] = (),
        links: Iterable[tuple[Body, int]] = (),
    ) -> None:
        """Read the shapes.

        Args:
            bodies: Whose.
            client: Id of the physics client.
            joined: Bodies between whose limbs cloth finds no gaps, see `SoftWorld.join_limbs`.
            links: Further links whose states are needed.

        Raises:
            WorldError: If a mesh is flat or cannot be read.
        """
        self.bodies = list(bodies)
        found = [read_shapes(body, client) for body in bodies]
        self._reaches = [reach_of(b, own, client) for b, own in zip(bodies, found, strict=True)]
        found = [
            [part for s in own for part in (s.joined() if b in joined and s.is_limb else [s])]
            for b, own in zip(bodies, found, strict=True)
        ]
        shapes = [shape for own in found for shape in own]
        self.links = list(dict.fromkeys([*((s.body, s.link) for s in shapes), *links]))
        self.row_of = {link: row for row, link in enumerate(self.links)}
        self.shape_links = np.array([self.row_of[s.body, s.link] for s in shapes], np.int64)
        self.shape_bodies = np.repeat(np.arange(len(found)), [len(own) for own in found])
        self.is_for_cloth = np.array([s.is_for_cloth for s in shapes], np.bool_)
        self.is_for_others = np.array([s.is_for_others for s in shapes], np.bool_)
        self.kinds = np.array([shape.kind for shape in shapes], np.int64)
        self.radii = np.array([shape.radius for shape in shapes])
        ends = np.cumsum([0] + [len(shape.planes) for shape in shapes])
        self.runs = np.column_stack((ends[:-1], ends[1:])).astype(np.int64)
        planes = np.concatenate([np.zeros((0, 4)), *(s.planes for s in shapes)])
        self.planes = planes.astype(np.float32)
        self.local = np.zeros((len(shapes), 16))  # place, turn, size, friction
        for row, shape in zip(self.local, shapes, strict=True):
            row[:3] = shape.pose.position
            row[3:12] = matrix_from_quaternion(shape.pose.quaternion).ravel()
            row[12:15], row[15] = shape.size, shape.friction
        self.states = np.zeros((len(self.links), STATE))
        self.foundations = np.zeros(len(shapes), np.float32)
        self._rows_of = [
            [row for row, (owner, _) in enumerate(self.links) if owner is body] for body in bodies
        ]
        self._is_still = [not body.is_movable and not body.joints for body in bodies]
        self._centres: dict[int, tuple[float, ...]] = {}  # of bodies that stand still
        self._fetched: set[int] = set()  # bodies that stand still, whose poses are known

    @cached_property
    def none(self) -> NearShapes:
        """No shapes."""
        return NearShapes(self, np.zeros(0, np.int64))

    @cached_property
    def no_shapes(self) -> Shapes:
        """None in the frame of the world, in double precision."""
        return self.none.in_world()

    def forget_poses(self) -> None:
        """Read the poses of bodies that stand still again: some may have been set elsewhere."""
        self._centres.clear()
        self._fetched.clear()

    def fetch_near(
        self, places: Iterable[int], spheres: Sequence[tuple[Sequence[float], float]], reach: float
    ) -> tuple[npt.NDArray[np.bool_], float]:
        """Read the poses of the bodies that may be within `reach` [m] of spheres.

        Args:
            places: Bodies to look at.
            spheres: Middle in the world [m] and radius [m] of each.
            reach: How near.

        Returns:
            Which shapes are of those bodies, shape [s], and how far away all others are at least [m].
        """
        near, beyond = np.zeros(len(self.bodies), np.bool_), math.inf
        for k in places:
            at = self._centres.get(k)
            if at is None:
                at = self.bodies[k].centre_pose()[0]
                if self._is_still[k]:
                    self._centres[k] = at
            gap = min([math.dist(middle, at) - radius for middle, radius in spheres])
            gap -= self._reaches[k]
            if gap > reach:
                beyond = min(beyond, gap)
                continue
            near[k] = True
            if k not in self._fetched:
                self._fetch_body(k)
                if self._is_still[k]:
                    self._fetched.add(k)
        return near[self.shape_bodies], beyond

    def _fetch_body(self, place: int) -> None:
        """Read the poses of all links of a body that have shapes."""
        body, rows = self.bodies[place], self._rows_of[place]
        indices = [self.links[row][1] for row in rows]
        if -1 in indices:
            self.states[rows[indices.index(-1)], :7] = np.concatenate(body.centre_pose())
        joined = [(row, link) for row, link in zip(rows, indices, strict=True) if link >= 0]
        if joined:
            found = body.centre_places([link for _, link in joined])
            self.states[[row for row, _ in joined], :7] = found

    def by_body(self, rows: Iterable[int]) -> list[Links]:
        """Return body, links and rows of links, those of one body that have joints together."""
        found: dict[tuple[int, bool], Links] = {}
        for row in rows:
            body, link = self.links[row]
            _, links, own = found.setdefault((id(body), link < 0), (body, [], []))
            links.append(link)
            own.append(row)
        return list(found.values())

    def fetch(self, grouped: Iterable[Links]) -> list[tuple[int, State]]:
        """Read poses and velocities of links, grouped by `by_body`; return them by row too."""
        found: list[tuple[int, State]] = []
        for body, links, rows in grouped:
            states = [body.centre_state(-1)] if links == [-1] else body.centre_states(links)
            self.states[rows] = states
            found += zip(rows, states, strict=True)
        return found


class NearShapes:
    """Shapes that one soft object may touch.

    Attributes:
        rows: Rows in the table of all shapes, shape [m].
    """

    def __init__(self, colliders: Colliders, rows: Rows) -> None:
        """Take the shapes in some rows."""
        self._colliders, self.rows = colliders, rows
        self._tables = (
            colliders.kinds[rows],
            colliders.planes,
            colliders.runs[rows],
            colliders.radii[rows],
            colliders.foundations[rows],
        )

    @cached_property
    def by_link(self) -> tuple[list[int], npt.NDArray[np.intp]]:
        """Rows of the links that carry them, each once, and the place of each shape's link among these."""
        found, owners = np.unique(self._colliders.shape_links[self.rows], return_inverse=True)
        return found.tolist(), owners.ravel()

    def seen_from(self, frame: Array, friction: float = 1.0) -> Shapes:
        """Return them as seen from a moving frame, in single precision.

        Args:
            frame: State of the frame, as that of a link.
            friction: Factor of the friction coefficients.
        """
        c = self._colliders
        out = np.empty((len(self.rows), contact.MEETING), np.float32)
        _relate(frame, c.states, c.shape_links, c.local, self.rows, friction, out)
        return Shapes(out, *self._tables)

    def in_world(self, friction: float = 1.0) -> Shapes:
        """Return them in the frame of the world, in double precision."""
        shapes = self.seen_from(WORLD_FRAME, friction)
        return shapes._replace(meetings=shapes.meetings.astype(np.float64))

    def gaps(self, frame: Array, sphere: tuple[Array, float], points: Floats, skin: Skin) -> Array:
        """Return how far shapes are from a skin [m], exact where they are near, else a lower bound.

        Args:
            frame: State of the frame that the skin is in.
            sphere: Middle in that frame [m], shape [3], and radius [m] of a sphere around the skin.
            points: Particles in that frame, shape [n, 4].
            skin: Those that can touch.
        """
        out = np.empty(len(self.rows))
        _gaps(tuple(self.seen_from(frame)), *sphere, points, skin, out)
        return out


@numba.njit(cache=True)
def turning(q):  # type: ignore[no-untyped-def]
    """Return the rotation matrix of a quaternion as nine numbers, row by row."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    x0, x1, x2 = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    y0, y1, y2 = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    z0, z1, z2 = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    return x0, x1, x2, y0, y1, y2, z0, z1, z2


@numba.njit(cache=True)
def carry(state, place, out) -> None:  # type: ignore[no-untyped-def]
    """Write the state of a frame that is fixed to a link: `place` is its pose, position first."""
    r = turning(state[3:7])
    x, y, z, w = state[3], state[4], state[5], state[6]
    a, b, c, d = place[3], place[4], place[5], place[6]
    for k in range(3):
        arm = r[3 * k] * place[0] + r[3 * k + 1] * place[1] + r[3 * k + 2] * place[2]
        out[k] = arm
        out[10 + k] = state[10 + k]
    out[7] = state[7] + state[11] * out[2] - state[12] * out[1]
    out[8] = state[8] + state[12] * out[0] - state[10] * out[2]
    out[9] = state[9] + state[10] * out[1] - state[11] * out[0]
    for k in range(3):
        out[k] += state[k]
    out[3] = w * a + x * d + y * c - z * b
    out[4] = w * b - x * c + y * d + z * a
    out[5] = w * c + x * b - y * a + z * d
    out[6] = w * d - x * a - y * b - z * c


@numba.njit(cache=True)
def place_of(frame, point):  # type: ignore[no-untyped-def]
    """Return a point of a frame in the world [m], for the state of the frame."""
    r, (x, y, z) = turning(frame[3:7]), (point[0], point[1], point[2])
    return (
        frame[0] + r[0] * x + r[1] * y + r[2] * z,
        frame[1] + r[3] * x + r[4] * y + r[5] * z,
        frame[2] + r[6] * x + r[7] * y + r[8] * z,
    )


@numba.njit(cache=True)
def _gaps(shapes, middle, radius, points, skin, out) -> None:  # type: ignore[no-untyped-def]
    shapes = Shapes(*shapes)
    for k in range(out.shape[0]):
        square = 0.0
        for a in range(3):
            square += (shapes.meetings[k, contact.PLACE + a] - middle[a]) ** 2
        out[k] = np.sqrt(square) - shapes.radii[k] - radius
        if out[k] >= EXACT:
            continue
        gap, _, _, _ = contact.distance(shapes, k, middle[0], middle[1], middle[2])
        out[k] = gap - radius  # no particle is nearer than that, whatever the shape
        if out[k] < FINE:
            out[k] = contact.least_gap(points, skin, shapes, k)


@numba.njit(cache=True)
def _relate(frame, states, shape_links, local, shapes, friction, out) -> None:  # type: ignore[no-untyped-def]
    f = turning(frame[3:7])
    world, apart, speed, spin = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(shapes.shape[0]):
        state, shape = states[shape_links[shapes[k]]], local[shapes[k]]
        r = turning(state[3:7])
        for a in range(3):
            world[a] = r[3 * a] * shape[0] + r[3 * a + 1] * shape[1] + r[3 * a + 2] * shape[2]
            spin[a] = state[10 + a] - frame[10 + a]
        speed[0] = state[7] + state[11] * world[2] - state[12] * world[1] - frame[7]
        speed[1] = state[8] + state[12] * world[0] - state[10] * world[2] - frame[8]
        speed[2] = state[9] + state[10] * world[1] - state[11] * world[0] - frame[9]
        for a in range(3):
            apart[a] = state[a] + world[a] - frame[a]
        # What the frame's own turning does to a point at rest in the world.
        speed[0] -= frame[11] * apart[2] - frame[12] * apart[1]
        speed[1] -= frame[12] * apart[0] - frame[10] * apart[2]
        speed[2] -= frame[10] * apart[1] - frame[11] * apart[0]
        for a in range(3):
            out[k, contact.PLACE + a] = f[a] * apart[0] + f[3 + a] * apart[1] + f[6 + a] * apart[2]
            out[k, contact.SLIDE + a] = f[a] * speed[0] + f[3 + a] * speed[1] + f[6 + a] * speed[2]
            out[k, contact.SPIN + a] = f[a] * spin[0] + f[3 + a] * spin[1] + f[6 + a] * spin[2]
            out[k, contact.SIZE + a] = shape[12 + a]
            for b in range(3):
                total = 0.0
                for c in range(3):
                    turned = (
                        r[3 * c] * shape[3 + b]
                        + r[3 * c + 1] * shape[6 + b]
                        + r[3 * c + 2] * shape[9 + b]
                    )
                    total += f[3 * c + a] * turned
                out[k, contact.TURN + 3 * a + b] = total
        out[k, contact.GRIP] = shape[15] * friction
