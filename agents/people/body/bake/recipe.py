"""What each person looks like: the strict schema of `assets/avatars/bodies/recipes.yaml`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from rcare_marl import assets
from rcare_marl.config import load

Rgb = tuple[int, int, int]


@dataclass(frozen=True)
class Hair:
    """Hair of the head.

    Attributes:
        style: `short` and `receding` are cropped; the others add a rigid piece to the head.
        color: RGB, 0 to 255.
        length: How far the hair stands off the scalp [m].
    """

    style: Literal["short", "receding", "bun", "bob", "ponytail"]
    color: Rgb
    length: float = 0.014


@dataclass(frozen=True)
class Beard:
    """Facial hair: `stubble` is colour only, the others also have thickness."""

    style: Literal["none", "stubble", "moustache", "full"] = "none"
    color: Rgb = (60, 45, 35)


@dataclass(frozen=True)
class Clothes:
    """A top, trousers and shoes.

    Attributes:
        top: RGB of the top.
        trousers: RGB of the trousers.
        shoes: RGB of the uppers.
        sole: RGB of the soles.
        neck: Neckline of the top.
        sleeve: Where the sleeve ends: 0 shoulder, 1 elbow, 2 wrist.
        trim: RGB of the neckband and cuffs; the top's own when left out.
        looseness: Extra distance of the top from the trunk [m].
    """

    top: Rgb
    trousers: Rgb
    shoes: Rgb
    sole: Rgb = (235, 235, 230)
    neck: Literal["crew", "v"] = "crew"
    sleeve: float = 0.6
    trim: Rgb | None = None
    looseness: float = 0.006


@dataclass(frozen=True)
class BodyRecipe:
    """Everything that makes one body.

    Attributes:
        gender: 0 male to 1 female.
        age: Age [years].
        height: Barefoot stature [m].
        mass: Body mass without clothes or hair [kg].
        muscle: 0 to 1.
        ancestry: Mixture of Anny's face and build prototypes.
        changes: Anny's local changes by name; a name without `l-` or `r-` acts on both sides.
        skin: RGB of the skin.
        lips: RGB of the lips.
        iris: RGB of the irises.
        seed: Seed of the noise in hair and cloth.
        proportions: Lengths of limb segments as shares of the published ones.
        girths: Girths [m] by name, of `girth.GIRTHS`.
    """

    gender: float
    age: float
    height: float
    mass: float
    skin: Rgb
    lips: Rgb
    iris: Rgb
    hair: Hair
    clothes: Clothes
    beard: Beard = Beard()
    muscle: float = 0.5
    ancestry: dict[str, float] = field(default_factory=dict)
    changes: dict[str, float] = field(default_factory=dict)
    seed: int = 0
    proportions: dict[str, float] = field(default_factory=dict)
    girths: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Recipes:
    """The file `recipes.yaml`."""

    bodies: dict[str, BodyRecipe]


def load_recipes() -> dict[str, BodyRecipe]:
    """Return the recipe of every body by name.

    Raises:
        ConfigError: If the file does not fit the schema.
    """
    return load(Recipes, assets.ROOT / "avatars" / "bodies" / "recipes.yaml").bodies
