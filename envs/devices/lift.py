"""What floor lifts and ceiling lifts share: a bar with a sling, and a person who hangs in it."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING

from rcare_marl.body import Body
from rcare_marl.pose import Pose
from rcare_marl.world import World

from .device import Device
from .slack_stop import SlackStop
from .spreader_bar import SpreaderBar

if TYPE_CHECKING:
    from rcare_marl.agents.human import Human


class Lift(Device, abc.ABC):
    """A device that raises people in a sling.

    Attributes:
        bar: The spreader bar.
        postures: How people rest in it.
    """

    _raises: str  # the control that lowers the bar where it moves backwards

    def __init__(self, bar: SpreaderBar) -> None:
        """Hang up a bar."""
        self.bar = bar
        self.postures = {"slung": (bar.sling.config.posture, "sling")}

    @property
    @abc.abstractmethod
    def safe_load(self) -> float:
        """Greatest weight of a person [kg]."""

    def frame_in_world(self, name: str) -> Pose:
        self.frame(name)
        self._need_body()
        if name in self.bar.frames:
            return self.bar.frame_in_world(name)
        return super().frame_in_world(name)

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        self.bar.join(world, body)
        world.matter.append(SlackStop(world, self, self._raises, self.bar))
        self.bar.settle()
        return body

    def reset(self) -> None:
        """Hold every control, and let go of who is gone after a rewind."""
        super().reset()
        if self.bar.is_joined:
            self.bar.settle()

    def carry(self, person: Human) -> None:
        """Put the sling round a person and hang it on the bar, as the person is now.

        The person is best in one of `postures`, at the frame named there. Lowered, the lift stops
        where a seat or bed bears the person: then `release` them.

        Raises:
            WorldError: If somebody hangs there already, or the lift is in no world.
            ConfigError: If the pelvis is held in place, or the person is too heavy.
        """
        self._need_body()
        self.bar.carry(person, limit=self.safe_load)

    def release(self) -> None:
        """Take the loops off the hooks; nothing happens if nobody hangs there."""
        self._need_body()
        self.bar.release()


__all__ = ["Lift"]
