"""Scenes with assistive devices that several files of tests share."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.body import Body
from rcare_marl.envs.devices import Device, ManualWheelchair
from rcare_marl.pose import Array, Pose, quaternion_from_rpy
from rcare_marl.world import World

FAST = ("morgan", "kim")  # the heaviest and the lightest
AVATARS = ("morgan", "jose", "natalia", "daniel", "kim", "karan")
HAND = 22.2  # [N], ADA 309.4
SECOND = 240  # physics steps
LEGS = ("left_hip_flexion", "right_hip_flexion", "left_knee_flexion", "right_knee_flexion")


def floor(world: World, slope: float = 0.0) -> Pose:
    """Add a floor that rises against x by `slope` [rad], and return its frame at the origin."""
    turn = tuple(quaternion_from_rpy(0.0, slope, 0.0).tolist())
    at = (-0.05 * math.sin(slope), 0.0, -0.05 * math.cos(slope))
    world.add_box((16, 6, 0.1), Pose(at, turn), name="floor").set_friction([-1], lateral=0.8)
    return Pose((0.0, 0.0, 0.0), turn)


def place(body: Body) -> Array:
    return np.array(body.base_pose().position)


def heading(body: Body) -> float:
    forward = body.base_pose().matrix()[:3, 0]
    return math.atan2(forward[1], forward[0])


def run(world: World, seconds: float) -> None:
    for _ in range(round(seconds * SECOND)):
        world.step()


def seated(
    world: World, chair: ManualWheelchair, at: Pose = Pose(), avatar: str = "karan"
) -> Human:
    """Spawn a chair and, as one rigid body, somebody who sits in it."""
    person = Human(
        "person",
        load_avatar(avatar),
        posture=load_posture("wheelchair"),
        movable=(),
        fixed_base=False,
    )
    soles = person.soles(chair.frame("seat_back"))
    chair.fit_footplates(soles["left"], soles["right"])
    chair.spawn(world, at)
    person.spawn(world, chair.frame_in_world("seat_back"))
    chair.carry(person)
    return person


def push(chair: ManualWheelchair, force: float, down: float = 0.0) -> None:
    """Push the handles for one step as somebody who walks behind does, who leans on them with `down`."""
    ahead = chair.pose.matrix()[:3, 0]
    for side in ("left", "right"):
        both = 0.5 * force * ahead - (0.0, 0.0, 0.5 * down)
        chair.body.apply_force(-1, both, chair.frame_in_world(f"grip_{side}").position)


def depth(world: World, person: Human, device: Device) -> float:
    """Return how far a person's rigid shapes lie inside a device [m]."""
    return -world.separation(person.body, device.body, within=0.1)
