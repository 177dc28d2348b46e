"""Cloth that a gripper takes by itself: held while the fingers are closed on it."""

from __future__ import annotations

from rcare_marl.errors import ConfigError
from rcare_marl.soft.cloth import Cloth
from rcare_marl.soft.grip import Grip

from .robot import Robot

RADIUS = 0.05  # [m] about the tool, within which cloth is caught: PhyRC's dressing scene
CLOSED, OPENED = 0.8, 0.6  # of the way of the fingers: they hold from the one, let go at the other
LEAST = 2  # particles that count as held; our own choice


class ClothPinch:
    """Holds what cloth is between the fingers of a robot when they close, until they open."""

    def __init__(self, robot: Robot, cloth: Cloth) -> None:
        """Watch the gripper of a robot's main arm; ConfigError if it has none that moves."""
        gripper = robot.gripper
        if gripper is None or not gripper.is_movable:
            raise ConfigError(
                f"{robot.name!r} has to take {cloth.name!r} with its fingers, and they do not move: "
                "name the gripper among `moves`, such as ['arm', 'gripper']"
            )
        self._robot, self._cloth, self._gripper = robot, cloth, gripper
        self._grip: Grip | None = None
        self._was_closed = True

    @property
    def is_held(self) -> bool:
        """Whether enough cloth is held now."""
        return self._grip is not None and len(self._grip.particles) >= LEAST

    @property
    def pull(self) -> float:
        """Force of the cloth on the fingers in the last physics step [N]."""
        return self._grip.load if self._grip is not None else 0.0

    def reset(self) -> None:
        """Forget what was held in the last episode."""
        self._let_go()
        self._was_closed = True

    def update(self) -> None:
        """Take cloth when the fingers close, let go when they open; once a control step."""
        closing = self._gripper.closing()
        if closing < OPENED:
            self._let_go()
        elif closing >= CLOSED and not self._was_closed:
            robot = self._robot
            self._grip = self._cloth.grasp(
                robot.body, robot.tool_link, RADIUS, point=robot.tool_pose().position
            )
        self._was_closed = closing >= OPENED if self._was_closed else closing >= CLOSED

    def _let_go(self) -> None:
        if self._grip is not None:
            self._cloth.release(self._grip)
        self._grip = None
