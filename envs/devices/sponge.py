"""A wet bath sponge on a backing plate: a soft block that a robot holds by a handle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rcare_marl import assets
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, WorldError
from rcare_marl.model.shape import Triple
from rcare_marl.pose import Array, Pose, quaternion_from_rpy
from rcare_marl.soft.material import Material
from rcare_marl.soft.soft_body import SoftBody
from rcare_marl.soft.soft_object import Carrier
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.soft.tetrahedron import make_block
from rcare_marl.world import World

from .device import Device


@dataclass(frozen=True)
class SpongeBlock:
    """Size [m] and material of the foam of a sponge; see `assets/devices/sponge_block.yaml`."""

    size: Triple
    cells: tuple[int, int, int]
    substeps: int
    rgb: tuple[int, int, int]
    material: Material

    def __post_init__(self) -> None:
        if min(self.size) <= 0 or min(self.cells) < 1:
            raise ConfigError("the foam of a sponge has a size, and cells each way")


class Sponge(Device):
    """A soft block on a plate with a handle: z from the handle to the face that wipes.

    `grips` are its poses in a robot's tool frame: held straight, and across for hands that cannot point
    down. The block is a soft body (`rcare_marl.soft`) held by the plate. What it presses on is pushed, and
    the plate the other way, so the robot feels it. Its weight is in the plate.

    Frames: `grip`, `face` (middle of the face that wipes, undeformed), `back` (where the block
    begins).
    """

    grips = (Pose(), Pose((0.0, 0.0, 0.0), tuple(quaternion_from_rpy(0, -math.pi / 2, 0).tolist())))

    def __init__(self, source: str = "sponge", block: SpongeBlock | None = None) -> None:
        """Make a sponge.

        Args:
            source: Name or YAML file of its plate and handle; the foam begins at their frame `back`.
            block: The foam; that of the data file if None.

        Raises:
            ConfigError: If the foam weighs more than all of it.
        """
        super().__init__(source)
        self.block = block or load(SpongeBlock, assets.find("devices", "sponge_block"))
        if float(np.prod(self.block.size)) * self.block.material.density_kg_m3 >= self.model.mass:
            raise ConfigError("a sponge with its plate weighs more than its foam alone")
        self._soft: SoftBody | None = None

    @property
    def soft(self) -> SoftBody:
        """The block; WorldError before `spawn`."""
        if self._soft is None:
            raise WorldError("this Sponge is in no world yet: spawn it first")
        return self._soft

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        c = self.block
        body = super().spawn(world, pose, name=name)
        rest, tetrahedra = make_block(c.size, c.cells)
        back = (c.cells[0] + 1) * (c.cells[1] + 1)
        self._soft = SoftBody(
            f"{body.name} block",
            rest + self.frame("back").position,
            material=c.material,
            tetrahedra=tetrahedra,
            held=range(back),
            carrier=Carrier(body, -1),
            substeps=c.substeps,
        )
        self._soft_world = SoftWorld.of(world)
        self._soft_world.add(self._soft, color=c.rgb)
        return body

    def spare(self, body: Body) -> None:
        """Let the block pass through a body, such as the robot that holds it."""
        self._soft_world.ignore([body], by=self.soft)

    def force_on(self, body: Body) -> Array:
        """Return the force of the block on a body in the last physics step, in the world [N], [3]."""
        return self.soft.force_on(body)

    def face_points(self) -> Array:
        """Return the particles of the face that wipes, as they are now in the world [m], shape [n, 3]."""
        c = self.block
        soft, count = self.soft, (c.cells[0] + 1) * (c.cells[1] + 1)
        return np.asarray(soft.in_world(soft.frame())[-count:], np.float64)

    def points(self) -> Array:
        """Return all particles of the block, as they are now in the world [m], shape [n, 3]."""
        soft = self.soft
        return np.asarray(soft.in_world(soft.frame()), np.float64)
