"""Garments cut to measure: tubes and panels of cloth, sewn where real ones are.

A garment lies in the frame of the body that it is cut for: x to the wearer's left, y up, z forward, as it
would be worn in the T-pose. That shape is cloth at rest; where it lies in the world is another matter.

All rows of a tube have as many particles; rows of different tubes share particles where they are sewn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..errors import ConfigError, check_name
from ..pose import Array
from .contact import Indices
from .material import Fabric

Row = list[int]

ROUNDNESS = 0.7  # depth of a trunk as a share of its width; our own choice
_FINE = 720  # points of an ellipse from which equal steps are taken
_UP, _LEFT = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
# Of a shirt, our own choices: how far it is above the ridge of the shoulder, how far that slopes, and how
# deep the neck is cut in front and at the back [m].
_RAISE, _SLOPE, _FRONT_NECK, _BACK_NECK = 0.03, 0.02, 0.07, 0.015
_ARMHOLE = 0.42  # half of the width of an armhole, as a share of its height; our own choice

Cut = Literal["trousers", "shirt", "sheet"]
DIMENSIONS: dict[Cut, tuple[str, ...]] = {
    "trousers": ("waist", "hip", "rise", "thigh", "hem", "leg"),
    "shirt": ("chest", "hem", "length", "shoulders", "neck", "armhole", "cuff", "sleeve"),
    "sheet": ("width", "length"),
}


@dataclass(frozen=True)
class Dimension:
    """A length of a garment: a share of a measure of the body, and ease.

    Attributes:
        measure: Name of the measure; none if empty.
        share: How much of it.
        ease_m: What is added [m], or all of it where there is no measure.
    """

    measure: str = ""
    share: float = 1.0
    ease_m: float = 0.0

    def of(self, measures: Mapping[str, float]) -> float:
        """Return it for the measures of a body [m]."""
        if not self.measure:
            return self.ease_m
        check_name("measure of a body", self.measure, measures)
        return self.share * measures[self.measure] + self.ease_m


@dataclass(frozen=True)
class GarmentConfig:
    """A garment (`assets/garments/<name>.yaml`).

    Attributes:
        description: One line for a person to read.
        cut: What it is sewn like.
        fabric: What it is made of.
        spacing_m: Distance of its particles [m].
        dimensions: Its lengths, by name; which ones depends on the cut.
        rgb: Its colour.
        open_back: Whether a shirt is open at the back but for a tie at the neck.
    """

    description: str
    cut: Cut
    fabric: Fabric
    spacing_m: float
    dimensions: dict[str, Dimension]
    rgb: tuple[int, int, int] = (120, 150, 180)
    open_back: bool = False

    def __post_init__(self) -> None:
        if not 0.005 <= self.spacing_m <= 0.2:
            raise ConfigError(f"spacing_m must lie in 0.005..0.2, got {self.spacing_m}")
        known = DIMENSIONS[self.cut]
        for name in self.dimensions:
            check_name(f"dimension of a garment cut as {self.cut}", name, known)
        missing = [name for name in known if name not in self.dimensions]
        if missing:
            raise ConfigError(f"a garment cut as {self.cut} also needs {', '.join(missing)}")


@dataclass(frozen=True, eq=False)
class Garment:
    """Cloth cut to measure.

    Attributes:
        config: What it was cut from.
        rest: Positions at rest in the frame of the body [m], shape [n, 3].
        faces: Shape [m, 3], counter-clockwise from outside.
        grain: Direction of the warp, shape [n, 3].
        rings: Particles along its openings by name, such as `waist`, `left_hem`; each in order.
    """

    config: GarmentConfig
    rest: Array
    faces: Indices
    grain: Array
    rings: dict[str, Indices] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Frame:
    """Where on a body a garment goes, in the T-pose; all in metres.

    Attributes:
        crotch: Height of the crotch.
        shoulder: Height of the shoulder's ridge.
        depth: Where the middle of the trunk is, to the front.
        arm: Height and depth of the arm's axis.
        knee: Where the middle of the knee is, to the side and to the front.
    """

    crotch: float = 0.8
    shoulder: float = 1.5
    depth: float = 0.0
    arm: tuple[float, float] = (1.45, 0.0)
    knee: tuple[float, float] = (0.1, 0.0)


class Pattern:
    """Particles, faces and grain of a garment that is being sewn.

    Attributes:
        rings: Particles along the openings, by name.
    """

    def __init__(self) -> None:
        self._points: list[Array] = []
        self._grain: list[Array] = []
        self._faces: list[tuple[int, int, int]] = []
        self.rings: dict[str, Indices] = {}

    def add(self, points: Array, grain: Sequence[float]) -> Row:
        """Add particles and return their numbers."""
        first = len(self._points)
        self._points.extend(np.asarray(points, np.float64))
        self._grain.extend([np.asarray(grain, np.float64)] * len(points))
        return list(range(first, len(self._points)))

    def at(self, row: Sequence[int]) -> Array:
        """Return the positions of particles [m], shape [r, 3]."""
        return np.array([self._points[i] for i in row])

    def join(self, upper: Sequence[int], lower: Sequence[int], *, closed: bool) -> None:
        """Put faces between two rows of equal length; outside is where a row runs counter-clockwise.

        Seen from outside, rows run to the right and `lower` lies below. Diagonals alternate.
        """
        count = len(upper)
        for k in range(count if closed else count - 1):
            n = (k + 1) % count
            a, b, c, d = upper[k], upper[n], lower[n], lower[k]
            if (k + len(self._faces) // (2 * max(count, 1))) % 2 == 0:
                self._faces += [(a, d, c), (a, c, b)]
            else:
                self._faces += [(a, d, b), (d, c, b)]

    def sewn(self) -> tuple[Array, Indices, Array]:
        """Return positions [m] [n, 3], faces [m, 3] without those that a seam closed, and grain [n, 3]."""
        faces = [f for f in self._faces if len(set(f)) == 3]
        return np.array(self._points), np.array(faces, np.int32), np.array(self._grain)

    def ring(self, name: str, row: Sequence[int]) -> None:
        """Name the particles along an opening."""
        self.rings[name] = np.array(row, np.int32)


def steps(length: float, spacing: float, least: int = 1) -> int:
    """Return how many cells a length has [m]."""
    return max(least, round(length / spacing))


def ellipse(girth: float, roundness: float, count: int) -> Array:
    """Return points at equal steps around an ellipse, from the front to the left, shape [count, 2].

    Args:
        girth: Its length [m].
        roundness: Depth as a share of width.
        count: How many.

    Returns:
        To the left and to the front [m].
    """
    angle = np.linspace(0.0, 2 * np.pi, _FINE + 1)
    fine = np.stack([np.sin(angle), roundness * np.cos(angle)], axis=1)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1)))
    wanted = np.arange(count) / count * along[-1]
    points = np.stack([np.interp(wanted, along, fine[:, k]) for k in range(2)], axis=1)
    return np.asarray(points * girth / along[-1])


def _level(points: Array, height: float, depth: float) -> Array:
    """Return points at a height of the body, given to the left and to the front, shape [n, 3]."""
    return np.column_stack((points[:, 0], np.full(len(points), height), points[:, 1] + depth))


def trousers(sizes: Mapping[str, float], spacing: float, frame: Frame) -> Pattern:
    """Sew trousers: a tube from waist to crotch, a gusset, and two legs.

    Args:
        sizes: `waist`, `hip`, `rise`, `thigh`, `hem` and `leg` [m].
        spacing: Of particles [m].
        frame: Where on the body they go.
    """
    out = Pattern()
    around = 2 * steps(sizes["hip"], 2 * spacing, 4)
    rows = steps(sizes["rise"], spacing, 2)
    above: Row = []
    for k in range(rows + 1):
        share = k / rows
        girth = sizes["waist"] + min(share / 0.6, 1.0) * (sizes["hip"] - sizes["waist"])
        height = frame.crotch + (1 - share) * sizes["rise"]
        ring = _level(ellipse(girth, ROUNDNESS, around), height, frame.depth)
        row = out.add(ring, _UP)
        if above:
            out.join(above, row, closed=True)
        else:
            out.ring("waist", row)
        above = row
    half = around // 2
    front, back = out.at(above)[[0, half]]
    inner = steps(float(front[2] - back[2]), spacing, 3) - 1
    across = np.arange(1, inner + 1) / (inner + 1)
    bridge = front + across[:, None] * (back - front)
    bridge[:, 1] -= 0.03 * np.sin(np.pi * across)  # a gusset hangs a little
    gusset = out.add(bridge, _UP)  # from front to back
    left = [*above[: half + 1], *gusset[::-1]]
    right = [*above[half:], above[0], *gusset]
    for name, top, side in (("left", left, 1.0), ("right", right, -1.0)):
        end = (side * frame.knee[0], frame.knee[1] + frame.depth / 2)
        _add_leg(out, name, top, sizes, spacing, end)
    return out


def _add_leg(
    out: Pattern,
    name: str,
    top: Row,
    sizes: Mapping[str, float],
    spacing: float,
    end: tuple[float, float],
) -> None:
    """Sew a leg onto the ring at the top of it, its hem's middle to the side and front of `end`."""
    ring = out.at(top)
    rows, count = steps(sizes["leg"], spacing, 2), len(top)
    middle = ring.mean(axis=0)
    angle = np.unwrap(np.arctan2(ring[:, 0] - middle[0], ring[:, 2] - middle[2]))
    even = angle.mean() + np.arange(count) / count * 2 * np.pi
    even -= even.mean() - angle.mean()
    above, lowest = top, float(ring[:, 1].max())
    for k in range(1, rows + 1):
        share = k / rows
        girth = sizes["thigh"] + share * (sizes["hem"] - sizes["thigh"])
        wide = max(0.0, 1 - k / 3)  # of the wide ring at the crotch, some is left below it
        at = angle * wide + even * (1 - wide)
        round_ring = girth / (2 * np.pi) * np.stack([np.sin(at), np.cos(at)], axis=1)
        x = middle[0] + share * (end[0] - middle[0]) + round_ring[:, 0]
        z = middle[2] + share * (end[1] - middle[2]) + round_ring[:, 1]
        flat = np.column_stack((x, np.full(count, lowest - share * sizes["leg"]), z))
        if wide:
            flat[:, [0, 2]] += 0.5 * wide * (ring[:, [0, 2]] - flat[:, [0, 2]])
            flat[:, 1] += 0.5 * wide * (ring[:, 1] - lowest)
        row = out.add(flat, _UP)
        out.join(above, row, closed=True)
        above = row
    out.ring(f"{name}_hem", above)


def shirt(sizes: Mapping[str, float], spacing: float, frame: Frame, *, open_back: bool) -> Pattern:
    """Sew a shirt or gown: a tube up to the armpits, front and back above, two sleeves.

    Args:
        sizes: `chest`, `hem`, `length`, `shoulders`, `neck`, `armhole`, `cuff` and `sleeve` [m].
        spacing: Of particles [m].
        frame: Where on the body it goes.
        open_back: Whether the back is open but for a tie at the neck.
    """
    out = Pattern()
    quarter = steps(sizes["chest"], 4 * spacing, 3)
    around, armpit = 4 * quarter, frame.shoulder - sizes["armhole"]
    rows = steps(sizes["length"] - sizes["armhole"], spacing, 2)
    # Rows run from the middle of the back by the wearer's right, front and left to the back again.
    order = (np.arange(around + (1 if open_back else 0)) + around // 2) % around
    below: Row = []
    for k in range(rows + 1):  # from the hem up
        share = k / rows
        girth = sizes["hem"] + share * (sizes["chest"] - sizes["hem"])
        height = armpit - (1 - share) * (sizes["length"] - sizes["armhole"])
        row = out.add(_level(ellipse(girth, ROUNDNESS, around)[order], height, frame.depth), _UP)
        if below:
            out.join(row, below, closed=not open_back)
        else:
            out.ring("hem", row)
        below = row
    chest = below if open_back else [*below, below[0]]
    upper = steps(1.2 * sizes["armhole"], spacing, 3)  # it goes up and inwards
    yoke = _Yoke(out, chest, sizes, upper, frame, is_open=open_back)
    rows = steps(sizes["sleeve"], spacing, 2)
    for name, side in (("left", 1.0), ("right", -1.0)):
        _add_sleeve(out, name, yoke.armhole(name), side, sizes, rows, frame.arm)
    return out


class _Yoke:
    """Front and back of a shirt above the armpits, joined at the shoulders."""

    def __init__(
        self,
        out: Pattern,
        chest: Row,
        sizes: Mapping[str, float],
        upper: int,
        frame: Frame,
        *,
        is_open: bool,
    ) -> None:
        q = (len(chest) - 1) // 4
        self._out, self._sizes = out, sizes
        self._shoulder, self._depth = frame.shoulder, frame.depth
        self._wide = sizes["shoulders"] / 2 / float(np.abs(out.at(chest)[:, 0]).max())
        # Front: right to left. Back: its left half from the left to the middle, then its right half.
        front, left, right = [chest[q : 3 * q + 1]], [chest[3 * q :]], [chest[: q + 1]]
        self._front, self._left, self._right = front, left, right
        for k in range(1, upper + 1):
            front.append(self._raised(front[0], k / upper, 1.0, {}))
            seam = list[int]()  # places across, where front and back are one: the shoulders
            if k == upper:
                x = np.abs(out.at(front[k])[:, 0])
                seam = np.flatnonzero(x > sizes["neck"] / 2).tolist()
            shared = {2 * q - j: front[k][j] for j in seam if j >= q}
            left.append(self._raised(left[0], k / upper, -1.0, shared))
            shared = {q - j: front[k][j] for j in seam if j <= q}
            if not is_open or k == upper:  # a gown's back is tied at the neck alone
                shared[0] = left[k][-1]
            right.append(self._raised(right[0], k / upper, -1.0, shared))
        for part in (front, left, right):
            for lower, higher in zip(part, part[1:], strict=False):
                out.join(higher, lower, closed=False)
        first, last = max(j for j in seam if j < q), min(j for j in seam if j > q)
        behind = [*left[-1][2 * q - last + 1 :], *right[-1][1 : q - first]]
        out.ring("neck", [*front[-1][first : last + 1], *behind])

    def _raised(self, base: Row, share: float, side: float, shared: Mapping[int, int]) -> Row:
        """Add a row above the chest and return it; at the places `shared` it has known particles."""
        points, neck = self._out.at(base), self._sizes["neck"] / 2
        x_top = points[:, 0] * self._wide
        inside = np.clip(1 - (x_top / neck) ** 2, 0.0, 1.0)  # of the neck's opening
        y_top = self._shoulder + _RAISE - _SLOPE * np.abs(x_top) / (self._sizes["shoulders"] / 2)
        y_top -= (_FRONT_NECK if side > 0 else _BACK_NECK) * inside
        z_top = self._depth + side * ROUNDNESS * neck * np.sqrt(inside)
        # Up a quarter of an ellipse where the trunk is deep, straight up at the armholes.
        deep = np.abs(points[:, 2] - self._depth)
        deep /= deep.max()
        high = share + (np.sin(share * np.pi / 2) - share) * deep
        x = points[:, 0] + high * (x_top - points[:, 0])
        y = points[:, 1] + high * (y_top - points[:, 1])
        z = z_top + (points[:, 2] - z_top) * np.cos(share * np.pi / 2)
        # The edges of front and back go round the arm.
        tall = self._sizes["armhole"] + _RAISE
        z += side * _ARMHOLE * tall * np.sin(np.pi * share) * (1 - deep) ** 2
        own = [i for i in range(len(base)) if i not in shared]
        made = self._out.add(np.column_stack((x, y, z))[own], _UP)
        row = dict(shared) | dict(zip(own, made, strict=True))
        return [row[i] for i in range(len(base))]

    def armhole(self, name: str) -> Row:
        """Return the particles around an armhole, from the armpit, as a sleeve's row runs."""
        at = -1 if name == "left" else 0
        front = [row[at] for row in self._front]
        back = [row[0] for row in self._left] if name == "left" else [r[-1] for r in self._right]
        if name == "left":
            return [*front, *back[-2:0:-1]]
        return [*back, *front[-2:0:-1]]


def _add_sleeve(
    out: Pattern,
    name: str,
    armhole: Row,
    side: float,
    sizes: Mapping[str, float],
    rows: int,
    arm: tuple[float, float],
) -> None:
    """Sew a sleeve onto an armhole; `side` is 1 on the left, -1 on the right."""
    ring = out.at(armhole)
    middle, count = ring.mean(axis=0), len(armhole)
    around = float(np.linalg.norm(np.diff(ring, axis=0, append=ring[:1]), axis=1).sum())
    at = np.arange(count) / count * 2 * np.pi
    first = float(np.abs(ring[:, 0]).max())
    above = armhole
    for k in range(1, rows + 1):
        share = k / rows
        girth = around + share * (sizes["cuff"] - around)
        down = min(k / 3, 1.0)  # it soon runs along the arm
        y = middle[1] + down * (arm[0] - middle[1]) - girth / (2 * np.pi) * np.cos(at)
        z = middle[2] + down * (arm[1] - middle[2]) + side * girth / (2 * np.pi) * np.sin(at)
        x = np.full(count, side * (first + share * sizes["sleeve"]))
        row = out.add(np.column_stack((x, y, z)), _LEFT)
        out.join(above, row, closed=True)
        above = row
    out.ring(f"{name}_armhole", armhole)
    out.ring(f"{name}_cuff", above)


def sheet(width: float, length: float, spacing: float) -> Pattern:
    """Cut a rectangle in the plane of x and z, its middle at the origin, its warp along z."""
    out = Pattern()
    nx, nz = steps(width, spacing), steps(length, spacing)
    x = (np.arange(nx + 1) / nx - 0.5) * width
    above: Row = []
    for k in range(nz + 1):
        z = np.full(nx + 1, (k / nz - 0.5) * length)
        row = out.add(np.column_stack((x, np.zeros(nx + 1), z)), (0.0, 0.0, 1.0))
        if above:
            out.join(above, row, closed=False)
        above = row
    return out


def cut_garment(
    config: GarmentConfig, measures: Mapping[str, float], frame: Frame = Frame()
) -> Garment:
    """Cut and sew a garment.

    Args:
        config: The garment.
        measures: Of the body, by name [m].
        frame: Where on the body it goes.

    Raises:
        UnknownNameError: If a dimension names a measure that there is not.
        ConfigError: If a dimension is not above 0.
    """
    sizes = {name: dimension.of(measures) for name, dimension in config.dimensions.items()}
    for name, size in sizes.items():
        if not size > 0:
            raise ConfigError(f"dimension {name!r} of a garment must be above 0, got {size:.3f} m")
    pattern: Pattern
    if config.cut == "trousers":
        pattern = trousers(sizes, config.spacing_m, frame)
    elif config.cut == "shirt":
        pattern = shirt(sizes, config.spacing_m, frame, open_back=config.open_back)
    else:
        pattern = sheet(sizes["width"], sizes["length"], config.spacing_m)
    rest, faces, grain = pattern.sewn()
    return Garment(config, rest, faces, grain, pattern.rings)
