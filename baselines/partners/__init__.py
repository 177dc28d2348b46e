"""Partners: people of several temperaments, and learned ones, to train with and to be tested with."""

from .refusing import Refusing
from .zoo import (
    TEMPERAMENTS,
    Habits,
    Partner,
    Temperament,
    learned_partner,
    mood_names,
    partner_zoo,
    trembling,
)

__all__ = [
    "TEMPERAMENTS",
    "Habits",
    "Partner",
    "Refusing",
    "Temperament",
    "learned_partner",
    "mood_names",
    "partner_zoo",
    "trembling",
]
