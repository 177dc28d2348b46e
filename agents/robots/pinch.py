"""A thing that a gripper takes by itself: a bond once both fingers press on it."""

from __future__ import annotations

from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.world import World

from .grasp import RELEASE
from .robot import Robot

LEAST_PRESS = 0.3  # [N] of each finger on the thing before it counts as taken; our own choice
HOLD_FORCE = 200.0  # [N] of the bond; our own choice


class Pinch:
    """Holds one thing while the fingers of a robot are closed on it.

    Nothing jumps into the hand: the thing is bonded as it lies between the fingers, when both press on
    it. It is let go of when the gap between them has grown by `grasp.RELEASE`.
    """

    def __init__(self, world: World, robot: Robot, thing: Body) -> None:
        """Watch the gripper of a robot's main arm.

        Raises:
            ConfigError: If the robot has no gripper that moves.
        """
        gripper = robot.gripper
        if gripper is None or not gripper.is_movable:
            raise ConfigError(
                f"{robot.name!r} has to take {thing.name!r} with its fingers, and they do not move: "
                "name the gripper among `moves`, such as ['arm', 'gripper']"
            )
        self._world, self._robot, self._thing, self._gripper = world, robot, thing, gripper
        body = robot.body
        self._fingers = [
            {index, *body.carried_by(index)}
            for index in (body.link_index(finger) for finger in gripper.config.fingers)
        ]
        self._bond: Attachment | None = None
        self._least_closing = 0.0

    @property
    def is_held(self) -> bool:
        """Whether the thing is held now."""
        return self._bond is not None and self._bond.is_active

    def reset(self) -> None:
        """Forget a bond of the last episode, which the world has broken."""
        if self._bond is not None:
            self._world.detach(self._bond)
        self._bond = None

    def update(self) -> None:
        """Take the thing, or let go of it, by what the fingers do; once a control step."""
        if self.is_held:
            if self._gripper.closing() < self._least_closing:
                assert self._bond is not None
                self._world.detach(self._bond)
                self._bond = None
        elif min(self.presses()) >= LEAST_PRESS:
            gripper, robot = self._gripper, self._robot
            self._bond = self._world.attach(
                robot.body, robot.tool_link, self._thing, force=HOLD_FORCE
            )
            widest = gripper.width(gripper.config.opened)
            gap = min(gripper.width(gripper.position()) + RELEASE, widest)
            self._least_closing = gripper.fraction(gripper.position_for(gap))

    def presses(self) -> list[float]:
        """Return the normal force of each finger on the thing [N], shape [2]."""
        out = [0.0, 0.0]
        for touch in self._world.contacts(self._robot.body, self._thing):
            for k, links in enumerate(self._fingers):
                if touch.link_a in links:
                    out[k] += touch.force
        return out
