"""One figure of a simulated person beside what was published about people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Basis = Literal["read", "model", "memory"]


@dataclass(frozen=True)
class Check:
    """A figure, the band that it should lie in, and where the band comes from.

    Attributes:
        family: What kind of figure, such as `torque`.
        case: Which one: joint, posture, person.
        ours: What the simulation gives.
        low: Least value of the band.
        high: Greatest value of the band.
        unit: Of the three.
        source: Publication or open model.
        basis: Whether the band was `read` in the publication, computed with an open `model`, or is quoted
            from `memory`; what is from memory counts neither as fitted nor as held out.
        is_fitted: Whether anything of ours was chosen by this figure. What was not is held out.
    """

    family: str
    case: str
    ours: float
    low: float
    high: float
    unit: str
    source: str
    basis: Basis
    is_fitted: bool

    @property
    def is_in_band(self) -> bool:
        """Whether the figure lies in its band."""
        return self.low <= self.ours <= self.high

    @property
    def split(self) -> str:
        """`fitted`, `held out` or `memory`."""
        return "memory" if self.basis == "memory" else "fitted" if self.is_fitted else "held out"
