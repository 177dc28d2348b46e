"""Things of care: made from data, with named frames that tasks use."""

from .arm_cradle import ArmCradle, ArmCradleConfig
from .catalogue import device_kinds, make_device
from .ceiling_lift import CeilingLift, CeilingLiftConfig
from .cup import Cup, CupConfig
from .cushion import Cushion
from .device import Device, DeviceControl, Frame
from .dressing_stand import DressingStand
from .floor_lift import FloorLift, FloorLiftConfig
from .hospital_bed import HospitalBed, HospitalBedConfig
from .overbed_table import OverbedTable
from .platform_lift import PlatformLift, PlatformLiftConfig
from .powered_wheelchair import PoweredWheelchair, PoweredWheelchairConfig
from .rolling_wheelchair import ManualWheelchair, ManualWheelchairConfig
from .slide_board import SlideBoard, SlideBoardConfig
from .sponge import Sponge, SpongeConfig
from .spoon import Spoon, SpoonConfig
from .transfer_bench import TransferBench, TransferBenchConfig
from .wash_basin import WashBasin
from .wheelchair import Wheelchair, WheelchairConfig

__all__ = [
    "ArmCradle",
    "ArmCradleConfig",
    "DressingStand",
    "OverbedTable",
    "WashBasin",
    "CeilingLift",
    "CeilingLiftConfig",
    "Cup",
    "CupConfig",
    "Cushion",
    "Device",
    "DeviceControl",
    "FloorLift",
    "FloorLiftConfig",
    "Frame",
    "HospitalBed",
    "HospitalBedConfig",
    "ManualWheelchair",
    "ManualWheelchairConfig",
    "PlatformLift",
    "PlatformLiftConfig",
    "PoweredWheelchair",
    "PoweredWheelchairConfig",
    "SlideBoard",
    "SlideBoardConfig",
    "Sponge",
    "SpongeConfig",
    "Spoon",
    "SpoonConfig",
    "TransferBench",
    "TransferBenchConfig",
    "Wheelchair",
    "WheelchairConfig",
    "device_kinds",
    "make_device",
]
