"""Whether a body in some posture is clear of itself and of all that stands in its world.

The world is copied into Pinocchio once a question (https://github.com/stack-of-tasks/pinocchio), whose
collision library tests convex shapes exactly, behind a tree of boxes. Nothing of the world is touched, so
it does not matter when one asks, nor which engine moves the world.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import ConvexHull  # type: ignore[import-untyped]

from rcare_marl.body import Body
from rcare_marl.errors import check_package
from rcare_marl.model.mesh_file import hulls
from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Follow, Link, Model, joint_pose
from rcare_marl.model.urdf_reader import read
from rcare_marl.pose import Array, Pose
from rcare_marl.world import World

RESTING = 0.002  # [m] from what is held, within which a loose thing is carried along; own choice
KEPT = 0.001  # [m] of a gap at the start that is too small, and may yet shrink; own choice


@dataclass(frozen=True)
class Keep:
    """What a path keeps clear of.

    Attributes:
        gap: Distance to everything of which nothing else is said [m].
        bodies: Distance to some bodies [m]; None lets a path go through one.
        own: Pairs of own links that must not touch, by index.
    """

    gap: float = 0.005
    bodies: Mapping[Body, float | None] = field(default_factory=dict)
    own: Collection[frozenset[int]] = ()


@dataclass(frozen=True, eq=False)
class _Solid:
    """A convex shape in the frame of its link."""

    link: int
    name: str
    pose: Pose
    shape: Any
    radius: float


_known: WeakKeyDictionary[Body, tuple[Model, list[_Solid]]] = WeakKeyDictionary()


def check_installed() -> None:
    """Raise a MissingPackageError where the extra `plan` is not installed."""
    for module in ("pinocchio", "ompl", "toppra"):
        check_package(module, "planning", "plan")


class Clearance:
    """The question of who is clear of what, for some joints of one body.

    Attributes:
        joints: The joints in question.
        too_near: What was too near where `allow` was told of it: two names, and the distance [m].
    """

    def __init__(
        self,
        world: World,
        body: Body,
        joints: Sequence[str],
        keep: Keep,
        *,
        followers: Mapping[str, Follow] | None = None,
    ) -> None:
        """Copy what is within reach.

        Args:
            world: The world as it is now.
            body: Who is to move.
            joints: The joints that are to move; the others stay where they are.
            keep: What is to be kept clear of.
            followers: How further joints follow those.

        Raises:
            MissingPackageError: If the extra `plan` is not installed.
        """
        check_installed()
        import pinocchio

        self._pin, self.joints, self._body, self._keep = pinocchio, tuple(joints), body, keep
        self._tree, self._solids = pinocchio.Model(), pinocchio.GeometryModel()
        self._owners: list[tuple[Body, _Solid]] = []
        self._nodes: dict[str, tuple[int, Pose]] = {}  # node that carries each own link, and where
        self._moved, self._shift = self._grow(followers or {})
        self._data = self._tree.createData()
        held = self._take_own(world)
        self._take_others(world, held)
        self.too_near: list[tuple[str, str, float]] = []
        self._pair_up(world)

    def _grow(self, followers: Mapping[str, Follow]) -> tuple[Array, Array]:
        """Build the tree of joints; return how their places come from the joints in question."""
        pin, body, model = self._pin, self._body, _read(self._body)[0]
        root = body.base_pose()
        self._nodes[model.root] = (0, root)
        index = {name: i for i, name in enumerate(self.joints)}
        rows, shifts = [], []
        free = list(body.joints)
        places = body.joint_states([body.joints[name].index for name in free])[0]
        now = dict(zip(free, places, strict=True))
        self._reach = [0.0]
        for name, joint in model.joints.items():  # parents come before children
            node, at = self._nodes[joint.parent]
            rule = followers.get(name)
            if name not in index and (rule is None or rule.joint not in index):
                place = now.get(name, 0.0)
                self._nodes[joint.child] = (node, at @ joint_pose(joint, place))
                continue
            row = np.zeros(len(index))
            row[index[name if rule is None else rule.joint]] = (
                1.0 if rule is None else rule.multiplier
            )
            rows.append(row)
            shifts.append(0.0 if rule is None else rule.offset)
            slides = joint.kind == "prismatic"
            kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
            axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
            origin = at @ joint_pose(joint)
            if not rows[1:]:
                self._centre = np.asarray(origin.position)
            way = max(abs(joint.lower), abs(joint.upper)) if slides else 0.0
            far = 0.0 if node == 0 else float(np.linalg.norm(origin.position))
            new = self._tree.addJoint(node, kind(axis), _se3(pin, origin), name)
            self._reach.append(self._reach[node] + far + way)
            self._nodes[joint.child] = (new, Pose())
        return np.array(rows), np.array(shifts)

    def _take_own(self, world: World) -> list[tuple[Body, Pose]]:
        """Add the shapes of the body and of what its moving links hold; return what that is."""
        names = {index: name for name, index in self._body.links.items()}
        model, solids = _read(self._body)
        names[-1] = model.root
        for solid in solids:
            node, at = self._nodes[names[solid.link]]
            self._add(self._body, solid, node, at)
        held: list[tuple[Body, Pose]] = []
        carried: dict[Body, tuple[int, Pose] | None] = {self._body: None}  # on its links, if None
        for bond in world.bonds:  # in their order, and what is held may hold in turn
            if not bond.is_active or bond.child in carried or bond.child.joints:
                continue
            if bond.parent in carried:
                node, at = carried[bond.parent] or self._nodes[names[bond.link]]
                place = at @ bond.child_in_link @ bond.child.link_pose(bond.child_link).inverse()
                base = place @ bond.child.base_pose()
                if node:
                    held.append((bond.child, base))
                    for solid in _read(bond.child)[1]:
                        self._add(bond.child, solid, node, base)
                    carried[bond.child] = node, base
        return held

    def _take_others(self, world: World, held: Sequence[tuple[Body, Pose]]) -> None:
        """Add the shapes of all other bodies that can be reached, but for what rests on what is held."""
        own = {self._body, *(body for body, _ in held)}
        moving = [
            s for s, (body, _) in zip(self._solids.geometryObjects, self._owners, strict=True)
        ]
        reach = max(
            (
                self._reach[s.parentJoint]
                + float(np.linalg.norm(s.placement.translation))
                + solid.radius
                for s, (_, solid) in zip(moving, self._owners, strict=True)
                if s.parentJoint
            ),
            default=0.0,
        )
        passing = self._keep.bodies
        for body in world.bodies:
            if body in own or (body in passing and passing[body] is None):
                continue
            solids = _read(body)[1]
            margin = max(passing.get(body) or 0.0, self._keep.gap)
            poses = {link: body.link_pose(link) for link in {solid.link for solid in solids}}
            near = [
                (solid, poses[solid.link])
                for solid in solids
                if math.dist((poses[solid.link] @ solid.pose).position, self._centre)
                < reach + margin + solid.radius
            ]
            if near and body.is_movable and not body.joints and self._rests(world, body, held):
                continue
            for solid, at in near:
                self._add(body, solid, 0, at)

    @staticmethod
    def _rests(world: World, body: Body, held: Sequence[tuple[Body, Pose]]) -> bool:
        """Return whether a loose thing lies on what is held, and so goes with it."""
        return any(world.separation(body, other, within=2 * RESTING) < RESTING for other, _ in held)

    def _add(self, body: Body, solid: _Solid, node: int, at: Pose) -> None:
        name = f"{body.name}/{solid.name}/{len(self._owners)}"
        placed = _se3(self._pin, at @ solid.pose)
        made = self._pin.GeometryObject(name, node, 0, placed, solid.shape)
        self._solids.addGeometryObject(made)
        self._owners.append((body, solid))

    def _pair_up(self, world: World) -> None:
        """Name the pairs that must keep apart: what moves against all else that physics lets collide."""
        nodes = np.array([shape.parentJoint for shape in self._solids.geometryObjects])
        uids = np.array([body.uid for body, _ in self._owners])
        places: dict[tuple[int, int], list[int]] = {}
        for i, (body, solid) in enumerate(self._owners):
            places.setdefault((body.uid, solid.link), []).append(i)
        wanted = (nodes[:, None] != nodes) & (uids[:, None] != uids)
        told = {frozenset((self._body.uid, a) for a in pair): True for pair in self._keep.own}
        for pair, collide in (world.filter.said | told).items():
            ends = [places[place] for place in (*pair, *pair)[:2] if place in places]
            if len(ends) == 2 and (not collide or pair in told):
                for a, b in itertools.product(*ends):
                    wanted[a, b] = wanted[b, a] = collide and nodes[a] != nodes[b]
        self._solids.setCollisionPairs(np.triu(wanted, 1))
        bodies = self._keep.bodies
        kept = np.array([np.nan if (g := bodies.get(b)) is None else g for b, _ in self._owners])
        margins = np.fmax(kept[:, None], kept)
        margins[np.isnan(margins)] = self._keep.gap
        margins[uids[:, None] == uids] = 0.0
        self._shapes = self._solids.createData()
        self._shapes.setSecurityMargins(self._solids, margins, True, True)
        self._ready()

    def _ready(self) -> None:
        """Sort the shapes into a tree of boxes."""
        manager = self._pin.BroadPhaseManager_DynamicAABBTreeCollisionManager
        self._manager = manager(self._tree, self._solids, self._shapes)

    def full(self, posture: Array) -> Array:
        """Return the places of all joints of the tree at a posture [rad or m], shape [n]."""
        return np.asarray(self._moved @ posture + self._shift)

    def is_clear(self, posture: Array) -> bool:
        """Return whether nothing is nearer than it may be at a posture [rad or m], shape [n]."""
        return not self._pin.computeCollisions(
            self._tree, self._data, self._manager, self.full(posture), True
        )

    def offenders(self, posture: Array) -> list[tuple[str, str, float]]:
        """Return what is too near at a posture, nearest first: two names, and the distance [m]."""
        return sorted((self._told(k, gap) for k, gap in self._near(posture)), key=lambda e: e[2])

    def _near(self, posture: Array) -> Iterable[tuple[int, float]]:
        """Yield the pairs that are too near at a posture, and their distances [m]."""
        pin, full = self._pin, self.full(posture)
        pin.computeCollisions(self._tree, self._data, self._solids, self._shapes, full, False)
        for k, result in enumerate(self._shapes.collisionResults):
            if result.isCollision():
                yield k, pin.computeDistance(self._solids, self._shapes, k).min_distance

    def _told(self, k: int, gap: float) -> tuple[str, str, float]:
        pair = self._solids.collisionPairs[k]
        return self._said(pair.first), self._said(pair.second), gap

    def _said(self, i: int) -> str:
        body, solid = self._owners[i]
        return f"{solid.name} of {body.name}" if solid.name else body.name

    def allow(self, posture: Array) -> None:
        """Let what is too near at `posture` already be as near as it is there, less `KEPT`."""
        near = list(self._near(posture))
        self.too_near = sorted((self._told(k, gap) for k, gap in near), key=lambda e: e[2])
        for k, gap in near:
            self._shapes.collisionRequests[k].security_margin = gap - KEPT
        if near:
            self._ready()

    def link_turn(self, link: str, posture: Array) -> Array:
        """Return how a link of the body is turned in the world at a posture, shape [3, 3]."""
        node, at = self._nodes[link]
        self._pin.forwardKinematics(self._tree, self._data, self.full(posture))
        return np.asarray(self._data.oMi[node].rotation @ at.matrix()[:3, :3])

    def turn_rates(self, link: str, posture: Array) -> Array:
        """Return the turning of a link in the world by the rates of the joints, shape [3, n]."""
        pin, node = self._pin, self._nodes[link][0]
        found = pin.computeJointJacobian(self._tree, self._data, self.full(posture), node)
        return np.asarray(self._data.oMi[node].rotation @ found[3:] @ self._moved)


def _read(body: Body) -> tuple[Model, list[_Solid]]:
    """Return the model of a body and its convex shapes."""
    if body not in _known:
        source = body.source
        model = read(source, repair=False) if isinstance(source, Path) else source
        found = []
        for name, link in model.links.items():
            index = -1 if name == model.root else body.links.get(name)
            if index is not None:
                said = name if len(model.links) > 1 else ""
                found += [_Solid(index, said, *each) for each in _shapes_of(link)]
        _known[body] = model, found
    return _known[body]


def _shapes_of(link: Link) -> Iterable[tuple[Pose, Any, float]]:
    for shape in link.collision:
        yield (shape.pose(), *_primitive(shape))
    for mesh in link.hulls:
        for corners in hulls(mesh.file):
            yield (mesh.pose(), *_hull(corners * mesh.scale))


def _primitive(shape: Shape) -> tuple[Any, float]:
    import coal

    if shape.kind == "box":
        return coal.Box(*shape.size), 0.5 * math.hypot(*shape.size)
    if shape.kind == "sphere":
        return coal.Sphere(shape.radius), shape.radius
    if shape.kind == "capsule":
        return coal.Capsule(shape.radius, shape.span()), shape.radius + 0.5 * shape.span()
    return coal.Cylinder(shape.radius, shape.span()), math.hypot(shape.radius, 0.5 * shape.span())


def _hull(corners: Array) -> tuple[Any, float]:
    import coal

    hull = ConvexHull(corners)
    places = {old: new for new, old in enumerate(hull.vertices.tolist())}
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in corners[hull.vertices]:
        points.append(corner)
    for face in hull.simplices.tolist():
        faces.append(coal.Triangle(*(places[corner] for corner in face)))
    return coal.Convex(points, faces), float(np.linalg.norm(corners, axis=1).max())


def _se3(pin: Any, pose: Pose) -> Any:
    matrix = pose.matrix()
    return pin.SE3(matrix[:3, :3], matrix[:3, 3])
