"""A manual wheelchair, made from its dimensions."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from typing import Literal

from rcare_marl import assets
from rcare_marl.agents.robot_config import Mount
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose, Vector
from rcare_marl.urdf import Link, Model, Shape, Triple
from rcare_marl.world import World

from .device import Device, Frame
from .wheelchair_frame import WheelchairConfig, WheelchairFrame

LOWEST_POST = 0.1  # [m]; what is mounted lower stands on the floor
EDGE = 0.002  # [m] by which contacts with a pad may lie beside it; our own choice


class Wheelchair(Device):
    """A wheelchair that stands still: x forward, y left, origin on the floor under the seat.

    Frames: `seat` (middle of the surface), `seat_back` (where it meets the backrest), `backrest`
    (middle of its face, x out of it), `headrest`, `armrest_left`, `armrest_right` (middle of the
    pad's top), `footplate_left`, `footplate_right`, `mount_left`, `mount_right` (base of a robot
    arm).

    Attributes:
        carries_robot: Whether it has a post for a robot arm.
    """

    postures = {"seated": ("wheelchair", "seat_back")}

    def __init__(self, config: WheelchairConfig | None = None, *, mounts: str = "both") -> None:
        """Make a wheelchair.

        Args:
            config: Its dimensions; those of the data file if None.
            mounts: Where a post for a robot arm stands: `both`, `left`, `right` or `none`.

        Raises:
            ConfigError: If `mounts` is none of these.
        """
        if mounts not in ("both", "left", "right", "none"):
            raise ConfigError(f"mounts must be one of both, left, right, none, got {mounts!r}")
        self.config = config or load(WheelchairConfig, assets.find("devices", "wheelchair"))
        self.carries_robot = mounts != "none"
        self._posts = {"both": (1, -1), "left": (1,), "right": (-1,), "none": ()}[mounts]

    def fit_footplates(self, left: Vector, right: Vector) -> None:
        """Move the footplates under a person's soles, given in the chair's frame [m], before `spawn`.

        Both plates stand at one height and distance: under the lower foot.
        """
        self.config = self.config.with_footplates(left, right)

    @property
    def frames(self) -> Mapping[str, Frame]:
        return self._frame().frames()

    @property
    def armrest_size(self) -> Triple:
        """Edges of the pad of an armrest [m]: along, across, thick."""
        return self._frame().armrest_pad(1).size

    def load_on_armrest(
        self, side: Literal["left", "right"], world: World, body: Body, links: Collection[int]
    ) -> float:
        """Return how some links of a body weigh on the top of an armrest's pad in `world` [N]."""
        touches = [
            touch
            for touch in world.contacts(body, self.body)
            if touch.link_a in links and touch.normal[2] > 0.5
        ]
        load = 0.0
        if touches:
            top = self.frame_in_world(f"armrest_{side}").inverse()
            length, width, _ = self.armrest_size
        for touch in touches:
            x, y, z = (top @ Pose(touch.position)).position
            if abs(x) < 0.5 * length + EDGE and abs(y) < 0.5 * width + EDGE and abs(z) < 5 * EDGE:
                load += touch.force * touch.normal[2]
        return load

    def model(self) -> Model:
        c, frame = self.config, self._frame()
        visual = [*frame.upholstery(), *frame.headrest_tubes()]
        for side in (1, -1):
            visual += [frame.armrest_pad(side, bevel=0.012), frame.plate(side, bevel=0.006)]
            visual += [*frame.side_frame(side), frame.hanger(side), frame.armrest_hoop(side)]
            visual += [*frame.wheel(side), *frame.fork(side), *frame.caster(side)]
        visual += [shape for side in self._posts for shape in frame.post(side)]
        link = Link(mass=18.0, visual=tuple(visual), collision=tuple(self._solids(frame)))
        return Model(
            name="wheelchair", source=c.source, links={"wheelchair": link}, materials=c.materials
        )

    def _frame(self) -> WheelchairFrame:
        return WheelchairFrame(self.config)

    def _solids(self, frame: WheelchairFrame) -> list[Shape]:
        c = self.config
        radius = 0.5 * c.wheel_diameter
        outer = 0.5 * c.width
        solids = [
            *frame.cushions(),
            *(frame.armrest_pad(side) for side in (1, -1)),
            *(frame.plate(side) for side in (1, -1)),
        ]
        for sign in (1, -1):
            wheel = (
                (c.wheel_axle, sign * (outer - 0.065), radius),
                (c.wheel_axle, sign * outer, radius),
            )
            solids.append(Shape(kind="cylinder", radius=radius, points=wheel))
        for sign in self._posts:
            x, y, z = c.mount
            solids.append(
                Shape(kind="cylinder", radius=0.06,
                      points=((x, sign * y, z - 0.15), (x, sign * y, z - 0.002)))
            )  # fmt: skip
        return solids


def chair_for(mount: Mount, side: Literal["left", "right"]) -> Wheelchair:
    """Return a wheelchair whose post carries a robot at `mount`, if the chair is to carry it.

    A robot that drives, or has a stand of its own, needs no post.
    """
    x, y, z = mount.position
    if mount.stand or z < LOWEST_POST:
        return Wheelchair(mounts="none")
    config = load(WheelchairConfig, assets.find("devices", "wheelchair"))
    return Wheelchair(dataclasses.replace(config, mount=(x, abs(y), z)), mounts=side)


__all__ = ["LOWEST_POST", "Wheelchair", "WheelchairConfig", "chair_for"]
