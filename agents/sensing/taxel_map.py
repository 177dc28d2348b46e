"""Distributed force: a map of small force sensors on links or on a person's skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.contact import Touch
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, matrix_from_quaternion
from rcare_marl.soft.soft_body import SoftBody
from rcare_marl.world import World

from ..agent import Agent
from ..people.body.skeleton import JOINT_INDEX
from ..people.human import Human
from ..robots.robot import Robot
from .contact_force import LinkChoice, TouchConfig, TouchSensor
from .place import Place, default_link, find_place, kept_links, wrist_link
from .sensor import Channel
from .surface import spread, spread_over_link

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
        out: Array = weights / weights.sum(axis=1, keepdims=True)
        return out


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
        out: Array = np.array([t.force for t in touches]) @ shares
        return out

    def channels(self) -> Sequence[Channel]:
        return (Channel("force", "N", (len(self.positions),), low=0.0),)

    def measure(self) -> Sequence[Array]:
        return (self.gathered()[:, 0],)

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
        out: Array = (total / pressed.sum() * pressed) @ self._shares
        return out
