"""A platform lift for wheelchairs, with a folding ramp, guards and a bar before the landing."""

from __future__ import annotations

import dataclasses

import numpy as np

from rcare_marl.cache import cached
from rcare_marl.errors import ConfigError
from rcare_marl.model import mesh_file
from rcare_marl.model.shape import MeshFile, Shape

from .device import Device

_OVER = 1.1  # of the tower over the platform's highest place [m]; own choice
_TIP = 0.0015  # height of the edge of the ramp [m]
_MARGIN = 0.001  # [m], by which Bullet thickens hulls that it reads from a file


class PlatformLift(Device):
    """A lift: x from its ramp to the landing, y left, origin on the ground under the platform.

    Frames: `platform` (middle of its top), `entry` (ground before the ramp), `landing` (edge of the
    platform at the landing), `button` (on the tower). Controls: `height` [m over the lowest], `ramp`
    (0 down, folded up at the upper limit), `bar` (0 closed, up at the upper limit) [rad].
    """

    def __init__(self, *, rise: float | None = None) -> None:
        """Make a lift.

        Args:
            rise: How far it lifts [m]; as far as it can if None.

        Raises:
            ConfigError: If it cannot lift so far.
        """
        super().__init__("platform_lift")
        model = self.model
        highest = model.joints["height"].upper
        self.rise = highest if rise is None else rise
        if not 0 < self.rise <= highest:
            raise ConfigError(f"this lift rises by 0 to {highest} m, not {rise} m")
        height = dataclasses.replace(model.joints["height"], upper=self.rise)
        model = dataclasses.replace(model, joints=model.joints | {"height": height})
        tower = model.links["tower"]
        seen, solid = (self._tall(shapes[0]) for shapes in (tower.visual, tower.collision))
        model = model.with_shapes("tower", (seen, *tower.visual[1:]), (solid,))
        self.model = model.with_shapes("ramp", hulls=[self._wedge()])

    def _tall(self, column: Shape) -> Shape:
        """Return the column of the tower, as high as the platform rises."""
        tall = self.rise + _OVER
        return dataclasses.replace(
            column, at=(*column.at[:2], 0.5 * tall), size=(*column.size[:2], tall)
        )

    def _wedge(self) -> MeshFile:
        """Return what the ramp collides with: sharp where it meets the ground, so as not to press on it."""
        thick, ramp, width = map(self.model.figure, ("thickness", "ramp", "width"))
        reach, side = float(np.sqrt(ramp**2 - thick**2)), 0.5 * width - 0.01
        edges = ((-reach, _TIP - thick), (0.0, -_MARGIN), (0.0, -0.03))
        corners = [(x, y, z) for x, z in edges for y in (-side, side)]
        return MeshFile(str(cached("ramp", ".obj", mesh_file.hull_obj(np.array(corners)))))
