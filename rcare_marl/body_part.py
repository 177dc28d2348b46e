"""What a body of the physics client has: joints, gears, surfaces, shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from rcare_marl.bullet import bullet

from .pose import Pose

State: TypeAlias = tuple[float, ...]  # see `Body.centre_state`

SHAPE_NAMES = {
    bullet.GEOM_BOX: "box",
    bullet.GEOM_SPHERE: "sphere",
    bullet.GEOM_CYLINDER: "cylinder",
    bullet.GEOM_CAPSULE: "capsule",
    bullet.GEOM_MESH: "mesh",
    bullet.GEOM_PLANE: "plane",
}


@dataclass(frozen=True)
class Joint:
    """A movable joint as its URDF states it.

    Attributes:
        index: Index in the physics client.
        kind: `revolute` or `prismatic`.
        lower: Lower limit [rad or m]; -inf for a continuous joint.
        upper: Upper limit [rad or m]; inf for a continuous joint.
        effort: Greatest torque or force [N·m or N].
        velocity: Greatest speed [rad/s or m/s].
        dof: Place among the movable joints of the body.
    """

    index: int
    kind: str
    lower: float
    upper: float
    effort: float
    velocity: float
    dof: int


class Gear(NamedTuple):
    """A follower that moves `multiplier` times as far as its leader; joints by index.

    Attributes:
        leader: The joint that leads.
        follower: The joint that follows.
        multiplier: How far it follows.
        force: Greatest force of the gear [N·m or N].
    """

    leader: int
    follower: int
    multiplier: float
    force: float


class Touching(NamedTuple):
    """How the surface of a link touches, as Bullet knows it; stiffness and damping 0 if it is rigid.

    Attributes:
        friction: Coefficient of sliding friction; those of two partners are multiplied.
        rolling: Coefficient of rolling friction [m].
        spinning: Coefficient of spinning friction [m].
        stiffness: Stiffness [N/m].
        damping: Damping [N·s/m].
    """

    friction: float
    rolling: float
    spinning: float
    stiffness: float
    damping: float


@dataclass(frozen=True)
class VisualShape:
    """A shape to draw or to collide with, in the frame of its link.

    Attributes:
        link: Link index, -1 for the base.
        kind: `box`, `sphere`, `cylinder`, `capsule`, `mesh` or `plane`.
        size: Box edges; sphere radius; cylinder or capsule length and radius [m]; mesh scale.
        mesh: File of a mesh, empty otherwise.
        pose: Pose in the frame of the link.
        rgba: Colour, each value in [0, 1].
    """

    link: int
    kind: str
    size: tuple[float, ...]
    mesh: str
    pose: Pose
    rgba: tuple[float, ...]
