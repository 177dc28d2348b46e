"""What a person rests on: flat pads of a cushion, and limbs that something else bears."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array, Pose, quaternion_from_rpy

from ..body.skeleton import JOINTS, SIDES

LEGS = tuple(f"{side}_knee" for side in SIDES)
FOREARMS = tuple(f"{side}_elbow" for side in SIDES)


@dataclass(frozen=True)
class Layer:
    """What yields under pressure p, column by column: strain e with p = preload + E e / (1 - e / limit).

    Attributes:
        thickness_m: Unloaded thickness [m].
        modulus_pa: Modulus E of small strain [Pa].
        limit: Strain that no pressure reaches.
        preload_pa: Pressure below which it does not yield, such as that of air in cells [Pa].
        spread: How much its columns hold each other: 0 not at all, 1 as an elastic solid, which is
            stiffer by 1 + 2 thickness / (pi a) under a patch of half-width a.
    """

    thickness_m: float
    modulus_pa: float
    limit: float
    preload_pa: float = 0.0
    spread: float = 1.0

    def __post_init__(self) -> None:
        for name in ("thickness_m", "modulus_pa"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} must be above 0, got {getattr(self, name)}")
        if not 0 < self.limit <= 1:
            raise ConfigError(f"limit must lie above 0 and up to 1, got {self.limit}")
        for name in ("preload_pa", "spread"):
            if not getattr(self, name) >= 0:
                raise ConfigError(f"{name} must not be negative, got {getattr(self, name)}")


@dataclass(frozen=True)
class Cushion:
    """A cushion, mattress or bare seat (`assets/cushions/<name>.yaml`).

    Attributes:
        description: One line for a person to read.
        layer: How it yields.
        source: Where the figures come from.
    """

    description: str
    layer: Layer
    source: str


@lru_cache(maxsize=32)
def load_cushion(name: str | Path) -> Cushion:
    """Return the cushion of that name, or from that YAML file."""
    return load(Cushion, assets.find("cushions", name))


@dataclass(frozen=True)
class Pad:
    """A rectangle that bears.

    Attributes:
        name: What it is, such as `seat`.
        pose: Middle of its unloaded surface in the world, z out of it, x to where who sits looks.
        size: Lengths along x and y [m].
        cushion: What it is made of.
        grips: Whether skin sticks to it along x. Who slides on all pads but one is held by that one.
    """

    name: str
    pose: Pose
    size: tuple[float, float]
    cushion: Cushion
    grips: bool = False

    def __post_init__(self) -> None:
        if not min(self.size) > 0:
            raise ConfigError(f"a pad needs lengths above 0, got {self.size}")

    @property
    def axes(self) -> Array:
        """Its axes in the world, as columns, shape [3, 3]."""
        return self.pose.matrix()[:3, :3]


@dataclass(frozen=True)
class Support:
    """Pads, and the limbs that something else bears.

    Attributes:
        pads: At least one; the first tells what is along, across and up.
        elsewhere: SMPL-X joints whose limb, down to its end, armrests or footplates bear.
    """

    pads: tuple[Pad, ...]
    elsewhere: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.pads:
            raise ConfigError("a support needs a pad at least")
        for joint in self.elsewhere:
            check_name("joint", joint, JOINTS)


def seat_and_back(
    fold: Pose,
    recline_deg: float,
    *,
    seat: str | Path,
    back: str | Path,
    seat_size: tuple[float, float],
    back_size: tuple[float, float],
    elsewhere: tuple[str, ...] = (),
) -> Support:
    """Return two pads that meet: a seat, and a back that leans back from upright.

    Args:
        fold: Where they meet, in the middle: z out of the seat, x along it to the front.
        recline_deg: How far the back leans back [deg]; 90 lies flat.
        seat: Name or file of the cushion.
        back: Name or file of what the back is made of.
        seat_size: Depth and width [m].
        back_size: Height and width [m].
        elsewhere: As in `Support`.

    Raises:
        ConfigError: If the back does not lean back by 0 to 90 degrees, or a size is not above 0.
        UnknownNameError: If there is no such cushion or joint.
    """
    if not 0 <= recline_deg <= 90:
        raise ConfigError(f"a back leans back by 0 to 90 degrees, got {recline_deg}")
    lean = math.radians(recline_deg)
    middle = 0.5 * back_size[0] * np.array((-math.sin(lean), 0.0, math.cos(lean)))
    # Its x leads down the back, its z forward: on a flat bed both pads have the same axes.
    turned = tuple(quaternion_from_rpy(0.0, 0.5 * math.pi - lean, 0.0).tolist())
    return Support(
        (
            Pad(
                "seat", fold @ Pose((0.5 * seat_size[0], 0, 0)), seat_size, load_cushion(seat), True
            ),
            Pad("back", fold @ Pose(tuple(middle.tolist()), turned), back_size, load_cushion(back)),
        ),
        elsewhere,
    )


def chair(fold: Pose, cushion: str | Path = "foam", recline_deg: float = 10.0) -> Support:
    """Return a wheelchair for an adult; footplates bear shanks and feet, armrests forearms and hands."""
    return seat_and_back(
        fold,
        recline_deg,
        seat=cushion,
        back="backrest",
        seat_size=(0.43, 0.46),
        back_size=(0.48, 0.44),
        elsewhere=(*LEGS, *FOREARMS),
    )


def bed(fold: Pose, mattress: str | Path = "hospital_foam", head_deg: float = 0.0) -> Support:
    """Return a bed whose head is raised [deg] from the fold, towards -x."""
    foot, head, width = 1.3, 1.0, 0.9  # [m]
    if head_deg == 0:
        middle = fold @ Pose((0.5 * (foot - head), 0.0, 0.0))
        return Support((Pad("bed", middle, (foot + head, width), load_cushion(mattress), True),))
    return seat_and_back(
        fold,
        90.0 - head_deg,
        seat=mattress,
        back=mattress,
        seat_size=(foot, width),
        back_size=(head, width),
    )
