"""How somebody makes themselves understood and takes what is done to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rcare_marl.errors import ConfigError

Speech = Literal["clear", "slow", "words", "sounds", "none"]


@dataclass(frozen=True)
class Manner:
    """Communication and temperament.

    Attributes:
        speech: Full speech, slow or slurred speech, single words, sounds only, or none.
        understanding: Share of what is said that is understood, 0 to 1.
        patience: How long somebody bears what they do not like before they refuse, 0 (not at all) to 1.
    """

    speech: Speech = "clear"
    understanding: float = 1.0
    patience: float = 0.8

    def __post_init__(self) -> None:
        for name in ("understanding", "patience"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(f"manner: {name} must lie in 0..1, got {getattr(self, name)}")
