"""A device: one body made from data, with named frames."""

from __future__ import annotations

import abc
import math
from collections.abc import Mapping
from dataclasses import dataclass

from rcare_marl.body import Body
from rcare_marl.errors import UnknownNameError
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.urdf import Model, Triple, write
from rcare_marl.world import World


@dataclass(frozen=True)
class Frame:
    """A place on a device, in the device's frame.

    Attributes:
        position: Origin [m].
        rpy_deg: Turn, fixed-axis roll, pitch, yaw [degrees].
        note: What it is.
    """

    position: Triple
    rpy_deg: Triple = (0.0, 0.0, 0.0)
    note: str = ""

    @property
    def pose(self) -> Pose:
        """The pose of the frame in the device."""
        turn = quaternion_from_rpy(*(math.radians(angle) for angle in self.rpy_deg))
        return Pose(self.position, tuple(turn.tolist()))


class Device(abc.ABC):
    """A body made from data.

    Attributes:
        body: The body, once spawned.
    """

    body: Body
    _fixed = True

    @abc.abstractmethod
    def model(self) -> Model:
        """Return its links and shapes."""

    @property
    @abc.abstractmethod
    def frames(self) -> Mapping[str, Frame]:
        """Named places on it."""

    @property
    def pose(self) -> Pose:
        """The present pose of the device in the world."""
        return self.body.base_pose()

    def frame(self, name: str) -> Pose:
        """Return the pose of a named frame in the device; UnknownNameError if there is none."""
        if name not in self.frames:
            raise UnknownNameError("frame", name, self.frames)
        return self.frames[name].pose

    def frame_in_world(self, name: str) -> Pose:
        """Return the present pose of a named frame in the world."""
        return self.pose @ self.frame(name)

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        """Load it into `world` at `pose`, once, and return its body."""
        model = self.model()
        self.body = world.load_urdf(write(model), pose, name=name or model.name, fixed=self._fixed)
        return self.body
