"""Things of care: made from data, with named frames that tasks use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from .arm_cradle import HOOK_SHARE, HOOK_SHARE_HANGING, ArmCradle
from .ceiling_lift import CeilingLift
from .cup import Cup
from .cushion import Cushion, lay_under, move_under
from .device import Device
from .device_model import DeviceControl, DeviceModel, Frame, Touch, load_device
from .dressing_stand import DressingStand
from .dry_friction import DryFriction, grip
from .floor_lift import FloorLift
from .hospital_bed import HospitalBed
from .platform_lift import PlatformLift
from .powered_wheelchair import PoweredWheelchair
from .rolling_wheelchair import ManualWheelchair
from .sponge import Sponge, SpongeBlock
from .spoon import Spoon
from .stand import add_stand
from .transfer_bench import TransferBench
from .wash_basin import WashBasin
from .weight import volume, weigh, weighed
from .wheelchair import Wheelchair, chair_for, spawn_fitted

# Those that do more than `Device` does; all others are `Device` itself.
_CLASSES: Mapping[str, Callable[[], Device]] = {
    "hoyer_lift_sling": partial(FloorLift, "hoyer_lift_sling"),
    "hoyer_lift_transfer": partial(FloorLift, "hoyer_lift_transfer"),
    "ceiling_lift": CeilingLift,
    "manual_wheelchair": ManualWheelchair,
    "transfer_bench": TransferBench,
    "hospital_bed": HospitalBed,
    "platform_lift": PlatformLift,
    "arm_cradle": ArmCradle,
    "cup": Cup,
    "powered_wheelchair": PoweredWheelchair,
    "sponge": Sponge,
    "spoon": Spoon,
    "wash_basin": WashBasin,
    "wheelchair": Wheelchair,
}


def device_kinds() -> tuple[str, ...]:
    """Return the names of the eight kinds of assistive device of the RCareWorld paper."""
    return (*tuple(_CLASSES)[:7], "slide_board")


def make_device(source: str | Path) -> Device:
    """Return a new device of that name in `assets/devices`, or of a YAML file of your own.

    Raises:
        UnknownNameError: If there is no such device, or its file has a key or name that it should not.
        ConfigError: If the file cannot be read, or a value in it is missing or impossible.
    """
    return _CLASSES[str(source)]() if source in _CLASSES else Device(source)


__all__ = [
    "HOOK_SHARE",
    "HOOK_SHARE_HANGING",
    "ArmCradle",
    "CeilingLift",
    "Cup",
    "Cushion",
    "Device",
    "DeviceControl",
    "DeviceModel",
    "DressingStand",
    "DryFriction",
    "FloorLift",
    "Frame",
    "HospitalBed",
    "ManualWheelchair",
    "PlatformLift",
    "PoweredWheelchair",
    "Sponge",
    "SpongeBlock",
    "Spoon",
    "Touch",
    "TransferBench",
    "WashBasin",
    "Wheelchair",
    "add_stand",
    "chair_for",
    "spawn_fitted",
    "device_kinds",
    "grip",
    "lay_under",
    "load_device",
    "make_device",
    "move_under",
    "volume",
    "weigh",
    "weighed",
]
