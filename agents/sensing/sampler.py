"""When a sensor is read, how old its samples are when they are seen, and their noise."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.world import World

from .sensor import Channel, Sensor

Readings = tuple[npt.NDArray[Any], ...]
SLACK = 1e-6  # share of a period by which a sample may come early: times are sums of floats


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
