"""Control of a gripper by the speed of its closing."""

from __future__ import annotations

import numpy as np

from rcare_marl.pose import Array

from ..gripper import Gripper
from .control import Control


class GripperClosing(Control):
    """One value closes the gripper (1) or opens it (-1), at its greatest speed.

    Attributes:
        gripper: The gripper.
    """

    size = 1

    def __init__(self, gripper: Gripper, name: str) -> None:
        self.gripper = gripper
        self.names = (f"{name} closing [1]",)
        self.max = np.array([1.0])

    def reset(self) -> None:
        self.gripper.drive(self.gripper.target)

    def command(self, action: Array, duration: float) -> None:
        self.gripper.advance(float(action[0]), duration)
