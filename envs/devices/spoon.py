"""A feeding spoon whose bowl can hold food."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rcare_marl import assets
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, Vector, quaternion_from_matrix
from rcare_marl.urdf import Link, Model, Shape
from rcare_marl.world import World

from .device import Device, Frame

_WALL = 0.003  # thickness of a wall of the bowl, for collision [m]
_FLOOR = 0.003  # thickness of its floor [m]


@dataclass(frozen=True)
class SpoonConfig:
    """Sizes of a spoon [m]; see `assets/devices/spoon.yaml`."""

    source: str
    mass: float
    handle_length: float
    handle_width: float
    handle_height: float
    grip_to_neck: float
    grip_to_bowl: float
    bowl_length: float
    bowl_width: float
    bowl_depth: float
    rim_height: float
    wall_count: int
    contact_stiffness: float
    contact_damping: float

    def __post_init__(self) -> None:
        if self.mass <= 0 or self.wall_count < 5 or self.bowl_depth <= _FLOOR:
            raise ConfigError(
                f"a spoon has mass, a bowl deeper than {_FLOOR} m and 5 walls at least"
            )


class Spoon(Device):
    """A spoon: z along the handle towards the tip, x up, origin at the grip.

    It fits a robot's tool frame: held straight, its pose in the tool is `Pose()`.

    Frames: `grip`, `bowl` (middle of its inside), `floor` (of the bowl), `tip`.
    """

    _fixed = False
    in_tool = Pose()  # the spoon in the tool's frame, held straight
    up = (1.0, 0.0, 0.0)  # out of the bowl, in the spoon's frame

    def __init__(self, config: SpoonConfig | None = None) -> None:
        """Make a spoon of the sizes in `config`; those of the data file if None."""
        self.config = config or load(SpoonConfig, assets.find("devices", "spoon"))

    @property
    def frames(self) -> Mapping[str, Frame]:
        c = self.config
        floor = c.rim_height - c.bowl_depth
        return {
            "grip": Frame((0.0, 0.0, 0.0), note="where a gripper holds it"),
            "bowl": Frame(self.bowl, note="middle of the bowl's inside"),
            "floor": Frame((floor, 0.0, c.grip_to_bowl), note="middle of the floor of the bowl"),
            "tip": Frame(
                (c.rim_height, 0.0, c.grip_to_bowl + c.bowl_length / 2), note="front of the bowl"
            ),
        }

    @property
    def bowl(self) -> tuple[float, float, float]:
        """The middle of the bowl's inside, where food lies, in the spoon's frame [m]."""
        c = self.config
        return (c.rim_height - 0.5 * c.bowl_depth, 0.0, c.grip_to_bowl)

    @staticmethod
    def facing(direction: Vector) -> Array:
        """Return how a level spoon is turned whose tip points along `direction`, shape [4].

        Raises:
            ConfigError: If `direction` is vertical.
        """
        length = math.hypot(direction[0], direction[1])
        if length < 1e-9:
            raise ConfigError(f"a level spoon cannot point along {tuple(direction)}")
        x, y = direction[0] / length, direction[1] / length
        # Columns: x up, y to its right seen along the tip, z along the tip.
        return quaternion_from_matrix(np.array([[0.0, y, x], [0.0, -x, y], [1.0, 0.0, 0.0]]))

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        body.set_softness(
            stiffness=self.config.contact_stiffness, damping=self.config.contact_damping
        )
        return body

    def model(self) -> Model:
        c = self.config
        middle = 0.5 * (2 * c.grip_to_neck - c.handle_length)
        back = c.grip_to_neck - c.handle_length
        tall = c.handle_height / c.handle_width
        handle = Shape(
            kind="lathe",
            material="handle",
            scale=(tall, 1.0, 1.0),
            profile=tuple(
                (0.5 * c.handle_width * r, back + c.handle_length * s)
                for r, s in (
                    (0.55, 0.0), (0.8, 0.01), (0.95, 0.045), (1.0, 0.1), (1.0, 0.25),
                    (0.92, 0.5), (1.0, 0.75), (0.97, 0.85), (0.8, 0.93), (0.5, 0.98), (0.35, 1.0),
                )
            ),
        )  # fmt: skip
        neck_end = c.grip_to_bowl - 0.47 * c.bowl_length
        neck = Shape(
            kind="tube",
            material="metal",
            radius=0.0028,
            bend=0.02,
            points=(
                (0.0, 0.0, c.grip_to_neck - 0.01),
                (0.001, 0.0, c.grip_to_neck + 0.015),
                (c.rim_height - 0.004, 0.0, c.grip_to_bowl - 0.5 * c.bowl_length + 0.002),
            ),
        )
        shank = Shape(
            kind="capsule",
            radius=0.004,
            points=((0.0, 0.0, c.grip_to_neck), (c.rim_height - 0.004, 0.0, neck_end - 0.004)),
        )
        grip = Shape(
            kind="box",
            at=(0.0, 0.0, middle),
            size=(c.handle_height, c.handle_width, c.handle_length),
        )
        along, across = c.mass * 0.18**2 / 12, c.mass * 0.03**2 / 12
        link = Link(
            mass=c.mass,
            com=(0.0, 0.0, 0.02),
            inertia=(along, 0.0, 0.0, along, 0.0, across),
            visual=(handle, neck, self._bowl()),
            collision=(grip, shank, *self._walls()),
        )
        materials: dict[str, tuple[float, ...]] = {
            "metal": (0.72, 0.73, 0.75, 1.0),
            "handle": (0.16, 0.36, 0.55, 1.0),
        }
        return Model(name="spoon", source=c.source, links={"spoon": link}, materials=materials)

    def _bowl(self) -> Shape:
        """A smooth bowl with a wall of half a millimetre: turned, then stretched to an ellipse."""
        c = self.config
        steps = 12
        outside = [
            (math.sin(0.5 * math.pi * k / steps), -(math.cos(0.5 * math.pi * k / steps) ** 0.8))
            for k in range(steps + 1)
        ]
        rim, deep = 0.5 * c.bowl_width, c.bowl_depth
        wall = 0.0006
        profile = [(rim * r, deep * z) for r, z in outside]
        profile += [((rim - wall) * r, (deep - wall) * z) for r, z in reversed(outside)]
        return Shape(
            kind="lathe",
            material="metal",
            at=(c.rim_height, 0.0, c.grip_to_bowl),
            rpy=(0.0, math.pi / 2, 0.0),  # the axis of turning points up, its x back to the handle
            scale=(c.bowl_length / c.bowl_width, 1.0, 1.0),
            profile=tuple(profile),
        )

    def _walls(self) -> list[Shape]:
        """A floor and a ring of boxes: the concave bowl, for collision."""
        c = self.config
        floor_top = c.rim_height - c.bowl_depth
        out = [
            Shape(
                kind="box",
                at=(floor_top - _FLOOR / 2, 0.0, c.grip_to_bowl),
                size=(_FLOOR, c.bowl_width - _WALL, c.bowl_length - _WALL),
            )
        ]
        a, b = 0.5 * (c.bowl_width - _WALL), 0.5 * (c.bowl_length - _WALL)
        corners = [
            (a * math.cos(t), b * math.sin(t))
            for t in (2 * math.pi * (k + 0.5) / c.wall_count for k in range(c.wall_count + 1))
        ]
        for (y0, z0), (y1, z1) in zip(corners, corners[1:], strict=False):
            length = math.hypot(y1 - y0, z1 - z0)
            out.append(
                Shape(
                    kind="box",
                    at=(
                        floor_top + c.bowl_depth / 2,
                        0.5 * (y0 + y1),
                        c.grip_to_bowl + 0.5 * (z0 + z1),
                    ),
                    rpy=(math.atan2(z1 - z0, y1 - y0), 0.0, 0.0),
                    size=(c.bowl_depth, length + _WALL / 2, _WALL),
                )
            )
        return out
