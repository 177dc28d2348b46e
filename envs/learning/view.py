"""What a network reads of an observation, in forms that carry over to other robots and people.

An observation holds a robot's joints and places in the world. A network that reads these fits one robot, and
one place of a mouth. A view leaves them out: it takes what is named, differences of places, and the axes of
a turn, now and some control steps ago, from which a network can tell speeds and average noise.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError, UnknownNameError

Floats = npt.NDArray[np.float32]
LONGEST = 100  # control steps back; our own choice
PART = re.compile(r"(?:axes\((?P<turn>\w+)\)|(?P<name>\w+)(?: - (?P<less>\w+))?)")
AXES = 6  # values of two axes


@dataclass(frozen=True)
class ViewConfig:
    """A view as data.

    Attributes:
        parts: What is read, each a name of what is observed such as `bowl_to_mouth`, a difference such as
            `elbow_position - tool_position`, or `axes(tool_rotation)`: the first two axes of a rotation
            vector's frame, which do not jump where the vector does (Zhou et al. 2019, On the continuity of
            rotation representations in neural networks).
        lags: How many control steps ago it is read once more, each time the whole.

    Raises:
        ConfigError: If a part is none of these, or a lag is out of 1..100.
    """

    parts: tuple[str, ...]
    lags: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not self.parts:
            raise ConfigError("a view needs at least one part")
        for part in self.parts:
            if not PART.fullmatch(part):
                raise ConfigError(
                    f"part of a view: 'name', 'name - name' or 'axes(name)', got {part!r}"
                )
        for lag in self.lags:
            if not 1 <= lag <= LONGEST:
                raise ConfigError(f"lags of a view must lie in 1..{LONGEST}, got {lag}")


class View:
    """Reads one agent's observation through a view, a control step after the other.

    Attributes:
        parts: Name and number of values of each part of what comes out; lags are told by `@`.
        now: What was read last, without what was before, shape [parts].
    """

    def __init__(self, config: ViewConfig, table: Sequence[tuple[str, slice]]) -> None:
        """Take a view of an observation whose parts have these names and places.

        Raises:
            UnknownNameError: If something is not observed.
            ConfigError: If sizes do not suit each other.
        """
        places = dict(table)
        add: list[int] = []
        less: list[int] = []
        self._turns: list[tuple[slice, int]] = []
        sizes: list[tuple[str, int]] = []
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
            sizes.append((part, size))
        self._add, self._less = np.array(add), np.array(less)
        self._differs = self._less >= 0
        self._lags = config.lags
        self.parts = (
            *sizes,
            *((f"{name}@{lag}", size) for lag in config.lags for name, size in sizes),
        )
        self._past: deque[Floats] = deque(maxlen=max(config.lags, default=0) + 1)
        self.now: Floats = np.zeros(len(add), np.float32)

    @property
    def size(self) -> int:
        """Number of values that come out."""
        return len(self.now) * (1 + len(self._lags))

    def reset(self) -> None:
        """Begin an episode: there is nothing before it."""
        self._past.clear()

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
