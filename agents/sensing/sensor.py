"""What every sensor has in common."""

from __future__ import annotations

import abc
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.world import World

if TYPE_CHECKING:
    from ..agent import Agent

# Of noise, in the unit of a channel, our own choice: above any reading, far below what float32 holds.
LOUDEST = 1e6


@dataclass(frozen=True)
class SensorConfig:
    """The options of a sensor, off by default: a perfect sensor.

    Attributes:
        name: Prefix of its observables, unique in an agent, not empty.
        rate: Samples a second [Hz]; between two the last one is observed. Zero samples whenever
            the agent observes.
        latency: Age of a sample when it is first observed [s].
        noise: Standard deviation of Gaussian noise on each value, in the unit of the channel, up to
            a million.
    """

    name: str
    rate: float = 0.0
    latency: float = 0.0
    noise: float = 0.0

    def __post_init__(self) -> None:
        if not self.name:
            raise ConfigError("a sensor needs a name, got ''")
        for option in ("rate", "latency", "noise"):
            value = getattr(self, option)
            if not 0 <= value < math.inf:
                raise ConfigError(f"sensor {self.name!r}: {option} must be 0 or more, got {value}")
        if self.noise > LOUDEST:
            raise ConfigError(
                f"sensor {self.name!r}: noise must be {LOUDEST:g} or less, got {self.noise:g}"
            )

    def check_once(self, option: str, names: Sequence[str]) -> None:
        """Raise ConfigError if an option names something twice."""
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConfigError(f"sensor {self.name!r}: {option} names {', '.join(twice)} twice")


@dataclass(frozen=True)
class Channel:
    """One kind of reading of a sensor.

    Attributes:
        name: What it is, such as `force`; the observable is called `<sensor>_<channel>`.
        unit: SI unit of a value.
        shape: Shape of a reading.
        is_array: Whether it stays an array of its own in the observation, as pictures do, or joins
            the flat vector.
        dtype: Kind of number.
        low: Least value.
        high: Greatest value.
        is_noisy: Whether `noise` applies (it does not to labels).
    """

    name: str
    unit: str
    shape: tuple[int, ...]
    is_array: bool = False
    dtype: Literal["float32", "uint8", "int32"] = "float32"
    low: float = -math.inf
    high: float = math.inf
    is_noisy: bool = True


class Sensor(abc.ABC):
    """Measures the world around, on or in an agent. It reads the physics and never changes it.

    Attributes:
        Config: Class of its options.
        config: Its options.
        watches: Whether `after_substep` must be called after every physics step.
    """

    Config: ClassVar[type[SensorConfig]] = SensorConfig
    config: SensorConfig
    watches: bool = False

    def __init__(self, config: SensorConfig) -> None:
        self.config = config

    def links(self, agent: Agent) -> Sequence[str]:
        """Return the links of `agent` that must stay links of their own; asked before `spawn`."""
        return ()

    @abc.abstractmethod
    def bind(self, world: World, agent: Agent) -> None:
        """Take hold of the spawned agent, once; raises UnknownNameError for what it lacks."""

    @abc.abstractmethod
    def channels(self) -> Sequence[Channel]:
        """Return what it measures, once bound."""

    @abc.abstractmethod
    def measure(self) -> Sequence[npt.NDArray[Any]]:
        """Return the true present readings, one a channel."""

    def disturb(
        self, readings: Sequence[npt.NDArray[Any]], rng: np.random.Generator
    ) -> Sequence[npt.NDArray[Any]]:
        """Return readings that `measure` has just given, with noise; the suite calls it then."""
        if not self.config.noise:
            return readings
        return [
            reading + rng.normal(0.0, self.config.noise, reading.shape)
            if channel.is_noisy
            else reading
            for channel, reading in zip(self.channels(), readings, strict=True)
        ]

    def reset(self) -> None:
        """Clear any memory of the last episode."""

    def after_substep(self) -> None:
        """Look at the world after a physics step, for what is integrated or differentiated."""

    def close(self) -> None:
        """Free what the sensor holds; safe to call twice."""
