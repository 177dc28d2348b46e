"""Measures what a robot model is good for: posture, reach, grip. For our models and for a user's own."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.body import Body
from rcare_marl.bullet import bullet
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, conjugate, multiply, rotation_vector
from rcare_marl.world import World

from .arm import Arm
from .control import JointPosition, ToolPose
from .robot import GripperUse, Robot
from .robot_config import RobotConfig
from .self_collision import overlapping, touching_links

CONTROL_DT = 0.05  # [s]
FLOOR_GAP = 0.02  # [m] that poses to reach stay above the floor
REACH_TIME = 12.0  # [s] that the arm gets to reach a pose, at most
CLOSING_TIME, HOLDING_TIME = 2.0, 3.0  # [s]
DRAWS = 500  # postures drawn for each pose to reach, at most
BOX = 0.045  # [m] edge of what a gripper is to hold, if it opens so far


@dataclass(frozen=True)
class Reach:
    """How near a robot's controller brings its tool to poses that it can reach.

    Attributes:
        distances: What is left of the way [m], shape [n].
        angles: What is left of the turn [rad], shape [n].
    """

    distances: Array
    angles: Array


@dataclass(frozen=True)
class Grip:
    """What a gripper does with a box.

    Attributes:
        width: Edge of the box [m].
        slip: How far the box moved in the hand while it was held [m].
        opened: Gap between the real pads after it was told to open [m].
        closed: Gap between the real pads after it was told to close round nothing [m].
        widest: Gap by its data when open [m].
    """

    width: float
    slip: float
    opened: float
    closed: float
    widest: float


def spawned(
    config: RobotConfig,
    *,
    moves: Sequence[str] | None = None,
    control: str = "tool_delta",
    gripper: GripperUse = "held",
    pose: Pose | None = None,
) -> tuple[World, Robot]:
    """Return a new world with the robot on the floor, or at `pose`; options as for `Robot`."""
    robot = Robot("robot", config, moves=moves, control=control, gripper=gripper)
    world = World()
    where = pose if pose is not None else robot.mount("floor") if config.mounts else Pose()
    robot.spawn(world, where)
    robot.reset(np.random.default_rng(0))
    return world, robot


def advance(world: World, robot: Robot, action: Array, duration: float) -> None:
    """Let the robot act for `duration` [s] in control steps."""
    for _ in range(max(round(duration / CONTROL_DT), 1)):
        robot.command(action, CONTROL_DT)
        for _ in range(round(CONTROL_DT / world.physics_dt)):
            robot.actuate()
            world.step()


def still(robot: Robot) -> Array:
    """Return the action that keeps the robot where it is."""
    parts = []
    for part in robot.parts.values():
        if isinstance(part.control, JointPosition) and part.joints is not None:
            parts.append(part.control.action_for(part.joints.positions()))
        elif isinstance(part.control, ToolPose) and part.tool is not None:
            parts.append(part.control.action_for(part.tool()))
        else:
            parts.append(np.zeros(part.control.size))
    return np.concatenate(parts)


def find_overlaps(config: RobotConfig) -> list[tuple[str, str]]:
    """Return the pairs of links that overlap at `home` though they share no joint.

    Links between which there are only links without collision shape share a joint too, and so do all
    links of one hand, whose linkages we do not close.
    """
    world, robot = spawned(config, moves=config.parts)
    pairs = overlapping(robot.body, touching_links(robot.files.model, robot.body, robot.hands))
    world.close()
    return pairs


def measure_posture(
    config: RobotConfig, *, seconds: float = 5.0, control: str = "tool_delta"
) -> tuple[float, float]:
    """Return how far joints drift from `home` without command: greatest [rad], and greatest [m]."""
    world, robot = spawned(config, moves=config.parts, control=control)
    groups = [part.joints for part in robot.parts.values() if part.joints is not None]
    start = [group.positions() for group in groups]
    turned = slid = 0.0
    action = still(robot)
    for _ in range(round(seconds / CONTROL_DT)):
        advance(world, robot, action, CONTROL_DT)
        for group, before in zip(groups, start, strict=True):
            drift = np.abs(group.positions() - before)
            slides = np.array([unit == "m" for unit in group.units])
            turned = max(turned, float(drift[~slides].max(initial=0.0)))
            slid = max(slid, float(drift[slides].max(initial=0.0)))
    world.close()
    return turned, slid


def measure_reach(
    config: RobotConfig, arm: str | None = None, *, count: int = 20, seed: int = 0
) -> Reach:
    """Send the tool to `count` random poses that it can reach, and see where it gets.

    Poses are those of postures drawn evenly within the limits in which the robot neither overlaps
    itself nor the floor. Inverse kinematics know the pose only, and start from `home`; the control
    mode is `joint_position`.
    """
    chosen = arm or config.main_arm
    world, robot = spawned(config, moves=(chosen,), control="joint_position")
    draw = _pose_sampler(world, robot, np.random.default_rng(seed))
    distances, angles = [], []
    for _ in range(count):
        goal = draw()
        robot.set_start()
        found = robot.solve_ik(goal)
        control = robot.control
        assert isinstance(control, JointPosition)
        action = control.action_for(found.posture)
        for _ in range(round(REACH_TIME / 0.5)):
            advance(world, robot, action, 0.5)
            if np.abs(robot.arm.velocities()).max() < 1e-4:
                break
        here = robot.body.link_pose(robot.tool_index)
        distances.append(math.dist(here.position, goal.position))
        turn = multiply(goal.quaternion, conjugate(here.quaternion))
        angles.append(float(np.linalg.norm(rotation_vector(turn))))
    world.close()
    return Reach(np.array(distances), np.array(angles))


def _pose_sampler(world: World, robot: Robot, rng: np.random.Generator) -> Callable[[], Pose]:
    """Return what draws poses of the tool that can be reached."""
    arm: Arm = robot.arm
    lower = np.where(np.isinf(arm.lower), -np.pi, arm.lower)
    upper = np.where(np.isinf(arm.upper), np.pi, arm.upper)
    body = robot.body
    apart = touching_links(robot.files.model, body, robot.hands)
    # What stands on the floor at the start, such as wheels, may do so ever after.
    clear = [link for link in body.solid_links() if lowest(world, body, link) > FLOOR_GAP]

    def draw() -> Pose:
        for _ in range(DRAWS):
            robot.set_posture(rng.uniform(lower, upper))
            tool = robot.tool_pose()
            heights = [tool.position[2], *(lowest(world, body, link) for link in clear)]
            if min(heights) > FLOOR_GAP and not overlapping(body, apart):
                return tool
        raise ConfigError(
            f"{robot.files.model.name}: all of {DRAWS} random postures overlap the robot or the floor"
        )

    return draw


def lowest(world: World, body: Body, link: int) -> float:
    """Return the height of the lowest corner of the box round a solid link [m]."""
    low, _ = bullet.getAABB(body.uid, link, physicsClientId=world.client)
    return float(low[2])


def pads(robot: Robot, arm: str) -> tuple[Array, Array]:
    """Return where the two pads of an arm's gripper really are in the world [m], each of shape [3].

    The fingers must be links of their own, as they are with `gripper="free"`.
    """
    config = robot.assembly.grippers[arm].config
    places = zip(config.fingers, (config.pad, config.other_pad), strict=True)
    first, second = (
        np.array((robot.body.link_pose(robot.body.link_index(link)) @ Pose(pad)).position)
        for link, pad in places
    )
    return first, second


def _gap(robot: Robot, arm: str) -> float:
    return math.dist(*pads(robot, arm))


def measure_grip(config: RobotConfig, arm: str | None = None, *, mass: float = 0.5) -> Grip:
    """Let the gripper of an arm hold a box of `mass` [kg] by friction alone, in the air at `home`."""
    chosen = arm or config.main_arm
    world, robot = spawned(config, moves=(chosen,), gripper="free", control="joint_delta")
    gripper = robot.assembly.grippers[chosen]
    zero = np.zeros(robot.action_size)
    widest = gripper.width(gripper.config.opened)
    robot.set_gripper(1.0)
    advance(world, robot, zero, CLOSING_TIME)
    closed = _gap(robot, chosen)
    robot.set_gripper(0.0)
    advance(world, robot, zero, CLOSING_TIME)
    opened = _gap(robot, chosen)
    edge = min(BOX, 0.7 * widest)
    box = world.add_box((edge, edge, edge), robot.tool_pose(), mass=mass, name="box")
    robot.set_gripper(1.0)
    for _ in range(round(CLOSING_TIME / CONTROL_DT)):  # a hand holds it up until it is grasped
        robot.command(zero, CONTROL_DT)
        for _ in range(round(CONTROL_DT / world.physics_dt)):
            robot.actuate()
            box.apply_force(-1, (0.0, 0.0, mass * 9.81), box.base_pose().position)
            world.step()
    start = robot.tool_pose().inverse() @ box.base_pose()
    advance(world, robot, zero, HOLDING_TIME)
    end = robot.tool_pose().inverse() @ box.base_pose()
    world.close()
    return Grip(edge, math.dist(start.position, end.position), opened, closed, widest)
