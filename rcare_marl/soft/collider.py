"""The rigid shapes of a world as tables: read once, then only the poses of links are fetched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import pybullet as bullet
from scipy.spatial import ConvexHull  # type: ignore[import-untyped]

from ..body import Body, VisualShape
from ..errors import WorldError
from ..pose import Pose, matrix_from_quaternion
from ..rendering.mesh import shape_mesh
from . import contact

Array = npt.NDArray[np.float64]

STATE = 13  # of a link: centre of mass [m], quaternion, velocity [m/s], rate of turning [rad/s]
_KINDS = {
    bullet.GEOM_SPHERE: contact.SPHERE,
    bullet.GEOM_BOX: contact.BOX,
    bullet.GEOM_CAPSULE: contact.CAPSULE,
    bullet.GEOM_CYLINDER: contact.CYLINDER,
    bullet.GEOM_MESH: contact.HULL,
    bullet.GEOM_PLANE: contact.HULL,
}
EXACT = 0.2  # [m] between bounding spheres, from where the shape itself is looked at
FINE = (
    0.08  # [m] from shape to bounding sphere, from where the distance of the skin itself is found
)
_UNBOUNDED = 1e3  # [m]


@dataclass(frozen=True, eq=False)
class Shape:
    """One collision shape.

    Attributes:
        body: The body that it belongs to.
        link: The link that carries it.
        kind: One of the constants of `contact`.
        size: See `contact.signed_distance`; zeros for a hull.
        pose: In the frame of the link's centre of mass.
        planes: Of a hull: unit normals and distances from its origin, shape [p, 4].
        radius: Of a sphere around the shape's origin that holds it [m].
        friction: Bullet's coefficient of sliding friction of the link.
    """

    body: Body
    link: int
    kind: int
    size: tuple[float, float, float]
    pose: Pose
    planes: Array
    radius: float
    friction: float


def read_shapes(body: Body, client: int) -> list[Shape]:
    """Return the collision shapes of a body; a mesh becomes its convex hull, as in Bullet.

    Raises:
        WorldError: If a mesh is flat.
    """
    found = []
    for link in range(-1, body.link_count):
        rows = bullet.getCollisionShapeData(body.uid, link, physicsClientId=client)
        friction = bullet.getDynamicsInfo(body.uid, link, physicsClientId=client)[1] if rows else 0
        for place, row in enumerate(rows):
            if row[2] not in _KINDS:
                continue
            size, planes, radius = _measure(body, link, place, row, client)
            pose = Pose(row[5], row[6])
            kind = _KINDS[row[2]]
            found.append(Shape(body, link, kind, size, pose, planes, radius, friction))
    return found


def _measure(
    body: Body, link: int, place: int, row: Sequence[Any], client: int
) -> tuple[tuple[float, float, float], Array, float]:
    """Return size, planes and bounding radius of a row of `getCollisionShapeData`."""
    kind, given = row[2], row[3]
    none = np.zeros((0, 4))
    if kind == bullet.GEOM_SPHERE:
        return (given[0], 0.0, 0.0), none, given[0]
    if kind == bullet.GEOM_BOX:
        half = (given[0] / 2, given[1] / 2, given[2] / 2)
        return half, none, float(np.linalg.norm(half))
    if kind == bullet.GEOM_CAPSULE:
        return (given[0] / 2, given[1], 0.0), none, given[0] / 2 + given[1]
    if kind == bullet.GEOM_CYLINDER:
        return (given[0] / 2, given[1], 0.0), none, float(np.hypot(given[0] / 2, given[1]))
    if kind == bullet.GEOM_PLANE:
        return (0.0, 0.0, 0.0), np.array(((0.0, 0.0, 1.0, 0.0),)), _UNBOUNDED
    points = _mesh_points(body, link, place, row, client)
    try:
        hull = ConvexHull(points)
    except ValueError as error:  # scipy's QhullError is one
        raise WorldError(
            f"a collision mesh of {body.name!r} has no convex hull: {error}"
        ) from error
    planes = np.unique(np.round(hull.equations, 9), axis=0)
    planes[:, 3] *= -1
    return (0.0, 0.0, 0.0), planes, float(np.linalg.norm(points, axis=1).max())


def _mesh_points(body: Body, link: int, place: int, row: Sequence[Any], client: int) -> Array:
    """Return the vertices of a mesh in the frame of the shape [m], shape [n, 3].

    Bullet tells the vertices of a link's first shape only, and those already moved by the pose of the
    shape; so a mesh from a file is read from there.
    """
    name = row[4].decode()
    if Path(name).is_file():
        shape = VisualShape(link, "mesh", tuple(row[3]), name, Pose(), (1.0, 1.0, 1.0, 1.0))
        mesh = shape_mesh(shape)
        if mesh is None:
            raise WorldError(f"the collision mesh {name} of {body.name!r} cannot be read")
        return np.asarray(mesh.vertices, np.float64)
    found = bullet.getMeshData(body.uid, link, collisionShapeIndex=place, physicsClientId=client)
    if not found or len(found[1]) < 4:
        raise WorldError(f"a collision mesh of {body.name!r} has no file and cannot be read")
    moved = np.array(found[1]) - row[5]
    return moved @ matrix_from_quaternion(row[6])


def reach_of(body: Body, shapes: Sequence[Shape], client: int) -> float:
    """Return how far from its base any shape of a body can come, whatever its joints do [m]."""
    out = [0.0] * (body.link_count + 1)
    for link in range(body.link_count):
        info = bullet.getJointInfo(body.uid, link, physicsClientId=client)
        slide = max(abs(info[8]), abs(info[9])) if info[2] == bullet.JOINT_PRISMATIC else 0.0
        # The joint's place is given from the parent's centre of mass; both offsets are counted.
        own = bullet.getDynamicsInfo(body.uid, link, physicsClientId=client)[3]
        out[link + 1] = (
            out[info[16] + 1] + float(np.linalg.norm(info[14])) + slide + float(np.linalg.norm(own))
        )
    return max(
        (out[s.link + 1] + float(np.linalg.norm(s.pose.position)) + s.radius for s in shapes),
        default=0.0,
    )


class Colliders:
    """All rigid shapes that soft bodies can meet.

    Attributes:
        links: (body, link) of each row of states.
        shape_links: Row of the link of each shape, shape [s].
        kinds: Kind of each shape, shape [s].
        runs: First and last plus one of the planes of each hull, shape [s, 2].
        planes: Planes of all hulls, shape [p, 4].
        radii: Bounding radius of each shape [m], shape [s].
        states: State of each link at the last fetch, shape [l, 13].
        beds: Stiffness of the flesh on each shape, see `Matter.bed` [Pa/m], shape [s].
    """

    def __init__(self, bodies: Sequence[Body], client: int) -> None:
        self._client = client
        self.bodies = list(bodies)
        found = {id(body): read_shapes(body, client) for body in bodies}
        shapes = [shape for body in bodies for shape in found[id(body)]]
        self.links = list(dict.fromkeys((shape.body, shape.link) for shape in shapes))
        row_of = {link: row for row, link in enumerate(self.links)}
        self.shape_links = np.array([row_of[s.body, s.link] for s in shapes], np.int64)
        self.kinds = np.array([shape.kind for shape in shapes], np.int64)
        self.radii = np.array([shape.radius for shape in shapes])
        ends = np.cumsum([0] + [len(shape.planes) for shape in shapes])
        self.runs = np.column_stack((ends[:-1], ends[1:])).astype(np.int64)
        self.planes = np.concatenate([np.zeros((0, 4)), *(s.planes for s in shapes)]).astype(
            np.float32
        )
        self._local = np.zeros((len(shapes), 16))  # place, turn, size, friction
        for row, shape in zip(self._local, shapes, strict=True):
            row[:3] = shape.pose.position
            row[3:12] = matrix_from_quaternion(shape.pose.quaternion).ravel()
            row[12:15], row[15] = shape.size, shape.friction
        self.states = np.zeros((len(self.links), STATE))
        self.beds = np.zeros(len(shapes), np.float32)
        self.rows_of = [
            [row for row, (owner, _) in enumerate(self.links) if owner is body] for body in bodies
        ]
        self.reaches = [reach_of(body, found[id(body)], client) for body in bodies]
        self.is_still = [not body.is_movable and not body.joints for body in bodies]

    def fetch_body(self, place: int) -> None:
        """Read the poses of all links of a body that have shapes."""
        body, rows = self.bodies[place], self.rows_of[place]
        indices = [self.links[row][1] for row in rows]
        if -1 in indices:
            self.states[rows[indices.index(-1)], :7] = np.concatenate(body.centre_pose())
        joined = [(row, link) for row, link in zip(rows, indices, strict=True) if link >= 0]
        if joined:
            found = bullet.getLinkStates(
                body.uid,
                [link for _, link in joined],
                computeForwardKinematics=1,
                physicsClientId=self._client,
            )
            for (row, _), state in zip(joined, found, strict=True):
                self.states[row, :3], self.states[row, 3:7] = state[0], state[1]

    def fetch_link(self, row: int) -> None:
        """Read pose and velocities of one link."""
        body, link = self.links[row]
        self.states[row] = link_state(body, link, self._client)

    def relate(
        self, frame: Array, shapes: npt.NDArray[np.int64], friction: float
    ) -> npt.NDArray[np.float32]:
        """Return the table of `shapes` as seen from a moving frame; columns as in `contact`.

        Args:
            frame: State of the frame, as that of a link.
            shapes: Which shapes, shape [m].
            friction: Factor of the friction coefficients.
        """
        out = np.empty((len(shapes), contact.MEETING), np.float32)
        _relate(frame, self.states, self.shape_links, self._local, shapes, friction, out)
        return out

    def gaps(
        self, frame: Array, shapes: npt.NDArray[np.int64], middle: Array, radius: float,
        points: npt.NDArray[np.float32], skin: npt.NDArray[np.int32],
    ) -> Array:  # fmt: skip
        """Return how far shapes are from a skin [m], exact where they are near, else a lower bound.

        Args:
            frame: State of the frame that the skin is in.
            shapes: Which shapes, shape [m].
            middle: Of a sphere around the skin, in that frame [m], shape [3].
            radius: Of that sphere [m].
            points: Particles in that frame, shape [n, 4].
            skin: Those that can touch.
        """
        out = np.empty(len(shapes))
        _gaps(
            self.relate(frame, shapes, 1.0), self.kinds, self.planes, self.runs, self.radii, shapes,
            middle, radius, points, skin, out,
        )  # fmt: skip
        return out

    @staticmethod
    def place_of(frame: Array, point: Array) -> tuple[float, float, float]:
        """Return a point of a frame in the world [m], for the state of the frame."""
        place: tuple[float, float, float] = _place_of(frame, point)
        return place


def link_state(body: Body, link: int, client: int) -> tuple[float, ...]:
    """Return centre of mass [m], quaternion, velocity [m/s] and rate [rad/s] of a link, length 13."""
    if link < 0:
        position, quaternion = body.centre_pose()
        linear, angular = bullet.getBaseVelocity(body.uid, physicsClientId=client)
        return (*position, *quaternion, *linear, *angular)
    state = bullet.getLinkState(body.uid, link, 1, 1, physicsClientId=client)
    return (*state[0], *state[1], *state[6], *state[7])


@numba.njit(cache=True)
def turning(q):  # type: ignore[no-untyped-def]
    """Return the rotation matrix of a quaternion as nine numbers, row by row."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    return (
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
    )  # fmt: skip


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
def _place_of(frame, point):  # type: ignore[no-untyped-def]
    r, (x, y, z) = turning(frame[3:7]), (point[0], point[1], point[2])
    return (
        frame[0] + r[0] * x + r[1] * y + r[2] * z,
        frame[1] + r[3] * x + r[4] * y + r[5] * z,
        frame[2] + r[6] * x + r[7] * y + r[8] * z,
    )


@numba.njit(cache=True)
def _gaps(  # type: ignore[no-untyped-def]
    meetings, kinds, planes, runs, radii, shapes, middle, radius, points, skin, out
) -> None:
    for k in range(shapes.shape[0]):
        square, row = 0.0, shapes[k]
        for a in range(3):
            square += (meetings[k, contact.PLACE + a] - middle[a]) ** 2
        out[k] = np.sqrt(square) - radii[row] - radius
        if out[k] >= EXACT:
            continue
        gap, _, _, _ = contact.distance_to(
            meetings[k], kinds[row], planes, runs[row], middle[0], middle[1], middle[2]
        )
        out[k] = gap - radius  # no particle is nearer than that, whatever the shape
        if out[k] < FINE:
            out[k] = contact.least_gap(points, skin, meetings[k], kinds[row], planes, runs[row])


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


__all__ = [
    "STATE",
    "Colliders",
    "Shape",
    "carry",
    "link_state",
    "reach_of",
    "read_shapes",
    "turning",
]
