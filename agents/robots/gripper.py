"""Grippers of one driven joint and joints that follow it, and what is bonded to a tool.

Bullet ignores `<mimic>`, so we drive all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.model.urdf import Joint, Model, joint_pose
from rcare_marl.pose import Pose
from rcare_marl.world import World

RELEASE = 0.01  # [m] that the gap of a gripper grows before it lets go; our own choice
LINKAGE_GAIN = 0.1  # share of a follower's position error that is removed in one physics step


@dataclass(frozen=True)
class GripperConfig:
    """The data of a gripper.

    Attributes:
        joint: The driven joint.
        opened: Its position when open [rad or m].
        closed: Its position when closed [rad or m].
        force: Greatest motor force of each joint [N·m or N].
        speed: Speed of the driven joint [rad/s or m/s].
        fingers: The two links that meet the object.
        pad: A point of the first finger's pad in that link's frame [m].
        other_pad: The same for the second finger.
        source: Where the figures are from.
        friction: Of the fingers against what they hold [1].
    """

    joint: str
    opened: float
    closed: float
    force: float
    speed: float
    fingers: tuple[str, str]
    pad: tuple[float, float, float]
    other_pad: tuple[float, float, float]
    source: str = ""
    friction: float = 1.0

    def __post_init__(self) -> None:
        if self.opened == self.closed or self.force <= 0 or self.speed <= 0:
            raise ConfigError("a gripper opens and closes at different positions, by force > 0")


class Gripper:
    """The fingers of a robot, in terms of their one driven joint.

    Attributes:
        config: The data.
        joints: How each joint follows the driven one, (multiplier, offset) by name, itself first.
        target: Where the driven joint is to be [rad or m].
    """

    def __init__(self, config: GripperConfig, model: Model, width: float | None = None) -> None:
        """Take the fingers of `model`, `width` [m] apart, or wide open if None.

        Raises:
            UnknownNameError: If the model lacks the joint or a finger.
        """
        check_name("joint", config.joint, model.joints)
        for link in config.fingers:
            check_name("link", link, model.links)
        self.config, self._model = config, model
        self.joints: dict[str, tuple[float, float]] = {config.joint: (1.0, 0.0)}
        for name, joint in model.joints.items():
            if joint.follows is not None and joint.follows.joint == config.joint:
                self.joints[name] = (joint.follows.multiplier, joint.follows.offset)
        chain = self._way_to_the_fingers()
        self._still = {model.root: Pose()}  # links that no finger's joint moves
        for name, joint in chain.items():
            if name not in self.joints and joint.parent in self._still:
                self._still[joint.child] = self._still[joint.parent] @ joint_pose(joint, 0.0)
        self._moved = {
            name: joint for name, joint in chain.items() if joint.child not in self._still
        }
        self._indices: list[int] = []
        self.start = config.opened if width is None else self.position_for(width)
        self.target = self.start

    @property
    def is_movable(self) -> bool:
        """Whether the fingers of the spawned robot can move."""
        return bool(self._indices)

    def positions(self, position: float) -> dict[str, float]:
        """Return the position of every joint when the driven one is at `position` [rad or m]."""
        return {name: m * position + offset for name, (m, offset) in self.joints.items()}

    def width(self, position: float) -> float:
        """Return the gap between the pads when the driven joint is at `position` [m]."""
        positions = self.positions(position)
        poses = dict(self._still)
        for name, joint in self._moved.items():
            poses[joint.child] = poses[joint.parent] @ joint_pose(joint, positions.get(name, 0.0))
        first, second = (
            np.asarray((poses[link] @ Pose(pad)).position)
            for link, pad in zip(
                self.config.fingers, (self.config.pad, self.config.other_pad), strict=True
            )
        )
        return float(np.linalg.norm(first - second))

    def _way_to_the_fingers(self) -> dict[str, Joint]:
        """Return the joints from the root to the fingers by name, the nearest to the root first."""
        before, joints = set(self.config.fingers), self._model.joints
        for joint in reversed(joints.values()):
            if joint.child in before:
                before.add(joint.parent)
        return {name: joint for name, joint in joints.items() if joint.child in before}

    def position_for(self, width: float) -> float:
        """Return where the driven joint leaves a gap of `width` [m], by bisection [rad or m].

        Raises:
            ConfigError: If the fingers do not open so far.
        """
        widest = self.width(self.config.opened)
        if not 0 <= width <= widest + 1e-9:
            raise ConfigError(
                f"the gripper opens from 0 to {widest:.3f} m, asked for a gap of {width} m"
            )
        wide, narrow = self.config.opened, self.config.closed
        if self.width(narrow) >= width:
            return narrow
        for _ in range(30):
            middle = 0.5 * (wide + narrow)
            if self.width(middle) > width:
                wide = middle
            else:
                narrow = middle
        return 0.5 * (wide + narrow)

    def least_closing(self, position: float, wider: float) -> float:
        """Return how far it is closed where the gap is `wider` [m] than at `position`, or wide open."""
        gap = min(self.width(position) + wider, self.width(self.config.opened))
        return self.fraction(self.position_for(gap))

    def bind(self, body: Body) -> None:
        """Take hold of the joints of a spawned body; frozen ones are not among them."""
        names = [name for name in self.joints if name in body.joints]
        self._body, self._indices = body, body.indices(names)
        self._rules = [self.joints[name] for name in names]
        self._lead, self._followers = self._indices[:1], self._indices[1:]
        self._follow = self._rules[1:]
        efforts = [body.joint(name).effort for name in names[1:]]
        self._linkage = [max(effort, 2 * self.config.force) for effort in efforts]
        if names:
            moved = {link for name in names for link in self._moved_by(name)}
            fingers = [body.links[link] for link in sorted(moved) if link in body.links]
            body.set_friction(fingers, lateral=self.config.friction)

    def _moved_by(self, name: str) -> set[str]:
        """Return the links that a joint moves, with all beyond them."""
        out = {self._model.joints[name].child}
        for joint in self._model.joints.values():  # parents come before children
            if joint.parent in out:
                out.add(joint.child)
        return out

    def drive(self, position: float, *, teleport: bool = False) -> None:
        """Drive the driven joint to `position` [rad or m]; its followers need `align`."""
        low, high = sorted((self.config.opened, self.config.closed))
        self.target = min(max(position, low), high)
        if not self._indices:
            return
        if teleport:
            targets = [m * self.target + offset for m, offset in self._rules]
            self._body.set_joints(self._indices, targets)
        self._body.drive_positions(
            self._indices[:1], [self.target], [self.config.force], position_gain=0.05
        )
        self.align()

    def align(self) -> None:
        """Drive the followers to where the driven joint really is, for a physics step.

        They act as the linkage that they are: where an object stops the driven joint they stop too,
        and they yield only to what would break it.
        """
        if len(self._indices) < 2:
            return
        (position,), (velocity,) = self._body.joint_states(self._lead)
        self._body.drive_positions(
            self._followers,
            [m * position + offset for m, offset in self._follow],
            self._linkage,
            position_gain=LINKAGE_GAIN,
            velocities=[m * velocity for m, _ in self._follow],
        )

    def advance(self, action: float, duration: float) -> None:
        """Close (action > 0) or open (< 0) for `duration` [s] at `action` times the full speed."""
        step = math.copysign(self.config.speed * duration, self.config.closed - self.config.opened)
        self.drive(self.target + action * step)

    def drive_fraction(self, closing: float) -> None:
        """Drive to `closing`: 0 is open, 1 is closed."""
        fraction = min(max(closing, 0.0), 1.0)
        self.drive(self.config.opened + fraction * (self.config.closed - self.config.opened))

    def position(self) -> float:
        """Return where the driven joint is [rad or m]."""
        return self._body.joint_states(self._lead)[0][0] if self._indices else self.target

    def closing(self) -> float:
        """Return how far it is closed: 0 is open, 1 is closed."""
        return self.fraction(self.position())

    def fraction(self, position: float) -> float:
        """Return how far it is closed with the driven joint at `position` [rad or m]."""
        return (position - self.config.opened) / (self.config.closed - self.config.opened)


class Grasp:
    """The bonds of one tool. Their state is in the world, and comes back with it."""

    def __init__(self, world: World, body: Body, tool_link: str, gripper: Gripper | None) -> None:
        self._world, self._body, self._tool_link = world, body, tool_link
        self._gripper = gripper
        self._held: list[Attachment] = []

    def take(self, thing: Body, pose: Pose, thing_in_tool: Pose, *, force: float) -> Attachment:
        """Put the base of `thing` at `pose` in the world and bond it to the tool.

        The robot and what it holds do not collide from then on.

        Args:
            thing: What to hold.
            pose: Where its base goes.
            thing_in_tool: The same place in the frame of the tool.
            force: Greatest force of the bond [N].
        """
        thing.set_base(pose)
        self._world.set_collision(self._body, thing, False)
        held = self._world.attach(self._body, self._tool_link, thing, thing_in_tool, force=force)
        gripper = self._gripper
        if gripper is not None and gripper.is_movable:
            self._least_closing = gripper.least_closing(gripper.start, RELEASE)
            self._held.append(held)
        return held

    def update(self) -> None:
        """Let go of everything if the gripper has opened too far to hold it."""
        if not self._held or self._gripper is None:
            return
        if self._gripper.closing() < self._least_closing:
            for held in self._held:
                self._world.detach(held)
