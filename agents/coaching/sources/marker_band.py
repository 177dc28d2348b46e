"""Bands with printed markers that a person wears so that a camera can tell how the upper body is bent.

A band is a stiff cuff of flat cards round a limb, or a card or two elsewhere. The cards of a cuff flare
towards the hand: an arm that points at the camera then still shows them, and one that hangs, is held out
or points up is seen no worse. All numbers are of OpenCV's dictionary 4x4_50. Sizes, places and flare are our
own choice; docs/coaching_camera.md has what they give.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array

from ..upper_body import SIDES, SIGN, UpperBody

DICTIONARY = "4x4_50"
# What carries bands. Frames as in `upper_body`: those of the hanging arm have z up along the bone. Origins:
# trunk in the middle of the shoulder line, head where it turns, upper arm at the shoulder, forearm at
# the elbow; the frame of a forearm turns with its pronation.
SEGMENTS = tuple(
    """
    trunk head left_upper_arm right_upper_arm left_forearm right_forearm
    """.split()
)
CARD = 8 / 6  # edge of a card over that of its black square: one cell of white all round


@dataclass(frozen=True, eq=False)
class Face:
    """One printed card of a band.

    Attributes:
        id: Number of its marker in the dictionary.
        size: Edge of the black square [m].
        place: Its frame in that of the band: x right in the print, y up, z out of it, shape [4, 4].
    """

    id: int
    size: float
    place: Array

    def corners(self) -> Array:
        """Return the corners of the black square in the frame of the band [m], shape [4, 3].

        Clockwise from the upper left as one looks at the print, as OpenCV has them.
        """
        half = self.size / 2 * np.array(((-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)))
        return np.asarray(half @ self.place[:3, :2].T + self.place[:3, 3])


@dataclass(frozen=True, eq=False)
class Band:
    """Cards that are fixed to each other and to one part of the body.

    Attributes:
        name: What it is called.
        segment: What carries it, one of `SEGMENTS`.
        faces: Its cards.
        at: Where its origin is on a segment of a body of 1.7 m [m], shape [3].
        grows: Share of `at` that grows with the stature, shape [3].
    """

    name: str
    segment: str
    faces: tuple[Face, ...]
    at: Array
    grows: Array

    def __post_init__(self) -> None:
        check_name("segment that carries a band", self.segment, SEGMENTS)
        if not self.faces:
            raise ConfigError(f"band {self.name!r} has no faces")

    def place_on(self, height: float) -> Array:
        """Return where its origin is on the segment of somebody `height` [m] tall [m], shape [3]."""
        return np.asarray(self.at * (1 + self.grows * (height / 1.7 - 1)))


def card(number: int, size: float, at: Sequence[float] | Array, out: Sequence[float]) -> Face:
    """Return a card whose print looks along `out`, its y as far up as that allows.

    Args:
        number: Of its marker.
        size: Edge of the black square [m].
        at: Middle of the print in the frame of the band [m].
        out: Where it looks, of any length.
    """
    z = np.asarray(out, np.float64) / np.linalg.norm(out)
    up = np.array((0.0, 0.0, 1.0)) - z[2] * z
    y = up / np.linalg.norm(up)
    place = np.eye(4)
    place[:3, :3] = np.column_stack((np.cross(y, z), y, z))
    place[:3, 3] = at
    return Face(number, size, place)


def cuff(
    first: int, size: float, radius: float, flare_deg: float, *, sign: float
) -> tuple[Face, ...]:
    """Return four cards round a limb, of the numbers from `first` on: outside, front, inside, back.

    Args:
        first: Number of the first.
        size: Edge of the black squares [m].
        radius: Of the limb where the narrow ends of the cards touch it [m].
        flare_deg: How far the cards look towards the hand [deg].
        sign: 1 on the left, -1 on the right: whether outside is left or right.
    """
    flare = math.radians(flare_deg)
    middle = radius + 0.5 * CARD * size * math.sin(flare)
    out = []
    for k in range(4):
        x, y = math.sin(k * math.pi / 2), sign * math.cos(k * math.pi / 2)
        normal = (x * math.cos(flare), y * math.cos(flare), -math.sin(flare))
        out.append(card(first + k, size, (middle * x, middle * y, 0.0), normal))
    return tuple(out)


def band_set(
    *, size: float = 0.06, chest: float = 0.09, flare_deg: float = 35.0
) -> tuple[Band, ...]:
    """Return the bands of one person: chest, shoulders, head, above the elbows and above the wrists.

    Args:
        size: Edge of the black squares [m]; a card is a third larger.
        chest: That of the one on the chest [m].
        flare_deg: How far the cards of cuffs look towards the hand [deg].

    Raises:
        ConfigError: If a size is not positive, or the flare does not lie in 0 to 80 degrees.
    """
    if not (size > 0 and chest > 0):
        raise ConfigError(f"sizes of markers must be positive, got {size} and {chest}")
    if not 0 <= flare_deg <= 80:
        raise ConfigError(f"flare_deg must lie in 0..80, got {flare_deg}")
    usual = UpperBody.of_height(1.7)
    none, wide, long = np.zeros(3), np.array((0.0, 1.0, 0.0)), np.array((0.0, 0.0, 1.0))
    bands = [
        Band(
            "chest",
            "trunk",
            (card(0, chest, none, (1.0, 0.0, 0.25)),),
            np.array((0.17, 0.0, -0.13)),
            long,
        ),
    ]
    for i, side in enumerate(SIDES):
        sign = SIGN[side]
        bands.append(
            Band(
                f"{side}_shoulder",
                "trunk",
                (card(1 + i, size, none, (0.75, 0.3 * sign, 0.6)),),
                np.array((0.07, sign * (usual.shoulder - 0.02), 0.075)),
                wide,
            )
        )
    headband = []
    for k, turn in enumerate(np.radians((0.0, 55.0, -55.0, 110.0, -110.0))):
        x, y = math.cos(turn), math.sin(turn)
        headband.append(card(4 + k, size, (0.115 * x, 0.095 * y, 0.0), (x, y, 0.15)))
    bands.append(Band("head", "head", tuple(headband), np.array((0.02, 0.0, 0.165)), long))
    for i, side in enumerate(SIDES):
        sign, first = SIGN[side], 10 + 10 * i
        above_elbow = np.array((0.0, 0.0, -usual.upper_arm + 0.075))
        above_wrist = np.array((0.0, 0.0, -usual.forearm + 0.055))
        bands.append(
            Band(
                f"{side}_elbow",
                f"{side}_upper_arm",
                cuff(first, size, 0.052, flare_deg, sign=sign),
                above_elbow,
                long,
            )
        )
        bands.append(
            Band(
                f"{side}_wrist",
                f"{side}_forearm",
                cuff(first + 4, size, 0.04, flare_deg, sign=sign),
                above_wrist,
                long,
            )
        )
    return tuple(bands)
