"""What contacts want, and how they give way: Bullet's figures for MuJoCo's contacts."""

from __future__ import annotations

import numba
import numpy as np

from . import native
from .native import CONTACT_ROW, real, whole, word

CONTACT_ERP = 0.08  # share of the overlap of rigid bodies that Bullet removes in a physics step
SLOP = 1e-5  # [m] of overlap that Bullet leaves
GIVE = 1e-9  # R of what is rigid, as a share of what joints give way by


@numba.njit(cache=True, error_model="numpy")
def write_contacts(dt, places, rows, surfaces, owners, wished, soft, touched):  # type: ignore[no-untyped-def]
    """Write what contacts want and how they give way.

    Returns:
        First row of each contact, -1 if it has none, and how many rows, shape [ncon, 2]; friction along the
            surface, about the normal and of rolling, shape [ncon, 3].
    """
    kinds, speeds, gives = rows
    data = places[native.DATA]
    count = whole(data + places[native.NCON], 1)[0]
    held, frictions = np.empty((count, 2), np.int64), np.empty((count, 3))
    start = word(data + places[native.CONTACT])
    for i in range(count):
        here = start + i * places[native.CONTACT_SIZE]
        row = whole(here + places[native.EFC_ADDRESS], 1)[0]
        held[i, 0] = -1
        if row < 0 or kinds[row] != CONTACT_ROW:
            continue
        size = whole(here + places[native.DIM], 1)[0]
        held[i, 0], held[i, 1] = row, size
        geoms = whole(here + places[native.GEOM], 2)
        friction = real(here + places[native.FRICTION], 5)
        one, other = geoms[0], geoms[1]
        gap = real(here + places[native.DIST], 1)[0] + SLOP
        gap -= surfaces[one, 3] + surfaces[other, 3]
        near = gives[row]
        touched[owners[one]] = touched[owners[other]] = True
        first, second = surfaces[one, 1], surfaces[other, 1]
        give = GIVE * near
        speed = -gap / dt if gap > 0.0 else -CONTACT_ERP * gap / dt
        if first > 0.0 or second > 0.0:
            spring = first + second
            if first > 0.0 and second > 0.0:
                spring = first * second / spring
            both = dt * spring + surfaces[one, 2] + surfaces[other, 2]
            give = 1.0 / (dt * both)
            if gap <= 0.0:
                speed = -gap * spring / both
        wished[row] = (speed - speeds[row]) / dt
        soft[row] = give
        for k in range(1, size):
            wished[row + k] = -speeds[row + k] / dt
            soft[row + k] = GIVE * near
        frictions[i, 0] = surfaces[one, 0] * surfaces[other, 0]
        frictions[i, 1], frictions[i, 2] = friction[2], friction[3]
    return held, frictions
