"""Tearing: a particle at an overstretched thread is split in two, and the faces are shared out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]
Ints = npt.NDArray[np.int64]
Numbers = npt.NDArray[np.uint32]

AT_ONCE = 4  # particles that are split in one physics step: a tear runs, it does not burst


def torn(
    points: Array, faces: Indices, threads: Numbers, worst: Ints, tension: Array, held: Indices
) -> tuple[Indices, Ints] | None:
    """Return the faces after tearing, and the particle that each new one was split from.

    Of a thread the end that is pulled at harder gives way. The faces at it that lie on the far side of the
    plane across the thread go to a new particle, if there are any on both sides and what remains at the
    old one is in one piece with what it was: M. Müller, "Hierarchical Position Based Dynamics", and many
    others tear cloth in this way.

    Args:
        points: Present positions [m], shape [n, 3].
        faces: Shape [m, 3].
        threads: Two particles each, shape [t, 2].
        worst: Threads that are stretched too far, the worst first, shape [w].
        tension: Of each thread, shape [t].
        held: Particles that are held; they are not split.

    Returns:
        Faces and parents, or None if nothing could be torn.
    """
    count = len(points)
    pull = np.zeros(count)
    for k in range(2):
        np.add.at(pull, threads[:, k], np.maximum(tension, 0.0))
    pull[held] = -1.0
    new, parents, touched = faces.copy(), list[int](), set[int]()
    for row in worst.tolist():
        i, j = threads[row].tolist()
        for vertex, other in ((i, j), (j, i)) if pull[i] >= pull[j] else ((j, i), (i, j)):
            around = np.flatnonzero((new == vertex).any(axis=1))
            if pull[vertex] < 0 or touched & set(new[around].ravel().tolist()):
                continue
            way = points[other] - points[vertex]
            # Faces with new corners are of no interest here: their particles are in `touched`.
            side = (points[new[around]].mean(axis=1) - points[vertex]) @ way > 0
            if side.all() or not side.any():
                continue
            moved = around[side]
            touched.update(new[around].ravel().tolist())
            new[moved] = np.where(new[moved] == vertex, count + len(parents), new[moved])
            parents.append(vertex)
            break
        if len(parents) >= AT_ONCE:
            break
    return (new, np.array(parents, np.int64)) if parents else None
