"""All sensors of one agent: made from what a user writes, sampled on the clock, disturbed, observed."""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from rcare_marl.config import load
from rcare_marl.errors import ConfigError, RcareError, WorldError, check_name
from rcare_marl.observable import Observable
from rcare_marl.world import World

from .camera import CameraSensor
from .contact_force import ContactForce
from .imu import Imu
from .joint_load import JointTorque, JointWrench, WristWrench
from .marker_sensor import MarkerSensor
from .proximity import Proximity
from .sensor import Channel, Sensor
from .taxel_map import TaxelMap

if TYPE_CHECKING:
    from ..agent import Agent

Entry = str | Mapping[str, Any]
Readings = tuple[npt.NDArray[Any], ...]
SLACK = 1e-6  # share of a period by which a sample may come early: times are sums of floats

SENSORS: dict[str, type[Sensor]] = {
    "camera": CameraSensor,
    "contact_force": ContactForce,
    "imu": Imu,
    "joint_torque": JointTorque,
    "joint_wrench": JointWrench,
    "markers": MarkerSensor,
    "proximity": Proximity,
    "taxels": TaxelMap,
    "wrist_wrench": WristWrench,
}


class Sampler:
    """Takes the samples of one bound sensor and keeps those that are not yet old enough to be seen.

    The clock starts with the first `sense` of an episode, which takes sample 0. A sample that is due
    between two physics steps is taken after the later one.

    Attributes:
        sensor: The sensor.
        channels: What it measures.
        is_clocked: Whether it must be called after every physics step.
    """

    def __init__(self, sensor: Sensor, world: World) -> None:
        """Take a bound sensor.

        Raises:
            ConfigError: If it shall sample faster than the physics steps, or pictures with latency
                at no rate.
        """
        self.sensor, self._world = sensor, world
        self.channels: Sequence[Channel] = tuple(sensor.channels())
        config = sensor.config
        self._rate, self._latency = config.rate, config.latency
        self.is_clocked = config.rate > 0 or config.latency > 0
        fastest = 1 / world.physics_dt
        if config.rate > fastest * (1 + SLACK):
            raise ConfigError(
                f"sensor {config.name!r}: rate {config.rate} Hz is above that of the physics, "
                f"{fastest:g} Hz"
            )
        if config.latency > 0 and config.rate == 0:
            if any(channel.is_array for channel in self.channels):
                raise ConfigError(
                    f"sensor {config.name!r}: pictures with a latency need a rate too; without one "
                    "a picture would be drawn at every physics step"
                )
            self._rate = fastest
        self._rng: np.random.Generator | None = None
        self._samples: deque[tuple[float, Readings]] = deque()
        self._start, self._taken = 0, 0

    @property
    def has_sensed(self) -> bool:
        """Whether there is anything to see."""
        return bool(self._samples)

    @property
    def readings(self) -> Readings:
        """What is seen at present, one array a channel; only after a `sense`."""
        return self._samples[0][1]

    def reset(self, rng: np.random.Generator | None) -> None:
        """Begin an episode; `rng` makes the noise, if there is any."""
        self._rng = rng
        self._samples.clear()
        self.sensor.reset()

    def after_substep(self) -> None:
        """Take a sample after a physics step if one is due."""
        if self._samples:  # the clock is running
            self._tick()

    def sense(self) -> None:
        """Bring `readings` up to date."""
        if not self._samples:
            self._start, self._taken = self._world.step_count, 1
            self._samples.append((0.0, self._sample()))
        elif not self.is_clocked:
            self._samples[0] = (0.0, self._sample())

    def _tick(self) -> None:
        now = (self._world.step_count - self._start) * self._world.physics_dt
        due = int(now * self._rate + SLACK) + 1
        if due > self._taken:
            self._taken = due
            self._samples.append((now, self._sample()))
        early = self._world.physics_dt * SLACK
        while len(self._samples) > 1 and self._samples[1][0] + self._latency <= now + early:
            self._samples.popleft()

    def _sample(self) -> Readings:
        """Return true readings with noise, rounded and clipped to what the channels can say."""
        truth = self.sensor.measure()
        if self._rng is not None:
            truth = self.sensor.disturb(truth, self._rng)
        return tuple(
            self._degraded(np.asarray(value), channel)
            for value, channel in zip(truth, self.channels, strict=True)
        )

    def _degraded(self, value: npt.NDArray[Any], channel: Channel) -> npt.NDArray[Any]:
        value = value.reshape(channel.shape)
        if self._rng is None and value.dtype == np.dtype(channel.dtype):
            return value.copy()  # a sensor may use its arrays again
        low, high = channel.low, channel.high
        if channel.dtype != "float32":
            limits = np.iinfo(channel.dtype)
            value = np.rint(value) if np.issubdtype(value.dtype, np.floating) else value
            low, high = max(low, float(limits.min)), min(high, float(limits.max))
        return np.clip(value, low, high).astype(channel.dtype)


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
    check_name(f"kind of sensor ({where})", kind, SENSORS)
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
