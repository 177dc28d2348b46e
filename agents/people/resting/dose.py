"""Pressure over time, by region of skin: how much of what tissue bears is used up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array

from ..body.skeleton import BODY, JOINTS, SIDES
from .bone import regions
from .pressure import PosedBody, PressureMap, pressure_map
from .support import Support

if TYPE_CHECKING:
    from ..human import Human

_ARMS = tuple(
    f"{side}_{part}" for side in SIDES for part in ("collar", "shoulder", "elbow", "wrist")
)
# From which a body has another posture, by trunk and legs: [m], [rad]; our own choice.
_MOVED, _TURNED = 0.005, 0.03
_LARGE = [
    JOINTS.index(j) for j in BODY if not j.startswith(_ARMS) and "eye" not in j and j != "jaw"
]


@dataclass(frozen=True)
class Tolerance:
    """How long tissue bears pressure (`assets/clinical/pressure_tolerance.yaml`).

    Attributes:
        curve: Which of the two is in use.
        product_pa_s: Pressure times time that is borne, of Reswick & Rogers [Pa·s].
        capillary_pa: Pressure below which tissue is fed, and recovers [Pa].
        least_s: The shortest time that either curve gives [s].
        sigmoid_high_pa: How much more than `sigmoid_low_pa` is borne for a short time [Pa].
        sigmoid_low_pa: What is borne for long, of Linder-Ganz [Pa].
        sigmoid_per_s: Its slope [1/s].
        sigmoid_middle_s: Time in its middle [s].
        recovery_s: Time constant with which the dose falls once pressure is off [s].
        source: Where the figures come from.
    """

    curve: Literal["reswick_rogers", "linder_ganz"]
    product_pa_s: float
    capillary_pa: float
    least_s: float
    sigmoid_high_pa: float
    sigmoid_low_pa: float
    sigmoid_per_s: float
    sigmoid_middle_s: float
    recovery_s: float
    source: str

    def borne_s(self, pressure: float) -> float:
        """Return how long a pressure [Pa] is borne [s]; infinite where tissue recovers under it."""
        if self.curve == "reswick_rogers":
            if pressure < self.capillary_pa:
                return math.inf
            return max(self.product_pa_s / pressure, self.least_s)
        over = pressure - self.sigmoid_low_pa
        if over <= 0:
            return math.inf
        if over >= self.sigmoid_high_pa:
            return self.least_s
        late = math.log(self.sigmoid_high_pa / over - 1) / self.sigmoid_per_s
        return max(self.sigmoid_middle_s + late, self.least_s)


@lru_cache(maxsize=1)
def tolerance() -> Tolerance:
    """Return the figures that ship."""
    return load(Tolerance, assets.find("clinical", "pressure_tolerance"))


class PressureDose:
    """What each region of skin has borne: 0 is rested, 1 is as much as it bears.

    Time at a pressure counts as a share of the time for which it is borne (Miner's rule). Below that
    pressure the dose falls exponentially.

    Attributes:
        map: The pressure as it was last found; None where nothing bears the person.
    """

    def __init__(self, limits: Tolerance | None = None) -> None:
        """Begin rested, with figures of one's own or those that ship."""
        self._limits = limits or tolerance()
        self.reset()

    def reset(self) -> None:
        """Begin rested."""
        self.map: PressureMap | None = None
        self._peaks = dict.fromkeys(regions(), 0.0)
        self._doses = dict.fromkeys(regions(), 0.0)
        self._posed: tuple[Support, Array, Array] | None = None

    def rest(self, who: Human | PosedBody, support: Support | None) -> None:
        """Take the pressure of a person as they are now; found anew once trunk or legs moved.

        Args:
            who: The person.
            support: What bears them; None while they are lifted.
        """
        if support is None:
            self._posed = None
            self.bear(None)
            return
        body = who if isinstance(who, PosedBody) else PosedBody.of(who)
        if self._posed is not None and self._posed[0] is support:
            moved, turned = body.places - self._posed[1], body.turns - self._posed[2]
            if np.abs(moved[_LARGE]).max() < _MOVED and np.abs(turned[_LARGE]).max() < _TURNED:
                return
        self._posed = (support, body.places, body.turns)
        self.bear(pressure_map(body, support))

    def bear(self, found: PressureMap | None) -> None:
        """Take a pressure map for the time to come; None while nothing presses."""
        self.map = found
        self._peaks = {name: 0.0 if found is None else found.peak(name) for name in self._peaks}

    def advance(self, duration: float) -> None:
        """Go on for `duration` [s].

        Raises:
            ConfigError: If it is negative or not finite.
        """
        if not 0 <= duration < math.inf:
            raise ConfigError(f"a duration is 0 s or more, got {duration}")
        for name, pressure in self._peaks.items():
            time = self._limits.borne_s(pressure)
            if time < math.inf:
                self._doses[name] += duration / time
            else:
                self._doses[name] *= math.exp(-duration / self._limits.recovery_s)

    def doses(self) -> dict[str, float]:
        """Return the dose of each region."""
        return dict(self._doses)

    @property
    def worst(self) -> tuple[str, float]:
        """The region with the greatest dose, and that dose."""
        name = max(self._doses, key=self._doses.__getitem__)
        return name, self._doses[name]

    def time_left(self, region: str = "") -> float:
        """Return how long until a region has borne all it can [s]; of the first one if unnamed."""
        if not region:
            return min(self.time_left(name) for name in self._doses)
        check_name("region of skin", region, self._doses)
        left = max(1.0 - self._doses[region], 0.0)
        time = self._limits.borne_s(self._peaks[region])
        return math.inf if time == math.inf else left * time
