"""Messages of ROS 2 from what we have, and back. Imports ROS: see `ros` in docs/ros.md."""

from __future__ import annotations

import array
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import TransformStamped, WrenchStamped
from sensor_msgs.msg import CameraInfo, Image, JointState
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from rcare_marl.pose import Array, Pose, Vector

WORLD = "world"


def seconds(stamp: Time) -> float:
    """Return a time or a duration [s]."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def moment(time: float) -> Time:
    """Return a time [s] as a message."""
    whole, part = divmod(round(time * 1e9), 10**9)
    return Time(sec=int(whole), nanosec=int(part))


def joint_state(stamp: Time, names: Sequence[str], states: Sequence[Array]) -> JointState:
    """Return positions, velocities and efforts of joints, each of shape [n]."""
    out = JointState(name=list(names))
    out.header.stamp = stamp
    out.position, out.velocity, out.effort = (each.tolist() for each in states)
    return out


def transforms(stamp: Time, frames: Mapping[str, Pose], prefix: str = "") -> TFMessage:
    """Return the poses of frames in the world."""
    out = []
    for name, pose in frames.items():
        each = TransformStamped(child_frame_id=prefix + name)
        each.header.stamp, each.header.frame_id = stamp, WORLD
        _fill(each.transform.translation, pose.position, "xyz")
        _fill(each.transform.rotation, pose.quaternion, "xyzw")
        out.append(each)
    return TFMessage(transforms=out)


def _fill(message: Any, values: Vector, names: str) -> None:
    for name, value in zip(names, values, strict=True):
        setattr(message, name, float(value))


def wrench(stamp: Time, frame: str, values: Array) -> WrenchStamped:
    """Return force [N] and torque [N·m], shape [6], along the axes of a frame."""
    out = WrenchStamped()
    out.header.stamp, out.header.frame_id = stamp, frame
    _fill(out.wrench.force, values[:3], "xyz")
    _fill(out.wrench.torque, values[3:], "xyz")
    return out


def pose_of(message: PoseMessage) -> Pose:
    """Return the pose in a message, its quaternion of length one."""
    place, turn = message.position, message.orientation
    quaternion = np.array((turn.x, turn.y, turn.z, turn.w))
    quaternion /= max(float(np.linalg.norm(quaternion)), 1e-9)
    return Pose((place.x, place.y, place.z), tuple(quaternion.tolist()))


def vector(message: Any) -> list[float]:
    """Return x, y, z of a message."""
    return [message.x, message.y, message.z]


def picture(stamp: Time, frame: str, pixels: Array) -> Image:
    """Return a picture, uint8 of shape [height, width, 3]."""
    height, width = pixels.shape[:2]
    out = Image(height=height, width=width, encoding="rgb8", step=3 * width)
    out.header.stamp, out.header.frame_id = stamp, frame
    out.data = array.array("B", np.ascontiguousarray(pixels).tobytes())
    return out


def lens(stamp: Time, frame: str, shape: Sequence[int], fov_deg: float) -> CameraInfo:
    """Return what a camera sees with, of a vertical field of view and without distortion."""
    height, width = int(shape[0]), int(shape[1])
    focus = 0.5 * height / float(np.tan(np.radians(fov_deg) / 2))
    x, y = width / 2, height / 2
    out = CameraInfo(height=height, width=width, distortion_model="plumb_bob", d=[0.0] * 5)
    out.header.stamp, out.header.frame_id = stamp, frame
    out.k = [focus, 0.0, x, 0.0, focus, y, 0.0, 0.0, 1.0]
    out.r = np.eye(3).ravel().tolist()
    out.p = [focus, 0.0, x, 0.0, 0.0, focus, y, 0.0, 0.0, 0.0, 1.0, 0.0]
    return out


def bones(stamp: Time, name: str, ends: Sequence[tuple[Sequence[float], Sequence[float]]]) -> Any:
    """Return a person as lines between joints [m], for RViz and Foxglove."""
    out = Marker(ns=name, type=Marker.LINE_LIST, action=Marker.ADD)
    out.header.stamp, out.header.frame_id = stamp, WORLD
    out.scale.x, out.pose.orientation.w = 0.04, 1.0
    out.color.r, out.color.g, out.color.b, out.color.a = 0.85, 0.65, 0.5, 1.0
    for pair in ends:
        for place in pair:
            point = type(out.pose.position)()
            _fill(point, place, "xyz")
            out.points.append(point)
    return MarkerArray(markers=[out])
