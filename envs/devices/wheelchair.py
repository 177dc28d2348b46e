"""Wheelchairs: one that stands still, and what all of them share."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.resting.support import Support, chair
from rcare_marl.agents.robots.robot_config import Mount
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.model.shape import Shape, Triple
from rcare_marl.model.urdf import Joint, Link
from rcare_marl.pose import Pose, Vector
from rcare_marl.world import World

from .device import Device
from .device_model import DeviceModel

if TYPE_CHECKING:
    from .rolling_wheelchair import ManualWheelchair

SIDES = {"left": 1, "right": -1}
LOWEST_POST = 0.1  # [m]; what is mounted lower stands on the floor
LOWEST_PLATE = 0.05  # [m] of footplates over the floor; our own choice
PLATE_STEP = 0.025  # [m] between the holes that a footrest's height is set by; our own choice
EDGE = 0.002  # [m] by which contacts with a pad may lie beside it; our own choice


def plates_under(left: Vector, right: Vector) -> dict[str, Triple]:
    """Return where footplates go under soles, given in the chair [m], by side: ahead, aside, and up.

    Both stand where the lower foot is, or, under a foot that is higher by whole `PLATE_STEP`, so much higher.
    """
    soles = {"left": left, "right": right}
    low = left if left[2] < right[2] else right
    lowest, aside, out = max(float(low[2]), LOWEST_PLATE), 0.5 * float(left[1] - right[1]), {}
    for side, sign in SIDES.items():
        steps = max(int((float(soles[side][2]) - lowest) / PLATE_STEP), 0)
        under = soles[side] if steps else low
        out[side] = (float(under[0]), sign * aside, lowest + steps * PLATE_STEP)
    return out


def with_plates(model: DeviceModel, places: Mapping[str, Triple]) -> DeviceModel:
    """Return a chair whose footplates, with the ends of their hangers, are elsewhere [m], by side."""
    for side, (ahead, aside, up) in places.items():
        name, link = f"footplate_{side}", f"footrest_{side}"
        frame, place = model.frames[name], (ahead, aside, up)
        x, y, z = (new - old for new, old in zip(place, frame.position, strict=True))
        (plate, hanger), (solid,) = model.links[link].visual, model.links[link].collision
        tilt, under = math.radians(-frame.rpy_deg[1]), 0.5 * plate.size[2]
        middle = (ahead + under * math.sin(tilt), aside, up - under * math.cos(tilt))
        a, b, c = (m - o for m, o in zip(middle, model.link_pose(link).position, strict=True))
        *above, ankle, end = hanger.points
        points = (
            *above,
            (ankle[0] + x, ankle[1], ankle[2] + z),
            (end[0] + x, end[1] + y, end[2] + z),
        )
        seen = (
            dataclasses.replace(plate, at=(a, b, c)),
            dataclasses.replace(hanger, points=points),
        )
        model = model.with_shapes(link, seen, [dataclasses.replace(solid, at=(a, b, c))])
        model = model.with_frames({name: place})
    return model


def spawn_fitted(
    chair: Wheelchair | ManualWheelchair, person: Human, world: World, pose: Pose = Pose()
) -> Pose:
    """Add a chair whose footplates fit somebody, and return the support to spawn them on.

    Their arms are going to lie on its armrests.
    """
    soles = person.soles(chair.frame("seat_back"))
    chair.fit_footplates(soles["left"], soles["right"])
    chair.spawn(world, pose)
    person.use_arm_rests(*(chair.frame_in_world(f"armrest_{side}") for side in SIDES))
    return chair.frame_in_world("seat_back")


def with_posts(model: DeviceModel, mount: Triple, signs: Sequence[int]) -> DeviceModel:
    """Return a chair with posts for robot arms whose base is at `mount` [m], left (1) and right (-1)."""
    f = model.figure
    x, aside, z = mount
    rail = model.frames["seat"].position[2] - f("cushion") - 0.015
    visual: list[Shape] = []
    solids: list[Shape] = []
    for sign in signs:
        y, inner, hold = sign * aside, sign * 0.5 * f("seat_width"), 0.5 * f("seat_depth") - 0.03
        arm = (
            (hold, inner, rail),
            (hold + 0.08, inner + sign * 0.1, rail - 0.03),
            (x, y, z - 0.07),
        )
        rods = (("steel", 0.06, z - 0.012, z), ("frame", 0.025, z - 0.11, z - 0.012))
        for material, radius, low, top in rods:
            ends = ((x, y, low), (x, y, top))
            visual.append(Shape("cylinder", material, radius=radius, points=ends))
        visual.append(Shape("tube", "frame", radius=0.019, bend=0.06, points=arm))
        visual.append(Shape("box", "steel", arm[0], size=(0.06, 0.045, 0.05), bevel=0.008))
        ends = ((x, y, z - 0.15), (x, y, z - 0.002))
        solids.append(Shape(kind="cylinder", radius=0.06, points=ends))
    posts = Link(visual=tuple(visual), collision=tuple(solids))
    mounts = {f"mount_{side}": (x, sign * aside, z) for side, sign in SIDES.items()}
    return dataclasses.replace(
        model.with_frames(mounts),
        links=model.links | {"posts": posts},
        joints=model.joints | {"posts": Joint("fixed", model.root, "posts")},
    )


class Wheelchair(Device):
    """A wheelchair that stands still: x forward, y left, origin on the floor under the seat.

    Frames: `seat` (middle of the surface), `seat_back` (where it meets the backrest), `backrest`
    (middle of its face, x out of it), `headrest`, `armrest_left`, `armrest_right` (middle of the
    pad's top), `footplate_left`, `footplate_right`, `mount_left`, `mount_right` (base of a robot
    arm).

    Attributes:
        carries_robot: Whether it has a post for a robot arm.
    """

    def __init__(
        self,
        source: str = "wheelchair",
        *,
        mounts: str = "both",
        mount: Triple | None = None,
        without_armrest: Collection[str] = (),
    ) -> None:
        """Make a wheelchair.

        Args:
            source: Name or YAML file.
            mounts: Where a post for a robot arm stands: `both`, `left`, `right` or `none`.
            mount: Base of a robot arm on the left, mirrored on the right [m]; that of the data if None.
            without_armrest: Sides, `left` and `right`, whose armrest is taken off.

        Raises:
            ConfigError: If `mounts` is none of these.
            UnknownNameError: If a side is neither `left` nor `right`.
        """
        if mounts not in ("both", "left", "right", "none"):
            raise ConfigError(f"mounts must be one of both, left, right, none, got {mounts!r}")
        super().__init__(source)
        self.carries_robot = mounts != "none"
        signs = {"both": (1, -1), "left": (1,), "right": (-1,), "none": ()}[mounts]
        place = mount or self.model.frames["mount_left"].position
        for side in without_armrest:
            check_name("side", side, SIDES)
        bare = self.model.without([f"armrest_{side}" for side in without_armrest])
        self.model = with_posts(bare, place, signs)

    def bears(self, cushion: str = "foam") -> Support:
        """Return what bears somebody in it now, for `Human.rest_on`; a cushion of `assets/cushions`."""
        return chair(self.frame_in_world("seat_back"), cushion)

    def fit_footplates(self, left: Vector, right: Vector) -> None:
        """Move the footplates under a person's soles, given in the chair's frame [m], before `spawn`."""
        self.model = with_plates(self.model, plates_under(left, right))

    def fit_seat(self, front: float) -> None:
        """Shorten a longer seat so that it ends `front` [m] ahead of the origin; before `spawn`."""
        seat, model = self.model.root, self.model
        x, y, z = model.frames["seat"].position
        depth = model.figure("seat_depth")
        cut = max(x + 0.5 * depth - front, 0.0)
        visual, collision = [
            (
                dataclasses.replace(
                    first,
                    at=(first.at[0] - 0.5 * cut, *first.at[1:]),
                    size=(first.size[0] - cut, *first.size[1:]),
                ),
                *others,
            )
            for first, *others in (model.links[seat].visual, model.links[seat].collision)
        ]
        model = model.with_shapes(seat, visual, collision).with_frames(
            {"seat": (x - 0.5 * cut, y, z)}
        )
        figures = {**model.figures, "seat_depth": depth - cut}
        self.model = dataclasses.replace(model, figures=figures)

    def fit_armrests(self, length: float) -> None:
        """Give the pads of the armrests another length [m], before `spawn`."""
        for name in self._armrests():
            link = self.model.links[name]
            visual, collision = (
                [
                    dataclasses.replace(s, size=(length, *s.size[1:])) if s.kind == "box" else s
                    for s in shapes
                ]
                for shapes in (link.visual, link.collision)
            )
            self.model = self.model.with_shapes(name, visual, collision)

    def _armrests(self) -> list[str]:
        return [f"armrest_{side}" for side in SIDES if f"armrest_{side}" in self.model.links]

    @property
    def armrest_size(self) -> Triple:
        """Edges of the pad of an armrest [m]: along, across, thick."""
        return self.model.links[self._armrests()[0]].collision[0].size

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


def chair_for(mount: Mount, side: Literal["left", "right"]) -> Wheelchair:
    """Return a wheelchair whose post carries a robot at `mount`, if the chair is to carry it.

    A robot that drives, or has a stand of its own, needs no post.
    """
    x, y, z = mount.position
    if mount.stand or z < LOWEST_POST:
        return Wheelchair(mounts="none")
    return Wheelchair(mounts=side, mount=(x, abs(y), z))
