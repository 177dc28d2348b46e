"""Where bone lies near the skin: how thick the flesh is over it, and which region of skin that is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array

from ..body.skeleton import DOF_INDEX, DOFS, JOINT_INDEX, JOINTS, SIDES, forward_kinematics
from ..body.skin import BodyModel

THINNEST = 0.002  # [m] of skin over bone
ELSEWHERE = "elsewhere"  # the region of skin that no prominence is near


@dataclass(frozen=True)
class Prominence:
    """A bone that comes near the skin, as a sphere.

    Attributes:
        joint: SMPL-X joint that it moves with, without its side if there is one on each.
        at: Where a line begins, from the joint or, for the pelvis, from the middle of the hips: shares
            of stature to the (left) side, up and forward in the T-pose.
        towards: Where that line leaves the body; the sphere lies on it beneath the skin.
        flesh_m: Thickness of the flesh over it where nothing presses, hips bent by 90 degrees [m].
        radius_m: Radius [m].
        region: Which region of skin it belongs to; a side comes before it if there is one on each.
        sided: Whether there is one on each side.
        source: Where the figures come from.
    """

    joint: str
    at: tuple[float, float, float]
    towards: tuple[float, float, float]
    flesh_m: float
    radius_m: float
    region: str
    source: str
    sided: bool = True


@dataclass(frozen=True)
class RestingFlesh:
    """Flesh between support and bone (`assets/clinical/resting_flesh.yaml`).

    Attributes:
        modulus_pa: Of small strain [Pa], as in `Layer`.
        limit: Strain that no pressure reaches.
        reach_m: By how much more flesh than over a prominence skin may have to belong to its region [m].
        wasted: Share of the flesh over prominences of buttocks and legs left at hip extensors of grade 0.
        cover_m: Thickness over bone away from prominences, by SMPL-X joint without its side [m].
        relaxed: Stiffness of joints that let a resting limb down, about the axis across [N·m/rad].
        prominences: By name.
        source: Where the figures come from.
    """

    modulus_pa: float
    limit: float
    reach_m: float
    wasted: float
    cover_m: dict[str, float]
    relaxed: dict[str, float]
    prominences: dict[str, Prominence]
    source: str

    def __post_init__(self) -> None:
        kinds = {_kind(joint) for joint in JOINTS}
        named = [*self.cover_m, *self.relaxed, *(p.joint for p in self.prominences.values())]
        for kind in named:
            check_name("joint", kind, kinds)


@lru_cache(maxsize=1)
def resting_flesh() -> RestingFlesh:
    """Return the figures that ship."""
    return load(RestingFlesh, assets.find("clinical", "resting_flesh"))


def regions() -> tuple[str, ...]:
    """Return the regions of skin, those over prominences first."""
    found: dict[str, None] = {}
    for one in resting_flesh().prominences.values():
        for side in SIDES if one.sided else ("",):
            found[f"{side}_{one.region}".lstrip("_")] = None
    return (*found, ELSEWHERE)


class Bones(NamedTuple):
    """Prominences of one body, in the frames of their joints in the T-pose, and its cover.

    Attributes:
        joints: Of each, an index, shape [b].
        centres: From the joint [m], shape [b, 3].
        radii: [m], shape [b].
        flesh: Thickness of the flesh over each [m], shape [b].
        regions: Of each, an index in `regions()`, shape [b].
        cover: Flesh over each vertex of the skin away from them [m], shape [v].
    """

    joints: npt.NDArray[np.intp]
    centres: Array
    radii: Array
    flesh: Array
    regions: npt.NDArray[np.intp]
    cover: Array


@lru_cache(maxsize=32)
def bones(model: BodyModel, height: float) -> Bones:
    """Return the prominences of a body of that stature [m].

    Raises:
        ConfigError: If a line to a prominence meets no skin.
    """
    figures, names = resting_flesh(), regions()
    angles = np.zeros(len(DOFS))
    for side in SIDES:
        angles[DOF_INDEX[f"{side}_hip_flexion"]] = 0.5 * math.pi
    turns, places = forward_kinematics(model.joints, angles)
    skin = model.posed(turns, places).astype(np.float64)
    hips = 0.5 * sum(model.joints[JOINT_INDEX[f"{side}_hip"]] for side in SIDES)
    rows = []
    for name, one in figures.prominences.items():
        for side, sign in zip(SIDES, (1.0, -1.0), strict=True) if one.sided else (("", 1.0),):
            joint = one.joint if one.joint in JOINT_INDEX else f"{side}_{one.joint}"
            j, mirror = JOINT_INDEX[joint], np.array((sign, 1.0, 1.0))
            start = mirror * one.at * height
            if joint == JOINTS[0]:
                start = start + hips - model.joints[j]
            way = mirror * one.towards / np.linalg.norm(one.towards)
            begin, along = turns[j] @ start + places[j], turns[j] @ way
            depth = _way_out(skin, model.faces, begin, along)
            if depth is None:
                raise ConfigError(f"{side} {name}: its line meets no skin")
            centre = start + (depth - one.flesh_m - one.radius_m) * way
            region = names.index(f"{side}_{one.region}".lstrip("_"))
            rows.append((j, centre, one.radius_m, one.flesh_m, region))
    cover = np.array([figures.cover_m.get(_kind(joint), 0.02) for joint in JOINTS])
    joints, centres, radii, flesh, where = zip(*rows, strict=True)
    return Bones(
        np.array(joints),
        np.array(centres),
        np.array(radii),
        np.array(flesh),
        np.array(where),
        (cover[model.weight_joints] * model.weights).sum(axis=1),
    )


def over_bone(
    found: Bones, turns: Array, places: Array, points: Array, cover: Array, left: Array
) -> tuple[Array, npt.NDArray[np.intp]]:
    """Return thickness of the flesh at points of the skin [m] and their regions, each of shape [n].

    Args:
        found: The prominences.
        turns: Rotations of the joints in the world, shape [55, 3, 3].
        places: Their positions [m], shape [55, 3].
        points: On the skin in the world [m], shape [n, 3].
        cover: Thickness away from prominences [m], shape [n].
        left: Share of the flesh over prominences that is left, shape [n].
    """
    j = found.joints
    middles = np.einsum("bac,bc->ba", turns[j], found.centres) + places[j]
    off = np.linalg.norm(points[:, None] - middles, axis=2) - found.radii
    beyond = off - found.flesh
    region = found.regions[np.argmin(beyond, axis=1)]
    region = np.where(beyond.min(axis=1) < resting_flesh().reach_m, region, len(regions()) - 1)
    flesh = np.minimum(cover, (off - (1 - left)[:, None] * found.flesh).min(axis=1))
    return np.maximum(flesh, THINNEST), region


def _kind(joint: str) -> str:
    return joint.split("_", 1)[1] if joint.startswith(SIDES) else joint


def _way_out(skin: Array, faces: npt.NDArray[np.int32], begin: Array, along: Array) -> float | None:
    """Return the way from a point to where a line last leaves the skin [m]; None if it meets none."""
    a, b, c = (skin[faces[:, k]] for k in range(3))
    u, w = b - a, c - a
    across = np.cross(along, w)
    size = (u * across).sum(axis=1)
    near = np.abs(size) > 1e-14
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=near)
    off = begin - a
    s = (off * across).sum(axis=1) * scale
    turned = np.cross(off, u)
    t = (turned @ along) * scale
    depth = (turned * w).sum(axis=1) * scale
    hit = depth[near & (s >= 0) & (t >= 0) & (s + t <= 1) & (depth > 0)]
    return float(hit.max()) if len(hit) else None
