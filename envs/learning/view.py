"""What a network reads of an observation, in forms that carry over to other robots and people.

An observation holds a robot's joints and places in the world. A network that reads these fits one robot, and
one place of a mouth. A view leaves them out: it takes what is named, differences of places, and the axes of
a turn, now and some control steps ago, from which a network can tell speeds and average noise. With a
heading it is the same whichever way a face is turned, and what the network does is turned back.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.robots.control.control import ToolMotion
from rcare_marl.errors import ConfigError, UnknownNameError

Floats = npt.NDArray[np.float32]
LONGEST = 100  # control steps back; our own choice
PART = re.compile(r"(?:axes\((?P<turn>\w+)\)|(?P<name>\w+)(?: - (?P<less>\w+))?)")
AXES = 6  # values of two axes
LEVEL = 0.1  # of a heading that is level enough to have a direction; our own choice


@dataclass(frozen=True)
class ViewConfig:
    """A view as data.

    Attributes:
        parts: What is read, each a name of what is observed such as `bowl_to_mouth`, a difference such as
            `elbow_position - tool_position`, or `axes(tool_rotation)`: the first two axes of a rotation
            vector's frame, which do not jump where the vector does (Zhou et al. 2019, On the continuity of
            rotation representations in neural networks).
        lags: How many control steps ago it is read once more, each time the whole.
        heading: A vector that is observed, such as `face_direction`. All that has three values and all axes
            are read turned about the vertical, as if it had pointed ahead when the episode began, and the
            tool's velocities of an action are turned back. Empty: as it is observed.
        tilted: Turned up or down, too, so that the heading itself points ahead; then the axes y and z of the
            world are read as well, under the name `left_and_up`.

    Raises:
        ConfigError: If a part is none of these, a lag is out of 1..100, or it is tilted and has no heading.
    """

    parts: tuple[str, ...]
    lags: tuple[int, ...] = ()
    heading: str = ""
    tilted: bool = False

    def __post_init__(self) -> None:
        if not self.parts:
            raise ConfigError("a view needs at least one part")
        for part in self.parts:
            if not PART.fullmatch(part):
                raise ConfigError(
                    f"part of a view: 'name', 'name - name' or 'axes(name)', got {part!r}"
                )
        if self.tilted and not self.heading:
            raise ConfigError("a view is tilted by its heading, and there is none")
        for lag in self.lags:
            if not 1 <= lag <= LONGEST:
                raise ConfigError(f"lags of a view must lie in 1..{LONGEST}, got {lag}")


class View:
    """Reads one agent's observation through a view, a control step after the other.

    Attributes:
        parts: Name and number of values of each part of what comes out; lags are told by `@`.
        now: What was read last, without what was before, shape [parts].
    """

    def __init__(
        self,
        config: ViewConfig,
        table: Sequence[tuple[str, slice]],
        acts: Sequence[str] = (),
    ) -> None:
        """Take a view of an observation whose parts have these names and places.

        Args:
            config: What is read.
            table: Name and place of each part of the observation.
            acts: Names of the action's values, which a heading turns back.

        Raises:
            UnknownNameError: If something is not observed.
            ConfigError: If sizes do not suit each other, or there is a heading and the action does not begin
                with the velocities of a tool.
        """
        places = dict(table)
        add: list[int] = []
        less: list[int] = []
        self._turns: list[tuple[slice, int]] = []
        sizes: list[tuple[str, int]] = []
        vectors: list[int] = []  # where they begin
        for part in config.parts:
            found = PART.fullmatch(part)
            assert found is not None  # a config holds no other
            at = _find(places, found["turn"] or found["name"])
            size, begin = at.stop - at.start, len(add)
            if found["turn"]:
                if size != 3:
                    raise ConfigError(f"{part}: a rotation has 3 values, got {size}")
                self._turns.append((at, begin))
                size = AXES
                add += [at.start] * AXES  # to be written over
                less += [-1] * AXES
            else:
                other = _find(places, found["less"]) if found["less"] else None
                if other is not None and other.stop - other.start != size:
                    raise ConfigError(f"{part}: {size} and {other.stop - other.start} values")
                add += range(at.start, at.stop)
                less += [-1] * size if other is None else range(other.start, other.stop)
            if found["turn"] or size == 3:
                vectors += range(begin, begin + size, 3)
            sizes.append((part, size))
        if config.tilted:
            sizes.append(("left_and_up", AXES))
            add += [0] * AXES  # to be written over
            less += [-1] * AXES
        self._add, self._less = np.array(add), np.array(less)
        self._differs = self._less >= 0
        self._lags = config.lags
        self.parts = (
            *sizes,
            *((f"{name}@{lag}", size) for lag in config.lags for name, size in sizes),
        )
        self._past: deque[Floats] = deque(maxlen=max(config.lags, default=0) + 1)
        self.now: Floats = np.zeros(len(add), np.float32)
        self._vectors = np.array(vectors, int)[:, None] + np.arange(3)
        self._heading = _find(places, config.heading) if config.heading else None
        self._tilted, self._begins = config.tilted, True
        self._turn = np.eye(3, dtype=np.float32)  # from the world to how it is read
        if self._heading is not None:
            if self._heading.stop - self._heading.start != 3:
                raise ConfigError(f"a heading has 3 values, {config.heading!r} has not")
            if tuple(acts[: len(ToolMotion.NAMES)]) != ToolMotion.NAMES:
                raise ConfigError(
                    f"a heading turns the velocities of a tool, and the action has {', '.join(acts)}"
                )

    @property
    def size(self) -> int:
        """Number of values that come out."""
        return len(self.now) * (1 + len(self._lags))

    def reset(self) -> None:
        """Begin an episode: there is nothing before it."""
        self._past.clear()
        self._begins = True

    def turned(self, action: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return an action of the world as it is read: its tool turned, within -1 to 1, shape [action]."""
        return self._with_tool(action, self._turn)

    def turned_back(self, action: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return what an action is in the world, within -1 to 1, shape [action]."""
        return self._with_tool(action, self._turn.T)

    def _with_tool(self, action: npt.NDArray[Any], turn: Floats) -> npt.NDArray[Any]:
        if self._heading is None:
            return action
        out, tool = action.copy(), len(ToolMotion.NAMES)
        out[:tool] = np.clip(_turned(action[:tool].reshape(2, 3), turn), -1.0, 1.0).ravel()
        return out

    def read(self, observation: Floats) -> Floats:
        """Return what a network reads, shape [size]; once in each control step.

        Before an episode is as old as a lag, its beginning stands for what was then.

        Args:
            observation: The vector that the agent observes, shape [observation].
        """
        now = observation[self._add]
        now[self._differs] -= observation[self._less[self._differs]]
        for at, begin in self._turns:
            now[begin : begin + AXES] = _axes(observation[at])
        if self._heading is not None:
            if self._begins:
                self._turn = _ahead(observation[self._heading], self._tilted)
            now[self._vectors] = _turned(now[self._vectors], self._turn)
            if self._tilted:
                now[-AXES:] = self._turn[:, 1:].T.ravel()
        self._begins = False
        self.now = now
        if not self._lags:
            return now
        self._past.appendleft(now)
        last = len(self._past) - 1
        return np.concatenate([now, *(self._past[min(lag, last)] for lag in self._lags)])


def _find(places: dict[str, slice], name: str) -> slice:
    if name not in places:
        raise UnknownNameError("part of the observation", name, places)
    return places[name]


def _turned(vectors: npt.NDArray[Any], turn: Floats) -> npt.NDArray[Any]:
    """Return vectors turned, shape [n, 3]; not by BLAS, whose last bit may depend on threads."""
    return np.asarray(np.einsum("ij,nj->ni", turn, vectors))


def _ahead(way: Floats, tilted: bool) -> Floats:
    """Return the turn that brings the level part of a way, or all of it, to x; y stays level. [3, 3]."""
    x, y, z = (float(value) for value in way)
    level = math.hypot(x, y)
    c, s = (x / level, y / level) if level > LEVEL else (1.0, 0.0)
    up = math.atan2(z, level) if tilted else 0.0
    e, f = math.cos(up), math.sin(up)
    return np.array(((e * c, e * s, f), (-s, c, 0.0), (-f * c, -f * s, e)), np.float32)


def _axes(turn: Floats) -> Floats:
    """Return the first two axes of the frame of a rotation vector [rad], one after the other, shape [6]."""
    x, y, z = (float(value) for value in turn)
    angle = (x * x + y * y + z * z) ** 0.5
    if angle > 1e-9:
        x, y, z = x / angle, y / angle, z / angle
    s, c = np.sin(angle), np.cos(angle)
    d = 1.0 - c
    return np.array(
        (c + x * x * d, x * y * d + z * s, x * z * d - y * s)
        + (x * y * d - z * s, c + y * y * d, y * z * d + x * s),
        np.float32,
    )
