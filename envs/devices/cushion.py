"""A positioning cushion: a firm block of foam that bears a limb."""

from __future__ import annotations

from collections.abc import Mapping

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.urdf import Link, Model, Shape, Triple
from rcare_marl.world import World

from .device import Device, Frame

# Our own choices. A forearm of 1.5 kg sinks in by less than a centimetre.
STIFFNESS, DAMPING = 3000.0, 60.0  # [N/m], [N·s/m] of a point of contact
FRICTION = 0.7
LEAST = 0.01  # [m] thick
RGBA = (0.93, 0.94, 0.92, 1.0)


class Cushion(Device):
    """A block with round edges, x along it, z up, origin in the middle of its underside.

    It stays where it is laid. It is cut to measure: such cushions come in wedges and layers.

    Frames: `top` (middle of the upper side).
    """

    def __init__(self, size: Triple) -> None:
        """Cut a cushion.

        Args:
            size: Edges along x, y, z [m].

        Raises:
            ConfigError: If an edge is shorter than `LEAST`.
        """
        if min(size) < LEAST:
            raise ConfigError(f"a cushion is {LEAST} m or more each way, got {size}")
        self.size = size

    @property
    def frames(self) -> Mapping[str, Frame]:
        return {"top": Frame((0.0, 0.0, self.size[2]), note="middle of the upper side")}

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        body.set_softness(stiffness=STIFFNESS, damping=DAMPING)
        body.set_friction([-1], lateral=FRICTION)
        return body

    def model(self) -> Model:
        at = (0.0, 0.0, 0.5 * self.size[2])
        bevel = min(0.02, 0.45 * min(self.size))
        link = Link(
            mass=0.5,
            com=at,
            inertia=(1e-3, 0.0, 0.0, 1e-3, 0.0, 1e-3),
            visual=(Shape(kind="box", material="linen", at=at, size=self.size, bevel=bevel),),
            collision=(Shape(kind="box", at=at, size=self.size),),
        )
        return Model(
            name="cushion", source="own choice", links={"cushion": link}, materials={"linen": RGBA}
        )


__all__ = ["Cushion"]
