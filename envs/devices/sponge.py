"""A wet bath sponge on a backing plate: a soft block that a robot holds by a handle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rcare_marl import assets
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, WorldError
from rcare_marl.pose import Array, Pose, quaternion_from_rpy
from rcare_marl.soft.block import make_block
from rcare_marl.soft.material import Material
from rcare_marl.soft.matter import Matter
from rcare_marl.soft.soft_body import Carrier, SoftBody
from rcare_marl.soft.soft_skin import SoftSkin
from rcare_marl.urdf import Link, Model, Shape, Triple
from rcare_marl.world import World

from .device import Device, Frame


@dataclass(frozen=True)
class SpongeConfig:
    """Sizes [m] and matter of a sponge; see `assets/devices/sponge.yaml`."""

    source: str
    mass: float
    handle_length: float
    handle_width: float
    handle_height: float
    grip_to_plate: float
    plate_thickness: float
    size: Triple
    cells: tuple[int, int, int]
    substeps: int
    rgb: tuple[int, int, int]
    plate_stiffness: float
    plate_damping: float
    material: Material

    def __post_init__(self) -> None:
        volume = float(np.prod(self.size))
        if not 0 < volume * self.material.density_kg_m3 < self.mass:
            raise ConfigError("a sponge has a size, and with its plate it weighs more than alone")
        if not self.plate_thickness > 0 or not self.handle_length > 0:
            raise ConfigError("a sponge hangs on a plate, and that on a handle")


class Sponge(Device):
    """A soft block on a plate with a handle: z from the handle to the face that wipes.

    `grips` are its poses in a robot's tool frame: held straight, and across for hands that cannot point
    down. The block is XPBD
    matter (`rcare_marl.soft`) held by the plate. What it presses on is pushed, and the plate the other
    way, so the robot feels it. Its weight is in the plate.

    Frames: `grip`, `face` (middle of the face that wipes, undeformed).
    """

    _fixed = False
    grips = (Pose(), Pose((0.0, 0.0, 0.0), tuple(quaternion_from_rpy(0, -math.pi / 2, 0).tolist())))

    def __init__(self, config: SpongeConfig | None = None) -> None:
        """Make a sponge of the sizes in `config`; those of the data file if None."""
        self.config = config or load(SpongeConfig, assets.find("devices", "sponge"))
        self._soft: SoftBody | None = None

    @property
    def _root(self) -> float:
        """Where the block begins on z [m]."""
        return self.config.grip_to_plate + self.config.plate_thickness

    @property
    def frames(self) -> Mapping[str, Frame]:
        return {
            "grip": Frame((0.0, 0.0, 0.0), note="where a gripper holds it"),
            "face": Frame((0.0, 0.0, self._root + self.config.size[2]), note="what wipes"),
        }

    @property
    def soft(self) -> SoftBody:
        """The block; WorldError before `spawn`."""
        if self._soft is None:
            raise WorldError("this Sponge is in no world yet: spawn it first")
        return self._soft

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        c = self.config
        body = super().spawn(world, pose, name=name)
        body.set_softness(stiffness=c.plate_stiffness, damping=c.plate_damping)
        rest, tetrahedra = make_block(c.size, c.cells)
        back = (c.cells[0] + 1) * (c.cells[1] + 1)
        self._soft = SoftBody(
            f"{body.name} block",
            rest + (0.0, 0.0, self._root),
            material=c.material,
            tetrahedra=tetrahedra,
            held=range(back),
            carrier=Carrier(body, -1),
            substeps=c.substeps,
        )
        self._matter = Matter.of(world)
        self._matter.add(self._soft)
        # Renderers draw a skin in place of its body, but the plate is to be seen as well: a second
        # handle on the same body.
        handle = Body(world, body.uid, body.name)
        world.skins.append(SoftSkin(self._soft, handle, world.client, rgb=c.rgb))
        return body

    def spare(self, body: Body) -> None:
        """Let the block pass through a body, such as the robot that holds it."""
        self._matter.spare(self.soft, [body])

    def force_on(self, body: Body) -> Array:
        """Return the force of the block on a body in the last physics step, in the world [N], [3]."""
        return self.soft.force_on(body)

    def face_points(self) -> Array:
        """Return the particles of the face that wipes, as they are now in the world [m], shape [n, 3]."""
        soft, count = self.soft, (self.config.cells[0] + 1) * (self.config.cells[1] + 1)
        return np.asarray(soft.in_world(soft.frame(self._client))[-count:], np.float64)

    def points(self) -> Array:
        """Return all particles of the block, as they are now in the world [m], shape [n, 3]."""
        soft = self.soft
        return np.asarray(soft.in_world(soft.frame(self._client)), np.float64)

    def model(self) -> Model:
        c = self.config
        size = (c.handle_height, c.handle_width, c.handle_length)
        plate = (c.size[0], c.size[1], c.plate_thickness)
        at = (0.0, 0.0, c.grip_to_plate + 0.5 * c.plate_thickness)
        neck_end = c.grip_to_plate + 0.001
        neck = ((0.0, 0.0, 0.4 * c.handle_length), (0.0, 0.0, neck_end))
        heavy = c.size[2] * 0.5 + self._root  # middle of the block
        middle = 0.5 * (heavy + 0.5 * c.grip_to_plate)
        across, along = c.mass * (c.size[0] ** 2 + 0.1**2) / 12, c.mass * c.size[0] ** 2 / 12
        link = Link(
            mass=c.mass,
            com=(0.0, 0.0, middle),
            inertia=(across, 0.0, 0.0, across, 0.0, along),
            visual=(
                Shape(kind="box", material="handle", size=size, bevel=0.006),
                Shape(kind="cylinder", material="handle", points=neck, radius=0.009),
                Shape(kind="box", material="plate", at=at, size=plate, bevel=0.002),
            ),
            collision=(Shape(kind="box", size=size), Shape(kind="box", at=at, size=plate)),
        )
        materials: dict[str, tuple[float, ...]] = {
            "handle": (0.16, 0.36, 0.55, 1.0),
            "plate": (0.88, 0.89, 0.90, 1.0),
        }
        return Model(name="sponge", source=c.source, links={"sponge": link}, materials=materials)


__all__ = ["Sponge", "SpongeConfig"]
