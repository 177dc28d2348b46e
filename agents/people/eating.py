"""How somebody chews and swallows, and what is in the mouth."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal

from rcare_marl.errors import ConfigError

from .profile import is_number

Texture = Literal["puree", "solid"]
COUGHING = 3.0  # [s] that a cough delays the swallow; our own choice


@dataclass(frozen=True)
class Eating:
    """How somebody deals with a spoonful.

    Those of a healthy adult: a puree is moved and swallowed within some seconds (from memory), a bite of
    biscuit is chewed for 15 to 20 s, as a cracker takes 30 to 50 s in two to three bites (Huckabee et al.
    2018, TOMASS; figures from memory).

    Attributes:
        puree_s: From taking a spoonful of puree to its swallow [s].
        solid_s: The same of food that is chewed [s].
        swallow_s: From then on until the mouth is empty and ready again [s].
        aspiration: Probability that a bite taken into a full mouth reaches the airway; less, in
            proportion, when most of what was there has been chewed.
        source: Where that comes from.
    """

    puree_s: float = 3.0
    solid_s: float = 15.0
    swallow_s: float = 1.5
    aspiration: float = 0.02
    source: str = "a healthy adult"

    def __post_init__(self) -> None:
        for name, most in (
            ("puree_s", 300),
            ("solid_s", 300),
            ("swallow_s", 60),
            ("aspiration", 1),
        ):
            if not is_number(getattr(self, name), 0, most):
                got = getattr(self, name)
                raise ConfigError(f"eating: {name} must lie in 0..{most}, got {got!r}")

    def time(self, texture: Texture) -> float:
        """Return how long a spoonful keeps the mouth busy [s]."""
        return (self.puree_s if texture == "puree" else self.solid_s) + self.swallow_s


@dataclass(frozen=True, eq=False)
class Mouthful:
    """What is in a mouth at the end of a control step, and what went wrong until then.

    Attributes:
        ready_at: When the mouth is empty again [s].
        is_ready: Whether it is.
        taken: Spoonfuls taken.
        swallowed: Spoonfuls swallowed.
        early: Offers of food at the lips before the mouth was ready.
        coughs: Times that food was taken into a full mouth: each makes one cough.
        risk: Probability that some of it was aspirated.
        is_early: Whether such an offer lasts.
        has_coughed: Whether it made a cough.
        coughs_now: Whether a cough began in this control step.
    """

    ready_at: Any = 0.0
    is_ready: Any = True
    taken: Any = 0
    swallowed: Any = 0
    early: Any = 0
    coughs: Any = 0
    risk: Any = 0.0
    is_early: Any = False
    has_coughed: Any = False
    coughs_now: Any = False

    def after(
        self,
        time: float,
        eating: Eating,
        texture: Texture,
        *,
        is_offered: bool,
        enters: bool,
        is_emptied: bool,
    ) -> Mouthful:
        """Return what is in the mouth a control step later.

        Args:
            time: Then [s].
            eating: Whose mouth it is.
            texture: What is eaten.
            is_offered: Whether food is at the lips.
            enters: Whether some of it was taken in this control step.
            is_emptied: Whether the last of a spoonful was.
        """
        is_ready, busy = time >= self.ready_at - 1e-9, eating.time(texture)
        is_early = (is_offered or enters) and not is_ready
        chokes = enters and not is_ready and not self.has_coughed
        ready_at, risk = self.ready_at, self.risk
        if chokes:
            share = min((ready_at - time) / busy, 1.0)
            risk = 1 - (1 - risk) * (1 - eating.aspiration * share)
            ready_at += COUGHING
        taken = self.taken + int(is_emptied)
        if is_emptied:
            ready_at = max(ready_at, time) + busy
        is_ready = time >= ready_at - 1e-9
        return dataclasses.replace(
            self,
            ready_at=ready_at,
            is_ready=is_ready,
            taken=taken,
            swallowed=taken if is_ready else self.swallowed,
            early=self.early + int(is_early and not self.is_early),
            coughs=self.coughs + int(chokes),
            risk=risk,
            is_early=is_early,
            has_coughed=is_early and (self.has_coughed or chokes),
            coughs_now=chokes,
        )
