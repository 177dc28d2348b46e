"""Robots: one class, one YAML file for each model."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, UnknownNameError, check_name
from rcare_marl.model.urdf import Follow
from rcare_marl.observable import Observable
from rcare_marl.pose import Pose
from rcare_marl.world import World

from ..agent import Agent, Array
from .arm import Arm
from .control import (
    CONTROLS,
    GROUP_CONTROLS,
    WEIGHT_CARRYING,
    BaseVelocity,
    Compliance,
    Control,
    GripperClosing,
    JointDelta,
    ToolDelta,
    make_control,
    moving_tool,
)
from .gripper import Grasp, Gripper
from .joint_group import JointGroup
from .kinematics import IkResult
from .mobile_base import MobileBase
from .robot_assembly import Assembly, assemble
from .robot_config import Mount, RobotConfig, gripper_name
from .robot_model import Meshes, RobotFiles
from .robot_part import Part, closing
from .self_collision import touching_links

if TYPE_CHECKING:
    from ..sensing.marker import MarkerConfig
    from ..sensing.suite import SensorSuite

GripperUse = Literal["held", "free", "commanded"]

MOST_NOISE = 1.0  # [rad or m] of a start posture; our own choice


class Robot(Agent):
    """A robot: one arm or two under one of the control modes, and what else of it is to move.

    Attributes:
        name: The role that it plays.
        config: Its model.
        moves: Names of the parts that actions move, in the order of the action.
        chosen_mount: Where it is mounted in place of where the task says.
        body: Its body, once spawned.
        arms: Its arms that move by name, once spawned.
        groups: Its head, torso and so on that move, by name, once spawned.
        base: Its base, if it is driven by itself, once spawned.
        parts: The parts that move by name, once spawned.
        acting: What `actuate` calls, once spawned.
    """

    body: Body
    arms: dict[str, Arm]
    groups: dict[str, JointGroup]
    base: MobileBase | None
    parts: dict[str, Part]
    acting: list[Callable[[], None]]

    def __init__(
        self,
        name: str,
        config: RobotConfig,
        *,
        control: str = "tool_delta",
        moves: Sequence[str] | None = None,
        posture: str | Mapping[str, float] | None = None,
        posture_noise: float = 0.0,
        gripper: GripperUse = "held",
        grip_width: float = 0.02,
        mount: str | Mount | None = None,
        contact_force: float = ToolDelta.CONTACT_FORCE,
        contact_torque: float = 0.0,
        compliance: Compliance = Compliance(),
        meshes: Meshes = "never",
        self_collision: bool = False,
    ) -> None:
        """Choose how the robot is built and driven.

        Args:
            name: The role that it plays.
            config: The model.
            control: Control mode of the arms, one of `CONTROLS`; head and torso take the same one
                if it is `joint_position` or `joint_velocity`, else `joint_delta`.
            moves: Parts that actions move, such as `("right_arm", "base")`; the main arm if None.
                All other joints are frozen in the start posture, which makes the simulation faster.
            posture: Name of the start posture, or joint positions [rad or m] by joint; that of the
                mount, or `home`, if None.
            posture_noise: Standard deviation of the start posture of the arms [rad or m].
            gripper: `held` freezes the fingers round something `grip_width` thick, which makes the
                simulation faster; `free` leaves them to `set_gripper`; `commanded` adds the gripper
                of the main arm to `moves`.
            grip_width: Gap between the fingers of the main arm at the start [m].
            mount: Its mount in place of the task's: by name, or a place of its own in the same frame.
            contact_force: Force at the tool from which `tool_delta` gives way [N].
            contact_torque: Torque with which it may turn what it holds; see `ToolDelta` [N·m].
            compliance: How the tool yields under `impedance` and `admittance`.
            meshes: Whether to draw the real meshes of an optional package; the physics is the same.
            self_collision: Whether links of the robot collide with each other.

        Raises:
            UnknownNameError: If there is no such control mode, part, posture, joint or link.
            ConfigError: If the model cannot be used, or an option is impossible.
            MissingPackageError: If meshes are required and not installed.
        """
        check_name("control mode", control, CONTROLS)
        if isinstance(posture, str):
            check_name("posture", posture, config.postures)
        check_name("use of a gripper", gripper, ("held", "free", "commanded"))
        contact = (contact_force, contact_torque)
        if not 0 < contact_force < math.inf or not 0 <= contact_torque < math.inf:
            raise ConfigError(f"contact must be above 0 N and at least 0 N·m, got {contact}")
        if not 0 <= posture_noise <= MOST_NOISE:
            raise ConfigError(f"posture_noise must be 0 to {MOST_NOISE}, got {posture_noise}")
        self.name, self.config = name, config
        self._control_name, self._gripper_use = control, gripper
        self._noise, self._gentleness = posture_noise, (contact, compliance)
        self._grip_width, self._meshes = grip_width, meshes
        self._self_collision = self_collision
        if isinstance(mount, str):
            check_name("mount", mount, config.mounts)
        self.chosen_mount = mount
        self._posture: str | Mapping[str, float] = "home" if posture is None else posture
        self._posture_is_chosen = posture is not None
        self.moves = self._checked_moves(moves)
        self._assembly: Assembly | None = self._assemble()
        self.parts, self.arms, self.groups, self.base = {}, {}, {}, None
        self._grasps: dict[str, Grasp] = {}

    def equip(self, sensors: SensorSuite | None, markers: Sequence[MarkerConfig] = ()) -> None:
        super().equip(sensors, markers)
        if self.kept_links():
            self.forget_assembly()

    def _checked_moves(self, moves: Sequence[str] | None) -> tuple[str, ...]:
        config = self.config
        chosen = (config.main_arm,) if moves is None else tuple(moves)
        main_gripper = gripper_name(config.leading(chosen))
        for part in chosen:
            check_name("part of the robot", part, config.parts)
        if len(set(chosen)) != len(chosen):
            raise ConfigError(f"moves names a part twice: {chosen}")
        if self._gripper_use == "commanded" and main_gripper not in chosen:
            if main_gripper not in config.parts:
                raise ConfigError(f"{self.name!r} has no gripper to command")
            chosen = (*chosen, main_gripper)
        return chosen

    def _assemble(self) -> Assembly:
        config, posture = self.config, self._posture
        is_free = self._gripper_use == "free"
        free = [arm for arm in config.arms if is_free or gripper_name(arm) in self.moves]
        return assemble(
            config,
            moves=self.moves,
            free_grippers=[arm for arm in free if config.arms[arm].gripper is not None],
            grip_width=self._grip_width,
            posture=config.postures[posture] if isinstance(posture, str) else posture,
            meshes=self._meshes,
            kept_links=self.kept_links(),
        )

    @property
    def assembly(self) -> Assembly:
        """The robot as it is loaded."""
        if self._assembly is None:
            self._assembly = self._assemble()
        return self._assembly

    def forget_assembly(self) -> None:
        """Put the model together anew at the next use, since what it depends on has changed."""
        self._assembly = None

    @property
    def files(self) -> RobotFiles:
        """What is loaded."""
        return self.assembly.files

    @property
    def arm(self) -> Arm:
        """The main arm that moves; ConfigError if none does."""
        return self.arms[self._main]

    @property
    def control(self) -> Control:
        """Control mode of the main arm; ConfigError if no arm moves."""
        return self.parts[self._main].control

    def tool_action(self, linear: Array, angular: Array) -> Array:
        """Return the action of the main arm that moves its tool so; see `ToolDelta.action`."""
        return moving_tool(self.control).action(linear, angular)

    @property
    def _main(self) -> str:
        """Name of the main arm that moves."""
        if (arm := self.config.leading(self.moves)) not in self.moves:
            moves, known = ", ".join(self.moves), ", ".join(self.config.arms)
            raise ConfigError(f"{self.name!r} moves {moves}, and none of it is an arm: add {known}")
        return arm

    @property
    def gripper(self) -> Gripper | None:
        """Gripper of the main arm."""
        return self.assembly.grippers.get(self._main)

    @property
    def hands(self) -> list[tuple[str, str]]:
        """The finger links of each hand."""
        return [gripper.config.fingers for gripper in self.assembly.grippers.values()]

    @property
    def action_size(self) -> int:
        return len(self.action_names)

    @property
    def action_names(self) -> tuple[str, ...]:
        return tuple(name for part in self.parts.values() for name in part.control.names)

    @property
    def tool_link(self) -> str:
        """The link whose frame is the tool's of the main arm."""
        return self.assembly.tools[self._main]

    @property
    def tool_index(self) -> int:
        """Index of the main arm's tool link in the body."""
        return self.body.link_index(self.tool_link)

    def mount(self, name: str, on: Pose = Pose(), *, with_posture: bool = True) -> Pose:
        """Return the pose of the root for the mount `name` of a device that stands at `on`.

        A mount that was chosen when the robot was built takes the place of `name`. Before `spawn`
        this also chooses the start posture of that name, if the model has one and none was asked for.

        Args:
            name: The mount.
            on: Pose of the device in the world.
            with_posture: Whether the mount chooses the posture.

        Raises:
            UnknownNameError: If the model has no mount of that name.
            ConfigError: As for `mount_named`.
        """
        mount = self.mount_named(name)
        chosen = self.chosen_mount or name
        if with_posture and isinstance(chosen, str) and not self._posture_is_chosen:
            if chosen in self.config.postures:
                self._posture = chosen
                self.forget_assembly()
        return on @ mount.pose

    def mount_named(self, name: str) -> Mount:
        """Return the mount `name`, or the one that was chosen in its place.

        Raises:
            UnknownNameError: If the model has no mount of that name.
            ConfigError: If it is one on a wheelchair and no arm of the model reaches from there.
        """
        chosen = self.chosen_mount or name
        if isinstance(chosen, Mount):
            return chosen
        if chosen in self.config.mounts:
            return self.config.mounts[chosen]
        if chosen in ("wheelchair_left", "wheelchair_right"):
            raise ConfigError(
                f"{self.files.model.name} has no arm that reaches a person in a wheelchair: it has no "
                f"mount {chosen!r}, only {', '.join(self.config.mounts)}. Give it a place with "
                "mount={'position': [x, y, z]} to try"
            )
        raise UnknownNameError("mount", chosen, self.config.mounts)

    def spawn(self, world: World, pose: Pose) -> None:
        self.world = world
        assembly = self.assembly
        self.body = world.load_urdf(
            assembly.files.urdf,
            pose,
            name=self.name,
            fixed=not self.rides,
            self_collision=self._self_collision,
        )
        if self._self_collision:
            self.body.exclude_pairs(touching_links(assembly.files.model, self.body, self.hands))
        if (c := self.config).contact_stiffness > 0:
            self.body.set_softness(stiffness=c.contact_stiffness, damping=c.contact_damping)
        for gripper in assembly.grippers.values():
            gripper.bind(self.body)
        for name in self.moves:
            self.parts[name] = self._make_part(world, assembly, name)
        controls = [part.control for part in self.parts.values()]
        self.acting = [control.actuate for control in controls if control.needs_actuation]
        if self._control_name not in WEIGHT_CARRYING:
            springs = [arm for arm in self.arms.values() if arm.counterbalanced]
            self.acting += [arm.balance for arm in springs]
        grippers = [g for g in assembly.grippers.values() if g.is_movable]
        self.acting += [gripper.align for gripper in grippers]
        self.set_start()
        self.sense()

    def _make_part(self, world: World, assembly: Assembly, name: str) -> Part:
        config = self.config
        if name in config.arms:
            chain = assembly.chains[name]
            arm = Arm(
                world,
                self.body,
                chain,
                [assembly.start[j] for j in chain.joints],
                _following(assembly, chain.joints),
                assembly.roots[name],
            )
            arm.counterbalanced = config.arms[name].counterbalanced
            self.arms[name] = arm
            control = make_control(self._control_name, arm, *self._gentleness)
            tool = self.body.link_index(assembly.tools[name])
            return Part(
                name,
                control,
                joints=arm,
                tool=lambda: self.body.link_pose(tool),
                prefix="" if name == self._main else f"{name}_",
            )
        if name in config.groups:
            joints = assembly.groups[name]
            rest = [assembly.start[j] for j in joints]
            group = JointGroup(world, self.body, joints, rest, _following(assembly, joints))
            self.groups[name] = group
            make = GROUP_CONTROLS.get(self._control_name, JointDelta)
            return Part(name, make(group), joints=group)
        if name == "base":
            assert config.base is not None  # or `base` would be no part
            self.base = MobileBase(self.body, config.base)
            return Part(name, BaseVelocity(self.base), base=self.base)
        of = next(arm for arm in assembly.grippers if gripper_name(arm) == name)
        shown = config.gripper_shown(of, self.moves)
        return Part(shown, GripperClosing(assembly.grippers[of], shown))

    def reset(self, rng: np.random.Generator) -> None:
        self.set_start()
        if self._noise:
            (own,) = rng.spawn(1)  # the noise of a robot changes nothing else of an episode
            for arm in self.arms.values():
                self._teleport(arm, arm.rest + own.normal(0.0, self._noise, len(arm)))

    def set_start(self) -> None:
        """Put every part that moves into its start posture, at rest."""
        if self.base is not None:
            self.base.teleport()
        for gripper in self.assembly.grippers.values():
            gripper.drive(gripper.start, teleport=True)
        for part in self.parts.values():
            if part.joints is not None:
                part.joints.teleport(
                    np.clip(part.joints.rest, part.joints.lower, part.joints.upper)
                )
        self._renew()

    def _renew(self) -> None:
        for arm in self.arms.values():
            arm.track()
        for part in self.parts.values():
            part.control.reset()

    def command(self, action: Array, duration: float) -> None:
        for arm in self.arms.values():
            if arm.is_carried:
                arm.track()
        start = 0
        for part in self.parts.values():
            size = part.control.size
            part.control.command(action[start : start + size], duration)
            start += size
        for grasp in self._grasps.values():
            grasp.update()

    @property
    def needs_actuation(self) -> bool:
        return bool(self.acting)

    def add_part(self, part: Part) -> None:
        """Let actions move `part` too, such as what the robot rides on; after `spawn`."""
        self.parts[part.name] = part
        self.acting.append(part.control.actuate)

    def actuate(self) -> None:
        for act in self.acting:
            act()

    def place(self, base: Pose) -> None:
        """Move the root to `base` in the world; all parts keep their posture, at rest."""
        self.body.set_base(base)
        self._renew()

    def set_posture(self, posture: Sequence[float] | Array) -> None:
        """Teleport the main arm to `posture` [rad or m], shape [n], within limits, and hold it."""
        self._teleport(self.arm, np.asarray(posture, np.float64))

    def set_tool(self, pose: Pose, near: Array | None = None) -> None:
        """Teleport the main arm, bent as it is or as in the posture `near` [n], with its tool at `pose`."""
        self.set_posture(self.solve_ik(pose, seed=near, near=True).posture)

    def _teleport(self, arm: Arm, posture: Array) -> None:
        arm.teleport(np.clip(posture, arm.lower, arm.upper))
        self._renew()

    def tool_pose(self, arm: str | None = None) -> Pose:
        """Return the pose of the tool in the world, of the main arm if none is named."""
        chosen = self._named_arm(arm)
        return chosen.chain.tip_pose(chosen.positions())

    def _named_arm(self, arm: str | None) -> Arm:
        if arm is not None:
            check_name(f"arm of {self.name!r} that moves", arm, self.arms)
        chosen = self.arm if arm is None else self.arms[arm]
        if chosen.is_carried:
            chosen.track()
        return chosen

    def solve_ik(
        self, pose: Pose, *, seed: Array | None = None, arm: str | None = None, near: bool = False
    ) -> IkResult:
        """Return the posture that puts the tool at `pose`, within limits; nothing moves.

        Args:
            pose: The wished pose of the tool in the world.
            seed: Posture to start from; the present one if None.
            arm: Which arm; the main one if None.
            near: Whether to miss `pose` a little rather than to bend the arm another way, see `Arm.solve`.
        """
        chosen = self._named_arm(arm)
        start = chosen.positions() if seed is None else np.asarray(seed, np.float64)
        return chosen.solve(pose, start, near=near)

    def grasp(self, body: Body, body_in_tool: Pose = Pose(), *, force: float = 500.0) -> Attachment:
        """Put the base of `body` at `body_in_tool` in the main tool's frame and bond it there.

        The robot and what it holds do not collide from then on. A gripper that is commanded lets go
        of it once the gap between its fingers is wider by `gripper.RELEASE` than at the start.
        """
        pose = self.tool_pose() @ body_in_tool
        arm = self._main
        if arm not in self._grasps:
            self._grasps[arm] = Grasp(self.world, self.body, self.tool_link, self.gripper)
        return self._grasps[arm].take(body, pose, body_in_tool, force=force)

    def set_gripper(self, closing: float, *, arm: str | None = None) -> None:
        """Drive a gripper, that of the main arm if none is named: 0 is open, 1 is closed.

        Raises:
            ConfigError: If the arm has no gripper, or its fingers are frozen.
        """
        gripper = self.assembly.grippers.get(arm or self._main)
        if gripper is None or not gripper.is_movable:
            raise ConfigError(
                f"{self.name!r} cannot move its fingers: build the robot with gripper='free'"
            )
        gripper.drive_fraction(closing)

    def sense(self) -> None:
        for part in self.parts.values():
            part.sense()

    def observables(self) -> Sequence[Observable]:
        out = [observable for part in self.parts.values() for observable in part.observables()]
        if self._gripper_use == "free":
            for arm, gripper in self.assembly.grippers.items():
                if gripper.is_movable:
                    out.append(closing(self.config.gripper_shown(arm, self.moves), gripper))
        return out

    def describe(self) -> dict[str, str]:
        return {
            "model": self.files.model.name,
            "control": self._control_name,
            "moves": ", ".join(self.moves),
            "physics": self.files.physics,
            "visuals": self.files.visuals,
            "mass": f"{self.files.model.mass:.3f} kg",
            "movable joints": str(len(self.body.joints)),
        }


def _following(assembly: Assembly, joints: Sequence[str]) -> dict[str, Follow]:
    return {n: rule for n, rule in assembly.followers.items() if rule.joint in joints}
