"""The sensors that synthetic people can be watched with, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rcare_marl.errors import UnknownNameError

from .camera_sensor import CameraSensor
from .noise import HandsSensor, JointsSensor, NoiseModel, Sensor

SENSORS: Mapping[str, Callable[[NoiseModel], Sensor]] = {
    "hands": HandsSensor,
    "joints": JointsSensor,
    "camera": CameraSensor,
}


def make_sensor(source: str, noise: NoiseModel) -> Sensor:
    """Return the sensors of a source of poses.

    Raises:
        UnknownNameError: If there is no such source.
    """
    if source not in SENSORS:
        raise UnknownNameError("source of poses", source, SENSORS)
    return SENSORS[source](noise)
