"""Distributed force: a map of small force sensors on links or on a person's skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull  # type: ignore[import-untyped]

from rcare_marl.body import Body
from rcare_marl.contact import Touch
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, matrix_from_quaternion
from rcare_marl.rendering.mesh import shape_mesh
from rcare_marl.soft.soft_body import SoftBody
from rcare_marl.world import World

from ..agent import Agent
from ..people.body.skeleton import JOINT_INDEX
from ..people.human import Human
from ..robots.robot import Robot
from .contact_force import LinkChoice, TouchConfig, TouchSensor
from .sensor import Channel, Place, default_link, find_place, kept_links, wrist_link

CONVEX = ("box", "sphere", "cylinder", "capsule")
DENSITY = 20  # candidates in a square of one spacing
MOST = 4000  # points on one surface
INSIDE = 5e-4  # [m] within another shape, from where a point is not on the outside
FACING = 0.1  # least cosine between a taxel and a contact that it can feel, our own choice


@dataclass(frozen=True)
class TaxelConfig(TouchConfig):
    """Options of `taxels`.

    Attributes:
        links: A robot's links or a person's segments; all of the main arm's hand, or the head, if empty.
        spacing: Distance between neighbours [m].
        spread: How far a contact point is felt around it, the standard deviation of a bell [m]; as far
            as `spacing` if zero.
    """

    links: tuple[str, ...] = ()
    spacing: float = 0.02
    spread: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_once("links", self.links)
        if not self.spacing > 0:
            raise ConfigError(f"sensor {self.name!r}: spacing must be above 0, got {self.spacing}")
        if not self.spread >= 0:
            raise ConfigError(f"sensor {self.name!r}: spread must be 0 or more, got {self.spread}")


@dataclass(frozen=True, eq=False)
class Patch:
    """The taxels of one link or segment.

    Attributes:
        name: Of the link or segment.
        place: Its frame.
        taxels: Where they stand in the list of all.
        positions: In that frame [m], shape [n, 3].
        normals: Out of the surface, unit length, shape [n, 3].
    """

    name: str
    place: Place
    taxels: slice
    positions: Array
    normals: Array

    def shares(self, points: Array, outward: Array, spread: float) -> Array:
        """Return how contact points are shared among the taxels; rows sum to one, shape [c, n].

        Args:
            points: In the frame of the patch [m], shape [c, 3].
            outward: Normals of the surface there, unit length, shape [c, 3].
            spread: Standard deviation [m].
        """
        facing = outward @ self.normals.T
        feels = facing > FACING
        blind = ~feels.any(axis=1)
        facing[blind], feels[blind] = 1.0, True
        square = ((points[:, None] - self.positions) ** 2).sum(axis=2)
        square[~feels] = np.inf
        # The nearest taxel always feels something, however far from the contact it is.
        square -= square.min(axis=1, keepdims=True)
        weights = np.where(feels, facing, 0.0) * np.exp(-square / (2 * spread**2))
        return weights / weights.sum(axis=1, keepdims=True)


class TaxelMap(TouchSensor):
    """Normal force [N] on each of many taxels, spread evenly over links or segments.

    Channel: `force`, one value a taxel, zero or more. On robots the taxels cover the collision shapes of
    a link, on people the skin of a segment. The force of a rigid contact point is shared among the
    taxels near it that face it, by a bell; that of contact on yielding flesh as the pressure on the flesh
    is. The shares of a contact sum to one, so the map sums to the normal force on its links; on flesh to
    all of the force, friction included, as `World.contacts` tells it.

    Attributes:
        patches: Taxels by link or segment, once bound.
        positions: Place of each taxel in the frame of its link or segment [m], shape [n, 3].
        normals: Out of the surface there, shape [n, 3].
    """

    Config = TaxelConfig
    config: TaxelConfig

    def links(self, agent: Agent) -> Sequence[str]:
        links = self.config.links
        if isinstance(agent, Robot) and not links:
            links = wrist_link(agent), default_link(agent)
        return kept_links(agent, *links)

    def bind(self, world: World, agent: Agent) -> None:
        self._world, self._body = world, agent.body
        names = self.config.links or _default_links(agent)
        self._choice = LinkChoice(agent, names)
        self._spread = self.config.spread or self.config.spacing
        self.patches: list[Patch] = []
        count = 0
        for name in names:
            place = find_place(agent, name)
            try:
                positions, normals = self._spread_over(agent, name, place.link)
            except ConfigError as error:
                raise ConfigError(f"sensor {self.config.name!r}, {name!r}: {error}") from error
            taxels = slice(count, count + len(positions))
            self.patches.append(Patch(name, place, taxels, positions, normals))
            count = taxels.stop
        self.positions = np.concatenate([patch.positions for patch in self.patches])
        self.normals = np.concatenate([patch.normals for patch in self.patches])
        tissue = agent.tissue if isinstance(agent, Human) else None
        self._soft = () if tissue is None else tuple(tissue.bodies.values())
        self._flesh = [
            FleshPatch(patch, tissue.bodies[patch.name], self._spread)
            for patch in self.patches
            if tissue is not None and patch.name in tissue.bodies
        ]
        self.begin(count, 1)

    def _spread_over(self, agent: Agent, name: str, link: int) -> tuple[Array, Array]:
        if not isinstance(agent, Human):
            return spread_over_link(agent.body, link, self.config.spacing)
        joint, model = JOINT_INDEX[name], agent.model
        faces = model.faces[model.owner[model.faces[:, 0]] == joint]
        skin = model.vertices.astype(np.float64) - model.joints[joint]
        return spread(skin[faces].reshape(-1, 3, 3), self.config.spacing)

    def present(self) -> Array:
        out = np.zeros((len(self.positions), 1))
        touches: dict[int, list[Touch]] = {}
        on_flesh = {tuple(touch.point.tolist()) for soft in self._soft for touch in soft.contacts}
        for touch in self._world.touches(self._body):
            if touch.position in on_flesh:
                continue  # that is spread by the pressure on the flesh
            row = self._choice.row(touch)
            if row is not None:
                touches.setdefault(row, []).append(touch)
        for row, felt in touches.items():
            patch = self.patches[row]
            out[patch.taxels, 0] += self._shared(patch, felt)
        for flesh in self._flesh:
            out[flesh.patch.taxels, 0] += flesh.forces()
        return out

    def _shared(self, patch: Patch, touches: Sequence[Touch]) -> Array:
        frame = self._body.link_pose(patch.place.link) @ patch.place.pose
        turn = matrix_from_quaternion(frame.quaternion)
        points = (np.array([t.position for t in touches]) - frame.position) @ turn
        outward = -np.array([t.normal for t in touches]) @ turn
        shares = patch.shares(points, outward, self._spread)
        return np.array([t.force for t in touches]) @ shares

    def channels(self) -> Sequence[Channel]:
        return (Channel("force", "N", (len(self.positions),), low=0.0),)

    def placed(self) -> tuple[Array, Array]:
        """Return where the taxels are in the world now [m], and their normals, each of shape [n, 3]."""
        places, normals = np.empty_like(self.positions), np.empty_like(self.normals)
        for patch in self.patches:
            frame = self._body.link_pose(patch.place.link) @ patch.place.pose
            turn = matrix_from_quaternion(frame.quaternion)
            places[patch.taxels] = patch.positions @ turn.T + frame.position
            normals[patch.taxels] = patch.normals @ turn.T
        return places, normals


def _default_links(agent: Agent) -> tuple[str, ...]:
    """Return the links of the main arm's hand that can touch anything, or the head of a person."""
    if not isinstance(agent, Robot):
        return (default_link(agent),)
    arm, body = agent.config.arms[agent.config.main_arm], agent.body
    beyond = body.carried_by(body.link_index(wrist_link(agent)))
    hand = [link for link in beyond if body.collision_shapes(link)]
    return tuple(body.link_names[link] for link in hand) or (arm.tool_link,)


class FleshPatch:
    """The taxels over one piece of flesh: what each particle of its surface does to each taxel.

    Attributes:
        patch: The taxels.
    """

    def __init__(self, patch: Patch, soft: SoftBody, spread: float) -> None:
        """Relate the particles of the surface at rest to the taxels of `patch`, in the same frame."""
        self.patch, self._soft = patch, soft
        self._nodes = np.flatnonzero(soft.areas > 0)
        inside = patch.place.pose.inverse() @ soft.carrier.pose
        turn = matrix_from_quaternion(inside.quaternion)
        rest = soft.rest[self._nodes].astype(np.float64) @ turn.T + inside.position
        nearest = ((rest[:, None] - patch.positions) ** 2).sum(axis=2).argmin(axis=1)
        self._shares = patch.shares(rest, patch.normals[nearest], spread)

    def forces(self) -> Array:
        """Return the force on each taxel in the last physics step [N], shape [n]."""
        total = sum(float(np.linalg.norm(c.force)) for c in self._soft.contacts)
        pressed = self._soft.pressure[self._nodes] * self._soft.areas[self._nodes]
        if total == 0 or pressed.sum() == 0:
            return np.zeros(len(self.patch.positions))
        return (total / pressed.sum() * pressed) @ self._shares


def spread(corners: Array, spacing: float, hulls: Sequence[Array] = ()) -> tuple[Array, Array]:
    """Return points on triangles, at least `spacing` [m] apart, that leave no larger hole, and their normals.

    Each point is put where the others are farthest (farthest point sampling, Eldar and others,
    1997), so the same surface always gets the same points.

    Args:
        corners: Of the triangles [m], counter-clockwise from outside, shape [t, 3, 3].
        spacing: Distance between neighbours [m].
        hulls: Planes of convex shapes, see `hull_planes`; what lies inside one is left out.

    Raises:
        ConfigError: If there would be more than `MOST` points, or none.
    """
    places, normals = _candidates(corners, spacing)
    keep = np.ones(len(places), np.bool_)
    for planes in hulls:
        depth = (places @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        keep &= depth > -INSIDE
    places, normals = places[keep], normals[keep]
    if not len(places):
        raise ConfigError("there is no surface to put points on")
    chosen = [int(np.argmax(places[:, 0]))]
    gaps = np.linalg.norm(places - places[chosen[0]], axis=1)
    while gaps.max() > spacing:
        if len(chosen) >= MOST:
            raise ConfigError(
                f"a spacing of {spacing} m needs more than {MOST} points: choose a greater one"
            )
        chosen.append(int(np.argmax(gaps)))
        np.minimum(gaps, np.linalg.norm(places - places[chosen[-1]], axis=1), out=gaps)
    return places[chosen], normals[chosen]


def _candidates(corners: Array, spacing: float) -> tuple[Array, Array]:
    """Return many points, as dense everywhere, and the normals of their triangles."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    cross = np.cross(b - a, c - a)
    doubled = np.linalg.norm(cross, axis=1)
    total = doubled.sum() / 2
    count = max(int(DENSITY * total / spacing**2), 200)
    if count > 4 * DENSITY * MOST:
        raise ConfigError(
            f"a spacing of {spacing} m needs more than {MOST} points: choose a greater one"
        )
    triangle = np.searchsorted(np.cumsum(doubled), (np.arange(count) + 0.5) / count * 2 * total)
    triangle = np.minimum(triangle, len(a) - 1)
    # The R2 sequence (Roberts 2018): even in the square, folded into the triangle.
    u, v = ((0.5 + np.arange(count) * step) % 1 for step in (0.7548776662, 0.5698402910))
    over = u + v > 1
    u, v = np.where(over, 1 - u, u)[:, None], np.where(over, 1 - v, v)[:, None]
    at = triangle
    places = a[at] + u * (b - a)[at] + v * (c - a)[at]
    return places, cross[at] / doubled[at, None]


def hull_planes(hull: ConvexHull) -> Array:
    """Return outward unit normals and offsets of a hull, shape [p, 4]; inside is negative."""
    return np.unique(np.round(hull.equations, 9), axis=0)


def spread_over_link(body: Body, link: int, spacing: float) -> tuple[Array, Array]:
    """Return points and normals on the outside of the collision shapes of a link, in its frame.

    Raises:
        ConfigError: If it has no shapes, or there would be too many points.
    """
    pieces, hulls = [], []
    for place, shape in enumerate(body.collision_shapes(link)):
        mesh = None
        if shape.kind != "mesh":
            mesh = shape_mesh(shape) if shape.kind in CONVEX else None
        elif Path(shape.mesh).is_file():
            mesh = shape_mesh(shape)
        if mesh is not None:
            turn = matrix_from_quaternion(shape.pose.quaternion)
            vertices = mesh.vertices.astype(np.float64) @ turn.T + shape.pose.position
        else:
            vertices = body.hull_points(link, place)
        if len(vertices):
            hull = ConvexHull(vertices)  # Bullet collides with hulls of meshes
            pieces.append(vertices[_outward(vertices, hull)])
            hulls.append(hull_planes(hull))
    if not pieces:
        raise ConfigError("there are no shapes to put points on")
    return spread(np.concatenate(pieces), spacing, hulls)


def _outward(vertices: Array, hull: ConvexHull) -> npt.NDArray[np.int64]:
    faces = np.array(hull.simplices, np.int64)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    wrong = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    faces[wrong] = faces[wrong][:, ::-1]
    return faces
