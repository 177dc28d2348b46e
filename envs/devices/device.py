"""A device: one body made from data, with named frames and joints that are worked by name."""

from __future__ import annotations

import abc
import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real

import pybullet as bullet

from rcare_marl.body import Body
from rcare_marl.errors import ActionError, UnknownNameError, WorldError
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.urdf import Model, Triple, write
from rcare_marl.world import World

_ROUNDING = 1e-4  # of limits and targets, and of joints that are pressed against a limit [rad or m]


@dataclass(frozen=True)
class Frame:
    """A place on a device, in the device's frame.

    Attributes:
        position: Origin [m].
        rpy_deg: Turn, fixed-axis roll, pitch, yaw [degrees].
        note: What it is.
    """

    position: Triple
    rpy_deg: Triple = (0.0, 0.0, 0.0)
    note: str = ""

    @property
    def pose(self) -> Pose:
        """The pose of the frame in the device."""
        turn = quaternion_from_rpy(*(math.radians(angle) for angle in self.rpy_deg))
        return Pose(self.position, tuple(turn.tolist()))


@dataclass(frozen=True)
class DeviceControl:
    """A motor, actuator or hand that works one joint of a device.

    Attributes:
        joint: The joint.
        speed: Greatest speed [rad/s or m/s].
        force: Greatest force or torque [N or N·m]; what holds it where it stands, too.
        note: What it does.
    """

    joint: str
    speed: float
    force: float
    note: str = ""


class Device(abc.ABC):
    """A body made from data.

    Its controls are worked by name: `command` drives one to a place, `stop` holds it, `position` tells
    where it stands, `limits` how far it goes, and `set_position` puts it there at once.
    """

    postures: Mapping[str, tuple[str, str]] = {}  # how people rest in it: posture, frame
    _fixed = True
    _body: Body | None = None
    _client: int
    _frame_poses: dict[str, Pose]  # of those that were asked for, once it is in a world

    @property
    def body(self) -> Body:
        """Its body; WorldError before `spawn`."""
        return self._need_body()

    def _need_body(self) -> Body:
        if self._body is None:
            raise WorldError(f"this {type(self).__name__} is in no world yet: spawn it first")
        return self._body

    @abc.abstractmethod
    def model(self) -> Model:
        """Return its links and shapes."""

    @property
    @abc.abstractmethod
    def frames(self) -> Mapping[str, Frame]:
        """Named places on it."""

    @property
    def controls(self) -> Mapping[str, DeviceControl]:
        """What can be worked by `command`; all other joints move freely, within their friction."""
        return {}

    @property
    def pose(self) -> Pose:
        """The present pose of the device in the world."""
        return self.body.base_pose()

    def frame(self, name: str) -> Pose:
        """Return the pose of a named frame in the device; UnknownNameError if there is none."""
        if self._body is not None and name in self._frame_poses:
            return self._frame_poses[name]
        frames = self.frames
        if name not in frames:
            raise UnknownNameError("frame", name, frames)
        if self._body is not None:  # its sizes do not change any more
            self._frame_poses[name] = frames[name].pose
        return frames[name].pose

    def frame_in_world(self, name: str) -> Pose:
        """Return the present pose of a named frame in the world."""
        return self.pose @ self.frame(name)

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        """Load it into `world` at `pose`, once, and return its body; WorldError the second time."""
        if self._body is not None:
            raise WorldError(f"{self._body.name!r} was spawned already: make another device")
        model = self.model()
        # Fixed joints cost nothing where their links melt into those that carry them.
        path = write(model, melt_except=self._kept_links())
        body = world.load_urdf(path, pose, name=name or model.name, fixed=self._fixed)
        self._body, self._client = body, world.client
        self._frame_poses = {}
        for joint, moving in body.joints.items():
            body.release_motors([moving.index], model.joints[joint].friction)
        self.reset()
        return body

    def _kept_links(self) -> tuple[str, ...]:
        """Return the links that stay links of their own although they hang on a fixed joint."""
        return ()

    def reset(self) -> None:
        """Hold what is controlled where it stands: motor targets do not return with a snapshot."""
        for name in self.controls:
            self.stop(name)

    def command(self, name: str, target: float) -> None:
        """Drive a control to `target` [rad or m] at its speed at most.

        Raises:
            UnknownNameError: If there is no such control.
            ActionError: If `target` is not a number within its limits.
            WorldError: If the device is in no world.
        """
        self._check(name, target)
        self._drive(name, target)

    def _drive(self, name: str, target: float) -> None:
        control = self._control(name)
        joint = self.body.joint(control.joint)
        self.body.wake()
        bullet.setJointMotorControl2(
            self.body.uid,
            joint.index,
            bullet.POSITION_CONTROL,
            targetPosition=min(max(float(target), joint.lower), joint.upper),
            force=control.force,
            maxVelocity=control.speed,
            positionGain=1.0,
            velocityGain=1.0,
            physicsClientId=self._client,
        )

    def stop(self, name: str) -> None:
        """Hold a control where it stands; UnknownNameError if there is none of that name."""
        self._drive(name, self.position(name))

    def position(self, name: str) -> float:
        """Return where a control stands [rad or m]; UnknownNameError if there is none."""
        index = self.body.joint(self._control(name).joint).index
        return self.body.joint_states([index])[0][0]

    def set_position(self, name: str, position: float) -> None:
        """Put a control at `position` [rad or m] at once and hold it there; raises as `command`."""
        self._check(name, position)
        joint = self.body.joint(self._control(name).joint)
        self.body.set_joints([joint.index], [min(max(position, joint.lower), joint.upper)])
        self.stop(name)

    def limits(self, name: str) -> tuple[float, float]:
        """Return how far a control goes, least and most [rad or m]; raises as `position`."""
        joint = self.body.joint(self._control(name).joint)
        return joint.lower, joint.upper

    def _check(self, name: str, target: float) -> None:
        low, high = self.limits(name)
        if not isinstance(target, Real) or not math.isfinite(target):
            raise ActionError(
                f"{name!r} of {self.body.name!r} needs a finite number, got {target!r}"
            )
        if not low - _ROUNDING <= target <= high + _ROUNDING:
            unit = "m" if self.body.joint(self._control(name).joint).kind == "prismatic" else "rad"
            raise ActionError(
                f"{name!r} of {self.body.name!r} goes from {low:.4g} to {high:.4g} {unit}, not to"
                f" {target:.4g}"
            )

    def _control(self, name: str) -> DeviceControl:
        if name not in self.controls:
            raise UnknownNameError("control", name, self.controls)
        return self.controls[name]
