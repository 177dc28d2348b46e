"""Bullet's greatest joint speed: it cuts speeds before and after the solver."""

from __future__ import annotations

import numba

USUAL = 100.0  # [rad/s or m/s] of each coordinate, unless a body says otherwise; Bullet's


@numba.njit(cache=True)
def cut_speeds(velocities, accelerations, caps, dt):  # type: ignore[no-untyped-def]
    """Change accelerations so that no speed is above its cap at the end of the step.

    Args:
        velocities: Now, shape [nv].
        accelerations: Shape [nv], written.
        caps: Greatest speeds, shape [nv].
        dt: Physics step [s].
    """
    for i in range(len(caps)):
        ahead = velocities[i] + dt * accelerations[i]
        if abs(ahead) > caps[i]:
            accelerations[i] = (min(max(ahead, -caps[i]), caps[i]) - velocities[i]) / dt
