"""PettingZoo's way in: `from rcare_marl.envs import feeding_v0; env = feeding_v0.parallel_env()`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from . import make
from .care_env import CareEnv
from .cast import CastEntry


def parallel_env(
    *,
    options: Mapping[str, Any] | None = None,
    policies: Mapping[str, Any] | None = None,
    physics_dt: float = 1 / 240,
    render_mode: str | None = None,
    home: str | None = None,
    level: int | None = None,
    room: str | None = None,
    **cast: CastEntry,
) -> CareEnv:
    """Return a feeding environment; arguments as for `rcare_marl.make`."""
    return make(
        "feeding",
        options=options,
        policies=policies,
        physics_dt=physics_dt,
        render_mode=render_mode,
        home=home,
        level=level,
        room=room,
        **cast,
    )
