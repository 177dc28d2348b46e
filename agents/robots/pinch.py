"""What a gripper takes by itself: a thing that both fingers press on, or cloth between them."""

from __future__ import annotations

from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.soft.cloth import Cloth, Grip
from rcare_marl.world import World

from .gripper import RELEASE, Gripper
from .robot import Robot

LEAST_PRESS = 0.3  # [N] of each finger on the thing before it counts as taken; our own choice
HOLD_FORCE = 200.0  # [N] of the bond; our own choice
RADIUS = 0.05  # [m] about the tool, within which cloth is caught: PhyRC's dressing scene
CLOSED, OPENED = 0.8, 0.6  # of the way of the fingers: they hold from the one, let go at the other
LEAST = 2  # particles that count as held; our own choice


def _moving_gripper(robot: Robot, thing: str) -> Gripper:
    """Return the gripper of a robot's main arm; ConfigError if it has none that moves."""
    gripper = robot.gripper
    if gripper is None or not gripper.is_movable:
        raise ConfigError(
            f"{robot.name!r} has to take {thing!r} with its fingers, and they do not move: name the "
            "gripper among `moves`, such as ['arm', 'gripper']"
        )
    return gripper


class Pinch:
    """Holds one thing while the fingers of a robot are closed on it.

    Nothing jumps into the hand: the thing is bonded as it lies between the fingers, when both press on
    it. It is let go of when the gap between them has grown by `gripper.RELEASE`.
    """

    def __init__(self, world: World, robot: Robot, thing: Body) -> None:
        """Watch the gripper of a robot's main arm.

        Raises:
            ConfigError: If the robot has no gripper that moves.
        """
        self._gripper = gripper = _moving_gripper(robot, thing.name)
        self._world, self._robot, self._thing = world, robot, thing
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
            robot = self._robot
            self._bond = self._world.attach(
                robot.body, robot.tool_link, self._thing, force=HOLD_FORCE
            )
            self._least_closing = self._gripper.least_closing(self._gripper.position(), RELEASE)

    def presses(self) -> list[float]:
        """Return the normal force of each finger on the thing [N], shape [2]."""
        out = [0.0, 0.0]
        for touch in self._world.contacts(self._robot.body, self._thing):
            for k, links in enumerate(self._fingers):
                if touch.link_a in links:
                    out[k] += touch.force
        return out


class ClothPinch:
    """Holds what cloth is between the fingers of a robot when they close, until they open."""

    def __init__(self, robot: Robot, cloth: Cloth) -> None:
        """Watch the gripper of a robot's main arm; ConfigError if it has none that moves."""
        self._robot, self._cloth = robot, cloth
        self._gripper = _moving_gripper(robot, cloth.name)
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
