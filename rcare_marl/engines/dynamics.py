"""Masses and friction of the bodies of a marked world, as they were built times a factor."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
import pybullet as bullet

from rcare_marl.body import Body
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.world import World

if TYPE_CHECKING:
    from .simulation import Simulation

# What MuJoCo keeps of each degree of freedom and each link that grows with mass, and what shrinks.
HEAVIER, LIGHTER = ("body_mass", "body_inertia", "dof_M0"), ("body_invweight0", "dof_invweight0")


class Dynamics:
    """Scales masses and friction from what they were when the world was marked.

    Factors are always of those first values, so that nothing drifts, and 1 brings them back to the last
    bit. Either engine reads them in every physics step. What somebody worked out from masses before, as
    controllers did, stays as it was: they go on with the nominal model. Sensors of joint loads and soft
    matter read anew, but for the friction of soft matter's own side of a touch.
    """

    def __init__(self, world: World, nominal: Iterable[Body] = ()) -> None:
        """Read what is there; after `World.mark_start`.

        Args:
            world: The world.
            nominal: Bodies whose controllers go on with the mass matrix that they have now.
        """
        self._world = world
        self._sim: Simulation | None = getattr(world, "sim", None)
        self._links = {
            body.uid: [
                (link, *body.mass_and_inertia(link), body.touching(link).friction)
                for link in range(-1, body.link_count)
            ]
            for body in world.bodies
        }
        for body in nominal:  # Bullet keeps the first tree that it works this out from
            if body.joints:
                body.mass_matrix([0.0] * len(body.joints))
        self._told: dict[int, tuple[float, float]] = {}
        self._model: dict[str, Any] = {}
        if self._sim is not None:
            arrays = {name: getattr(self._sim.model, name) for name in (*HEAVIER, *LIGHTER)}
            self._model = {name: array.copy() for name, array in arrays.items()}
            self._grips = self._sim.surfaces[:, 0].copy()

    def scale(self, body: Body, *, mass: float = 1.0, friction: float = 1.0) -> None:
        """Give a body its first masses and inertias times `mass`, and its friction times `friction`.

        Friction of two bodies is the product of both, in either engine. Links of no mass, such as what is
        bolted down, have none afterwards.
        """
        if self._told.get(body.uid, (1.0, 1.0)) == (mass, friction):
            return
        self._told[body.uid] = (mass, friction)
        client = self._world.client
        for link, kilograms, inertia, grip in self._links[body.uid]:
            values: dict[str, Any] = {"lateralFriction": grip * friction}
            if kilograms > 0:
                turning = [mass * each for each in inertia.tolist()]
                values |= {"mass": mass * kilograms, "localInertiaDiagonal": turning}
            bullet.changeDynamics(body.uid, link, physicsClientId=client, **values)
        if self._sim is not None:
            self._scale_model(self._sim, body, mass, friction)
        if "feedback" in vars(body):
            body.feedback.read_masses()
        for matter in self._world.matter:
            if isinstance(matter, SoftWorld):
                matter.read_bodies()

    def _scale_model(self, sim: Simulation, body: Body, mass: float, friction: float) -> None:
        model, number = sim.model, self._world.bodies.index(body)
        links = sim.places[number].links
        dofs = np.flatnonzero(np.isin(model.dof_bodyid, links))
        for name, first in self._model.items():
            rows = dofs if name.startswith("dof") else links
            factor = mass if name in HEAVIER else 1.0 / mass
            getattr(model, name)[rows] = factor * first[rows]
        whole = model.body_mass.copy()  # of each link and all that it carries
        for link in range(model.nbody - 1, 0, -1):
            whole[model.body_parentid[link]] += whole[link]
        model.body_subtreemass[:] = whole
        geoms = sim.geoms_of(number)
        sim.surfaces[geoms, 0] = friction * self._grips[geoms]


def grip(factor: float) -> float:
    """Return the factor of the friction of every body that multiplies that of every touch by `factor`."""
    return math.sqrt(factor)
