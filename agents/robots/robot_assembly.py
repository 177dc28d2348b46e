"""Puts a robot's model together for the parts that move: what does not move is frozen."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.model.urdf import Follow, Joint, Link, Model
from rcare_marl.pose import rpy_from_matrix

from .gripper import Gripper
from .kinematics import Chain
from .mobile_base import with_base
from .robot_config import BASE_JOINTS, ArmConfig, RobotConfig, frame
from .robot_model import Meshes, RobotFiles, robot_files, robot_model

SLACK = 1e-4  # [rad or m] that a posture may lie beyond a limit, since figures are rounded


@dataclass(frozen=True)
class Assembly:
    """A robot ready to be spawned.

    Attributes:
        files: What to load.
        chains: Kinematics of the arms that move, by name.
        roots: Links that carry those arms and move; None for the base of the body.
        tools: Links whose frames are the tools', by arm.
        groups: Joints of the other groups that move, by name.
        grippers: Grippers by arm, also those that are held.
        followers: How joints that can move follow others, by name.
        start: Start position of each joint [rad or m].
    """

    files: RobotFiles
    chains: dict[str, Chain]
    roots: dict[str, str | None]
    tools: dict[str, str]
    groups: dict[str, tuple[str, ...]]
    grippers: dict[str, Gripper]
    followers: dict[str, Follow]
    start: dict[str, float]


def assemble(
    config: RobotConfig,
    *,
    moves: Sequence[str],
    free_grippers: Collection[str],
    grip_width: float,
    posture: Mapping[str, float],
    meshes: Meshes = "never",
    kept_links: Collection[str] = (),
) -> Assembly:
    """Return the robot with the parts `moves` movable and all else frozen in `posture`.

    Args:
        config: The robot.
        moves: Names of its parts that move.
        free_grippers: Arms whose fingers can move.
        grip_width: Gap between the fingers of the main arm at the start [m].
        posture: Joint positions [rad or m]; joints not named are at 0, or the limit nearest to it.
        meshes: As for `robot_files`.
        kept_links: Links that must stay links of their own.

    Raises:
        UnknownNameError: If the model lacks a joint or a link that `config` or `posture` names.
        ConfigError: If the model cannot be used, or the gripper does not open so far.
    """
    own = robot_model(config.model, urdf=config.urdf)
    _check_names(config, own, posture)
    arms = _moved_arms(config, own, moves)
    model = _adapted(own, config, moves, arms)
    main = next(iter(arms), config.main_arm)
    grippers = {
        name: Gripper(arm.gripper, model, grip_width if name == main else None)
        for name, arm in config.arms.items()
        if arm.gripper is not None
    }
    movable = _movable(config, moves, arms)
    followers = {
        name: joint.follows
        for name, joint in model.joints.items()
        if joint.follows is not None and joint.follows.joint in movable
    }
    fingers = {j for arm, g in grippers.items() if arm in free_grippers for j in g.joints}
    start = _start(model, posture)
    for gripper in grippers.values():
        start |= gripper.positions(gripper.start)
    frozen = {
        name: start[name]
        for name, joint in model.joints.items()
        if joint.kind != "fixed" and name not in movable | followers.keys() | fingers
    }
    tools = {name: _tool_link(name, arm) for name, arm in arms.items()}
    kept = {*kept_links, *tools.values()}
    for link in kept:
        check_name("link", link, model.links)
    files = robot_files(
        config.model,
        config.package,
        urdf=config.urdf,
        meshes=meshes,
        fixed_joints=frozen,
        melt_except=None if free_grippers else tuple(sorted(kept)),
        adapt=lambda plain: _adapted(plain, config, moves, arms),
    )
    moving = movable | followers.keys()
    roots = {name: _moving_root(model, arm, moving) for name, arm in arms.items()}
    chains = {
        name: Chain(model, _arm_joints(arm), tools[name], others=start, root=roots[name])
        for name, arm in arms.items()
    }
    return Assembly(
        files=files,
        chains=chains,
        roots=roots,
        tools=tools,
        groups={name: joints for name, joints in config.groups.items() if name in moves},
        grippers=grippers,
        followers=followers,
        start=start,
    )


def _movable(config: RobotConfig, moves: Sequence[str], arms: Mapping[str, ArmConfig]) -> set[str]:
    """Return the joints that actions move."""
    out = {joint for arm in arms.values() for joint in _arm_joints(arm)}
    out |= {joint for name in moves for joint in config.groups.get(name, ())}
    return out | (set(BASE_JOINTS) if "base" in moves else set())


def _moved_arms(config: RobotConfig, model: Model, moves: Sequence[str]) -> dict[str, ArmConfig]:
    """Return the arms that move, without help of the base where that would be in the way.

    The base helps the first of them, as long as it does not drive by itself and no torso between the
    two moves.
    """
    out: dict[str, ArmConfig] = {}
    between = {joint for name in moves for joint in config.groups.get(name, ())}
    for name in (part for part in moves if part in config.arms):
        arm = config.arms[name]
        way = set(model.way(arm.tool_link))
        if out or "base" in moves or between & way:
            arm = replace(arm, base_joints=())
        out[name] = arm
    return out


def _arm_joints(arm: ArmConfig) -> tuple[str, ...]:
    """Return the joints that an arm's actions move."""
    return (*arm.base_joints, *arm.joints)


def _tool_link(name: str, arm: ArmConfig) -> str:
    return f"{name}_tool_frame" if arm.has_own_tool else arm.tool_link


def _check_names(config: RobotConfig, model: Model, posture: Mapping[str, float]) -> None:
    for arm in config.arms.values():
        for name in arm.joints:
            _check_joint(name, model)
        for link in (arm.tool_link, arm.wrist_link):
            if link is not None:
                check_name("link", link, model.links)
    for joints in config.groups.values():
        for name in joints:
            _check_joint(name, model)
    for camera in config.cameras.values():
        check_name("link", camera.link, model.links)
    for name, value in posture.items():
        if name in BASE_JOINTS:
            continue
        _check_joint(name, model)
        joint = model.joints[name]
        if joint.follows is not None:
            raise ConfigError(
                f"posture: {name!r} follows {joint.follows.joint!r}, so name that one"
            )
        if joint.kind != "continuous" and not joint.lower - SLACK <= value <= joint.upper + SLACK:
            raise ConfigError(
                f"posture: {name!r} goes from {joint.lower:g} to {joint.upper:g} "
                f"{'m' if joint.kind == 'prismatic' else 'rad'}, got {value:g}"
            )


def _check_joint(name: str, model: Model) -> None:
    movable = [n for n, joint in model.joints.items() if joint.kind != "fixed"]
    if name in model.joints and name not in movable:
        raise ConfigError(f"joint {name!r} of {model.name} is fixed and cannot be moved")
    check_name(f"movable joint of {model.name}", name, movable)


def _adapted(
    model: Model, config: RobotConfig, moves: Sequence[str], arms: Mapping[str, ArmConfig]
) -> Model:
    """Return the model with tool frames of the user's own, and on a base if that moves."""
    links, joints = dict(model.links), dict(model.joints)
    for name, arm in arms.items():
        if arm.has_own_tool:
            pose = frame(arm.tool_at, arm.tool_rpy_deg)
            r, p, y = rpy_from_matrix(pose.matrix()[:3, :3])
            links[_tool_link(name, arm)] = Link()
            joints[f"{name}_tool_joint"] = Joint(
                "fixed", arm.tool_link, _tool_link(name, arm), arm.tool_at, (r, p, y)
            )
    out = replace(model, links=links, joints=joints)
    is_driven = "base" in moves
    if config.base is not None and (is_driven or any(arm.base_joints for arm in arms.values())):
        out = with_base(out, config.base, is_driven=is_driven)
    return out


def _start(model: Model, posture: Mapping[str, float]) -> dict[str, float]:
    """Return the start position of every joint that is not fixed."""
    out: dict[str, float] = {}
    for name, joint in model.joints.items():
        if joint.kind == "fixed" or joint.follows is not None:
            continue
        value = posture.get(name, 0.0)
        is_limited = joint.kind != "continuous"
        out[name] = float(np.clip(value, joint.lower, joint.upper)) if is_limited else value
    for name, joint in model.joints.items():
        if joint.follows is not None:
            out[name] = joint.follows.multiplier * out[joint.follows.joint] + joint.follows.offset
    return out


def _moving_root(model: Model, arm: ArmConfig, moving: Collection[str]) -> str | None:
    """Return the last link before an arm that another part moves; None if nothing moves it."""
    own = set(_arm_joints(arm))
    for name in model.way(model.joints[arm.joints[0]].parent):
        if name in moving and name not in own:
            return model.joints[name].child
    return None
