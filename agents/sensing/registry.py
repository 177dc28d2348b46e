"""The kinds of sensors, as users write them."""

from __future__ import annotations

from .camera import CameraSensor
from .contact_force import ContactForce
from .imu import Imu
from .joint_load import JointTorque, JointWrench
from .marker_sensor import MarkerSensor
from .proximity import Proximity
from .sensor import Sensor
from .taxel_map import TaxelMap
from .wrist_wrench import WristWrench

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
