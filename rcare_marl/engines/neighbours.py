"""Which geoms can touch in the next physics steps: a neighbour list, as molecular dynamics has them.

MuJoCo looks in each step for what is near, which took a quarter of feeding's physics. But what is farther
apart than `SKIN` cannot touch before something has moved by half of that. So geoms whose boxes are nearer
are listed, MuJoCo is told of these pairs and of no others, and the list is made anew when a link has moved
that far. What touches is the same as without, and comes in the order of links and geoms, whenever the
list was made.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from rcare_marl.pose import Array

from .native import Ints, struct, whole

# [m] that boxes are apart, beyond the skin, up to where what touches something is solved together: about
# Bullet's, which has boxes round links that are wider by its threshold of contacts, 0.02, on each side.
TOGETHER = 0.02
SKIN = 0.02  # [m]; our own choice: 0.04 and 0.08 are no faster, and slower of limb repositioning
MOST = 1 << 17  # pairs of geoms in a list


class Neighbours:
    """Who meets in a scene, and which geoms of it are near each other.

    Attributes:
        compiled: What `keep_list` takes.
    """

    def __init__(self, model: Any, data: Any, bodies: Sequence[Ints], loose: Array) -> None:
        """Take a scene whose shapes and margins no longer change.

        Args:
            model: MuJoCo's model.
            data: Its data.
            bodies: The numbers of each body's links.
            loose: How far apart points in which each geom touches may come [m], shape [ngeom].
        """
        count, still = model.nbody, model.body_weldid
        self._apart = np.triu(still[:, None] != still[None], 1)
        self._meets = _meeting(model) & self._apart
        self._is_stale = np.ones(1, np.bool_)
        self.mark()
        trees = model.body_treeid.astype(np.int64)
        whole = np.arange(model.ntree)
        for links in bodies:
            own = np.unique(trees[links])
            whole[own[own >= 0]] = own.max()
        begins, counts = (a.astype(np.int64) for a in (model.body_geomadr, model.body_geomnum))
        boxes = model.geom_aabb.reshape(-1, 2, 3)
        reach = np.zeros(count)
        far = np.linalg.norm(model.geom_pos, axis=1) + np.linalg.norm(boxes, axis=2).sum(axis=1)
        np.maximum.at(reach, model.geom_bodyid, far)
        rubs = (
            model.geom_condim.astype(np.int32),
            model.geom_friction,
            model.geom_margin.copy(),
            loose,
        )
        most = min(int((np.cumsum(counts) - counts) @ counts), MOST)
        counted = {
            name: np.zeros(most, np.int32) for name in ("dim", "geom1", "geom2", "signature")
        }
        written = counted | {"margin": np.zeros(most), "friction": np.zeros((most, 5))}
        self._nothing = np.zeros(
            (most, 5)
        )  # rows of contacts get what they want from `bullet_rows`
        kind = struct("mjModel")
        told = kind.from_address(model._address)
        for name in ("solref", "solreffriction", "solimp", "gap", "adhesion"):
            setattr(told, f"pair_{name}", self._nothing.ctypes.data)
        for name, array in written.items():
            setattr(told, f"pair_{name}", array.ctypes.data)
        told.npair = 0
        model.body_contype[:] = model.body_conaffinity[:] = 0
        self.compiled = (
            model._address + kind.npair.offset,
            self._is_stale,
            (data.xpos, data.xmat, np.full((count, 3), np.nan), np.zeros((count, 9)), reach),
            (
                data.geom_xpos,
                data.geom_xmat.reshape(-1, 3, 3),
                boxes,
                np.zeros((model.ngeom, 2, 3)),
            ),
            (np.flatnonzero(counts), begins, counts, np.zeros((count, 2, 3)), self._meets),
            rubs,
            tuple(written.values()),
            (trees, whole, whole.copy()),
        )

    def switch(self, one: Ints, other: Ints, enabled: bool) -> None:
        """Let links of two bodies, by MuJoCo's numbers, meet or not."""
        for first, second in ((one, other), (other, one)):
            self._meets[np.ix_(first, second)] = enabled
        self._meets &= self._apart
        self._is_stale[0] = True

    def mark(self) -> None:
        """Remember who meets."""
        self._marked = self._meets.copy()

    def rewind(self) -> None:
        """Return to the marked state."""
        self._meets[:] = self._marked
        self._is_stale[0] = True


def _meeting(model: Any) -> npt.NDArray[np.bool_]:
    """Return which links meet by MuJoCo's rules, the first with the lower number, shape [nbody, nbody]."""
    kinds, met = model.body_contype, model.body_conaffinity
    meets = (kinds[:, None] & met[None]) | (kinds[None] & met[:, None]) != 0
    still = model.body_weldid
    above = still[model.body_parentid[still]]
    is_child = (still[:, None] == above[None]) & (still[:, None] != 0)
    meets &= ~(is_child | is_child.T)
    excluded = model.exclude_signature
    meets[excluded >> 16, excluded & 0xFFFF] = False
    pairs = np.sort(model.geom_bodyid[np.stack([model.pair_geom1, model.pair_geom2])], axis=0)
    meets[pairs[0], pairs[1]] = True
    return meets


@numba.njit(cache=True, error_model="numpy", inline="always")
def keep_list(near) -> None:  # type: ignore[no-untyped-def]
    """Make the list anew if it must be; where links are is known.

    Args:
        near: Where MuJoCo's number of pairs is; whether the list is wrong, shape [1]. Of each link where it
            is and how it is turned, the same when its box was found, and how far it reaches from there [m].
            Of each geom where it is and how it is turned; its box, middle and half edges, in its own frame;
            and its box in the world with half of the skin, least and greatest corner, shape [ngeom, 2, 3].
            Links that have geoms; first and number of those of each link; the box of each link; and who
            meets, shape [nbody, nbody]. Of each geom the kind of contact, friction, margin and how loose its
            points may be; and the same of pairs, with geoms and links, as MuJoCo has them. The tree of each
            link, -1 if it cannot move; of each tree the number of its body; and the number by which it goes
            with all that is near.
    """
    place, is_stale, links, _, (solid, _, _, _, _), _, _, _ = near
    spots, turns, old_spots, old_turns, reach = links
    if not is_stale[0]:
        moved = 0.0
        for link in solid:
            shift = turn = 0.0
            for k in range(3):
                shift += (spots[link, k] - old_spots[link, k]) ** 2
            for k in range(9):
                turn += (turns[link, k] - old_turns[link, k]) ** 2
            moved = max(moved, np.sqrt(shift) + reach[link] * np.sqrt(turn))
        if moved <= 0.5 * SKIN:
            return
    _find_boxes(near)
    _join(near)
    whole(place, 1)[0] = _find_pairs(near)
    is_stale[0] = False


@numba.njit(cache=True, error_model="numpy")
def _find_boxes(near) -> None:  # type: ignore[no-untyped-def]
    """Find the boxes of all links that have moved."""
    _, _, links, geoms, (solid, begins, counts, hulls, _), (_, _, margins, _), _, _ = near
    spots, turns, old_spots, old_turns, _ = links
    geom_spots, geom_turns, boxes, found = geoms
    for link in solid:
        same = True
        for k in range(3):
            same &= spots[link, k] == old_spots[link, k]
            old_spots[link, k] = spots[link, k]
        for k in range(9):
            same &= turns[link, k] == old_turns[link, k]
            old_turns[link, k] = turns[link, k]
        if same:
            continue
        hull = hulls[link]
        for k in range(3):
            hull[0, k], hull[1, k] = np.inf, -np.inf
        for geom in range(begins[link], begins[link] + counts[link]):
            for k in range(3):
                middle, half = geom_spots[geom, k], 0.5 * SKIN + margins[geom]
                for axis in range(3):
                    middle += geom_turns[geom, k, axis] * boxes[geom, 0, axis]
                    half += abs(geom_turns[geom, k, axis]) * boxes[geom, 1, axis]
                found[geom, 0, k], found[geom, 1, k] = middle - half, middle + half
                hull[0, k], hull[1, k] = (
                    min(hull[0, k], middle - half),
                    max(hull[1, k], middle + half),
                )


@numba.njit(cache=True, error_model="numpy")
def _join(near) -> None:  # type: ignore[no-untyped-def]
    """Give trees that are near each other one number."""
    _, _, _, _, (solid, _, _, hulls, meets), _, _, (trees, whole, joined) = near
    for tree in range(len(whole)):
        joined[tree] = whole[tree]
    for i, one in enumerate(solid):
        for other in solid[i + 1 :]:
            if min(trees[one], trees[other]) < 0 or not meets[one, other]:
                continue
            first, second = joined[trees[one]], joined[trees[other]]
            if first != second and not _are_apart(hulls[one], hulls[other], TOGETHER):
                for tree in range(len(joined)):
                    if joined[tree] == second:
                        joined[tree] = first


@numba.njit(cache=True, error_model="numpy")
def _find_pairs(near) -> int:  # type: ignore[no-untyped-def]
    """Write the pairs of geoms whose boxes overlap, and return how many."""
    _, _, _, (_, _, _, boxes), (solid, begins, counts, hulls, meets), rubs, written, _ = near
    kinds, frictions, margins, loose = rubs
    sizes, ones, others, signatures, gaps, rubbing = written
    count = 0
    for i, one in enumerate(solid):
        for other in solid[i + 1 :]:
            if not meets[one, other] or _are_apart(hulls[one], hulls[other], 0.0):
                continue
            for a in range(begins[one], begins[one] + counts[one]):
                if _are_apart(boxes[a], hulls[other], 0.0):
                    continue
                for b in range(begins[other], begins[other] + counts[other]):
                    if _are_apart(boxes[a], boxes[b], 0.0):
                        continue
                    if count == len(ones):
                        raise MemoryError(
                            "more geoms are near each other than a list has places for"
                        )
                    ones[count], others[count] = a, b
                    signatures[count] = (one << 16) + other
                    sizes[count] = max(kinds[a], kinds[b])
                    gaps[count] = margins[a] + margins[b] + min(loose[a], loose[b])
                    for k, axis in enumerate((0, 0, 1, 2, 2)):  # two ways, spinning, rolling
                        rubbing[count, k] = max(frictions[a, axis], frictions[b, axis])
                    count += 1
    return count


@numba.njit(cache=True, error_model="numpy", inline="always")
def _are_apart(one, other, gap):  # type: ignore[no-untyped-def]
    """Return whether two boxes, least and greatest corner, are farther apart than `gap` along an axis [m]."""
    for k in range(3):
        if one[0, k] - gap > other[1, k] or other[0, k] - gap > one[1, k]:
            return True
    return False
