"""A tube in a tube between two links, such as the actuator of a lift, for the eye."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rcare_marl.model.shape import Triple

from .device import Device


class Telescope:
    """A cylinder and its rod, between two frames of a device: implements `rcare_marl.world.Lines`.

    It lengthens and turns with them; the joint that it works does the pushing.

    Attributes:
        starts: First point of each line, and the end of the last, shape [3].
        radii: Radius at each point [m], shape [4].
    """

    def __init__(
        self,
        device: Device,
        low: str,
        high: str,
        *,
        length: float,
        radii: tuple[float, float] = (0.026, 0.013),
        colors: tuple[Triple, Triple] = ((0.2, 0.21, 0.23), (0.72, 0.73, 0.75)),
    ) -> None:
        """Prepare it.

        Args:
            device: What it is part of.
            low: Frame where the cylinder begins.
            high: Frame where the rod ends.
            length: Of the cylinder [m].
            radii: Of cylinder and rod [m].
            colors: Of cylinder and rod, red, green, blue, each in [0, 1].
        """
        self._device, self._ends, self._length = device, (low, high), length
        self.starts = np.array((0, 2, 4), np.int64)
        self.radii = np.repeat(np.array(radii, np.float32), 2)
        self._colors = np.repeat(np.round(255 * np.array(colors)).astype(np.uint8), 2, axis=0)

    def points(self) -> npt.NDArray[np.float32]:
        """Return where it is in the world [m], shape [4, 3]."""
        low, high = (np.array(self._device.frame_in_world(end).position) for end in self._ends)
        top = low + (high - low) * min(1.0, self._length / float(np.linalg.norm(high - low)))
        return np.array((low, top, low, high), np.float32)

    def colors(self) -> npt.NDArray[np.uint8]:
        """Return the colour of each point, shape [4, 3]."""
        return self._colors
