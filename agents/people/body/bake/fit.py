"""The naked body of any person: stature by height, mass by weight and less muscle, girths by their fields."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rcare_marl.errors import ConfigError

from .girth import girths
from .phenotype import phenotype_age
from .recipe import BodyRecipe
from .shape import DENSITY, NakedBody, pose_body
from .source import ShapeSource

HEIGHT_TOLERANCE, MASS_TOLERANCE = 3e-4, 0.05  # [m], [kg]
_LEANEST = 0.05  # muscle of the thinnest and of the fattest
# Share by which who is shorter or taller than the source goes is scaled in all directions; our own choice.
_SCALED = 0.01
_FATTEST = 2.5  # weight, where 1 is the most that the source was made for
_GIRTH_RANGE = (0.7, 1.45)  # what a girth may depart from that of the body without it
_GIRTH_ROUNDS = 4


def fit_body(source: ShapeSource, recipe: BodyRecipe) -> NakedBody:
    """Return the body of the recipe's stature, mass and girths.

    Muscle follows from body mass: the recipe's at the source's middle weight, less to both sides,
    for at a fixed muscle the source's weight spans a few kilograms only. A soft layer, thinner or
    thicker, is left for who is beyond both.

    Raises:
        ConfigError: If no body of the source has that stature and mass, or a girth.
    """
    fit = _Fit(source, recipe)
    body = fit.solve()
    skin, factors = len(source.faces), dict.fromkeys(recipe.girths, 1.0)
    for _ in range(_GIRTH_ROUNDS if factors else 0):
        have = girths(body.mesh, body.joints, skin)
        if all(abs(have[name] / wanted - 1) < 2e-3 for name, wanted in recipe.girths.items()):
            break
        for name, wanted in recipe.girths.items():
            factors[name] *= wanted / have[name]
            low, high = _GIRTH_RANGE
            if not low <= factors[name] <= high:
                without = have[name] * factors[name] ** -1 * wanted / have[name]
                raise ConfigError(
                    f"a girth of {name} of {wanted:.3f} m does not go with the rest of the body, "
                    f"which has about {without:.3f} m; allowed are {low} to {high} times that"
                )
        fit.swell = factors
        body = fit.solve()
    short, light = recipe.height - body.height, recipe.mass - body.mass
    if abs(short) > 1e-3 or abs(light) > 0.5:
        raise ConfigError(
            f"no body of {recipe.height:.3f} m and {recipe.mass:.1f} kg at {recipe.age:g} years: the "
            f"nearest has {body.height:.3f} m and {body.mass:.1f} kg"
        )
    return body


@dataclass
class _Fit:
    """Solves stature and mass; what it found is where it starts the next time."""

    source: ShapeSource
    recipe: BodyRecipe
    swell: dict[str, float] = field(default_factory=dict)
    height: float = 0.4
    weight: float = 0.5
    layer: float = 0.0

    def at(self, weight: float) -> NakedBody:
        """Return the body of a weight that has the stature."""
        r = self.recipe
        span = (0.0, 0.5, 1.0)
        muscle = float(np.interp(weight, span, (_LEANEST, max(r.muscle, _LEANEST), _LEANEST)))
        phenotype = {
            "gender": r.gender, "age": phenotype_age(r.age), "muscle": muscle, "weight": weight,
            "height": self.height, "proportions": 0.7, "african": 0.0, "asian": 0.0, "caucasian": 0.0,
        }  # fmt: skip
        phenotype.update(r.ancestry or {"african": 1.0, "asian": 1.0, "caucasian": 1.0})
        slope = 0.6 * r.height
        for _ in range(8):
            phenotype["height"] = self.height
            body = pose_body(self.source, r, phenotype, self.layer, self.swell)
            missing = r.height - body.height
            if abs(missing) < HEIGHT_TOLERANCE:
                break
            before, old = self.height, body.height
            self.height = float(np.clip(before + missing / slope, 0.0, 1.0))
            if self.height == before:
                break
            phenotype["height"] = self.height
            body = pose_body(self.source, r, phenotype, self.layer, self.swell)
            slope = max((body.height - old) / (self.height - before), 0.1 * r.height)
            if abs(r.height - body.height) < HEIGHT_TOLERANCE:
                break
            self.height = float(np.clip(self.height + (r.height - body.height) / slope, 0.0, 1.0))
        beyond = r.height / body.height
        if self.height in (0.0, 1.0) and abs(beyond - 1) <= _SCALED:
            body.mesh.vertices, body.joints = body.mesh.vertices * beyond, body.joints * beyond
            body.height, body.mass = r.height, body.mass * beyond**3
        return body

    def solve(self) -> NakedBody:
        """Return the body of the stature and mass, or the nearest."""
        mass = self.recipe.mass
        body = self.at(self.weight)
        low, high = 0.0, _FATTEST
        error, step = mass - body.mass, 0.15
        before: tuple[float, float] | None = None
        for _ in range(14):
            if abs(error) < MASS_TOLERANCE:
                break
            low, high = (self.weight, high) if error > 0 else (low, self.weight)
            if before is None:
                wanted = self.weight + np.copysign(step, error)
            else:  # the secant, kept inside what is known to hold the root
                rise = (before[1] - error) / (self.weight - before[0])
                wanted = self.weight + error / max(rise, 1.0)
            if not low < wanted < high:
                wanted = 0.5 * (low + high)
            if high - low < 1e-4:
                break
            before = self.weight, error
            self.weight = float(wanted)
            body = self.at(self.weight)
            error = mass - body.mass
        for _ in range(6):  # beyond what weight can do
            if abs(error) < MASS_TOLERANCE:
                break
            self.layer += error / (DENSITY * 0.65 * self.recipe.height**2 / 1.7)
            body = self.at(self.weight)
            error = mass - body.mass
        body.parameters["layer_m"] = self.layer
        return body
