"""Head and hands that a headset tracks: what they say, and the actions that they mean.

A hand drives a robot's tool while it holds the clutch: from where both were when it closed, the tool goes
the way of the hand. Or hands and head are those of a person in the scene, who follows them within the active
range; where they cannot, the hand of the person stays behind the one that is tracked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcare_marl.agents.agent import Agent, Array
from rcare_marl.agents.people.body.goal import Goal, Orientation, Position
from rcare_marl.agents.people.body.ik import WholeBodyIk, arm_dofs, grip_point, present_angles
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS, SIDES
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.motion.caregiving import STRIVING, Striving
from rcare_marl.agents.people.motion.skill import NEAR_LADEN
from rcare_marl.agents.robots.control import GripperClosing, moving_tool
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose, conjugate, multiply, rotate, rotation_vector

from ..pages.strict import MessageError, Reader, field_of, flag, number, numbers, or_null, whole

FAR = 50.0  # [m] from the middle of the scene at most
UNIT = 0.02  # by which the length of a quaternion may be off
GAIN = 5.0  # of the tool towards the hand [1/s]; our own choice
# A radian of wrist or head against a metre of the hand, where both cannot be; our own choices.
WRIST_WEIGHT, HEAD_WEIGHT = 0.05, 0.1
BEHIND = 0.03  # [m] from which a hand is said to stay behind; our own choice
AT_END = math.radians(1.0)  # of a range that counts as its end
OPEN = 0.35  # of the jaw at a full grasp, for who has no hand to grasp with [rad]
FROM_VIEWER = (0.0, 1.0, 0.0, 0.0)  # a head looks along its z, a viewer against its own


def place(value: Any, name: str) -> Pose:
    """Read a pose in the scene: x, y, z [m] and a unit quaternion x, y, z, w."""
    if not isinstance(value, list) or len(value) != 7:
        raise MessageError(f"{name} is a list of 7 numbers")
    position, turn = numbers(value[:3], name, 3, FAR), numbers(value[3:], name, 4, 1 + UNIT)
    length = math.sqrt(sum(x * x for x in turn))
    if abs(length - 1) > UNIT:
        raise MessageError(f"the last four numbers of {name} are a unit quaternion")
    x, y, z, w = (each / length for each in turn)
    return Pose((position[0], position[1], position[2]), (x, y, z, w))


@dataclass(frozen=True)
class TrackedHand:
    """A hand.

    Attributes:
        place: Of the palm, in the scene.
        clutch: Whether it holds the dead-man's switch.
        grasp: How far it is closed, 0 to 1.
    """

    place: Pose
    clutch: bool
    grasp: float


def _hand(value: Any, name: str) -> TrackedHand:
    if not isinstance(value, dict) or value.keys() != {"place", "clutch", "grasp"}:
        raise MessageError(f"{name} has place, clutch and grasp")
    return TrackedHand(
        place(value["place"], name),
        flag(value["clutch"], f"the clutch of {name}"),
        number(0.0, 1.0)(value["grasp"], f"the grasp of {name}"),
    )


def _shares(count: int) -> Reader:
    return lambda value, name: tuple(numbers(value, name, count, 1.0))


@dataclass(frozen=True)
class Tracked:
    """What a headset tracks.

    Attributes:
        seen: Number of the last scene that the page showed.
        head: In the scene, with the axes of WebXR's viewer: x right, y up, against z ahead.
        left: The left hand, where it is tracked.
        right: The right one.
        walk: Forward, left and turning left, as shares of the greatest speeds.
        kneel: Down on the left knee and on the right one, or up below zero.
    """

    seen: int = field_of(whole(0, 2**31))
    head: Pose | None = field_of(or_null(place))
    left: TrackedHand | None = field_of(or_null(_hand))
    right: TrackedHand | None = field_of(or_null(_hand))
    walk: tuple[float, ...] = field_of(_shares(3))
    kneel: tuple[float, ...] = field_of(_shares(2))

    @property
    def hands(self) -> Mapping[str, TrackedHand]:
        """The hands that hold the clutch, by side."""
        both = {"left": self.left, "right": self.right}
        return {side: hand for side, hand in both.items() if hand is not None and hand.clutch}

    @property
    def clutch(self) -> bool:
        """Whether a hand holds the dead-man's switch."""
        return bool(self.hands)


class LedTool:
    """A robot whose tool goes the way of a hand while that holds the clutch."""

    def __init__(self, robot: Robot) -> None:
        """Take a robot whose actions move its tool; ConfigError if they do not."""
        moving_tool(robot.control)
        self._robot = robot
        names = robot.action_names
        closing = next((c for c in _controls(robot) if isinstance(c, GripperClosing)), None)
        self._closing = None if closing is None else names.index(closing.names[0])
        self._led: tuple[str, Pose, Pose] | None = None  # side, hand and tool as they were

    def action(self, tracked: Tracked) -> Array:
        """Return the action that a headset means."""
        robot, action, hands = self._robot, np.zeros(self._robot.action_size), tracked.hands
        if not hands:
            self._led = None
            return action
        tool = robot.tool_pose()
        if self._led is None or self._led[0] not in hands:
            side = next(iter(hands))
            self._led = side, hands[side].place, tool
        side, first, start = self._led
        now = hands[side].place
        way = np.add(start.position, np.subtract(now.position, first.position)) - tool.position
        turned = multiply(now.quaternion, conjugate(first.quaternion))
        left = multiply(multiply(turned, start.quaternion), conjugate(tool.quaternion))
        moved = robot.tool_action(GAIN * way, GAIN * rotation_vector(left))
        at = robot.action_names.index(robot.control.names[0])
        action[at : at + len(moved)] = moved
        if self._closing is not None:
            action[self._closing] = 2 * hands[side].grasp - 1
        return action

    def told(self) -> dict[str, Any]:
        """Return what a headset shows of it."""
        return {"tool": list(self._robot.tool_pose().position)}


def _controls(robot: Robot) -> list[Any]:
    return [part.control for part in robot.parts.values()]


class Embodied:
    """A person in the scene who does what a tracked head and hands do, as far as they can."""

    def __init__(self, person: Human, control_dt: float) -> None:
        """Take a spawned person, and the length of a control step [s]; ConfigError if they act by muscles."""
        if person.action_low == 0.0:
            raise ConfigError(
                f"{person.name!r} acts by excitations, which no hand shows: take the actuation "
                "'skeletal', or 'muscle' with the excitation 'posture'"
            )
        self._person, self._dt = person, control_dt
        arms = {side: arm_dofs(person, side) for side in SIDES}
        self._arms = {
            side: dofs
            for side, dofs in arms.items()
            if any(dof.startswith(f"{side}_shoulder") for dof in dofs)
        }
        joints = [DOFS[DOF_INDEX[dof]].joint for dof in person.movable]
        self._neck = [
            d for d, j in zip(person.movable, joints, strict=True) if j in ("neck", "head")
        ]
        self._grips = {side: grip_point(person, side) for side in SIDES}
        self._clutched: dict[str, tuple[Pose, Pose]] = {}  # hand and wrist as they were
        self._striving = Striving(person)
        self._limits = person.avatar.profile.limits("active")
        self._behind: dict[str, str] = {}

    def action(self, tracked: Tracked) -> Array:
        """Return the action that a headset means."""
        person, hands = self._person, tracked.hands
        self._clutched = {side: was for side, was in self._clutched.items() if side in hands}
        self._behind = {}
        if not hands:
            self._striving.forget()
            return np.zeros(person.action_size)
        arms = {side: hand for side, hand in hands.items() if side in self._arms}
        goals, movable = list[Goal](), list[str]()
        for side, hand in arms.items():
            wrist = f"{side}_wrist"
            first, start = self._clutched.setdefault(side, (hand.place, person.joint_pose(wrist)))
            turned = multiply(hand.place.quaternion, conjugate(first.quaternion))
            held = multiply(turned, start.quaternion)
            goals.append(Position(wrist, hand.place.position, self._grips[side]))
            goals.append(Orientation(wrist, tuple(held.tolist()), weight=WRIST_WEIGHT))
            movable += self._arms[side]
        if tracked.head is not None and self._neck:
            look = multiply(tracked.head.quaternion, FROM_VIEWER)
            goals.append(Orientation("head", tuple(look.tolist()), weight=HEAD_WEIGHT))
            movable += self._neck
        wish: dict[str, float] = {}
        if goals:
            ik = WholeBodyIk.of(person, movable=tuple(dict.fromkeys(movable)))
            base, angles = person.body.base_pose(), present_angles(person)
            found = ik.solve(goals, angles, base, fallback=False)
            wish = found.wish
            for k, side in enumerate(arms):
                if found.errors[2 * k] > BEHIND:
                    self._behind[side] = self._end(side, wish)
        self._strive(arms, wish)
        if "jaw_opening" in person.movable and not person.hands:
            wish["jaw_opening"] = OPEN * max(hand.grasp for hand in hands.values())
        action = person.action_towards(wish, self._dt)
        entries = person.entries
        if "walk" in entries:
            action[entries["walk"]] = tracked.walk
        if "kneel" in entries:
            action[entries["kneel"]] = tracked.kneel
        if "grasp" in entries:
            closed = {side: 2 * hand.grasp - 1 for side, hand in hands.items()}
            action[entries["grasp"]] = [closed.get(side, 0.0) for side in person.hands]
        return action

    def _strive(self, arms: Mapping[str, TrackedHand], wish: dict[str, float]) -> None:
        """Try harder under a load, until the hands are where they are wished to be."""
        person = self._person
        if not any(person.hands[side].held for side in arms if side in person.hands):
            self._striving.forget()
            return
        left = [math.dist(self._palm(side), hand.place.position) for side, hand in arms.items()]
        self._striving.add(wish, STRIVING if max(left) > NEAR_LADEN else 0.0)

    def _palm(self, side: str) -> Array:
        wrist = self._person.joint_pose(f"{side}_wrist")
        return np.asarray(rotate(wrist.quaternion, self._grips[side]) + wrist.position)

    def _end(self, side: str, wish: Mapping[str, float]) -> str:
        """Return which joints of an arm are at the end of their active range."""
        ends = []
        for dof in self._arms[side]:
            low, high = self._limits[dof]
            if min(wish[dof] - low, high - wish[dof]) < AT_END and high - low > AT_END:
                ends.append(dof.replace("_", " "))
        return f"at its end: {', '.join(ends)}" if ends else "out of reach"

    def told(self) -> dict[str, Any]:
        """Return what a headset shows of it: eyes, where they look, palms, and why a hand stays behind."""
        person = self._person
        eyes = [person.joint_pose(f"{side}_eye_smplhf") for side in SIDES]
        ahead = rotate(person.joint_pose("head").quaternion, (0.0, 0.0, 1.0))
        pelvis = person.body.base_pose()
        face = rotate(pelvis.quaternion, (0.0, 0.0, 1.0))
        return {
            "eyes": np.mean([each.position for each in eyes], axis=0).tolist(),
            "ahead": ahead.tolist(),
            "palms": {side: self._palm(side).tolist() for side in self._arms},
            "pelvis": [*pelvis.position, math.atan2(face[1], face[0])],
            "behind": self._behind,
        }


def led(agent: Agent, control_dt: float) -> LedTool | Embodied:
    """Return what turns what a headset tracks into actions of an agent; ConfigError if nothing does."""
    if isinstance(agent, Robot):
        return LedTool(agent)
    assert isinstance(agent, Human)
    return Embodied(agent, control_dt)
