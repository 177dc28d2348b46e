"""Contact forces on the links of a robot or the segments of a person."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcare_marl.contact import Touch
from rcare_marl.errors import check_name
from rcare_marl.pose import Array
from rcare_marl.world import World

from ..agent import Agent
from ..people.body.skeleton import JOINTS
from ..people.human import Human
from .sensor import Channel, Sensor, SensorConfig, kept_links


@dataclass(frozen=True)
class TouchConfig(SensorConfig):
    """Options of sensors of contact.

    Attributes:
        statistic: Of the physics steps since the last sample, which is a control step if there is no
            `rate`: their `mean`, or the greatest force of each, `peak`; or the `last` physics step
            alone, which is cheaper. Impacts are short: only the peak tells how hard they were.
    """

    statistic: Literal["mean", "peak", "last"] = "mean"


class TouchSensor(Sensor):
    """A sensor of contact forces, in rows of one or three values."""

    Config = TouchConfig
    config: TouchConfig
    _world: World

    @abc.abstractmethod
    def present(self) -> Array:
        """Return what was felt in the last physics step [N], shape [rows, 1] or [rows, 3]."""

    def begin(self, rows: int, width: int) -> None:
        """Say how much there is to read, when it is bound."""
        self._seen, self._gathered = np.zeros((rows, width)), np.zeros((rows, width))
        self.watches = self.config.statistic != "last"
        self.reset()

    def reset(self) -> None:
        self._begun, self._count = self._world.step_count, 0
        self._seen = np.zeros_like(self._seen)

    def after_substep(self) -> None:
        now = self.present()
        if self._count == 0:
            self._gathered[:] = now
        elif self.config.statistic == "mean":
            self._gathered += now
        else:
            greater = (now**2).sum(axis=1) > (self._gathered**2).sum(axis=1)
            self._gathered[greater] = now[greater]
        self._count += 1

    def measure(self) -> Sequence[Array]:
        """Return the statistic since it was last asked for, in rows; zeros before the first step."""
        if not self.watches:
            if self._world.step_count != self._begun:  # what Bullet tells is of the last episode
                self._seen = self.present()
        elif self._count:
            share = self._count if self.config.statistic == "mean" else 1
            self._seen, self._count = self._gathered / share, 0
        return (self._seen,)


@dataclass(frozen=True)
class ContactForceConfig(TouchConfig):
    """Options of `contact_force`.

    Attributes:
        links: A robot's links or a person's segments; all of them if empty.
        per_link: Whether each has a reading of its own; one sum otherwise.
        output: `vector` is the force in the world. `magnitude` sums the sizes of the forces of all
            contact points, so that what pinches from both sides does not cancel out.
    """

    links: tuple[str, ...] = ()
    per_link: bool = False
    output: Literal["vector", "magnitude"] = "vector"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_once("links", self.links)


class LinkChoice:
    """The links of a body, or segments of a person, that a sensor covers.

    Attributes:
        names: Their names.
    """

    def __init__(self, agent: Agent, names: Sequence[str]) -> None:
        """Find `names` on a spawned agent, or all that it has if there are none.

        Raises:
            UnknownNameError: If the agent has no such link or segment.
        """
        self._person = agent if isinstance(agent, Human) else None
        body = agent.body
        if self._person is not None:
            self.names: tuple[str, ...] = tuple(names) or JOINTS
            for name in self.names:
                check_name("segment of a person", name, JOINTS)
            self._row = {name: i for i, name in enumerate(self.names)}
            return
        indices = [body.link_index(name) for name in names] or list(range(-1, body.link_count))
        self.names = tuple(names) or tuple(body.link_names[index] for index in indices)
        self._row_of_link = {index: row for row, index in enumerate(indices)}

    def row(self, touch: Touch) -> int | None:
        """Return the place among `names` of what a contact is on, or None."""
        if self._person is None:
            return self._row_of_link.get(touch.link)
        # Segments that do not move against each other are one link.
        return self._row.get(self._person.segment_at(touch.link, np.array(touch.position)))


class ContactForce(TouchSensor):
    """Force [N] of everything that touches chosen links, normal force and friction together.

    Channel: `force`; with `per_link` one row for each of `names`. Vectors are in the world and point
    from what touches into the body: a hand that lies on a table feels a force upward. Yielding flesh
    counts as part of its person. Bonds such as that of a grasped spoon are no contact, nor is what an agent
    does to itself, such as a hand that lies on the own thigh. Before the first
    physics step of an episode nothing touches.

    Attributes:
        names: The links or segments, once bound.
    """

    Config = ContactForceConfig
    config: ContactForceConfig

    def links(self, agent: Agent) -> Sequence[str]:
        return kept_links(agent, *self.config.links)

    def bind(self, world: World, agent: Agent) -> None:
        self._world, self._body = world, agent.body
        self._choice = LinkChoice(agent, self.config.links)
        self.names = self._choice.names
        self._width = 3 if self.config.output == "vector" else 1
        self.begin(len(self.names) if self.config.per_link else 1, self._width)

    def present(self) -> Array:
        out = np.zeros((len(self.names) if self.config.per_link else 1, self._width))
        for touch in self._world.touches(self._body):
            row = self._choice.row(touch)
            if row is not None:
                force = np.array(touch.normal) * touch.force + touch.friction
                out[row if self.config.per_link else 0] += (
                    force if self._width == 3 else np.linalg.norm(force)
                )
        return out

    def channels(self) -> Sequence[Channel]:
        shape: tuple[int, ...] = (self._width,)
        if self.config.per_link:
            shape = (len(self.names), 3) if self._width == 3 else (len(self.names),)
        return (Channel("force", "N", shape),)
