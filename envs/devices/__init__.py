"""Things of care: made from data, with named frames that tasks use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from .arm_cradle import HOOK_SHARE as HOOK_SHARE
from .arm_cradle import HOOK_SHARE_HANGING as HOOK_SHARE_HANGING
from .arm_cradle import ArmCradle as ArmCradle
from .cup import Cup as Cup
from .cup import Spoon as Spoon
from .cushion import Cushion as Cushion
from .cushion import lay_under as lay_under
from .cushion import move_under as move_under
from .device import Device as Device
from .device import DryFriction as DryFriction
from .device import grip as grip
from .device_model import DeviceControl as DeviceControl
from .device_model import DeviceModel as DeviceModel
from .device_model import Frame as Frame
from .device_model import Touch as Touch
from .device_model import load_device as load_device
from .device_model import volume as volume
from .device_model import weigh as weigh
from .device_model import weighed as weighed
from .dressing_stand import DressingStand as DressingStand
from .hospital_bed import HospitalBed as HospitalBed
from .lift import CeilingLift as CeilingLift
from .lift import FloorLift as FloorLift
from .platform_lift import PlatformLift as PlatformLift
from .rolling_wheelchair import ManualWheelchair as ManualWheelchair
from .rolling_wheelchair import PoweredWheelchair as PoweredWheelchair
from .sponge import Sponge as Sponge
from .sponge import SpongeBlock as SpongeBlock
from .stand import add_stand as add_stand
from .stand import needs_stand as needs_stand
from .transfer_bench import TransferBench as TransferBench
from .ventilator import Ventilator as Ventilator
from .ventilator import hang_ventilator as hang_ventilator
from .wash_basin import WashBasin as WashBasin
from .wheelchair import Wheelchair as Wheelchair
from .wheelchair import chair_for as chair_for
from .wheelchair import spawn_fitted as spawn_fitted

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
    "ventilator": Ventilator,
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
