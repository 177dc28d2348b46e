"""A drinking cup that holds fluid."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rcare_marl import assets
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, WorldError
from rcare_marl.pose import (
    Array,
    Pose,
    Vector,
    multiply,
    quaternion_from_axis_angle,
    quaternion_from_matrix,
    rotate,
)
from rcare_marl.soft.pool import Pool
from rcare_marl.soft.vessel import Vessel
from rcare_marl.urdf import Link, Model, Shape
from rcare_marl.world import World

from .device import Device, Frame


@dataclass(frozen=True)
class CupConfig:
    """Sizes of a cup [m]; see `assets/devices/cup.yaml`."""

    source: str
    mass: float
    bottom_radius: float
    rim_radius: float
    depth: float
    wall: float
    grip_to_axis: float
    grip_height: float
    handle_length: float
    handle_width: float
    handle_depth: float
    wall_count: int
    contact_stiffness: float
    contact_damping: float

    def __post_init__(self) -> None:
        if self.mass <= 0 or self.wall_count < 6:
            raise ConfigError("a cup has mass, and 6 boxes round its wall at least")
        if self.grip_to_axis <= self.rim_radius + self.wall + self.handle_depth / 2:
            raise ConfigError(
                "the handle of a cup stands clear of its wall: grip_to_axis is too small"
            )


class Cup(Device):
    """A cup: z from the handle to its axis, x up, origin at the grip.

    It fits a robot's tool frame: held straight, its pose in the tool is `Pose()`; to tilt it to the side
    is then to turn the tool about its own axis.

    Frames: `grip`, `inside` (middle of the bottom, z up the axis), `middle` (of the cup).
    """

    _fixed = False
    in_tool = Pose()  # the cup in the tool's frame, held straight
    up = (1.0, 0.0, 0.0)  # up the axis, in the cup's frame

    def __init__(self, config: CupConfig | None = None) -> None:
        """Make a cup of the sizes in `config`; those of the data file if None."""
        self.config = config or load(CupConfig, assets.find("devices", "cup"))
        self._vessel: Vessel | None = None

    @property
    def frames(self) -> Mapping[str, Frame]:
        c = self.config
        return {
            "grip": Frame((0.0, 0.0, 0.0), note="where a gripper holds it"),
            "inside": Frame(
                (-c.grip_height, 0.0, c.grip_to_axis),
                (0.0, 90.0, 0.0),
                note="middle of the bottom",
            ),
            "middle": Frame((0.5 * c.depth - c.grip_height, 0.0, c.grip_to_axis)),
        }

    @property
    def vessel(self) -> Vessel:
        """Its inside, for fluids; WorldError before `spawn`."""
        if self._vessel is None:
            raise WorldError("this Cup is in no world yet: spawn it first")
        return self._vessel

    @staticmethod
    def facing(direction: Vector) -> Array:
        """Return how an upright cup is turned whose handle points away from `direction`, shape [4].

        Raises:
            ConfigError: If `direction` is vertical.
        """
        length = math.hypot(direction[0], direction[1])
        if length < 1e-9:
            raise ConfigError(f"the handle of an upright cup cannot point along {tuple(direction)}")
        x, y = direction[0] / length, direction[1] / length
        # Columns: x up, y to the right of who looks from the handle, z to the axis.
        return quaternion_from_matrix(np.array([[0.0, y, x], [0.0, -x, y], [1.0, 0.0, 0.0]]))

    def pouring(self, rim: Vector, way: Vector, tilt: float, handle: float) -> Pose:
        """Return where the cup is when a point of its rim is at a place.

        Args:
            rim: The place [m], shape [3].
            way: From the axis of the upright cup to that point of the rim, level, shape [3].
            tilt: How far the cup is tilted that way, about that point [rad].
            handle: Angle about z from `way` to the way from the handle to the axis [rad].
        """
        c, up = self.config, np.array((0.0, 0.0, 1.0))
        aside = rotate(quaternion_from_axis_angle(up, handle), way)
        tilting = quaternion_from_axis_angle(np.cross(up, way), tilt)
        to_rim = c.grip_to_axis * aside + c.rim_radius * np.asarray(way)
        to_rim[2] += c.depth - c.grip_height
        position = np.asarray(rim) - rotate(tilting, to_rim)
        turn = multiply(tilting, self.facing(aside))
        return Pose(tuple(position.tolist()), tuple(turn.tolist()))

    def up_in_world(self) -> Array:
        """Return where the axis of the cup points, a unit vector in the world, shape [3]."""
        return rotate(self.pose.quaternion, self.up)

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        c = self.config
        body = super().spawn(world, pose, name=name)
        body.set_softness(stiffness=c.contact_stiffness, damping=c.contact_damping)
        self._vessel = Vessel(
            body,
            -1,
            self.frame("inside"),
            bottom_radius=c.bottom_radius,
            rim_radius=c.rim_radius,
            depth=c.depth,
            wall=c.wall,
        )
        Pool.of(world).add_vessel(self._vessel)
        return body

    def model(self) -> Model:
        c = self.config
        axis = c.grip_to_axis
        wide = 0.5 * (c.bottom_radius + c.rim_radius)
        low, high = -c.grip_height - c.wall, c.depth - c.grip_height
        # Of a thin round wall, as of a hoop.
        about = c.mass * wide * wide
        across = 0.5 * about + c.mass * c.depth * c.depth / 12
        link = Link(
            mass=c.mass,
            com=(0.5 * (low + high), 0.0, axis),
            inertia=(about, 0.0, 0.0, across, 0.0, across),
            visual=(self._beaker(), *self._handle()),
            collision=(
                Shape(kind="box", size=(c.handle_length, c.handle_width, c.handle_depth)),
                *self._walls(),
            ),
        )
        materials: dict[str, tuple[float, ...]] = {
            "cup": (0.86, 0.92, 0.95, 0.42),
            "handle": (0.16, 0.36, 0.55, 1.0),
        }
        return Model(name="cup", source=c.source, links={"cup": link}, materials=materials)

    def _beaker(self) -> Shape:
        c = self.config
        low, high, wall = c.bottom_radius, c.rim_radius, c.wall
        profile = (
            (0.0, -wall), (0.9 * (low + wall), -wall), (low + wall, -0.3 * wall),
            (high + wall, c.depth - 0.3 * wall), (high + 0.8 * wall, c.depth - 0.05 * wall),
            (high + 0.5 * wall, c.depth), (high + 0.2 * wall, c.depth - 0.05 * wall),
            (high, c.depth - 0.3 * wall), (low, 0.3 * wall), (low - 0.7 * wall, 0.0), (0.0, 0.0),
        )  # fmt: skip
        return Shape(
            kind="lathe",
            material="cup",
            at=(-c.grip_height, 0.0, c.grip_to_axis),
            rpy=(0.0, math.pi / 2, 0.0),
            profile=profile,
        )

    def _handle(self) -> tuple[Shape, Shape]:
        """A bar, and a bow that joins both of its ends to the wall."""
        c = self.config
        bar = Shape(
            kind="box",
            material="handle",
            size=(c.handle_length, c.handle_width, c.handle_depth),
            bevel=0.4 * c.handle_depth,
        )
        out, slope = 0.42 * c.handle_length, (c.rim_radius - c.bottom_radius) / c.depth
        ends = [
            c.grip_to_axis - c.bottom_radius - slope * (c.grip_height + x) - 0.5 * c.wall
            for x in (-out, out)
        ]
        bow = Shape(
            kind="tube",
            material="handle",
            radius=0.005,
            bend=0.012,
            points=((-out, 0.0, ends[0]), (-out, 0.0, 0.0), (out, 0.0, 0.0), (out, 0.0, ends[1])),
        )
        return bar, bow

    def _walls(self) -> list[Shape]:
        """A bottom and a ring of leaning boxes: open at the top, for noses."""
        c = self.config
        lean = math.atan2(c.rim_radius - c.bottom_radius, c.depth)
        middle = 0.5 * (c.bottom_radius + c.rim_radius + c.wall)
        edge = 2 * (c.rim_radius + c.wall) * math.tan(math.pi / c.wall_count)
        out = [
            Shape(
                kind="box",
                at=(-c.grip_height - 0.5 * c.wall, 0.0, c.grip_to_axis),
                size=(c.wall, 1.6 * c.bottom_radius, 1.6 * c.bottom_radius),
            )
        ]
        for k in range(c.wall_count):
            angle = 2 * math.pi * (k + 0.5) / c.wall_count
            out.append(
                Shape(
                    kind="box",
                    at=(
                        0.5 * c.depth - c.grip_height,
                        middle * math.sin(angle),
                        c.grip_to_axis + middle * math.cos(angle),
                    ),
                    rpy=(-angle, lean, 0.0),
                    size=(c.depth / math.cos(lean), edge, c.wall),
                )
            )
        return out


__all__ = ["Cup", "CupConfig"]
