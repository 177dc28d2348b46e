"""The collision shapes of a rigid body as soft matter meets them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull  # type: ignore[import-untyped]

from rcare_marl.bullet import bullet

from ..body import Body
from ..body_part import VisualShape
from ..errors import WorldError
from ..pose import Array, Pose, matrix_from_quaternion
from ..rendering.mesh import shape_mesh
from . import contact

_KINDS = {
    bullet.GEOM_SPHERE: contact.SPHERE,
    bullet.GEOM_BOX: contact.BOX,
    bullet.GEOM_CAPSULE: contact.CAPSULE,
    bullet.GEOM_CYLINDER: contact.CYLINDER,
    bullet.GEOM_MESH: contact.HULL,
    bullet.GEOM_PLANE: contact.HULL,
}
_UNBOUNDED = 1e3  # [m]
# Of capsules: half a length per radius from where one is a limb and not a trunk, and how much longer it
# is for cloth. Our own choices: then a straight leg has a neck of 2 mm at the knee.
SLENDER, JOINED = 0.5, 0.75


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
        is_for_cloth: Whether cloth meets it.
        is_for_others: Whether fluids and soft bodies do.
    """

    body: Body
    link: int
    kind: int
    size: tuple[float, float, float]
    pose: Pose
    planes: Array
    radius: float
    friction: float
    is_for_cloth: bool = True
    is_for_others: bool = True

    @property
    def is_limb(self) -> bool:
        """Whether it is a slender capsule."""
        return self.kind == contact.CAPSULE and self.size[0] > SLENDER * self.size[1]

    def joined(self) -> list[Shape]:
        """Return it for all but cloth, and for cloth a capsule that is longer at both ends."""
        half, radius, _ = self.size
        size = (half + JOINED * radius, radius, 0.0)
        longer = replace(self, size=size, radius=self.radius + JOINED * radius, is_for_others=False)
        return [replace(self, is_for_cloth=False), longer]


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
