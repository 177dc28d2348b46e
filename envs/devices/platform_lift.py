"""A platform lift for wheelchairs, with a folding ramp, guards and a bar before the landing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rcare_marl import assets, hull
from rcare_marl.body import Body
from rcare_marl.cache import cached
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.urdf import MeshFile, Model, Shape, Triple
from rcare_marl.world import World

from .assembly import Assembly, Part, shifted, weigh
from .device import DeviceControl, Frame
from .jointed_device import JointedDevice

_WALL = 0.03  # thickness of guards [m]
_TIP = 0.0015  # height of the edge of the ramp [m]
_MARGIN = 0.001  # [m], by which Bullet thickens hulls that it reads from a file
_FLAP = 0.012  # thickness of the ramp [m]
_OPEN = math.radians(88)  # of the bar
_LIFT = 6000.0  # [N]
_FOLD, _SWING = 60.0, 20.0  # [N·m], motors of ramp and bar; own choice


@dataclass(frozen=True)
class PlatformLiftConfig:
    """Dimensions of a lift [m, kg]; see `assets/devices/platform_lift.yaml`."""

    source: str
    length: float
    width: float
    thickness: float
    rise: float
    speed: float
    ramp: float
    guard_height: float
    bar_height: float
    friction: float
    masses: dict[str, float]
    materials: dict[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        if self.ramp <= self.thickness or self.speed <= 0 or self.rise <= 0:
            raise ConfigError("a lift has a rise, a speed, and a ramp longer than it is thick")


class PlatformLift(JointedDevice):
    """A lift: x from its ramp to the landing, y left, origin on the ground under the platform.

    Frames: `platform` (middle of its top), `entry` (ground before the ramp), `landing` (edge of the
    platform at the landing), `button` (on the tower). Controls: `height` [m over the lowest], `ramp`
    (0 down, folded up at the upper limit), `bar` (0 closed, up at the upper limit) [rad].
    """

    postures = {"standing": ("standing", "platform")}
    _on = {"platform": "platform", "landing": "platform"}

    def __init__(
        self, config: PlatformLiftConfig | None = None, *, rise: float | None = None
    ) -> None:
        """Make a lift.

        Args:
            config: Its dimensions; those of the data file if None.
            rise: How far it lifts [m]; as far as it can if None.

        Raises:
            ConfigError: If it cannot lift so far.
        """
        self.config = config or load(PlatformLiftConfig, assets.find("devices", "platform_lift"))
        self.rise = self.config.rise if rise is None else rise
        if not 0 < self.rise <= self.config.rise:
            raise ConfigError(f"this lift rises by 0 to {self.config.rise} m, not {rise} m")

    @property
    def frames(self) -> Mapping[str, Frame]:
        c, half = self.config, 0.5 * self.config.length
        return {
            "platform": Frame((0.0, 0.0, c.thickness), note="middle of the top"),
            "entry": Frame((-half - c.ramp - 0.7, 0.0, 0.0), note="on the ground, facing the ramp"),
            "landing": Frame((half, 0.0, c.thickness), note="edge of the platform"),
            "button": Frame((-0.1, self._tower_y() - 0.08, 1.0), (0.0, 0.0, -90.0)),
        }

    @property
    def controls(self) -> Mapping[str, DeviceControl]:
        return {
            "height": DeviceControl("height", self.config.speed, _LIFT, "motor"),
            "ramp": DeviceControl("ramp", 0.4, _FOLD, "motor"),
            "bar": DeviceControl("bar", 0.8, _SWING, "motor"),
        }

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        body.set_friction(
            [body.links["platform"], body.links["ramp"]], lateral=self.config.friction
        )
        return body

    def _tower_y(self) -> float:
        return 0.5 * self.config.width + _WALL + 0.11

    def _slope(self) -> float:
        """Return how steep the ramp is that lies on the ground [rad]."""
        return math.asin(self.config.thickness / self.config.ramp)

    def model(self) -> Model:
        c = self.config
        made = Assembly("tower", 60.0)
        self._add_tower(made.parts["tower"])
        platform = made.hang(
            "platform", "tower", c.masses["platform"], kind="prismatic", at=(0.0, 0.0, 0.0),
            axis=(0.0, 0.0, 1.0), upper=self.rise, effort=_LIFT, velocity=c.speed, joint="height",
        )  # fmt: skip
        self._add_platform(platform)
        half, slope = 0.5 * c.length, self._slope()
        hinge = (-half, 0.0, c.thickness)
        ramp = made.hang(
            "ramp", "platform", c.masses["ramp"], at=hinge, axis=(0.0, 1.0, 0.0),
            upper=0.5 * math.pi + slope, effort=_FOLD,
        )  # fmt: skip
        along, down = 0.5 * c.ramp, 0.5 * _FLAP
        at = (
            -half - along * math.cos(slope) + down * math.sin(slope),
            0.0,
            c.thickness - along * math.sin(slope) - down * math.cos(slope),
        )
        turn = (0.0, -slope, 0.0)
        flap = (c.ramp, c.width - 0.02, _FLAP)
        ramp.visual.append(Shape(kind="box", material="platform", at=at, rpy=turn, size=flap))
        ramp.hulls.append(self._wedge())
        back = (half, 0.0, -c.thickness)
        ramp.inertia = weigh(c.masses["ramp"], [shifted(ramp.visual[0], back)])
        edge = (-half - (c.ramp - 0.02) * math.cos(slope), 0.0,
                c.thickness - (c.ramp - 0.02) * math.sin(slope))  # fmt: skip
        ramp.visual.append(
            Shape(kind="box", material="warning", at=edge, rpy=turn,
                  size=(0.04, c.width - 0.02, 0.002))
        )  # fmt: skip
        self._hang_bar(made)
        return made.model("platform_lift", c.source, c.materials)

    def _wedge(self) -> MeshFile:
        """Return what the ramp collides with: sharp where it meets the ground, so as not to press on it."""
        c = self.config
        reach, side = c.ramp * math.cos(self._slope()), 0.5 * c.width - 0.01
        edges = ((-reach, _TIP - c.thickness), (0.0, -_MARGIN), (0.0, -0.03))
        corners = [(x, y, z) for x, z in edges for y in (-side, side)]
        return MeshFile(str(cached("ramp", ".obj", hull.obj(np.array(corners)))))

    def _add_tower(self, tower: Part) -> None:
        tall = self.rise + 1.1
        at, size = (0.0, self._tower_y(), 0.5 * tall), (0.5, 0.16, tall)
        tower.visual += [
            Shape(kind="box", material="tower", at=at, size=size, bevel=0.02),
            Shape(kind="box", material="steel", size=(0.1, 0.008, 0.16),
                  at=(-0.1, at[1] - 0.083, 1.0)),
            Shape(kind="box", material="tower", size=(0.7, 0.22, 0.02), at=(0.0, at[1], 0.01)),
        ]  # fmt: skip
        for z in (0.96, 1.04):
            on = ((-0.1, at[1] - 0.087, z), (-0.1, at[1] - 0.097, z))
            tower.visual.append(Shape(kind="cylinder", material="button", radius=0.018, points=on))
        tower.collision.append(Shape(kind="box", at=at, size=size))

    def _add_platform(self, part: Part) -> None:
        c = self.config
        deck = (c.length, c.width + 2 * _WALL, c.thickness - 0.005)
        at = (0.0, 0.0, 0.5 * (c.thickness + 0.005))
        part.visual.append(Shape(kind="box", material="platform", at=at, size=deck))
        part.collision.append(Shape(kind="box", at=at, size=deck))
        for x in (-0.5 * c.length + 0.02, 0.5 * c.length - 0.02):
            mark = (x, 0.0, c.thickness + 0.001)
            part.visual.append(
                Shape(kind="box", material="warning", at=mark, size=(0.04, c.width, 0.002))
            )
        top = c.thickness + c.guard_height
        for sign in (1, -1):
            y = sign * 0.5 * (c.width + _WALL)
            panel: tuple[Triple, Triple] = (
                (0.0, y, c.thickness + 0.5 * (c.guard_height - 0.06)),
                (c.length - 0.1, 0.018, c.guard_height - 0.14),
            )
            part.visual.append(
                Shape(kind="box", material="guard", at=panel[0], size=panel[1], bevel=0.006)
            )
            wall = (c.length, _WALL, c.guard_height)
            part.collision.append(
                Shape(kind="box", at=(0.0, y, c.thickness + 0.5 * c.guard_height), size=wall)
            )
            x = 0.5 * c.length - 0.02
            frame = ((-x, y, c.thickness), (-x, y, top - 0.018), (x, y, top - 0.018),
                     (x, y, c.thickness))  # fmt: skip
            part.visual.append(
                Shape(kind="tube", material="steel", radius=0.018, bend=0.08, points=frame)
            )
        carriage = (0.0, 0.5 * c.width + _WALL + 0.012, c.thickness + 0.3)
        part.visual.append(Shape(kind="box", material="steel", at=carriage, size=(0.3, 0.03, 0.5)))

    def _hang_bar(self, made: Assembly) -> None:
        c = self.config
        x, y = 0.5 * c.length - 0.05, 0.5 * (c.width + _WALL)
        z = c.thickness + c.bar_height
        bar = made.hang(
            "bar", "platform", c.masses["bar"], at=(x, y, z), axis=(-1.0, 0.0, 0.0), upper=_OPEN,
            effort=_SWING,
        )  # fmt: skip
        ends = ((x, y - 0.03, z), (x, -y + 0.02, z))
        bar.visual.append(Shape(kind="tube", material="warning", radius=0.016, points=ends))
        bar.collision.append(Shape(kind="capsule", radius=0.016, points=ends))


__all__ = ["PlatformLift", "PlatformLiftConfig"]
