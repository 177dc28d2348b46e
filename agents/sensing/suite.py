"""All sensors of one agent: made from what a user writes, sampled on the clock, observed."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from rcare_marl.config import load
from rcare_marl.errors import ConfigError, RcareError, UnknownNameError, WorldError, check_name
from rcare_marl.observable import Observable
from rcare_marl.world import World

from .registry import SENSORS
from .sampler import Sampler
from .sensor import Channel, Sensor

if TYPE_CHECKING:
    from ..agent import Agent

Entry = str | Mapping[str, Any]


class SensorSuite:
    """The sensors of one agent.

    Made before the agent is spawned, so that the agent can ask for `links`; then bound once, `reset`
    at each episode, told of physics steps if it `watches`, and asked to `sense` before anything is
    observed.

    Attributes:
        sensors: The sensors by name, in the order in which they were asked for.
    """

    def __init__(self, entries: Sequence[Entry], owner: str) -> None:
        """Make the sensors of `entries`.

        Args:
            entries: Each a kind of `SENSORS`, with all defaults, or a mapping with `kind` and
                options of that kind. The name is the kind if there is no `name`.
            owner: Whose they are, for messages.

        Raises:
            UnknownNameError: If there is no such kind or option.
            ConfigError: If an option is impossible, or two sensors have the same name.
        """
        if isinstance(entries, str | Mapping):
            raise ConfigError(f"{owner}: sensors must be a list, got {entries!r}")
        self._owner = owner
        self.sensors: dict[str, Sensor] = {}
        for i, entry in enumerate(entries):
            sensor = _make(entry, f"{owner} sensors[{i}]")
            name = sensor.config.name
            if name in self.sensors:
                raise ConfigError(
                    f"{owner}: two sensors are called {name!r}; give one another `name`"
                )
            self.sensors[name] = sensor
        self._samplers: dict[str, Sampler] = {}
        self._watching: tuple[Sensor, ...] = ()
        self._clocked: tuple[Sampler, ...] = ()

    def links(self, agent: Agent) -> tuple[str, ...]:
        """Return the links of `agent` that must stay links of their own; asked before `spawn`."""
        found: list[str] = []
        for name, sensor in self.sensors.items():
            with self._naming(name):
                found += sensor.links(agent)
        return tuple(dict.fromkeys(found))

    def bind(self, world: World, agent: Agent) -> None:
        """Take hold of the spawned agent, once.

        Raises:
            UnknownNameError: If a sensor names what the agent lacks.
            ConfigError: If a sensor cannot be on such an agent, or be read so often.
        """
        for name, sensor in self.sensors.items():
            with self._naming(name):
                sensor.bind(world, agent)
                self._samplers[name] = Sampler(sensor, world)
        self._watching = tuple(sensor for sensor in self.sensors.values() if sensor.watches)
        self._clocked = tuple(s for s in self._samplers.values() if s.is_clocked)

    @contextmanager
    def _naming(self, name: str) -> Iterator[None]:
        """Put owner and sensor before the message of an error."""
        try:
            yield
        except RcareError as error:
            here, message = f"sensor {name!r}", str(error)
            if not message.startswith(here):
                message = f"{here}: {message}"
            error.args = (f"{self._owner}, {message}",)
            raise

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode. `rng` is drawn from, once, only if a sensor has noise."""
        noisy = any(sensor.config.noise > 0 for sensor in self.sensors.values())
        seed = int(rng.integers(2**32)) if noisy else 0
        for name, sampler in self._samplers.items():
            if sampler.sensor.config.noise > 0:
                # Its own generator: another sensor beside it does not change its noise.
                sampler.reset(np.random.default_rng((seed, zlib.crc32(name.encode()))))
            else:
                sampler.reset(None)

    @property
    def watches(self) -> bool:
        """Whether `after_substep` must be called after every physics step; asked once, bound."""
        return bool(self._watching or self._clocked)

    def after_substep(self) -> None:
        """Look at the world after a physics step."""
        for sensor in self._watching:
            sensor.after_substep()
        for sampler in self._clocked:
            sampler.after_substep()

    def sense(self) -> None:
        """Bring all readings up to date: at reset, and at the end of each control step."""
        for sampler in self._samplers.values():
            sampler.sense()

    def reading(self, sensor: str, channel: str) -> npt.NDArray[Any]:
        """Return what was last sensed, in the shape of the channel.

        Raises:
            UnknownNameError: If there is no such sensor or channel.
            WorldError: If nothing was sensed yet.
        """
        check_name(f"sensor of {self._owner}", sensor, self.sensors)
        if sensor not in self._samplers:
            raise WorldError(f"sensor {sensor!r} of {self._owner} is not bound: spawn the agent")
        sampler = self._samplers[sensor]
        names = [c.name for c in sampler.channels]
        check_name(f"channel of {sensor!r}", channel, names)
        if not sampler.has_sensed:
            raise WorldError(f"sensor {sensor!r} of {self._owner} has sensed nothing yet")
        return sampler.readings[names.index(channel)]

    def observables(self) -> list[Observable]:
        """Return one observable a channel, called `<sensor>_<channel>`; once bound."""
        return [
            _observable(sampler, index, channel)
            for sampler in self._samplers.values()
            for index, channel in enumerate(sampler.channels)
        ]

    def close(self) -> None:
        """Free what the sensors hold; safe to call twice."""
        for sensor in self.sensors.values():
            sensor.close()


def _make(entry: Entry, where: str) -> Sensor:
    data = {"kind": entry} if isinstance(entry, str) else entry
    if not isinstance(data, Mapping):
        raise ConfigError(f"{where}: expected a kind or a mapping, got {entry!r}")
    if "kind" not in data:
        raise ConfigError(f"{where}: missing kind, one of {', '.join(sorted(SENSORS))}")
    kind = data["kind"]
    if not isinstance(kind, str) or kind not in SENSORS:
        raise UnknownNameError(f"kind of sensor ({where})", str(kind), SENSORS)
    options = {key: value for key, value in data.items() if key != "kind"}
    made = SENSORS[kind]
    return made(load(made.Config, {"name": kind, **options}, where))


def _observable(sampler: Sampler, index: int, channel: Channel) -> Observable:
    return Observable(
        name=f"{sampler.sensor.config.name}_{channel.name}",
        unit=channel.unit,
        size=int(np.prod(channel.shape)),
        read=lambda: sampler.readings[index].reshape(-1),
        shape=channel.shape if channel.is_array else None,
        dtype=channel.dtype,
        low=channel.low,
        high=channel.high,
    )
