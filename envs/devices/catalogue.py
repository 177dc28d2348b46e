"""The eight kinds of assistive device, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rcare_marl.errors import UnknownNameError

from .ceiling_lift import CeilingLift
from .device import Device
from .floor_lift import FloorLift
from .hospital_bed import HospitalBed
from .platform_lift import PlatformLift
from .rolling_wheelchair import ManualWheelchair
from .slide_board import SlideBoard
from .transfer_bench import TransferBench

_KINDS: Mapping[str, Callable[[], Device]] = {
    "hoyer_lift_sling": lambda: FloorLift("hoyer_lift_sling"),
    "hoyer_lift_transfer": lambda: FloorLift("hoyer_lift_transfer"),
    "ceiling_lift": CeilingLift,
    "manual_wheelchair": ManualWheelchair,
    "transfer_bench": TransferBench,
    "slide_board": SlideBoard,
    "hospital_bed": HospitalBed,
    "platform_lift": PlatformLift,
}


def device_kinds() -> tuple[str, ...]:
    """Return the names of the eight kinds of assistive device."""
    return tuple(_KINDS)


def make_device(kind: str) -> Device:
    """Return a new device with the figures of its data file; UnknownNameError if there is no such kind."""
    if kind not in _KINDS:
        raise UnknownNameError("device", kind, _KINDS)
    return _KINDS[kind]()


__all__ = ["device_kinds", "make_device"]
