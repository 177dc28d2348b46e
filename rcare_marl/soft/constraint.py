"""The constraints of a cloth: threads that stretch and tear, and folds that bend.

A thread is an edge of the mesh. Along and across the grain it stands for the strip of cloth around it;
between them, for shear: with the cell's two edges du, dv and its diagonal L, a shear g lengthens the
diagonal by g du dv / L, so a stiffness G L² / (du dv) has the energy G g² / 2 per area.

A fold is an inner edge with the two triangles at it. Its energy is the square of a sum of positions whose
weights depend on the shape at rest alone: M. Bergou, M. Wardetzky, D. Harmon, D. Zorin and E. Grinspun, "A
Quadratic Bending Model for Inextensible Surfaces" (SGP 2006). It knows neither angle nor root, and is
right where cloth bends much more easily than it stretches. All cloth is flat at rest. Their factor of 3 is
for edges in all directions; of cells with a right angle the sides alone fold over a bend along the grain, so
the factor is 1, and 1/2 for diagonals: then a plate bends in all directions as it should, within 5 %.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..errors import ConfigError
from ..pose import Array
from .contact import Indices
from .material import Fabric

Ints = npt.NDArray[np.int64]
Unsigned = npt.NDArray[np.uint32]

ALONG = 0.9  # cosine of edge and grain, from where the edge is a thread and not a diagonal
ACROSS = (1 - ALONG**2) ** 0.5
# Columns of the table of threads: rest length [m] and compliance [m/N].
REST, SOFTNESS = range(2)
# Columns of the table of folds: weights of the four particles, compliance [m/N].
FOLD_SOFTNESS = 4
AT_ONCE = 4  # particles that are split in one physics step: a tear runs, it does not burst


def colours(constraints: npt.NDArray[np.integer], count: int) -> Ints:
    """Return a colour for each constraint, greedily, shape [m].

    Those of one colour share no particle, so they may be solved at once.

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


def face_areas(positions: Array, faces: Indices) -> Array:
    """Return the area of each face [m²], shape [m]."""
    a, b, c = (positions[faces[:, k]] for k in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def vertex_masses(positions: Array, faces: Indices, fabric: Fabric) -> Array:
    """Return a third of the mass of the faces around each vertex [kg], shape [n]."""
    share = face_areas(positions, faces) * fabric.area_density_kg_m2 / 3
    return summed(faces, share, len(positions))


def summed(members: Indices, shares: Array, count: int) -> Array:
    """Return what particles get if each member of a row, shape [m, k], gets its share [m], shape [count]."""
    out = np.zeros(count)
    for column in members.T:
        np.add.at(out, column, shares)
    return out


class Constraints(NamedTuple):
    """Threads and folds of a cloth, each sorted by colour: neighbours in memory share no particle.

    Numbers of particles have no sign: then an index needs no check whether it counts from the end, which
    takes a fifth of the time.

    Attributes:
        threads: Two particles each, shape [t, 2].
        thread_table: Their constants, shape [t, 2].
        folds: Ends of an edge and the two particles across, shape [f, 4].
        fold_table: Their constants, shape [f, 5].
    """

    threads: Unsigned
    thread_table: Array
    folds: Unsigned
    fold_table: Array


def make_constraints(rest: Array, faces: Indices, grain: Array, fabric: Fabric) -> Constraints:
    """Return the constraints of a cloth.

    Args:
        rest: Positions of the particles in cloth at rest [m], shape [n, 3].
        faces: Shape [m, 3].
        grain: Direction of the warp at each particle, of unit length, shape [n, 3].
        fabric: What it is made of.

    Raises:
        ConfigError: If a face has no area.
    """
    areas = face_areas(rest, faces)
    if areas.min() <= 1e-10:
        raise ConfigError(f"face {int(np.argmin(areas))} of a cloth has no area")
    return Constraints(
        *_threads(rest, faces, areas, grain, fabric), *_folds(rest, faces, grain, fabric)
    )


def _threads(
    rest: Array, faces: Indices, areas: Array, grain: Array, fabric: Fabric
) -> tuple[Unsigned, Array]:
    sides = np.concatenate([faces[:, k] for k in ((0, 1), (1, 2), (2, 0))])
    pairs, where = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    around = np.bincount(where.ravel(), weights=np.tile(areas, 3), minlength=len(pairs))
    way = rest[pairs[:, 1]] - rest[pairs[:, 0]]
    lengths = np.linalg.norm(way, axis=1)
    cosine = _slant(way, grain, pairs)
    # A strip of cloth is as wide as the area around the edge says.
    stiffness = np.where(
        cosine > ALONG,
        fabric.stretch_warp_n_m * around / lengths**2,
        fabric.stretch_weft_n_m * around / lengths**2,
    )
    diagonal = (cosine <= ALONG) & (cosine >= ACROSS)
    stiffness[diagonal] = (fabric.shear_n_m * lengths**2 / around)[diagonal]
    table = np.empty((len(pairs), 2))
    table[:, REST], table[:, SOFTNESS] = lengths, 1 / stiffness
    order = np.argsort(colours(pairs, len(rest)), kind="stable")
    return np.ascontiguousarray(pairs[order], np.uint32), np.ascontiguousarray(table[order])


def _slant(way: Array, grain: Array, ends: Indices) -> Array:
    """Return the size of the cosine between edges and the grain at their two ends, shape [e]."""
    along = grain[ends[:, 0]] + grain[ends[:, 1]]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return np.asarray(np.abs(np.einsum("ea,ea->e", way, along)) / np.linalg.norm(way, axis=1))


def _hinges(faces: Indices) -> Indices:
    """Return (edge start, edge end, opposite, opposite) of each inner edge of a mesh, shape [h, 4]."""
    sides: dict[tuple[int, int], list[int]] = {}
    for a, b, c in faces.tolist():
        for start, end, across in ((a, b, c), (b, c, a), (c, a, b)):
            sides.setdefault((min(start, end), max(start, end)), []).append(across)
    rows = [(*edge, *across) for edge, across in sides.items() if len(across) == 2]
    return np.array(rows, np.int32).reshape(-1, 4)


def _folds(rest: Array, faces: Indices, grain: Array, fabric: Fabric) -> tuple[Unsigned, Array]:
    members = _hinges(faces)
    p, q, a, b = (rest[members[:, k]] for k in range(4))
    edge = q - p

    def cotangent(corner: Array, one: Array, other: Array) -> Array:
        u, v = one - corner, other - corner
        size = np.linalg.norm(np.cross(u, v), axis=1)
        return np.asarray(np.einsum("ea,ea->e", u, v) / size)

    at_p = (cotangent(p, q, a), cotangent(p, q, b))
    at_q = (cotangent(q, p, a), cotangent(q, p, b))
    table = np.empty((len(members), 5))
    table[:, 0] = at_q[0] + at_q[1]
    table[:, 1] = at_p[0] + at_p[1]
    table[:, 2] = -at_p[0] - at_q[0]
    table[:, 3] = -at_p[1] - at_q[1]
    area = (
        np.linalg.norm(np.cross(edge, a - p), axis=1)
        + np.linalg.norm(np.cross(edge, b - p), axis=1)
    ) / 2
    cosine = _slant(edge, grain, members)
    diagonal = (cosine <= ALONG) & (cosine >= ACROSS)
    table[:, FOLD_SOFTNESS] = area / (np.where(diagonal, 0.5, 1.0) * fabric.bending_nm)
    order = np.argsort(colours(members, len(rest)), kind="stable")
    return np.ascontiguousarray(members[order], np.uint32), np.ascontiguousarray(table[order])


def torn(
    points: Array, faces: Indices, threads: Unsigned, worst: Ints, tension: Array, held: Indices
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
