"""A device whose frames move with its links, and that can hold a person."""

from __future__ import annotations

from collections.abc import Mapping

import pybullet as bullet

from rcare_marl.agents.human import Human
from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.world import World

from .device import Device

HOLD = 5000.0  # [N], of the bond between a person and what carries them; own choice
# A person on a device of a few kilograms is hard to solve for: with the 30 iterations of `World` an
# occupied chair creeps by 2 mm/s and a bench sinks into its legs, with these by less than 0.1 mm/s.
FINE_ITERATIONS = 150


def refine(world: World) -> None:
    """Let the solver of a world work more finely, for a heavy load on something light."""
    bullet.setPhysicsEngineParameter(
        numSolverIterations=FINE_ITERATIONS, physicsClientId=world.client
    )


class JointedDevice(Device):
    """A device of several links; frames on moving links go with them."""

    _on: Mapping[str, str] = {}  # frame, link that carries it; those absent are on the base

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        # All joints stand at zero until `reset`, which the last line of `Device.spawn` calls.
        self._world, self._rest = world, dict[str, Pose]()
        return super().spawn(world, pose, name=name)

    def reset(self) -> None:
        if not self._rest:
            base = self.body.base_pose().inverse()
            self._rest = {
                link: base @ self.body.link_pose(self.body.link_index(link))
                for link in set(self._on.values())
            }
        super().reset()

    def frame_in_world(self, name: str) -> Pose:
        link = self._on.get(name)
        if link is None:
            return super().frame_in_world(name)
        there = self.body.link_pose(self.body.link_index(link))
        return there @ self._rest[link].inverse() @ self.frame(name)

    def carry(self, person: Human, frame: str = "") -> Attachment:
        """Bond a person to what bears them, as by a belt, and return the bond.

        The world's solver works more finely from then on.

        Args:
            person: Who rests on it already; spawned with `fixed_base=False`.
            frame: The frame that they rest on; that of the first of `postures` if empty.

        Raises:
            ConfigError: If the person's pelvis is held in place, or nobody rests in the device.
            UnknownNameError: If there is no such frame.
        """
        if not self.postures:
            raise ConfigError(f"nobody rests in {self.body.name!r}")
        if not person.body.is_movable:
            raise ConfigError(
                f"{self.body.name!r} can carry {person.name!r} only with fixed_base=False"
            )
        frame = frame or next(iter(self.postures.values()))[1]
        self.frame(frame)
        link = self._on.get(frame, "base")
        person.ignore(self.body)
        refine(self._world)
        return self._world.attach(self.body, link, person.body, force=HOLD)


__all__ = ["HOLD", "JointedDevice", "refine"]
