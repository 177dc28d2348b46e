"""Distances along rays, such as those of a laser scanner or of a sensor in the hand."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from rcare_marl.body import Body
from rcare_marl.bullet import bullet
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Vector, matrix_from_quaternion
from rcare_marl.world import World

from ..agent import Agent
from ..robots.robot_config import ZERO, Triple
from .sensor import Channel, Sensor, SensorConfig, default_link, find_place, kept_links

MOST_HITS = 256  # of one ray that are looked through
BATCH = bullet.MAX_RAY_INTERSECTION_BATCH_SIZE
NEAREST = -1  # Bullet's number of a ray's first hit; the others have no certain order
GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))  # between neighbours on a sunflower


def ray_distances(
    world: World,
    origin: Vector,
    directions: Array,
    reach: float,
    unseen: Collection[Body] = (),
) -> Array:
    """Return how far it is along each ray to the nearest collision shape [m], shape [n].

    Args:
        world: The world.
        origin: Where all rays begin, in the world [m], shape [3]. A shape around it is not met.
        directions: Unit vectors in the world, shape [n, 3].
        reach: Length of the rays [m], the answer where nothing is met.
        unseen: Bodies that rays go through.
    """
    starts = np.tile(np.asarray(origin, np.float64), (len(directions), 1))
    ends = starts + reach * directions
    hidden = {body.uid for body in unseen}
    out = np.full(len(directions), float(reach))
    rays, number = np.arange(len(directions)), NEAREST
    while len(rays) and number < MOST_HITS:
        through = []
        for ray, (body, share) in zip(rays, _hits(world, starts, ends, rays, number), strict=True):
            if body >= 0 and body not in hidden:
                out[ray] = min(out[ray], share * reach)
            # What lies behind a hidden body is found by looking at all hits of the ray.
            if body in hidden or (number != NEAREST and body >= 0):
                through.append(ray)
        rays, number = np.array(through, np.int64), number + 1
    return out


def _hits(
    world: World, starts: Array, ends: Array, rays: npt.NDArray[np.int64], number: int
) -> list[tuple[int, float]]:
    """Return body, -1 for none, and share of the way of a hit of each of `rays`."""
    found: list[tuple[int, float]] = []
    world.show()
    for at in range(0, len(rays), BATCH):
        part = rays[at : at + BATCH]
        rows = bullet.rayTestBatch(
            starts[part].tolist(),
            ends[part].tolist(),
            reportHitNumber=number,
            physicsClientId=world.client,
        )
        found.extend((row[0], row[2]) for row in rows)
    return found


@dataclass(frozen=True)
class ProximityConfig(SensorConfig):
    """Options of `proximity`.

    Attributes:
        link: A robot's link or a person's segment; the tool of the main arm, or the head, if empty.
        at: Where the rays begin in the frame of the link [m].
        rpy_deg: Turn of the sensor in it, fixed-axis roll, pitch, yaw [degrees]; z is forward, x up.
            On a link with x forward and z up, (180, -90, 0) makes a level scanner.
        pattern: `cone` spreads rays about z; `fan` turns them about x, from right to left.
        rays: Number of rays.
        angle_deg: From one edge of cone or fan to the other [degrees].
        reach: How far it sees [m].
    """

    link: str = ""
    at: Triple = ZERO
    rpy_deg: Triple = ZERO
    pattern: Literal["cone", "fan"] = "cone"
    rays: int = 1
    angle_deg: float = 30.0
    reach: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rays < 1:
            raise ConfigError(f"sensor {self.name!r}: rays must be 1 or more, got {self.rays}")
        if not 0 <= self.angle_deg <= 360:
            raise ConfigError(
                f"sensor {self.name!r}: angle_deg must lie in [0, 360], got {self.angle_deg}"
            )
        if not self.reach > 0:
            raise ConfigError(f"sensor {self.name!r}: reach must be positive, got {self.reach} m")

    def directions(self) -> Array:
        """Return the unit vectors of the rays in the frame of the sensor, shape [rays, 3]."""
        half, count = math.radians(self.angle_deg) / 2, self.rays
        if self.pattern == "fan":
            turn: Array = np.linspace(-half, half, count) if count > 1 else np.zeros(1)
            return np.stack((np.zeros(count), -np.sin(turn), np.cos(turn)), axis=1)
        rank: Array = np.arange(count, dtype=np.float64)
        # The first ray is the axis; the area of a cap grows with one less the cosine.
        height = 1 - (1 - math.cos(half)) * rank / max(count - 1, 1)
        across, turn = np.sqrt(1 - height**2), GOLDEN_ANGLE * rank
        return np.stack((across * np.cos(turn), across * np.sin(turn), height), axis=1)


class Proximity(Sensor):
    """Distances [m] along rays to the nearest thing; `reach` where there is none.

    Channel: `distance`, one value a ray, from where the rays begin. The sensor does not see the agent's
    own body, nor what bonds of it hold. It sees collision shapes; of yielding flesh it sees the core.
    """

    Config = ProximityConfig
    config: ProximityConfig

    def links(self, agent: Agent) -> Sequence[str]:
        return kept_links(agent, self.config.link or default_link(agent))

    def bind(self, world: World, agent: Agent) -> None:
        self._world, self._body = world, agent.body
        self._place = find_place(agent, self.config.link, self.config.at, self.config.rpy_deg)
        self._directions = self.config.directions()

    def channels(self) -> Sequence[Channel]:
        return (Channel("distance", "m", (self.config.rays,), low=0.0, high=self.config.reach),)

    def measure(self) -> Sequence[Array]:
        frame = self._body.link_pose(self._place.link) @ self._place.pose
        directions = self._directions @ matrix_from_quaternion(frame.quaternion).T
        unseen = [self._body, *self._world.held_by(self._body)]
        return (ray_distances(self._world, frame.position, directions, self.config.reach, unseen),)
