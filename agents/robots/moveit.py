"""A robot as a package for MoveIt 2: URDF, SRDF and the files that configure planning and control."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any
from xml.etree import ElementTree as xml

import numpy as np
import yaml

from rcare_marl.body import Body
from rcare_marl.bullet import bullet
from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Link, Model, files, write
from rcare_marl.pose import Pose
from rcare_marl.world import World

from .robot import Robot
from .robot_assembly import Assembly
from .robot_config import RobotConfig, gripper_name
from .self_collision import touching_links

Pair = tuple[str, str]

SAMPLES = 10_000  # postures drawn evenly, and as many nearer to the limits
SWELLING = 0.01  # [m] by which shapes are thicker while postures are drawn: for those not drawn
FULL_SPEED = 0.25  # [s] from rest to the greatest speed, for limits of acceleration; our own choice
PLANNERS = ("RRTConnect", "BiTRRT", "BITstar")
ACTIONS = "follow_joint_trajectory", "gripper_cmd"  # of arms and groups, and of grippers


@dataclass(frozen=True)
class Planned:
    """A robot as MoveIt is told of it: all parts can move, and a base is no part of the model.

    Attributes:
        config: The robot.
        assembly: It, put together.
        model: Links and joints, with solids that any reader of URDF knows.
        frozen: Joints that no part moves, such as wheels, with their positions [rad or m].
    """

    config: RobotConfig
    assembly: Assembly
    model: Model
    frozen: dict[str, float]

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """The joints of every arm, gripper and other group, by its name."""
        out = {name: arm.joints for name, arm in self.config.arms.items()}
        for arm, gripper in self.assembly.grippers.items():
            out[gripper_name(arm)] = (gripper.config.joint,)
        return out | self.config.groups

    @property
    def leaders(self) -> list[str]:
        """The joints that can be moved and follow no other."""
        free = {n for n, j in self.model.joints.items() if j.kind != "fixed" and j.follows is None}
        return [name for name in self.model.joints if name in free - self.frozen.keys()]

    def whole(self, positions: Mapping[str, float]) -> dict[str, float]:
        """Return the positions [rad or m] of all movable joints, from those of the leaders."""
        out = dict(positions)
        for name, joint in self.model.joints.items():
            if joint.follows is not None and joint.follows.joint in out:
                rule = joint.follows
                out[name] = rule.multiplier * out[rule.joint] + rule.offset
        return out

    def postures(
        self, rng: np.random.Generator, count: int, *, sharp: bool = False
    ) -> Iterator[dict[str, float]]:
        """Draw postures within limits, evenly or, if `sharp`, mostly near to a limit."""
        joints = [self.model.joints[name] for name in self.leaders]
        turning = np.array([joint.kind == "continuous" for joint in joints])
        lower = np.where(turning, -math.pi, [joint.lower for joint in joints])
        upper = np.where(turning, math.pi, [joint.upper for joint in joints])
        shape = 0.3 if sharp else 1.0
        for _ in range(count):
            drawn = lower + (upper - lower) * rng.beta(shape, shape, len(joints))
            yield self.whole(dict(zip(self.leaders, drawn.tolist(), strict=True)))


def planned(config: RobotConfig) -> Planned:
    """Return a robot as MoveIt is told of it.

    Raises:
        ConfigError: If the model cannot be used.
    """
    arms = {name: replace(arm, base_joints=()) for name, arm in config.arms.items()}
    bolted = replace(config, base=None, arms=arms)
    robot = Robot("robot", bolted, moves=bolted.parts, gripper="free", control="joint_position")
    assembly = robot.assembly
    moving = {joint for name in bolted.groups for joint in bolted.groups[name]}
    moving |= {joint for arm in bolted.arms.values() for joint in arm.joints}
    moving |= {joint for gripper in assembly.grippers.values() for joint in gripper.joints}
    moving |= assembly.followers.keys()
    model = assembly.files.model
    frozen = {
        name: assembly.start[name]
        for name, joint in model.joints.items()
        if joint.kind != "fixed" and name not in moving
    }
    links = {name: replace(link, collision=_solids(link)) for name, link in model.links.items()}
    return Planned(config, assembly, replace(model, links=links), frozen)


def _solids(link: Link) -> tuple[Shape, ...]:
    """Return what a link collides with, capsules as what URDF has: a cylinder and two spheres."""
    out: list[Shape] = []
    for shape in link.collision:
        if shape.kind != "capsule":
            out.append(shape)
            continue
        half = shape.span() / 2
        ends = (shape.pose() @ Pose((0.0, 0.0, z)) for z in (-half, half))
        (ax, ay, az), (bx, by, bz) = (end.position for end in ends)
        out.append(replace(shape, kind="cylinder"))
        out += [
            Shape("sphere", shape.material, at, radius=shape.radius)
            for at in ((ax, ay, az), (bx, by, bz))
        ]
    return tuple(out)


def spawn(robot: Planned, world: World, *, swelling: float = 0.0) -> Body:
    """Load the robot, its links colliding with each other, shapes thicker by `swelling` [m]."""
    model = robot.model
    if swelling:
        links = {
            name: replace(link, collision=tuple(_swollen(s, swelling) for s in link.collision))
            for name, link in model.links.items()
        }
        model = replace(model, links=links)
    file = write(model, fixed_joints=robot.frozen)
    return world.load_urdf(file, name=model.name, self_collision=True)


def _swollen(shape: Shape, by: float) -> Shape:
    if shape.kind == "box":
        x, y, z = shape.size
        return replace(shape, size=(x + 2 * by, y + 2 * by, z + 2 * by))
    return replace(shape, radius=shape.radius + by)


def set_posture(body: Body, positions: Mapping[str, float]) -> None:
    """Put the joints of a body at `positions` [rad or m]."""
    body.set_joints(body.indices(positions), list(positions.values()))


def colliding(body: Body, client: int) -> set[Pair]:
    """Return the pairs of links that overlap now; those of parent and child are not looked at."""
    bullet.performCollisionDetection(physicsClientId=client)
    found = bullet.getContactPoints(body.uid, body.uid, physicsClientId=client)
    return {pair(body.link_names[p[3]], body.link_names[p[4]]) for p in found if p[8] < 0}


def pair(a: str, b: str) -> Pair:
    """Return two names in order."""
    return (a, b) if a < b else (b, a)


def ignored_pairs(
    robot: Planned, *, samples: int = SAMPLES, seed: int = 0
) -> dict[str, list[Pair]]:
    """Return the pairs of links whose collisions MoveIt need not look for, by reason.

    `Adjacent` are those that touch by design, see `touching_links`. `Never` are those that met in no
    posture of `samples` drawn evenly and as many drawn near to limits, with all shapes thicker by
    `SWELLING`.
    """
    world = World()
    body = spawn(robot, world, swelling=SWELLING)
    hands = [gripper.config.fingers for gripper in robot.assembly.grippers.values()]
    melted = replace(
        robot.model,
        joints={
            name: replace(joint, kind="fixed") if name in robot.frozen else joint
            for name, joint in robot.model.joints.items()
        },
    )
    beside = {_own(robot, pair(*each)) for each in touching_links(melted, body, hands)}
    rng, met = np.random.default_rng(seed), set[Pair]()
    for sharp in (False, True):
        for posture in robot.postures(rng, samples, sharp=sharp):
            set_posture(body, posture)
            met |= colliding(body, world.client)
    met = {_own(robot, each) for each in met}
    world.close()
    solid = [name for name, link in robot.model.links.items() if link.collision or link.hulls]
    every = {pair(a, b) for a, b in combinations(solid, 2)}
    return {"Adjacent": sorted(every & beside), "Never": sorted(every - beside - met)}


def _own(robot: Planned, names: Pair) -> Pair:
    """Return names as the model has them: Bullet also calls the root `base`."""
    links = robot.model.links
    first, second = (n if n in links else robot.model.root for n in names)
    return pair(first, second)


def moveit_package(robot: Planned, ignored: Mapping[str, Sequence[Pair]]) -> dict[str, str]:
    """Return the files of a package for MoveIt 2 by their names in it."""
    name = robot.model.name
    package = f"{name}_moveit"
    made = files(robot.model, robot.frozen)
    (urdf,) = (text for file, text in made.items() if file.endswith(".urdf"))
    out = {}
    for file, text in made.items():
        if not file.endswith(".urdf"):
            out[f"meshes/{file}"] = text
            urdf = urdf.replace(f'"{file}"', f'"package://{package}/meshes/{file}"')
    configured = {
        "kinematics": _kinematics(robot),
        "joint_limits": _limits(robot),
        "ompl_planning": _planning(robot),
        "moveit_controllers": _controllers(robot),
    }
    out |= {
        f"config/{file}.yaml": yaml.safe_dump(each, sort_keys=False)
        for file, each in configured.items()
    }
    out[f"config/{name}.urdf"] = urdf
    out[f"config/{name}.srdf"] = srdf(robot, ignored)
    out["package.xml"] = _MANIFEST.format(package=package, name=name)
    out["CMakeLists.txt"] = _CMAKE.format(package=package)
    out["launch/demo.launch.py"] = _LAUNCH.format(package=package, name=name)
    return out


def srdf(robot: Planned, ignored: Mapping[str, Sequence[Pair]]) -> str:
    """Return what MoveIt is to know of a robot beside its URDF."""
    config, model = robot.config, robot.model
    root = xml.Element("robot", name=model.name)
    for name, joints in robot.groups.items():
        group = xml.SubElement(root, "group", name=name)
        chain = _chain(robot, name)
        if chain is not None:
            xml.SubElement(group, "chain", base_link=chain[0], tip_link=chain[1])
        for joint in joints if chain is None else ():
            xml.SubElement(group, "joint", name=joint)
    whole = xml.SubElement(root, "group", name="whole_body")
    xml.SubElement(whole, "joint", name="base")
    for name in robot.groups:
        xml.SubElement(whole, "group", name=name)
    for name, posture in config.postures.items():
        for part, joints in robot.groups.items():
            if part in config.arms or part in config.groups:
                _state(root, name, part, {j: _within(model, j, posture) for j in joints})
    for arm, gripper in robot.assembly.grippers.items():
        hand, told, tip = gripper_name(arm), gripper.config, robot.assembly.tools[arm]
        _state(root, "open", hand, {told.joint: told.opened})
        _state(root, "closed", hand, {told.joint: told.closed})
        ends = {"name": f"{hand}_end", "parent_link": tip, "group": hand, "parent_group": arm}
        xml.SubElement(root, "end_effector", ends)
    drives = config.base is not None
    kind, frame = ("planar", "odom") if drives else ("fixed", "world")
    xml.SubElement(
        root, "virtual_joint", name="base", type=kind, parent_frame=frame, child_link=model.root
    )
    for reason, pairs in ignored.items():
        for a, b in pairs:
            xml.SubElement(root, "disable_collisions", link1=a, link2=b, reason=reason)
    xml.indent(root)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n' + xml.tostring(root, encoding="unicode") + "\n"
    )


def _chain(robot: Planned, group: str) -> Pair | None:
    """Return the ends of an arm's chain, if no joint of another part is between them."""
    if group not in robot.config.arms:
        return None
    model, joints = robot.model, robot.config.arms[group].joints
    base, tip = model.joints[joints[0]].parent, robot.assembly.tools[group]
    between = [model.joints[name] for name in model.way(tip, base)]
    leading = [j for j in between if j.kind != "fixed" and j.follows is None]
    own = [model.joints[name] for name in joints]
    others = [j for j in leading if j not in own and _name(model, j) not in robot.frozen]
    return None if others else (base, tip)


def _name(model: Model, joint: object) -> str:
    return next(name for name, each in model.joints.items() if each is joint)


def _within(model: Model, joint: str, posture: Mapping[str, float]) -> float:
    found, value = model.joints[joint], posture.get(joint, 0.0)
    return value if found.kind == "continuous" else float(np.clip(value, found.lower, found.upper))


def _state(root: xml.Element, name: str, group: str, values: Mapping[str, float]) -> None:
    element = xml.SubElement(root, "group_state", name=name, group=group)
    for joint, value in values.items():
        xml.SubElement(element, "joint", name=joint, value=repr(value))


def _kinematics(robot: Planned) -> dict[str, Any]:
    solver = {
        "kinematics_solver": "kdl_kinematics_plugin/KDLKinematicsPlugin",
        "kinematics_solver_search_resolution": 0.005,
        "kinematics_solver_timeout": 0.05,
    }
    return {
        name: solver | ({"position_only_ik": True} if len(arm.joints) < 6 else {})
        for name, arm in robot.config.arms.items()
    }


def _limits(robot: Planned) -> dict[str, Any]:
    limits = {}
    for name in robot.leaders:
        speed = robot.model.joints[name].velocity
        limits[name] = {
            "has_velocity_limits": True,
            "max_velocity": speed,
            "has_acceleration_limits": True,
            "max_acceleration": speed / FULL_SPEED,
        }
    scaling = {f"default_{what}_scaling_factor": 0.1 for what in ("velocity", "acceleration")}
    return {**scaling, "joint_limits": limits}


def _planning(robot: Planned) -> dict[str, Any]:
    adapters = ("ResolveConstraintFrames", "ValidateWorkspaceBounds", "CheckStartStateBounds")
    after = ("AddTimeOptimalParameterization", "ValidateSolution", "DisplayMotionPath")
    return {
        "planning_plugins": ["ompl_interface/OMPLPlanner"],
        "request_adapters": [
            f"default_planning_request_adapters/{each}"
            for each in (*adapters, "CheckStartStateCollision")
        ],
        "response_adapters": [f"default_planning_response_adapters/{each}" for each in after],
        "planner_configs": {name: {"type": f"geometric::{name}"} for name in PLANNERS},
        **{
            group: {
                "default_planner_config": PLANNERS[0],
                "planner_configs": list(PLANNERS),
                "longest_valid_segment_fraction": 0.003,
            }
            for group in (*robot.groups, "whole_body")
        },
    }


def controllers(robot: Planned) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return the controllers by name, each with its kind of action and its joints."""
    grippers = [gripper_name(arm) for arm in robot.assembly.grippers]
    return {
        f"{group}_controller": (
            "GripperCommand" if group in grippers else "FollowJointTrajectory",
            joints,
        )
        for group, joints in robot.groups.items()
    }


def _controllers(robot: Planned) -> dict[str, Any]:
    told = controllers(robot)
    return {
        "moveit_controller_manager": (
            "moveit_simple_controller_manager/MoveItSimpleControllerManager"
        ),
        "moveit_simple_controller_manager": {
            "controller_names": list(told),
            **{
                name: {
                    "type": kind,
                    "action_ns": ACTIONS[kind == "GripperCommand"],
                    "default": True,
                    "joints": list(joints),
                }
                for name, (kind, joints) in told.items()
            },
        },
    }


_MANIFEST = """\
<?xml version="1.0"?>
<package format="3">
  <name>{package}</name>
  <version>0.1.0</version>
  <description>{name} for MoveIt 2, written by rcare-marl export</description>
  <maintainer email="nobody@example.org">nobody</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <exec_depend>moveit</exec_depend>
  <exec_depend>moveit_configs_utils</exec_depend>
  <exec_depend>robot_state_publisher</exec_depend>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""
_CMAKE = """\
cmake_minimum_required(VERSION 3.16)
project({package})
find_package(ament_cmake REQUIRED)
install(DIRECTORY config launch meshes scene DESTINATION share/${{PROJECT_NAME}} OPTIONAL)
ament_package()
"""
_LAUNCH = '''\
"""move_group for {name}; the robot is what `rcare-marl ros serve` or the maker's driver serves."""

from moveit_configs_utils import MoveItConfigsBuilder
from moveit_configs_utils.launches import generate_move_group_launch


def generate_launch_description():
    builder = MoveItConfigsBuilder("{name}", package_name="{package}")
    builder = builder.robot_description(file_path="config/{name}.urdf")
    builder = builder.robot_description_semantic(file_path="config/{name}.srdf")
    builder = builder.robot_description_kinematics(file_path="config/kinematics.yaml")
    builder = builder.joint_limits(file_path="config/joint_limits.yaml")
    builder = builder.trajectory_execution(file_path="config/moveit_controllers.yaml")
    builder = builder.planning_pipelines(pipelines=["ompl"])
    return generate_move_group_launch(builder.to_moveit_configs())
'''
