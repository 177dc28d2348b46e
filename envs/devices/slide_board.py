"""A transfer slide board: it bridges two seats, and somebody slides along it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rcare_marl import assets
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.urdf import Joint, Link, Model, Shape
from rcare_marl.world import World

from .assembly import weigh
from .device import Device, Frame
from .dry_friction import grip

_RUBBER = 0.003  # thickness of what is under the ends [m]
_END = 0.16  # length of an end [m]


@dataclass(frozen=True)
class SlideBoardConfig:
    """Dimensions of a board [m, kg]; see `assets/devices/slide_board.yaml`."""

    source: str
    length: float
    width: float
    thickness: float
    mass: float
    friction: float
    grip: float
    materials: dict[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        if self.length <= 2 * _END or self.thickness < 0.01:
            raise ConfigError(f"a slide board is longer than {2 * _END} m and 10 mm thick at least")
        if not 0 <= self.friction < self.grip:
            raise ConfigError("the top of a slide board slips before its ends do")


class SlideBoard(Device):
    """A rigid board: x along it, z up, origin in the middle of its smooth top.

    Frames: `middle`, `end_a`, `end_b` (tops of the ends), `grip` (a hand hole, beside the middle).
    """

    postures = {"seated": ("bench", "middle")}
    _fixed = False

    def __init__(self, config: SlideBoardConfig | None = None) -> None:
        """Make a board of the dimensions in `config`; those of the data file if None."""
        self.config = config or load(SlideBoardConfig, assets.find("devices", "slide_board"))

    @property
    def frames(self) -> Mapping[str, Frame]:
        c = self.config
        end = 0.5 * c.length - 0.5 * _END
        return {
            "middle": Frame((0.0, 0.0, 0.0), note="of the top"),
            "end_a": Frame((-end, 0.0, 0.0), note="top of one end"),
            "end_b": Frame((end, 0.0, 0.0), note="top of the other end"),
            "grip": Frame((0.0, 0.5 * c.width - 0.03, 0.0), note="hand hole"),
        }

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        grip(world, body, [-1], friction=self.config.friction)
        grip(world, body, [body.links["ends"]], friction=self.config.grip)
        return body

    def _kept_links(self) -> tuple[str, ...]:
        return ("ends",)  # they grip, the top does not

    def model(self) -> Model:
        c = self.config
        wood = c.thickness - _RUBBER
        plank = Shape(kind="box", at=(0.0, 0.0, -0.5 * wood), size=(c.length, c.width, wood))
        middle = c.length - 2 * _END
        seen: list[Shape] = []
        # Three pieces: the ends look thin, where they go under a thigh.
        for x, size, deep in (
            (0.0, middle + 0.02, wood),
            (-0.5 * (middle + _END), _END, 0.7 * wood),
            (0.5 * (middle + _END), _END, 0.7 * wood),
        ):
            seen.append(
                Shape(kind="box", material="wood", at=(x, 0.0, -0.5 * deep),
                      size=(size, c.width, deep), bevel=0.004)
            )  # fmt: skip
        for sign in (1, -1):  # hand holes
            hole = (0.0, sign * (0.5 * c.width - 0.03), -0.5 * wood)
            seen.append(
                Shape(kind="box", material="edge", at=hole, size=(0.1, 0.026, wood + 0.0006),
                      bevel=0.006)
            )  # fmt: skip
        pads = [
            Shape(kind="box", material="rubber", size=(_END, c.width, _RUBBER),
                  at=(sign * 0.5 * (middle + _END), 0.0, -wood - 0.5 * _RUBBER))
            for sign in (1, -1)
        ]  # fmt: skip
        com, inertia = weigh(0.95 * c.mass, [plank])
        below, about = weigh(0.05 * c.mass, pads)
        links = {
            "board": Link(0.95 * c.mass, com, inertia, visual=tuple(seen), collision=(plank,)),
            "ends": Link(0.05 * c.mass, below, about, visual=tuple(pads), collision=tuple(pads)),
        }
        joints = {"ends": Joint(kind="fixed", parent="board", child="ends")}
        return Model(
            name="slide_board", source=c.source, links=links, joints=joints, materials=c.materials
        )


__all__ = ["SlideBoard", "SlideBoardConfig"]
