"""A device whose frames move with its links, and that can hold a person."""

from __future__ import annotations

from collections.abc import Mapping

from rcare_marl.agents.human import Human
from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, WorldError
from rcare_marl.pose import Pose
from rcare_marl.world import World

from .device import Device

HOLD = 5000.0  # [N], of the bond between a person and what carries them; own choice


class JointedDevice(Device):
    """A device of several links; frames on moving links go with them.

    Attributes:
        least_iterations: Of the world's solver, for a person whom it carries.
    """

    least_iterations = 1
    _bond: Attachment | None = None

    _on: Mapping[str, str] = {}  # frame, link that carries it; those absent are on the base

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        # All joints stand at zero until `reset`, which the last line of `Device.spawn` calls.
        self._world, self._to_base = world, dict[str, Pose]()
        return super().spawn(world, pose, name=name)

    def reset(self) -> None:
        if not self._to_base:
            base = self.body.base_pose().inverse()
            self._to_base = {
                link: (base @ self.body.link_pose(self.body.link_index(link))).inverse()
                for link in set(self._on.values())
            }
        super().reset()

    def frame_in_world(self, name: str) -> Pose:
        link = self._on.get(name)
        if link is None:
            return super().frame_in_world(name)
        there = self.body.link_pose(self.body.link_index(link))
        return there @ self._to_base[link] @ self.frame(name)

    def carry(self, person: Human, frame: str = "") -> Attachment:
        """Bond a person to what bears them, as by a belt, and return the bond.

        They pass through the device from then on.

        Args:
            person: Who rests on it already; spawned with `fixed_base=False`.
            frame: The frame that they rest on; that of the first of `postures` if empty.

        Raises:
            ConfigError: If the person's pelvis is held in place, or nobody rests in the device.
            UnknownNameError: If there is no such frame.
            WorldError: If somebody is carried already, the device is in no world, or the solver of
                the world works with fewer than `least_iterations`.
        """
        self._need_body()
        if not self.postures:
            raise ConfigError(f"nobody rests in {self.body.name!r}")
        if not person.body.is_movable:
            raise ConfigError(
                f"{self.body.name!r} can carry {person.name!r} only with fixed_base=False"
            )
        frame = frame or next(iter(self.postures.values()))[1]
        self.frame(frame)
        link = self._on.get(frame, "base")
        if self._bond is not None and self._bond.is_active:
            raise WorldError(f"{self._bond.child.name!r} rests there already: release them first")
        if self._world.solver_iterations < self.least_iterations:
            raise WorldError(
                f"{self.body.name!r} with a person needs {self.least_iterations} iterations of the"
                f" solver, got {self._world.solver_iterations}: call"
                f" world.set_solver_iterations({self.least_iterations})"
            )
        person.ignore(self.body)
        self._bond = self._world.attach(self.body, link, person.body, force=HOLD)
        return self._bond

    def release(self) -> None:
        """Let go of who is carried; nothing happens if nobody is. They still pass through it."""
        self._need_body()
        if self._bond is not None:
            self._world.detach(self._bond)
        self._bond = None


__all__ = ["HOLD", "JointedDevice"]
