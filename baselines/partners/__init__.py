"""Partners: people of several temperaments, and learned ones, to train with and to be tested with."""

from .temperament import Habits, Temperament, mood_names
from .zoo import TEMPERAMENTS, Partner, learned_partner, partner_zoo, trembling

__all__ = [
    "TEMPERAMENTS",
    "Habits",
    "Partner",
    "Temperament",
    "learned_partner",
    "mood_names",
    "partner_zoo",
    "trembling",
]
