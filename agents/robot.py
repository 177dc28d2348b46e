"""Robots: one class, one YAML file for each model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from rcare_marl import assets
from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.observable import Observable
from rcare_marl.pose import Pose, quaternion_from_rpy, rotation_vector
from rcare_marl.world import World

from .agent import Agent, Array
from .arm import Arm
from .control import CONTROLS, Control, JointTorque, ToolDelta, make_control
from .gripper import Gripper, GripperConfig
from .kinematics import Chain, IkResult
from .robot_model import Meshes, MeshPackage, robot_files

GripperUse = Literal["held", "free", "commanded"]


@dataclass(frozen=True)
class Mount:
    """Where a robot's base goes, in the frame of a device or of the world.

    Attributes:
        note: What the place is, and whose choice.
        position: Of the base link's frame [m].
        rpy_deg: Turn of the base, fixed-axis roll, pitch, yaw [degrees].
    """

    note: str
    position: tuple[float, float, float]
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        """The pose of the base."""
        turn = quaternion_from_rpy(*(math.radians(angle) for angle in self.rpy_deg))
        return Pose(self.position, tuple(turn.tolist()))


@dataclass(frozen=True)
class RobotConfig:
    """A robot model.

    Attributes:
        model: Its data, a file below `assets/robots`.
        arm_joints: Names of the joints that actions move, base to tip.
        tool_link: The link whose frame is the tool's: z forward, x up.
        postures: Start postures by name [rad or m], one value a joint; `home` is the default.
        mounts: Places for the base by name.
        gripper: The gripper, if it has one.
        package: Where its real meshes can be had, if anywhere.
        base: Whether the base is bolted down or drives.
        contact_stiffness: Of contact with any link [N/m]; zero is rigid.
        contact_damping: Of contact with any link [N·s/m].
    """

    model: str
    arm_joints: tuple[str, ...]
    tool_link: str
    postures: dict[str, tuple[float, ...]]
    mounts: dict[str, Mount] = field(default_factory=dict)
    gripper: GripperConfig | None = None
    package: MeshPackage | None = None
    base: Literal["fixed", "wheeled"] = "fixed"
    contact_stiffness: float = 0.0
    contact_damping: float = 0.0

    def __post_init__(self) -> None:
        if "home" not in self.postures:
            raise ConfigError(f"postures need one called 'home', got {sorted(self.postures)}")
        for name, posture in self.postures.items():
            if len(posture) != len(self.arm_joints):
                raise ConfigError(
                    f"posture {name!r} needs {len(self.arm_joints)} values, one a joint of the "
                    f"arm, got {len(posture)}"
                )


def load_robot(name: str | Path) -> RobotConfig:
    """Return the robot of that name, or from that YAML file."""
    path = Path(name)
    is_file = path.suffix in (".yaml", ".yml")
    return load(RobotConfig, path if is_file else assets.find("robots", str(name)))


class Robot(Agent):
    """A robot arm with a gripper under one of the control modes.

    Attributes:
        name: The role that it plays.
        config: Its model.
        files: What was loaded.
        body: Its body, once spawned.
        arm: Its arm, once spawned.
        control: Its control mode, once spawned.
    """

    body: Body
    arm: Arm
    control: Control

    def __init__(
        self,
        name: str,
        config: RobotConfig,
        *,
        control: str = "tool_delta",
        posture: str | None = None,
        posture_noise: float = 0.0,
        gripper: GripperUse = "held",
        grip_width: float = 0.02,
        contact_force: float = ToolDelta.CONTACT_FORCE,
        meshes: Meshes = "never",
        urdf: str | Path | None = None,
        self_collision: bool = False,
    ) -> None:
        """Choose how the robot is built and driven.

        Args:
            name: The role that it plays.
            config: The model.
            control: One of `CONTROLS`.
            posture: Name of the start posture; that of the mount, or `home`, if None.
            posture_noise: Standard deviation of the start posture [rad or m].
            gripper: `held` freezes the fingers round something `grip_width` thick, which makes the
                simulation faster; `free` leaves them to `set_gripper`; `commanded` adds an action
                value that closes (1) and opens (-1) them.
            grip_width: Gap between the fingers at the start [m].
            contact_force: Force at the tool from which `tool_delta` gives way [N].
            meshes: Whether to draw the real meshes of an optional package; the physics is the same.
            urdf: A URDF of the user's own with the joints and links that `config` names.
            self_collision: Whether links of the robot collide with each other.

        Raises:
            UnknownNameError: If there is no such control mode, posture, joint or link.
            ConfigError: If the model cannot be used, or an option is impossible.
            MissingPackageError: If meshes are required and not installed.
        """
        if control not in CONTROLS:
            raise UnknownNameError("control mode", control, CONTROLS)
        if posture is not None and posture not in config.postures:
            raise UnknownNameError("posture", posture, config.postures)
        if gripper not in ("held", "free", "commanded"):
            raise UnknownNameError("use of a gripper", gripper, ("held", "free", "commanded"))
        if contact_force <= 0:
            raise ConfigError(f"contact_force must be positive, got {contact_force} N")
        self.name, self.config = name, config
        self._control_name = control
        self._posture_name, self._posture_is_chosen = posture or "home", posture is not None
        self._noise, self._contact_force = posture_noise, contact_force
        self._self_collision = self_collision
        self._commanded = gripper == "commanded"
        self.files = robot_files(config.model, config.package, urdf=urdf, meshes=meshes)
        self.gripper: Gripper | None = None
        frozen: dict[str, float] = {}
        if config.gripper is not None:
            self.gripper = Gripper(config.gripper, self.files.model, grip_width)
            frozen = self.gripper.positions(self.gripper.start)
        elif self._commanded:
            raise ConfigError(f"{self.files.model.name} has no gripper to command")
        if gripper == "held" and urdf is None:  # in a user's own URDF motors hold the fingers
            self.files = robot_files(
                config.model,
                config.package,
                meshes=meshes,
                fixed_joints=frozen,
                melt_except=(config.tool_link,),
            )
        self._chain = Chain(self.files.model, config.arm_joints, config.tool_link, others=frozen)

    @property
    def action_size(self) -> int:
        return len(self.action_names)

    @property
    def action_names(self) -> tuple[str, ...]:
        names = self.control.names
        return (*names, "gripper closing [1]") if self._commanded else names

    @property
    def tool_index(self) -> int:
        """Index of the tool link in the body."""
        return self.body.link_index(self.config.tool_link)

    def mount(self, name: str, on: Pose = Pose()) -> Pose:
        """Return the pose of the base for the mount `name` of a device that stands at `on`.

        Before `spawn` this also chooses the start posture of that name, if the model has one and
        none was asked for.

        Raises:
            UnknownNameError: If the model has no mount of that name.
        """
        if name not in self.config.mounts:
            raise UnknownNameError("mount", name, self.config.mounts)
        if not self._posture_is_chosen and name in self.config.postures:
            self._posture_name = name
        return on @ self.config.mounts[name].pose

    def spawn(self, world: World, pose: Pose) -> None:
        self._world = world
        self.body = world.load_urdf(
            self.files.urdf, pose, name=self.name, self_collision=self._self_collision
        )
        if self.config.contact_stiffness > 0:
            self.body.set_softness(
                stiffness=self.config.contact_stiffness, damping=self.config.contact_damping
            )
        rest = self.config.postures[self._posture_name]
        self.arm = Arm(world, self.body, self._chain, rest)
        self._period = np.where(np.isinf(self.arm.upper), 2 * np.pi, 1e9)
        self._tool = self.tool_index
        self.control = make_control(self._control_name, self.arm)
        if isinstance(self.control, ToolDelta):
            self.control.contact_force = self._contact_force
        if self.gripper is not None:
            self.gripper.bind(self.body)
            self.gripper.drive(self.gripper.start, teleport=True)
        self.set_posture(rest)
        self.sense()

    def reset(self, rng: np.random.Generator) -> None:
        self._chain.place(self.body.base_pose())
        posture = np.array(self.config.postures[self._posture_name])
        if self._noise:
            posture += rng.normal(0.0, self._noise, len(posture))
        if self.gripper is not None:
            self.gripper.drive(self.gripper.start, teleport=True)
        self.set_posture(posture)

    def command(self, action: Array, duration: float) -> None:
        if self._commanded and self.gripper is not None:
            self.gripper.advance(float(action[-1]), duration)
            action = action[:-1]
        self.control.command(action, duration)

    @property
    def needs_actuation(self) -> bool:
        return isinstance(self.control, (JointTorque, ToolDelta))

    def actuate(self) -> None:
        self.control.actuate()

    def place(self, base: Pose) -> None:
        """Move the base to `base` in the world; the arm keeps its posture, at rest."""
        self.body.set_base(base)
        self._chain.place(base)
        self.control.reset()

    def set_posture(self, posture: Sequence[float] | Array) -> None:
        """Teleport the arm to `posture` [rad or m], shape [n], cut to its limits, and hold it."""
        values = np.clip(np.asarray(posture, np.float64), self.arm.lower, self.arm.upper)
        self.body.set_joints(self.arm.indices, values)
        self.control.reset()

    def tool_pose(self) -> Pose:
        """Return the pose of the tool in the world."""
        return self._chain.tip_pose(self.arm.positions())

    def solve_ik(
        self,
        pose: Pose,
        *,
        seed: Sequence[float] | Array | None = None,
        position_only: bool = False,
    ) -> IkResult:
        """Return the posture that puts the tool at `pose`, within limits; nothing moves.

        Args:
            pose: The wished pose of the tool in the world.
            seed: Posture to start from; the present one if None.
            position_only: Whether any orientation will do.
        """
        start = self.arm.positions() if seed is None else np.asarray(seed, np.float64)
        return self.arm.solve(pose, start, position_only=position_only)

    def grasp(self, body: Body, body_in_tool: Pose = Pose(), *, force: float = 500.0) -> Attachment:
        """Put the base of `body` at `body_in_tool` in the tool's frame and bond it there.

        The robot and what it holds do not collide from then on.
        """
        body.set_base(self.tool_pose() @ body_in_tool)
        self._world.set_collision(self.body, body, False)
        return self._world.attach(self.body, self.config.tool_link, body, body_in_tool, force=force)

    def set_gripper(self, closing: float) -> None:
        """Drive the gripper to `closing`: 0 is open, 1 is closed.

        Raises:
            ConfigError: If the robot has no gripper, or its fingers are frozen.
        """
        if self.gripper is None or not self.gripper.is_movable:
            raise ConfigError(
                f"{self.name!r} cannot move its fingers: build the robot with gripper='free'"
            )
        self.gripper.drive_fraction(closing)

    def sense(self) -> None:
        positions, self._velocities, _ = self.arm.read()
        pose = self.body.link_pose(self._tool)
        # A continuous joint is at the same place every turn.
        self._positions = positions - self._period * np.rint(positions / self._period)
        self._tool_position = pose.position
        self._tool_rotation = rotation_vector(pose.quaternion)

    def observables(self) -> Sequence[Observable]:
        count = len(self.arm)
        out = [
            Observable("joint_position", "rad", count, lambda: self._positions),
            Observable("joint_velocity", "rad/s", count, lambda: self._velocities),
            Observable("tool_position", "m", 3, lambda: self._tool_position),
            Observable("tool_rotation", "rad", 3, lambda: self._tool_rotation),
        ]
        gripper = self.gripper
        if gripper is not None and gripper.is_movable:
            out.append(Observable("gripper_closing", "1", 1, lambda: [gripper.closing()]))
        return out

    def describe(self) -> dict[str, str]:
        return {
            "model": self.files.model.name,
            "control": self._control_name,
            "physics": self.files.physics,
            "visuals": self.files.visuals,
            "mass": f"{self.files.model.mass:.3f} kg",
            "movable joints": str(len(self.body.joints)),
        }
