"""Things of care: made from data, with named frames that tasks use."""

from .device import Device, Frame
from .spoon import Spoon, SpoonConfig
from .wheelchair import Wheelchair, WheelchairConfig

__all__ = ["Device", "Frame", "Spoon", "SpoonConfig", "Wheelchair", "WheelchairConfig"]
