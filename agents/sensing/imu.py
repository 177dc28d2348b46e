"""An inertial measurement unit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.pose import Array, Pose, conjugate, multiply, rotate, rotation_vector
from rcare_marl.world import GRAVITY, World

from ..agent import Agent
from ..robots.robot_config import ZERO, Triple
from .sensor import Channel, Sensor, SensorConfig, default_link, find_place, kept_links

MAX_SPEED = 20.0  # [m/s], our own choice: what goes farther in a physics step was put there


@dataclass(frozen=True)
class ImuConfig(SensorConfig):
    """Options of `imu`.

    Attributes:
        link: A robot's link or a person's segment; the tool of the main arm, or the head, if empty.
        at: Place in the frame of the link [m].
        rpy_deg: Turn in it, fixed-axis roll, pitch, yaw [degrees].
    """

    link: str = ""
    at: Triple = ZERO
    rpy_deg: Triple = ZERO


class Imu(Sensor):
    """Specific force [m/s²] and angular velocity [rad/s] of a place on a link, in its own axes.

    Channels: `acceleration`, the acceleration less that of free fall: at rest it reads 9.81 m/s² upward,
    in free fall zero; and `angular_velocity`. Both are differences of poses over physics steps, so what
    is moved from pose to pose is measured as well, and both are of the middle of what they are taken
    from: half a physics step ago for turning, one for acceleration. At the start of an episode it was
    at rest before.
    """

    Config = ImuConfig
    config: ImuConfig
    watches = True

    def links(self, agent: Agent) -> Sequence[str]:
        return kept_links(agent, self.config.link or default_link(agent))

    def bind(self, world: World, agent: Agent) -> None:
        self._world, self._body = world, agent.body
        self._place = find_place(agent, self.config.link, self.config.at, self.config.rpy_deg)
        self._poses: list[Pose] = []

    def reset(self) -> None:
        self._poses.clear()

    def after_substep(self) -> None:
        if self._poses:  # before the first reading an agent may still be put in place
            self._poses = [*self._poses[-2:], self._body.link_pose(self._place.link)]

    def channels(self) -> Sequence[Channel]:
        return (
            Channel("acceleration", "m/s²", (3,)),
            Channel("angular_velocity", "rad/s", (3,)),
        )

    def measure(self) -> Sequence[Array]:
        if not self._poses:
            self._poses.append(self._body.link_pose(self._place.link))
        dt = self._world.physics_dt
        now, before, earlier = self._frames(MAX_SPEED * dt)
        last, first = (
            np.subtract(b.position, a.position) / dt for a, b in ((before, now), (earlier, before))
        )
        specific = (last - first) / dt + (0.0, 0.0, GRAVITY)
        turned = rotation_vector(multiply(conjugate(before.quaternion), now.quaternion)) / dt
        return rotate(conjugate(before.quaternion), specific), turned

    def _frames(self, farthest: float) -> list[Pose]:
        """Return the last three poses of the sensor, newest first; before a jump it was at rest."""
        frames: list[Pose] = []
        for pose in reversed(self._poses):
            frame = pose @ self._place.pose
            if frames and math.dist(frame.position, frames[-1].position) > farthest:
                break
            frames.append(frame)
        return frames + [frames[-1]] * (3 - len(frames))
