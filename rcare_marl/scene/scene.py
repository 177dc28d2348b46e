"""What is in a world, as plain data that no engine owns: models, poses, joints, bonds, who touches whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path
from typing import TypeAlias

from rcare_marl.body import Body
from rcare_marl.body_part import Touching
from rcare_marl.model.urdf import Model, joint_pose
from rcare_marl.model.urdf_reader import read
from rcare_marl.pose import Pose
from rcare_marl.world import GRAVITY, World

Place: TypeAlias = tuple[str, str]  # name of a body, of a link


@dataclass(frozen=True)
class SceneBody:
    """A body of a scene.

    Attributes:
        name: Its name, unique in the scene.
        model: Links, joints and shapes.
        pose: Of the root link's frame in the world.
        is_movable: Whether the root can move.
        positions: Of the movable joints [rad or m], by name, in the order of the model.
        efforts: Greatest torque or force of the joints that have a motor [N·m or N].
        friction: Dry friction of the joints that have none [N·m or N].
        gears: Joints that follow: (leader, multiplier) by follower.
        touching: How the surface of each link touches.
    """

    name: str
    model: Model
    pose: Pose
    is_movable: bool
    positions: Mapping[str, float]
    efforts: Mapping[str, float]
    friction: Mapping[str, float]
    gears: Mapping[str, tuple[str, float]]
    touching: Mapping[str, Touching]

    def solid(self) -> list[str]:
        """Return the links that have a collision shape."""
        links = self.model.links.items()
        return [name for name, link in links if link.collision or link.hulls]


@dataclass(frozen=True)
class Bond:
    """A bond between two links.

    Attributes:
        parent: Who holds.
        child: Who is held.
        at: Pose of the held link in the frame of the one that holds.
        force: Greatest force [N].
        pivot: Point of the holding link about which the other may turn [m]; None if the bond is rigid.
        is_active: Whether it holds now.
    """

    parent: Place
    child: Place
    at: Pose
    force: float
    pivot: tuple[float, ...] | None
    is_active: bool


@dataclass(frozen=True)
class Scene:
    """All bodies of a world as they are, without soft matter and food that was eaten.

    Attributes:
        bodies: The bodies by name, in the order of the world.
        bonds: Bonds, in the order of the world.
        meeting: Pairs of links of one body that collide.
        passing: Pairs of links of two bodies that do not, though others of these bodies may.
        physics_dt: Physics step [s].
        iterations: Of the solver.
        gravity: Acceleration downwards [m/s²].
    """

    bodies: Mapping[str, SceneBody]
    bonds: Sequence[Bond]
    meeting: frozenset[frozenset[Place]]
    passing: frozenset[frozenset[Place]]
    physics_dt: float
    iterations: int
    gravity: float = GRAVITY

    def held(self) -> dict[str, Bond]:
        """Return the bonds that hold single bodies without joints rigidly, by who is held."""
        found: dict[str, Bond] = {}
        for bond in self.bonds:
            body = self.bodies[bond.child[0]]
            whole = bond.child[1] == body.model.root and not body.model.joints
            if bond.is_active and bond.pivot is None and whole:
                found.setdefault(body.name, bond)
        return found


def scene_of(world: World) -> Scene:
    """Return what is in a world now."""
    bodies = {body.name: _body(body) for body in world.bodies}
    names = {
        (body.uid, index): (body.name, link_name(body, index))
        for body in world.bodies
        for index in range(-1, body.link_count)
    }
    meeting = {
        frozenset((names[body.uid, a], names[body.uid, b]))
        for body in world.bodies
        for a, b in body.meeting
    }
    for body in (body for body in world.bodies if body.meets_itself):
        meeting |= _own_pairs(bodies[body.name])
    passing = set()
    for pair, collide in world.filter.said.items():
        places = frozenset(names[place] for place in pair)
        if not collide:
            meeting.discard(places)
            passing.add(places)
    bonds = [
        Bond(
            (bond.parent.name, link_name(bond.parent, bond.link)),
            (bond.child.name, link_name(bond.child, bond.child_link)),
            bond.child_in_link,
            bond.force,
            bond.pivot,
            bond.is_active,
        )
        for bond in world.bonds
    ]
    return Scene(
        bodies,
        bonds,
        frozenset(meeting),
        frozenset(pair for pair in passing if len({name for name, _ in pair}) == 2),
        world.physics_dt,
        world.solver_iterations,
    )


def _body(body: Body) -> SceneBody:
    source = body.source
    model = read(source, repair=False) if isinstance(source, Path) else source
    names = list(body.joints)
    found, _ = body.joint_states([body.joints[name].index for name in names])
    positions = dict(zip(names, found, strict=True))
    by_index = {joint.index: name for name, joint in body.joints.items()}
    return SceneBody(
        body.name,
        model,
        body.base_pose(),
        body.is_movable,
        positions,
        {n: j.effort for n, j in body.joints.items() if j.index not in body.friction},
        {by_index[i]: friction for i, friction in body.friction.items() if i in by_index},
        {by_index[g.follower]: (by_index[g.leader], g.multiplier) for g in body.gears},
        {name: body.touching(_index(body, model, name)) for name in model.links},
    )


def _index(body: Body, model: Model, link: str) -> int:
    return -1 if link == model.root else body.links[link]


def link_name(body: Body, index: int) -> str:
    """Return the name that a link has in its model; -1 is the root."""
    if index >= 0:
        return body.link_names[index]
    source = body.source
    return (read(source, repair=False) if isinstance(source, Path) else source).root


def _own_pairs(body: SceneBody) -> set[frozenset[Place]]:
    """Return the pairs of links that have shapes and are not parent and child."""
    beside = {frozenset((joint.parent, joint.child)) for joint in body.model.joints.values()}
    pairs = {frozenset(pair) for pair in combinations(body.solid(), 2)}
    return {frozenset((body.name, link) for link in pair) for pair in pairs - beside}


def link_poses(body: SceneBody) -> dict[str, Pose]:
    """Return the pose of each link's frame in the world."""
    poses = {body.model.root: body.pose}
    for name, joint in body.model.joints.items():
        poses[joint.child] = poses[joint.parent] @ joint_pose(joint, body.positions.get(name, 0.0))
    return poses


def apart(scene: Scene) -> dict[frozenset[str], set[frozenset[Place]] | None]:
    """Return for pairs of bodies which links pass through each other; None if the whole bodies do."""
    told: dict[frozenset[str], set[frozenset[Place]]] = {}
    for pair in scene.passing:
        told.setdefault(frozenset(name for name, _ in pair), set()).add(pair)
    found: dict[frozenset[str], set[frozenset[Place]] | None] = {}
    for names, pairs in told.items():
        a, b = (scene.bodies[name] for name in names)
        every = {frozenset(((a.name, i), (b.name, j))) for i, j in product(a.solid(), b.solid())}
        found[names] = None if every <= pairs else every & pairs
    return found
