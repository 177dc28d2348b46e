"""A positioning cushion: a firm block of foam that bears a limb."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape, Triple
from rcare_marl.model.urdf import Link
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.world import World

from .device import Device
from .device_model import DeviceModel, Frame, Touch

# Our own choices. A forearm of 1.5 kg sinks in by less than a centimetre.
STIFFNESS, DAMPING = 3000.0, 60.0  # [N/m], [N·s/m] of a point of contact
FRICTION = 0.7
LEAST = 0.01  # [m] thick
LENGTH, MIDDLE = 0.8, 0.6  # of the way from shoulder to wrist: how long, and where its middle is
WIDTH = 0.18  # [m]
RGBA = (0.93, 0.94, 0.92, 1.0)


class Cushion(Device):
    """A block with round edges, x along it, z up, origin in the middle of its underside.

    It stays where it is laid. It is cut to measure: such cushions come in wedges and layers.

    Frames: `top` (middle of the upper side).
    """

    def __init__(self, size: Triple) -> None:
        """Cut a cushion.

        Args:
            size: Edges along x, y, z [m].

        Raises:
            ConfigError: If an edge is shorter than `LEAST`.
        """
        if min(size) < LEAST:
            raise ConfigError(f"a cushion is {LEAST} m or more each way, got {size}")
        self.size, at = size, (0.0, 0.0, 0.5 * size[2])
        bevel = min(0.02, 0.45 * min(size))
        block = Shape(kind="box", at=at, size=size)
        link = Link(
            mass=0.5,
            com=at,
            inertia=(1e-3, 0.0, 0.0, 1e-3, 0.0, 1e-3),
            visual=(dataclasses.replace(block, material="linen", bevel=bevel),),
            collision=(block,),
        )
        model = DeviceModel(
            name="cushion",
            source="own choice",
            links={"cushion": link},
            materials={"linen": RGBA},
            frames={"top": Frame((0.0, 0.0, size[2]), note="middle of the upper side")},
            contact={"cushion": Touch(FRICTION, stiffness=STIFFNESS, damping=DAMPING)},
        )
        super().__init__(model)


def lay_under(world: World, person: Human, side: str, *, base: float, under: float) -> Body | None:
    """Lay a cushion under an arm, cut to fill the gap to what the person lies on.

    Arm and cushion touch; the rest of the person, who lies beside it, passes through it.

    Args:
        world: Where.
        person: Who lies there.
        side: Of the arm, `left` or `right`.
        base: Height of what they lie on [m].
        under: Height of the underside of the upper arm [m].

    Returns:
        The cushion; None where the gap is smaller than `LEAST`.
    """
    if under - base < LEAST:
        return None
    pose, length = _beneath(person, side, base)
    cushion = Cushion((length, WIDTH, under - base)).spawn(world, pose)
    person.ignore(cushion)
    joints = [JOINT_INDEX[f"{side}_{part}"] for part in ("shoulder", "elbow", "wrist")]
    arm = {person.frames[joint].link for joint in joints}
    world.set_collision(person.body, cushion, True, links_a=arm)
    return cushion


def move_under(cushion: Body, person: Human, side: str) -> None:
    """Move a cushion to under an arm that lies elsewhere now; it keeps its height and length."""
    cushion.set_base(_beneath(person, side, cushion.base_pose().position[2])[0])


def _beneath(person: Human, side: str, base: float) -> tuple[Pose, float]:
    """Return where a cushion goes under an arm, and how long it is [m]."""
    start, end = (
        np.array(person.joint_pose(f"{side}_{j}").position) for j in ("shoulder", "wrist")
    )
    way = end - start
    x, y = (start + MIDDLE * way)[:2].tolist()
    turn = quaternion_from_rpy(0, 0, math.atan2(way[1], way[0]))
    return Pose((x, y, base), tuple(turn.tolist())), LENGTH * math.hypot(way[0], way[1])
