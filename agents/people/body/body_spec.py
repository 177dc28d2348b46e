"""A body by what describes it: sex, age, stature, mass, proportions, girths; no baked file."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from rcare_marl import assets
from rcare_marl.cache import cached_file
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name

from .anthropometry import LENGTHS, Sex
from .bake.basis import BASIS_FILE, shape_basis
from .bake.dressed import dress
from .bake.fit import fit_body
from .bake.girth import GIRTHS
from .bake.phenotype import ANCESTRIES
from .bake.recipe import Beard, BodyRecipe, Clothes, Hair, Rgb

YOUNGEST, OLDEST = 6.0, 95.0  # [years], of whom the basis was made
_PROPORTION = (0.85, 1.15)
_GREY_FROM, _GREY_AT = 38.0, 68.0  # [years] between which hair turns grey; our own choice
_BEARD_FROM, _RECEDES_FROM = 18.0, 35.0  # [years]; our own choice


@dataclass(frozen=True)
class BodySpec:
    """What a body is like beside sex, age, stature and mass; an avatar's `body:` as a mapping.

    Attributes:
        muscle: Muscle at a middling mass, 0 to 1.
        proportions: Limb segments as shares of the published length of that sex and stature.
        girths: Girths of the naked body [m]; what is not named follows from the mass.
        ancestry: Mixture of prototypes of face and build; drawn with the skin if empty.
        changes: Changes of face and body by name, -1 to 1.
        skin: RGB of the skin; this and all below are drawn from the seed if left out.
        lips: RGB of the lips.
        iris: RGB of the irises.
        hair: Hair of the head.
        beard: Facial hair.
        clothes: Clothes.
        seed: Of what is drawn, and of the noise in hair and cloth.
    """

    muscle: float = 0.5
    proportions: dict[str, float] = field(default_factory=dict)
    girths: dict[str, float] = field(default_factory=dict)
    ancestry: dict[str, float] = field(default_factory=dict)
    changes: dict[str, float] = field(default_factory=dict)
    skin: Rgb | None = None
    lips: Rgb | None = None
    iris: Rgb | None = None
    hair: Hair | None = None
    beard: Beard | None = None
    clothes: Clothes | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.muscle <= 1:
            raise ConfigError(f"muscle must lie in 0..1, got {self.muscle}")
        for name, share in self.proportions.items():
            check_name("limb segment in proportions", name, LENGTHS)
            if not _PROPORTION[0] <= share <= _PROPORTION[1]:
                low, high = _PROPORTION
                raise ConfigError(f"proportions.{name} must lie in {low}..{high}, got {share}")
        for name, girth in self.girths.items():
            check_name("girth", name, GIRTHS)
            if not 0.05 <= girth <= 2.5:
                raise ConfigError(f"girths.{name} is in metres, 0.05..2.5, got {girth}")
        for name, part in self.ancestry.items():
            check_name("prototype in ancestry", name, ANCESTRIES)
            if part < 0:
                raise ConfigError(f"ancestry.{name} must not be negative, got {part}")
        if self.ancestry and sum(self.ancestry.values()) <= 0:
            raise ConfigError("ancestry must name a prototype with a share above 0")
        for name, value in self.changes.items():
            check_name("change in changes", name, shape_basis().changes)
            if not -1 <= value <= 1:
                raise ConfigError(f"changes.{name} must lie in -1..1, got {value}")
        if self.seed < 0:
            raise ConfigError(f"seed must not be negative, got {self.seed}")


@dataclass(frozen=True)
class _Skin:
    """A skin, and what is seen with it."""

    skin: Rgb
    lips: Rgb
    ancestry: dict[str, float]
    hair: tuple[str, ...]
    iris: tuple[str, ...]


@dataclass(frozen=True)
class _Looks:
    """The file `assets/avatars/bodies/looks.yaml`."""

    skins: tuple[_Skin, ...]
    hair: dict[str, Rgb]
    grey: Rgb
    iris: dict[str, Rgb]
    styles: dict[str, tuple[str, ...]]
    beards: tuple[str, ...]
    tops: tuple[Rgb, ...]
    trousers: tuple[Rgb, ...]
    shoes: tuple[Rgb, ...]


@lru_cache(maxsize=1)
def _looks() -> _Looks:
    return load(_Looks, assets.ROOT / "avatars" / "bodies" / "looks.yaml")


def body_recipe(spec: BodySpec, sex: Sex, age: float, height: float, mass: float) -> BodyRecipe:
    """Return everything that makes a body, with what the spec leaves open drawn from its seed.

    Raises:
        ConfigError: If the age is not one that the basis was made of.
    """
    if not YOUNGEST <= age <= OLDEST:
        raise ConfigError(
            f"a body without a file has an age of {YOUNGEST:g} to {OLDEST:g} years, got {age:g}"
        )
    looks, rng = _looks(), np.random.default_rng([spec.seed, 22])

    def one(choices: Any) -> Any:
        return choices[int(rng.integers(len(choices)))]

    skin = one(looks.skins)
    grey = float(np.clip((age - _GREY_FROM) / (_GREY_AT - _GREY_FROM) + rng.normal(0, 0.2), 0, 1))
    color = (1 - grey) * np.array(looks.hair[one(skin.hair)]) + grey * np.array(looks.grey)
    tint: Rgb = tuple(int(c) for c in np.rint(color))  # type: ignore[assignment]
    style = one(looks.styles[sex])
    if style == "receding" and age < _RECEDES_FROM:
        style = "short"
    hair = load(
        Hair, {"style": style, "color": list(tint), "length": round(rng.uniform(0.009, 0.018), 4)}
    )
    style = one(looks.beards) if sex == "male" and age >= _BEARD_FROM else "none"
    beard = load(Beard, {"style": style, "color": [int(0.85 * c) for c in tint]})
    clothes = Clothes(
        top=one(looks.tops), trousers=one(looks.trousers), shoes=one(looks.shoes),
        neck=one(("crew", "v")), sleeve=round(rng.uniform(0.55, 0.8), 3),
    )  # fmt: skip
    iris = looks.iris[one(skin.iris)]
    aged = {"head-age-incr": round(float(np.clip((age - 45) / 45, 0, 1)), 3)} if age > 45 else {}
    return BodyRecipe(
        gender=0.0 if sex == "male" else 1.0,
        age=age,
        height=height,
        mass=mass,
        skin=spec.skin or skin.skin,
        lips=spec.lips or (skin.lips if spec.skin is None else _lips(spec.skin)),
        iris=spec.iris or iris,
        hair=spec.hair or hair,
        clothes=spec.clothes or clothes,
        beard=spec.beard or beard,
        muscle=spec.muscle,
        ancestry=dict.fromkeys(ANCESTRIES, 0.0) | (spec.ancestry or skin.ancestry),
        changes=aged | spec.changes,
        seed=spec.seed,
        proportions=dict(spec.proportions),
        girths=dict(spec.girths),
    )


def _lips(skin: Rgb) -> Rgb:
    r, g, b = skin
    return (int(0.9 * r), int(0.74 * g), int(0.76 * b))


def made_body(recipe: BodyRecipe) -> Path:
    """Return the npz of a dressed body, made now if it is not in the user's cache yet.

    Raises:
        ConfigError: If no body has that stature and mass, or a girth; or the cache cannot be written.
    """
    key = json.dumps(dataclasses.asdict(recipe), sort_keys=True)

    def make() -> bytes:
        source = shape_basis()
        naked = fit_body(source, recipe)
        file = io.BytesIO()
        np.savez(file, **dress(source, "body", recipe, naked))  # type: ignore[arg-type]
        return file.getvalue()

    return cached_file("body", ".npz", key.encode() + _maker(), make)


@lru_cache(maxsize=1)
def _maker() -> bytes:
    """Return a hash of what turns recipes into bodies: the basis and the code of the bake."""
    digest = hashlib.sha256(BASIS_FILE.read_bytes())
    here = Path(__file__).parent
    for file in (
        *sorted((here / "bake").glob("*.py")),
        here / "anthropometry.py",
        here / "refinement.py",
    ):
        digest.update(file.read_bytes())
    return digest.digest()
