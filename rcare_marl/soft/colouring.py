"""Sorts constraints into colours: those of one colour share no particle, so they may be solved at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]


def colours(constraints: npt.NDArray[np.integer], count: int) -> Ints:
    """Return a colour for each constraint, greedily, shape [m].

    Args:
        constraints: Particles of each constraint, shape [m, k].
        count: Number of particles.
    """
    used = [0] * count  # of each particle: its colours, as the bits of a number
    out = np.empty(len(constraints), np.int64)
    for row, members in enumerate(constraints.tolist()):
        taken = 0
        for particle in members:
            taken |= used[particle]
        free = ~taken & (taken + 1)  # the lowest bit that is not set
        out[row] = free.bit_length() - 1
        for particle in members:
            used[particle] |= free
    return out


def groups(colour: Ints, place: npt.NDArray[np.float64], lanes: int) -> Ints:
    """Return rows of `lanes` constraints of one colour each, shape [g, lanes]; -1 fills the last row.

    Args:
        colour: Colour of each constraint, shape [m].
        place: Where each constraint is along the body; neighbours come to lie next to each other in
            memory, shape [m].
        lanes: How many constraints are solved at once.
    """
    rows = []
    for k in range(int(colour.max()) + 1):
        members = np.flatnonzero(colour == k)
        members = members[np.argsort(place[members], kind="stable")]
        filler = np.full(-len(members) % lanes, -1, np.int64)
        rows.append(np.concatenate((members, filler)))
    return np.concatenate(rows).reshape(-1, lanes)
