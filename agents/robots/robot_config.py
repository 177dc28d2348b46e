"""The data of robots: parts, postures, places to stand, cameras."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.model.shape import ZERO as ZERO
from rcare_marl.model.shape import Triple as Triple
from rcare_marl.pose import Pose, quaternion_from_rpy

from .gripper import GripperConfig
from .robot_model import MeshPackage

BASE_JOINTS = ("base_x", "base_y", "base_turn")  # in front of the root of a robot that drives


@dataclass(frozen=True)
class Mount:
    """Where a robot's root link goes, in the frame of a device or of the world.

    Attributes:
        note: What the place is, and whose choice.
        position: Of the root link's frame [m].
        rpy_deg: Turn of the root, fixed-axis roll, pitch, yaw [degrees].
        stand: Whether a stand of its own carries it there, and not the device.
    """

    position: Triple
    note: str = ""
    rpy_deg: Triple = ZERO
    stand: bool = False

    @property
    def pose(self) -> Pose:
        """The pose of the root."""
        return frame(self.position, self.rpy_deg)


@dataclass(frozen=True)
class ArmConfig:
    """An arm: what lies between the body of the robot and one tool.

    Attributes:
        joints: Names of the joints that actions move, base to tip. Joints that follow one of them
            are not named.
        tool_link: The link whose frame is the tool's: z forward, x up, unless turned by `tool_rpy_deg`.
        tool_at: Where the tool's frame lies in that link [m].
        tool_rpy_deg: How it is turned there, fixed-axis roll, pitch, yaw [degrees].
        wrist_link: The link whose joint carries the whole hand; a wrist wrench is felt there.
        base_joints: Those of `BASE_JOINTS` that help the arm while the base is not driven by itself.
        counterbalanced: Whether springs carry its weight, so that its motors need not.
        gripper: The gripper, if it has one.
    """

    joints: tuple[str, ...]
    tool_link: str
    tool_at: Triple = ZERO
    tool_rpy_deg: Triple = ZERO
    wrist_link: str | None = None
    base_joints: tuple[str, ...] = ()
    counterbalanced: bool = False
    gripper: GripperConfig | None = None

    def __post_init__(self) -> None:
        if not self.joints:
            raise ConfigError("an arm needs at least one joint")
        for name in self.base_joints:
            check_name("joint of the base", name, BASE_JOINTS)
        if list(self.base_joints) != [n for n in BASE_JOINTS if n in self.base_joints]:
            raise ConfigError(f"base_joints come in the order {', '.join(BASE_JOINTS)}")

    @property
    def has_own_tool(self) -> bool:
        """Whether the tool's frame is another one than its link's."""
        return (*self.tool_at, *self.tool_rpy_deg) != (*ZERO, *ZERO)


@dataclass(frozen=True)
class BaseConfig:
    """A base that drives on a flat floor.

    Wheels are not simulated: three joints in the plane of the floor carry the robot, and motors with
    the force of the wheels drive them.

    Attributes:
        kind: `differential` drives along x and turns, `omnidirectional` along y as well.
        speed: Greatest speed in each direction [m/s].
        turn: Greatest turning speed [rad/s].
        force: Greatest push [N].
        torque: Greatest torque about the vertical [N·m].
        source: Where the figures are from.
        reach: How far an arm may move the base with it: along [m], and turning [rad].
    """

    kind: Literal["differential", "omnidirectional"]
    speed: float
    turn: float
    force: float
    torque: float
    source: str
    reach: tuple[float, float] = (0.5, 0.8)  # our own choice: the base should not wander off

    def __post_init__(self) -> None:
        for name in ("speed", "turn", "force", "torque"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} of a base must be positive, got {getattr(self, name)}")


@dataclass(frozen=True)
class CameraMount:
    """Where a robot has a camera. Its frame: z forward, x right and y down in the picture.

    Attributes:
        link: The link that carries it.
        fov_deg: Vertical field of view [degrees].
        at: Place in the link [m].
        rpy: Turn in the link, fixed-axis roll, pitch, yaw [rad].
        source: Where the figures are from.
    """

    link: str
    fov_deg: float
    at: Triple = ZERO
    rpy: Triple = ZERO
    source: str = ""

    def __post_init__(self) -> None:
        if not 1 <= self.fov_deg <= 170:
            raise ConfigError(f"fov_deg of a camera must lie in [1, 170], got {self.fov_deg}")

    @property
    def pose(self) -> Pose:
        """The pose of the camera in its link."""
        return Pose(self.at, tuple(quaternion_from_rpy(*self.rpy).tolist()))


@dataclass(frozen=True)
class PublishedMass:
    """What a maker says that a robot weighs.

    Attributes:
        value: Mass [kg].
        source: Where it is from, and what was corrected for it.
    """

    value: float
    source: str


@dataclass(frozen=True)
class RobotConfig:
    """A robot model.

    Attributes:
        model: Its links and joints: a file below `assets/robots`, or the path of a YAML or URDF file.
        arms: The arms by name, the main one first: `arm`, or `right_arm` and `left_arm`.
        groups: Other joints that can be moved, such as `head` and `torso`.
        base: How it drives; None if it is bolted down.
        postures: Start postures by name: joints [rad or m]; joints not named are at 0, or at the
            limit nearest to it.
        mounts: Places for the root link by name.
        cameras: Cameras by name.
        published_mass: What it weighs by its maker.
        package: Where its real meshes can be had, if anywhere.
        contact_stiffness: Of contact with any link [N/m]; zero is rigid.
        contact_damping: Of contact with any link [N·s/m].
    """

    model: str
    arms: dict[str, ArmConfig]
    groups: dict[str, tuple[str, ...]] = field(default_factory=dict)
    base: BaseConfig | None = None
    postures: dict[str, dict[str, float]] = field(default_factory=lambda: {"home": {}})
    mounts: dict[str, Mount] = field(default_factory=dict)
    cameras: dict[str, CameraMount] = field(default_factory=dict)
    published_mass: PublishedMass | None = None
    package: MeshPackage | None = None
    contact_stiffness: float = 0.0
    contact_damping: float = 0.0

    def __post_init__(self) -> None:
        if not self.arms:
            raise ConfigError("a robot needs at least one arm")
        if "home" not in self.postures:
            raise ConfigError(f"postures need one called 'home', got {sorted(self.postures)}")
        for name in self.arms:
            if name != "arm" and not name.endswith("_arm"):
                raise ConfigError(f"an arm is called 'arm' or '<side>_arm', got {name!r}")
            if self.arms[name].base_joints and self.base is None:
                raise ConfigError(
                    f"{name!r} has base_joints, but the robot has no base that drives"
                )
        taken = [n for n in self.groups if n in self.parts_beside_groups()]
        if taken:
            raise ConfigError(f"groups {taken} are called like other parts of the robot")

    def mount_for(self, place: str, use: str) -> str:
        """Return the mount of a place for a use, such as `wheelchair_right_leg`, or of the place."""
        own = f"{place}_{use}"
        return own if own in self.mounts else place

    @property
    def main_arm(self) -> str:
        """Name of the first arm."""
        return next(iter(self.arms))

    @property
    def urdf(self) -> str | None:
        """The URDF of the user's own that is the model; None if it is another file."""
        is_urdf = Path(self.model).suffix.lower() in (".urdf", ".xml", ".xacro")
        return self.model if is_urdf else None

    def leading(self, moves: Sequence[str]) -> str:
        """Return the main arm of some parts: the first arm of them, or else the model's."""
        return next((name for name in moves if name in self.arms), self.main_arm)

    def gripper_shown(self, arm: str, moves: Sequence[str]) -> str:
        """Return what a gripper is called in actions and observations: the main arm's as if it were alone."""
        return "gripper" if arm == self.leading(moves) else gripper_name(arm)

    def parts_beside_groups(self) -> tuple[str, ...]:
        """Return the names of arms, grippers and base."""
        grippers = (gripper_name(n) for n, arm in self.arms.items() if arm.gripper is not None)
        return (*self.arms, *grippers, *(("base",) if self.base is not None else ()))

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of all that can be moved: arms, grippers, base, groups."""
        return (*self.parts_beside_groups(), *self.groups)


def gripper_name(arm: str) -> str:
    """Return the name of an arm's gripper: `gripper` of `arm`, `left_gripper` of `left_arm`."""
    return arm.removesuffix("arm") + "gripper"


def frame(position: Triple, rpy_deg: Triple) -> Pose:
    """Return the pose of a frame from its place [m] and fixed-axis angles [degrees]."""
    turn = quaternion_from_rpy(*(math.radians(angle) for angle in rpy_deg))
    return Pose(position, tuple(turn.tolist()))


def no_reach(config: RobotConfig, model: str, moves: Sequence[str]) -> str:
    """Return that no arm of a robot reaches, and what could help, for an error."""
    arms = [name for name in moves if name in config.arms]
    others = [name for name in config.arms if name != arms[0]]
    text = f"{model} has no arm that reaches"
    if others:
        text += f" with its {arms[0]} (the first of `moves`; it also has {', '.join(others)})"
    if "base" in moves and config.arms[arms[0]].base_joints:
        text += " while its base is driven by itself (without `base` it would help the arm)"
    return text


def load_robot(name: str | Path) -> RobotConfig:
    """Return the robot of that name, or from that YAML file.

    A `model` in a user's file is looked for beside it, then below `assets/robots`.
    """
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        return load(RobotConfig, assets.find("robots", str(name)))
    config = load(RobotConfig, path)
    beside = path.parent / config.model
    return replace(config, model=str(beside.resolve())) if os.path.isfile(beside) else config


def urdf_robot(
    urdf: str | Path,
    joints: Sequence[str],
    tool_link: str,
    *,
    tool_at: Triple = ZERO,
    tool_rpy_deg: Triple = ZERO,
    gripper: GripperConfig | Mapping[str, Any] | None = None,
    home: Mapping[str, float] | None = None,
) -> RobotConfig:
    """Return a robot described by a URDF of the user's own.

    Args:
        urdf: The file.
        joints: The joints of its arm, base to tip.
        tool_link: The link that carries the tool's frame.
        tool_at: Where the tool's frame lies in that link [m].
        tool_rpy_deg: How it is turned there, so that z is forward and x up [degrees].
        gripper: Its gripper, or the fields of a `GripperConfig`.
        home: Start posture, joints by name [rad or m].
    """
    if isinstance(gripper, Mapping):
        gripper = load(GripperConfig, gripper, "gripper")
    arm = ArmConfig(tuple(joints), tool_link, tool_at, tool_rpy_deg, gripper=gripper)
    # Where the Gen3 is mounted, our own choice: other places are given with the cast.
    gen3 = load_robot("kinova_gen3").mounts
    return RobotConfig(
        model=str(Path(urdf)),
        arms={"arm": arm},
        postures={"home": dict(home or {})},
        mounts={
            name: gen3[name]
            for name in ("floor", "table", "wheelchair_left", "wheelchair_right", "bed_side")
        },
    )
