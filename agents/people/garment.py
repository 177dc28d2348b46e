"""Garments for an avatar: cut to their measure, and laid where they would be worn."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree  # type: ignore[import-untyped]

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array, Vector
from rcare_marl.rendering.mesh import SmoothNormals
from rcare_marl.soft.cloth import SUBSTEPS, Cloth
from rcare_marl.soft.garment import Frame, Garment, GarmentConfig, cut_garment
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.world import World

from .body.measure import measure
from .body.skin import BodyModel, PersonSkin
from .human import Human

_NEIGHBOURS = 8  # vertices of the skin that a particle follows
_CLEAR = 0.012  # [m] from the skin, where cloth is laid; our own choice
_PUSHES = 4
_TURN = 0.05  # [m] along a leg, over which its direction is taken


def load_garment(name: str | Path) -> GarmentConfig:
    """Return the garment of that name, or from that YAML file."""
    return load(GarmentConfig, assets.find("garments", name))


@lru_cache(maxsize=32)
def _tailored(name: str, model: BodyModel) -> Garment:
    taken = measure(model)
    frame = Frame(taken.crotch, taken.shoulder, taken.depth, taken.arm, taken.leg)
    return cut_garment(load_garment(name), taken.sizes, frame)


def tailor(name: str | Path, model: BodyModel) -> Garment:
    """Return a garment cut to a body's measure, in the frame of the body in the T-pose."""
    return _tailored(str(name), model)


def worn(garment: Garment, model: BodyModel, rotations: Array, positions: Array) -> Array:
    """Return where the particles of a garment are when it is worn in a posture [m], shape [n, 3].

    Each particle follows the skin that is next to it in the T-pose. That is a start, not yet at rest: let
    it settle.

    Args:
        garment: Cut for this body.
        model: The body.
        rotations: Of the joints in the world, shape [55, 3, 3].
        positions: Of the joints in the world [m], shape [55, 3].
    """
    tree, rest = cKDTree(model.vertices), _outside(garment.rest, model)
    distance, near = tree.query(rest, k=_NEIGHBOURS)
    share = 1 / (distance + 0.01)
    share /= share.sum(axis=1, keepdims=True)
    weights = np.zeros((len(rest), len(positions)))
    for k in range(_NEIGHBOURS):
        for j in range(model.weights.shape[1]):
            np.add.at(
                weights,
                (np.arange(len(weights)), model.weight_joints[near[:, k], j]),
                share[:, k] * model.weights[near[:, k], j],
            )
    moved = np.einsum("jab,njb->nja", rotations, rest[:, None] - model.joints[None])
    return np.asarray(np.einsum("nj,nja->na", weights, moved + positions[None]))


def dress(
    world: World,
    person: Human,
    name: str | Path,
    *,
    positions: Array | None = None,
    substeps: int = SUBSTEPS,
) -> Cloth:
    """Cut a garment for a spawned person, put it into the world, and return its cloth.

    Args:
        world: Where the person is.
        person: Who it is for.
        name: The garment.
        positions: Where its particles are [m], shape [n, 3]; worn if None.
        substeps: Small steps in a physics step.
    """
    garment = tailor(name, person.model)
    skin = next(s for s in world.skins if s.body is person.body and isinstance(s, PersonSkin))
    if positions is None:
        positions = worn(garment, person.model, *skin.joint_transforms())
    cloth = Cloth(
        Path(name).stem,
        garment.rest,
        garment.faces,
        fabric=garment.config.fabric,
        grain=garment.grain,
        positions=positions,
        substeps=substeps,
    )
    soft_world = SoftWorld.of(world)
    soft_world.join_limbs(person.body)
    return soft_world.add(cloth, color=garment.config.rgb, beneath=[skin])


def threaded(
    garment: Garment, leg: str, path: Array, *, start: float, gather: float, towards: Vector
) -> Array:
    """Return where trousers are that hang on a leg, gathered, the hem first [m], shape [n, 3].

    The foot has come through the waist and out of the hem; the rest hangs beside it.

    Args:
        garment: Trousers.
        leg: Which of their legs is on it: `left` or `right`.
        path: Points of the middle of the leg from the toes upwards, in the world [m], shape [k, 3].
        start: How far along the path the hem is [m].
        gather: Length on the path of a metre of trousers.
        towards: Direction in the world to where the other leg of the trousers lies, shape [3].

    Raises:
        UnknownNameError: If there is no such leg.
        ConfigError: If the path has no length or ends before the trousers do.
    """
    rings = {name.removesuffix("_hem"): name for name in garment.rings if name.endswith("_hem")}
    check_name("leg of a garment", leg, rings)
    rest, ring = garment.rest, garment.rest[garment.rings[rings[leg]]]
    middle, side = ring.mean(axis=0), 1.0 if leg == "left" else -1.0
    way = np.linalg.norm(np.diff(path, axis=0), axis=1)
    along = np.append(0.0, np.cumsum(way))
    at = start + gather * (rest[:, 1] - middle[1])
    if len(path) < 2 or way.min() <= 0 or at.max() > along[-1] or start < 0:
        raise ConfigError(
            f"trousers from {start:.2f} to {at.max():.2f} m do not fit on a path of {along[-1]:.2f} m"
        )
    points = np.stack([np.interp(at, along, path[:, k]) for k in range(3)], axis=1)
    ahead = np.stack([np.interp(at + _TURN, along, path[:, k]) for k in range(3)], axis=1)
    behind = np.stack([np.interp(at - _TURN, along, path[:, k]) for k in range(3)], axis=1)
    up = ahead - behind
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    across = np.asarray(towards, np.float64) - up * (up @ np.asarray(towards))[:, None]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    front = np.cross(-side * across, up)
    moved = points - side * (rest[:, :1] - middle[0]) * across
    return np.asarray(moved + (rest[:, 2:] - middle[2]) * front)


def band_over_leg(garment: Garment, leg: str, count: int) -> npt.NDArray[np.int32]:
    """Return neighbours on the waistband of trousers, in front above the middle of a leg.

    Args:
        garment: Trousers.
        leg: `left` or `right`.
        count: How many; rounded up to an odd number.
    """
    waist = garment.rings["waist"]
    rest, hem = garment.rest[waist], garment.rest[garment.rings[f"{leg}_hem"]].mean(axis=0)
    over = int(np.argmin(np.abs(rest[:, 0] - hem[0]) + rest[:, 2].max() - rest[:, 2]))
    return np.asarray(waist[np.arange(over - count // 2, over + count // 2 + 1) % len(waist)])


def _outside(points: Array, model: BodyModel) -> Array:
    """Return points moved out of the skin of the T-pose where they lie in it [m], shape [n, 3]."""
    skin = model.vertices.astype(np.float64)
    normals = SmoothNormals(model.faces, len(skin)).compute(model.vertices).astype(np.float64)
    tree, out = cKDTree(skin), points.copy()
    for _ in range(_PUSHES):
        _, near = tree.query(out, k=_NEIGHBOURS)
        away = np.einsum("nka,nka->nk", out[:, None] - skin[near], normals[near]).mean(axis=1)
        way = normals[near].mean(axis=1)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        out += np.maximum(_CLEAR - away, 0.0)[:, None] * way
    return out
