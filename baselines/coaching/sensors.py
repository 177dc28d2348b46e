"""The sensors that synthetic people can be watched with, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rcare_marl.errors import check_name

from .camera_sensor import CameraSensor
from .noise import HandsSensor, JointsSensor, NoiseModel, Sensor

SENSORS: Mapping[str, Callable[[NoiseModel], Sensor]] = {
    "hands": HandsSensor,
    "joints": JointsSensor,
    "camera": CameraSensor,
}


# [1/s] A NAO's camera gives thirty pictures of this size at best, over a network about half; our own choice.
RATES: Mapping[str, float] = {"camera": 15.0}


def usual_noise(source: str) -> NoiseModel:
    """Return the noise that a source is evaluated with; a camera's has 15 pictures a second."""
    return NoiseModel(rate=RATES.get(source, NoiseModel.rate))


def make_sensor(source: str, noise: NoiseModel) -> Sensor:
    """Return the sensors of a source of poses.

    Raises:
        UnknownNameError: If there is no such source.
    """
    check_name("source of poses", source, SENSORS)
    return SENSORS[source](noise)
