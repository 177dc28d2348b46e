"""How robots get on with a room: how near they and their tools come to its walls and furniture.

Read once a control step, so a touch that begins and ends between two of them is not seen. On a bare floor
there is nothing to meet, and nothing is reported.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rcare_marl.agents.robots.robot import Robot
from rcare_marl.pose import Array

from .safety import moving_links
from .task import Task

NEAR = 0.05  # [m] from a thing: nearer is a near miss; our own choice
TOUCH = 0.001  # [m] at which it counts as touched: shapes have margins
FLOOR = 0.02  # [m] height up to which a thing is ground to stand on; own choice
LOOK = 0.2  # [m] how far it looks


class RoomMeter:
    """Counts over an episode what robots touch, and what they come near to."""

    def __init__(self, task: Task) -> None:
        """Prepare for a task whose scene is built: its robots, their tools, and a chair that drives.

        What the task is about, as a door that is to be opened, is not counted.
        """
        self._world, place, chair = task.world, task.place, task.chair
        robots = [agent.body for agent in task.cast.values() if isinstance(agent, Robot)]
        driven = [chair.body] if chair is not None and chair.body.is_movable else []
        movers = [*robots, *task.tools, *driven]
        self._movers = [(body, links) for body in movers if (links := moving_links(body))]
        self._links = [(body, link) for body, links in self._movers for link in links]
        there = place.obstacles if self._links and place.room is not None else ()
        met = [body for name, body in there if name != place.at_fixture and body.solid_links()]
        self._things = [body for body in met if body.bounds()[1][2] > FLOOR]

    def begin(self) -> None:
        """Begin an episode; what is near at the start is no near miss."""
        self._bounds = [np.stack(thing.bounds()) for thing in self._things]
        self._gaps = self._read()
        self._closest = self._gaps.min(initial=LOOK)
        self._touches = self._misses = 0
        self._is_near = self._gaps < NEAR

    def look(self) -> None:
        """Look at the room after the physics of a control step."""
        before, self._gaps = self._gaps, self._read()
        self._closest = min(self._closest, self._gaps.min(initial=LOOK))
        touched = (self._gaps < TOUCH) & (before >= TOUCH)
        came_near = (self._gaps < NEAR) & ~self._is_near
        self._touches += int(touched.sum())
        self._misses += int((came_near & ~touched).sum())
        # Who trembles at the edge of near does not come near again and again.
        self._is_near = self._gaps < np.where(self._is_near, 1.2 * NEAR, NEAR)

    def numbers(self) -> Mapping[str, float]:
        """Return what is told of the episode so far; nothing where there is no room.

        `room_contacts` counts touches of a thing by robots or tools, `room_near_misses` how often one
        came within 5 cm of a thing without touching it then, `room_clearance_m` is the least distance,
        at most 0.2 m.
        """
        if not self._things:
            return {}
        return {
            "room_contacts": float(self._touches),
            "room_near_misses": float(self._misses),
            "room_clearance_m": max(float(self._closest), 0.0),
        }

    def _read(self) -> Array:
        """Return how far the nearest mover is from each thing [m], `LOOK` at most."""
        out = np.full(len(self._things), LOOK)
        if not self._things:
            return out
        own = np.array([body.bounds(links) for body, links in self._movers])
        low, high = own[:, 0].min(axis=0) - LOOK, own[:, 1].max(axis=0) + LOOK
        for k, thing in enumerate(self._things):
            if thing.joints:
                self._bounds[k] = np.stack(thing.bounds())
            its_low, its_high = self._bounds[k]
            if (its_low < high).all() and (low < its_high).all():
                out[k] = min(self._world.gaps(self._links, thing, within=LOOK))
        return out
