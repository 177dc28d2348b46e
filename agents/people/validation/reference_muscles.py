"""The muscles that checks look at: those of the reference skeleton, or of an avatar, over all DoFs."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..actuation.drive import fitted_musculature
from ..actuation.muscle_model import MuscleModel, Tendon
from ..actuation.musculature import load_musculature
from ..avatar import body_segments, load_avatar
from ..body.person_tree import person_tree
from ..body.skeleton import DOFS


@lru_cache(maxsize=2)
def muscle_model(avatar: str | None = None, tendon: Tendon = "quasi_static") -> MuscleModel:
    """Return the muscles of an avatar over all 112 DoFs, or of the reference skeleton if None."""
    person = load_avatar(avatar or "caregiver")
    muscles = fitted_musculature(person, None) if avatar else load_musculature()
    # Masses do not matter to a muscle that is held still, so the reference may borrow anybody's.
    segments = body_segments(person.body_path(), person.height_m, person.mass_kg, person.sex)
    chain = person_tree(segments, muscles.joints, np.zeros(len(DOFS)), [dof.name for dof in DOFS])
    return MuscleModel(muscles.units, muscles.joints, chain, tendon=tendon)
