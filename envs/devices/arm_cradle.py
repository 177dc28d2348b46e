"""A padded cradle with which a robot lifts a forearm."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rcare_marl import assets
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, Vector, quaternion_from_matrix, quaternion_from_rpy, rotate
from rcare_marl.urdf import Link, Model, Shape, Triple
from rcare_marl.world import World

from .device import Device, Frame

# How it lifts a forearm best; our own choices. Where, from elbow to wrist: level, and hanging.
HOOK_SHARE, HOOK_SHARE_HANGING = 0.75, 0.5
# Of the plate's tip towards the forearm, beyond lying along it, so that the forearm rolls against the wall.
TILT, MOST_TILT = math.radians(12), math.radians(55)
WALL_ROOM = 0.008  # [m] between forearm and wall


@dataclass(frozen=True)
class ArmCradleConfig:
    """Sizes of a cradle [m]; see `assets/devices/arm_cradle.yaml`."""

    source: str
    mass: float
    handle_length: float
    handle_radius: float
    grip_to_wall: float
    handle_angle_deg: float
    plate_length: float
    plate_width: float
    wall_height: float
    thickness: float
    friction: float
    contact_stiffness: float
    contact_damping: float

    def __post_init__(self) -> None:
        if min(self.mass, self.thickness, self.plate_length, self.plate_width) <= 0:
            raise ConfigError("a cradle has mass, and a plate that is thick, long and wide")
        if not 0 <= self.handle_angle_deg <= 120:
            raise ConfigError(
                f"the handle of a cradle leans back by 0 to 120 degrees, got {self.handle_angle_deg}"
            )


class ArmCradle(Device):
    """A plate with a wall at its root and a handle behind the wall: origin at the grip, z along the handle.

    A forearm lies across the plate and rolls against the wall while the tip is held higher. Level, the
    plate slides out from under the arm, away from the tip.

    It fits a robot's tool frame: held straight, its pose in the tool is `Pose()`.

    Frames, all but the first with z along the plate to its tip and x up out of it: `grip`, `seat`
    (middle of the plate's top), `corner` (middle of where plate and wall meet), `tip` (middle of the
    free edge).
    """

    _fixed = False
    in_tool = Pose()  # the cradle in the tool's frame, held straight

    def __init__(self, config: ArmCradleConfig | None = None) -> None:
        """Make a cradle of the sizes in `config`; those of the data file if None."""
        self.config = config or load(ArmCradleConfig, assets.find("devices", "arm_cradle"))

    @property
    def frames(self) -> Mapping[str, Frame]:
        length, lean = self.config.plate_length, (0.0, self.config.handle_angle_deg, 0.0)
        return {
            "grip": Frame((0.0, 0.0, 0.0), note="where a gripper holds it"),
            "seat": Frame(self._place((0.0, 0.0, 0.5 * length)), lean, "middle of the plate"),
            "corner": Frame(self._place((0.0, 0.0, 0.0)), lean, "where plate and wall meet"),
            "tip": Frame(self._place((0.0, 0.0, length)), lean, "free edge of the plate"),
        }

    def _turn(self) -> Array:
        """Return how the plate is turned in the cradle, shape [4]."""
        return quaternion_from_rpy(0.0, math.radians(self.config.handle_angle_deg), 0.0)

    def _place(self, point: Vector) -> Triple:
        """Return a point that is given from the corner, x out of the plate and z along it [m]."""
        c = self.config
        to_corner = (-0.5 * c.wall_height, 0.0, c.thickness)  # from where the handle ends
        x, y, z = rotate(self._turn(), np.add(point, to_corner)).tolist()
        return (x, y, z + c.grip_to_wall)

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        c = self.config
        body.set_friction([-1], lateral=c.friction)
        body.set_softness(stiffness=c.contact_stiffness, damping=c.contact_damping)
        return body

    def under(
        self, elbow: Array, wrist: Array, radius: float, share: float | None = None
    ) -> tuple[Array, Array]:
        """Return where the middle of the plate lifts a left forearm [m], and how it is turned then.

        The plate lies behind a forearm that hangs, and below one that is level; along x of the world, its
        tip to the right and raised.

        Args:
            elbow: One end of the forearm's axis [m], shape [3].
            wrist: The other end.
            radius: Radius of the forearm [m].
            share: Which point of it, 0 at the elbow, 1 at the wrist; the best one if None.
        """
        forearm = wrist - elbow
        x, y, z = (forearm / math.sqrt(float(forearm @ forearm))).tolist()
        aslant = math.atan2(-z * (math.hypot(x, y) - x), max(y, 1e-6))  # lying along the forearm
        tilt = min(TILT + max(aslant, 0.0), MOST_TILT)
        z = min(z, 0.0)  # never beyond level: few wrists of robots bend so far
        out = np.array((-z, 0.0, math.sqrt(1 - z * z)))  # of a plate as steep as the forearm
        inward = np.array((0.0, -1.0, 0.0))
        up = math.cos(tilt) * out - math.sin(tilt) * inward
        tip = math.cos(tilt) * inward + math.sin(tilt) * out
        turned = np.column_stack((up, _cross(tip, up), tip))
        # A forearm that lies askew needs more of the plate before it meets the wall.
        _, across, skew = (turned.T @ forearm).tolist()
        slope = abs(skew / across) if across else 0.0
        length, half = self.config.plate_length, 0.5 * self.config.plate_width
        room = radius * math.hypot(1.0, slope) + half * slope + WALL_ROOM
        aside = min(room, 0.85 * length) - 0.5 * length
        if share is None:
            share = HOOK_SHARE + (HOOK_SHARE_HANGING - HOOK_SHARE) * z * z
        return elbow + share * forearm - radius * up - aside * tip, quaternion_from_matrix(turned)

    def lift_way(
        self, elbow: Array, wrist: Array, middle: Array, radius: float
    ) -> list[tuple[Array, Array]]:
        """Return places and turns of the plate on the way of a left arm that hangs, up onto an armrest.

        They are those of `under` behind the arm, ahead of it, beside the armrest, over it and on it, and
        last where the plate is drawn out.

        Args:
            elbow: Where the elbow is [m], shape [3].
            wrist: Where the wrist is.
            middle: Where the middle of the forearm is to lie.
            radius: Radius of the forearm [m].
        """
        length = math.dist(elbow, wrist)
        shift = middle - (0.5 * length, 0.0, 0.0) - elbow
        forearms = [  # share of the elbow's way, its rise [m], direction of the forearm; own choice
            (0.0, 0.0, (wrist - elbow) / length),
            (0.8, 0.03, np.array((0.6, 0.35, -0.7))),
            (1.0, 0.04, np.array((0.93, 0.35, 0.1))),
            (1.0, 0.05, np.array((0.95, 0.0, 0.3))),
            (1.0, 0.0, np.array((1.0, 0.0, 0.0))),
        ]
        starts = [elbow + share * shift + (0.0, 0.0, rise) for share, rise, _ in forearms]
        out = [
            self.under(start, start + length * along, radius)
            for start, (_, _, along) in zip(starts, forearms, strict=True)
        ]
        place, turn = out[-1]
        return [*out, (place + (0.0, 2.0 * self.config.plate_length, 0.0), turn)]

    def model(self) -> Model:
        c = self.config
        thick, lean = c.thickness, (0.0, math.radians(c.handle_angle_deg), 0.0)
        boxes: list[tuple[Triple, Triple]] = [  # place and size of plate and wall
            (self._place((-0.5 * thick, 0.0, 0.5 * c.plate_length)),
             (thick, c.plate_width, c.plate_length)),
            (self._place((0.5 * (c.wall_height - thick), 0.0, -0.5 * thick)),
             (c.wall_height + thick, c.plate_width, thick)),
        ]  # fmt: skip
        ends: tuple[Triple, Triple] = (
            (0.0, 0.0, c.grip_to_wall - c.handle_length),
            (0.0, 0.0, c.grip_to_wall),
        )
        handle = Shape(kind="cylinder", material="handle", radius=c.handle_radius, points=ends)
        pads = [
            Shape(kind="box", material="pad", at=at, rpy=lean, size=size, bevel=0.45 * thick)
            for at, size in boxes
        ]
        solids = [Shape(kind="box", at=at, rpy=lean, size=size) for at, size in boxes]
        solids.append(Shape(kind="cylinder", radius=c.handle_radius, points=ends))
        along, across = c.mass * 0.18**2 / 12, c.mass * 0.1**2 / 12
        link = Link(
            mass=c.mass,
            com=self._place((0.0, 0.0, 0.0)),
            inertia=(along, 0.0, 0.0, along, 0.0, across),
            visual=(handle, *pads),
            collision=tuple(solids),
        )
        colours: dict[str, tuple[float, ...]] = {
            "pad": (0.23, 0.47, 0.55, 1.0),
            "handle": (0.2, 0.2, 0.22, 1.0),
        }
        return Model(name="arm_cradle", source=c.source, links={"cradle": link}, materials=colours)


def _cross(a: Array, b: Array) -> Array:
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


__all__ = ["HOOK_SHARE", "HOOK_SHARE_HANGING", "ArmCradle", "ArmCradleConfig"]
