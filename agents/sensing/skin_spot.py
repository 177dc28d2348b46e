"""Where something flat comes to lie on a person's skin."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array, Pose, quaternion_from_matrix
from rcare_marl.world import World

from ..people.body.skeleton import JOINT_INDEX, JOINTS, PARENTS, SIDES
from ..people.body.skin import PersonSkin
from ..people.human import Human

Ints = npt.NDArray[np.int64]

# Share of the bone where a spot is that nobody chose; our own choice.
_ALONG = {"shoulder": 0.35, "elbow": 0.25}
_ELSEWHERE = 0.5
_ARM = ("collar", "shoulder", "elbow", "wrist")
_NEAR = 0.03  # [m]; skin farther above or below a plate is not what it lies on
_GAP = 0.0005  # [m] between the skin and what lies on it, so that neither is drawn into the other


def lie_on_skin(
    world: World,
    person: Human,
    joint: str,
    at: tuple[float, float, float] | None,
    edge: float,
) -> tuple[int, Pose]:
    """Return the link that carries a spot on the skin, and the pose of a plate's back there.

    A ray from the bone through `at` finds the outermost skin. The plate lies on it as a stiff one
    would, touching the highest point below it. Its z points out of the skin, its y along the bone
    towards the joint.

    Args:
        world: Where the person is.
        person: A spawned person, as they sit or lie now.
        joint: SMPL-X joint of the segment.
        at: A point in the frame of the joint [m], or None for the outer side of a limb or the
            front of the trunk and the head.
        edge: Edge of the plate [m].

    Raises:
        UnknownNameError: If there is no such joint.
        ConfigError: If `at` lies on the bone, or no skin is there.
    """
    check_name("segment of a person", joint, JOINTS)
    index = JOINT_INDEX[joint]
    skin = next(s for s in world.skins if s.body is person.body and isinstance(s, PersonSkin))
    rotations, positions = skin.joint_transforms()
    surface = person.model.posed(rotations, positions).astype(np.float64)
    bone = _bone(index, positions)
    start, ray = _ray(joint, at, positions[index], rotations[index], bone)
    faces = _faces_of(person, index)
    hit = _outermost(surface[faces], start, ray)
    if hit is None:
        where = "where markers go by themselves" if at is None else f"on the ray through {at}"
        raise ConfigError(
            f"segment {joint!r} has no skin of its own {where}: say another `at`, or choose a "
            "segment next to it"
        )
    turn = _turned(surface[faces], hit, ray, bone, edge)
    local = (surface[np.unique(faces)] - hit) @ turn
    under = (np.abs(local[:, :2]) < edge / 2).all(axis=1) & (np.abs(local[:, 2]) < _NEAR)
    height = float(local[under, 2].max(initial=0.0)) + _GAP
    place = hit + height * turn[:, 2]
    pose = Pose(tuple(place.tolist()), tuple(quaternion_from_matrix(turn).tolist()))
    return person.frames[index].link, pose


def _bone(index: int, positions: Array) -> Array:
    """Return the way from a joint to the end of its segment [m], shape [3]."""
    children = [child for child, parent in enumerate(PARENTS) if parent == index]
    if not children:  # a finger tip, an eye: on as before
        return positions[index] - positions[PARENTS[index]]
    return positions[children].mean(axis=0) - positions[index]


def _ray(
    joint: str,
    at: tuple[float, float, float] | None,
    origin: Array,
    rotation: Array,
    bone: Array,
) -> tuple[Array, Array]:
    """Return a point on the bone [m] and the direction in which to look for skin, in the world."""
    along = bone / np.linalg.norm(bone)
    if at is None:
        side, _, rest = joint.partition("_")
        share = _ALONG.get(rest, _ELSEWHERE)
        if side not in SIDES:
            out = rotation[:, 2]
        elif rest in _ARM:  # what is above in the T-pose is outside of a hanging arm
            out = rotation[:, 1]
        else:
            out = rotation[:, 0] * (1.0 if side == "left" else -1.0)
        start = origin + share * bone
    else:
        point = rotation @ np.asarray(at)
        start = origin + (point @ along) * along
        out = origin + point - start
    out = out - (out @ along) * along
    if np.linalg.norm(out) < 1e-4:
        raise ConfigError(f"a spot on the skin of {joint!r} cannot lie on its bone, as {at} does")
    return start, out / np.linalg.norm(out)


def _faces_of(person: Human, index: int) -> Ints:
    """Return the faces of the skin of a segment and its neighbours, shape [m, 3]."""
    near = {index, PARENTS[index], *(c for c, parent in enumerate(PARENTS) if parent == index)}
    faces = person.model.faces.astype(np.int64)
    return faces[np.isin(person.model.owner[faces], list(near)).all(axis=1)]


def _outermost(corners: Array, start: Array, ray: Array) -> Array | None:
    """Return where a ray last meets triangles of `corners` [m], shape [m, 3, 3].

    By Möller and Trumbore (1997).
    """
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(ray, second)
    volume = np.einsum("ij,ij->i", first, across)
    volume[np.abs(volume) < 1e-15] = np.inf  # seen from the edge
    away = start - corners[:, 0]
    u = np.einsum("ij,ij->i", away, across) / volume
    over = np.cross(away, first)
    v = over @ ray / volume
    distance = np.einsum("ij,ij->i", second, over) / volume
    hits = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    if not hits.any():
        return None
    return start + distance[hits].max() * ray


def _turned(corners: Array, hit: Array, ray: Array, bone: Array, edge: float) -> Array:
    """Return the axes of a plate on the skin at `hit` as columns, shape [3, 3]."""
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    close = np.linalg.norm(corners.mean(axis=1) - hit, axis=1) < edge / 2
    outside = areas @ ray > 0
    normal = areas[close & outside].sum(axis=0)
    if not normal.any():  # a plate smaller than the triangles of the skin
        normal = ray
    z = normal / np.linalg.norm(normal)
    y = -bone + (bone @ z) * z
    y /= np.linalg.norm(y)
    return np.column_stack((np.cross(y, z), y, z))
