"""Points in which shapes touch, kept from step to step and in order, as Bullet keeps them.

In a physics step Bullet finds one point of two shapes, where they are nearest or overlap most (of two boxes
several), and keeps those of the steps before, four at most, for as long as they stay on each other. So an arm
that is laid on a plate touches at one end, then at both. MuJoCo finds both ends at once, and forgets them. Here
the deepest point that MuJoCo finds is that of Bullet's step, and the others are kept by Bullet's rules.

Bullet has a list of shapes whose boxes overlap: what comes is added at its end, and the last takes the place of
what goes. Those that touch are sorted by their links with a quicksort that is not stable, so that the shapes of
two links come in an order that depends on all others. The solver's sweeps do not converge, so it shows.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from rcare_marl.pose import Array

from . import native
from .boxes import boxes_touch
from .native import real, whole, word
from .row_order import quicksort

MOST = 4  # points of two shapes that Bullet keeps
# Of the reach of the smaller link from its centre of mass, how far points may come apart: Bullet's.
LOOSE = 0.02
WIDE = 0.02  # [m] by which Bullet's boxes of links are wider than they are
Frames = list[tuple[Array, Array]]
PAIRS, CONTACTS = 1024, 2048  # our own choice; more of them are a MemoryError
ON_ONE, ON_OTHER, NORMAL, GAP = slice(0, 3), slice(3, 6), slice(6, 9), 9


class Manifolds:
    """What is kept of the contacts of a scene.

    Attributes:
        loose: How far apart points in which each geom touches may come [m], shape [ngeom].
        compiled: What `keep_points` takes. Of each geom how loose its points may be [m], how wide its box is
            beyond MuJoCo's, whether it is a link by itself, its box along its link, and the link; where pairs of geoms are in the list, shape
            [ngeom, ngeom], -1 if their boxes are apart; the list, shape [pairs, 2]; how many are in it, and
            a clock; the points of each: how many, where they are on either geom, in its frame, the normal in
            the world and the gap, shape [pairs, 4, 10]; when boxes were last seen to overlap; and room.
    """

    def __init__(self, model: Any, roundings: Array, frames: Frames) -> None:
        """Take a scene whose shapes no longer change.

        Args:
            model: MuJoCo's model.
            roundings: How much wider than MuJoCo's Bullet's geoms are [m], shape [ngeom].
            frames: Of each link, by MuJoCo's number, its main axes, shape [3, 3], and its centre of mass [m].
        """
        self._kept = (
            np.full((model.ngeom, model.ngeom), -1, np.int16),
            np.zeros((PAIRS, 2), np.int64),
            np.zeros(2, np.int64),
            np.zeros(PAIRS, np.int64),
            np.zeros((PAIRS, MOST, 10)),
            np.zeros(PAIRS, np.int64),
        )
        size = native.contact_size() // 8
        boxes = _boxes(model, roundings, frames)
        axes, centres = (np.array([frame[i] for frame in frames]) for i in range(2))
        self.loose = LOOSE * _reaches(model, boxes)
        links = model.geom_bodyid.astype(np.int64)
        shapes = self.loose, (roundings, _plain(model, frames), boxes, links, axes, centres)
        self.compiled = (
            shapes,
            self._kept,
            (np.zeros((CONTACTS, size)), np.zeros((PAIRS, 3), np.int64)),
        )

    def forget(self) -> None:
        """Keep nothing."""
        self._kept[0][:] = -1
        self._kept[2][:] = 0


def _boxes(model: Any, widths: Array, frames: Frames) -> Array:
    """Return the boxes of geoms along the main axes of their links, from their centres of mass.

    Middle and half edges [m], shape [ngeom, 2, 3].
    """
    import mujoco

    turn, found = np.zeros(9), np.empty((model.ngeom, 2, 3))
    for geom, link in enumerate(model.geom_bodyid):
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        middle, half = model.geom_aabb[geom].reshape(2, 3)
        turned, (axes, centre) = turn.reshape(3, 3), frames[link]
        found[geom, 0] = axes.T @ (model.geom_pos[geom] + turned @ middle - centre)
        found[geom, 1] = np.abs(axes.T @ turned) @ half + widths[geom]
    return found


def _reaches(model: Any, boxes: Array) -> Array:
    """Return how far the box of each geom's link reaches from its centre of mass [m], shape [ngeom].

    It is Bullet's radius of a shape that turns: of the ball round its box, and how far the ball is away.
    """
    low, high = np.full((model.nbody, 3), 1e9), np.full((model.nbody, 3), -1e9)
    np.minimum.at(low, model.geom_bodyid, boxes[:, 0] - boxes[:, 1])
    np.maximum.at(high, model.geom_bodyid, boxes[:, 0] + boxes[:, 1])
    reach = 0.5 * np.linalg.norm(high - low, axis=1) + 0.5 * np.linalg.norm(high + low, axis=1)
    return np.asarray(reach[model.geom_bodyid])


def _plain(model: Any, frames: Frames) -> Any:
    """Return which geoms Bullet takes for their link itself: the only one of it, where its mass is."""
    links = model.geom_bodyid
    alone = model.body_geomnum[links] == 1
    for geom in np.flatnonzero(alone):
        axes, centre = frames[links[geom]]
        alone[geom] = np.allclose(model.geom_pos[geom], centre) and np.allclose(axes, np.eye(3))
    return alone & (np.abs(model.geom_quat[:, 0]) > 1 - 1e-9)


@numba.njit(cache=True, error_model="numpy")
def keep_points(places, geoms, surfaces, links, near, kept) -> None:  # type: ignore[no-untyped-def]
    """Put the contacts that Bullet would have in the place of those that MuJoCo has found.

    Args:
        places: See `native.addresses`.
        geoms: How geoms are turned, shape [ngeom, 9], where they are [m] and half edges of boxes [m], shapes
            [ngeom, 3].
        surfaces: See `physics_step`.
        links: The link of each geom.
        near: See `Neighbours.compiled`.
        kept: See `Manifolds.compiled`, written.
    """
    (loose, shapes), (where_listed, listed, state, counts, points, seen), (room, found) = kept
    turns, spots, sizes = geoms
    _list_pairs(near, shapes, (where_listed, listed, state, counts, points, seen))
    count = whole(places[native.DATA] + places[native.NCON], 1)
    start = word(places[native.DATA] + places[native.CONTACT])
    size = places[native.CONTACT_SIZE]
    first = number = 0
    edges, fresh = np.empty((2, 3)), np.empty((MOST, 10))
    for place in range(state[0]):
        one, other = listed[place, 0], listed[place, 1]
        if counts[place] > 0:
            where = turns[one], spots[one], turns[other], spots[other]
            counts[place] = _refresh(
                points[place], counts[place], where, min(loose[one], loose[other])
            )
    while first < count[0]:
        pair = whole(start + first * size + places[native.GEOM], 2)
        one, other = pair[0], pair[1]
        end, deepest = first, first
        while end < count[0]:
            also = whole(start + end * size + places[native.GEOM], 2)
            if also[0] != one or also[1] != other:
                break
            here, least = start + end * size, start + deepest * size
            if real(here + places[native.DIST], 1)[0] < real(least + places[native.DIST], 1)[0]:
                deepest = end
            end += 1
        first = end
        place = where_listed[one, other]
        if place < 0:
            continue
        where = turns[one], spots[one], turns[other], spots[other]
        outs, slack = (surfaces[one, 3], surfaces[other, 3]), min(loose[one], loose[other])
        mine, many = points[place], counts[place]
        new = 1
        if surfaces[one, 4] > 0.0 and surfaces[other, 4] > 0.0:
            for k in range(3):
                edges[0, k], edges[1, k] = sizes[one, k] + outs[0], sizes[other, k] + outs[1]
            box = turns[one].reshape(3, 3), spots[one], edges[0]
            new = boxes_touch(box, (turns[other].reshape(3, 3), spots[other], edges[1]), fresh)
        else:
            _see(places, start + deepest * size, outs, fresh[0])
        for i in range(new):
            _bring(fresh[i], where)
            many = _add(mine, many, fresh[i], slack)
        counts[place] = _refresh(mine, many, where, slack)
        if counts[place] > 0:
            room[number] = real(start + deepest * size, size // 8)
            found[number, 0], found[number, 1], found[number, 2] = place, one, other
            number += 1
    margins = near[5][2]
    count[0] = _write_all(
        places, start, geoms, (surfaces, margins), links, (counts, points), (room, found, number)
    )


@numba.njit(cache=True, error_model="numpy")
def _list_pairs(near, shapes, kept) -> None:  # type: ignore[no-untyped-def]
    """Add pairs of geoms to the list whose boxes overlap now, and drop those of which they no longer do.

    Bullet goes through pairs of links from the last to the first, and after each drops what it must.
    """
    where_listed, listed, state, counts, _, seen = kept
    _, ones, others, signatures, _, _ = near[6]
    end = whole(near[0], 1)[0]
    state[1] += 1
    while end > 0:
        begin = end - 1
        while begin > 0 and signatures[begin - 1] == signatures[begin]:
            begin -= 1
        for pair in range(begin, end):
            one, other = ones[pair], others[pair]
            if not _overlap(near[3], one, other, shapes):
                continue
            place = where_listed[one, other]
            if place < 0 and not _comes(near[2], one, other, shapes):
                continue
            if place < 0:
                place = state[0]
                if place == len(listed):
                    raise MemoryError("more shapes are near each other than there is room for")
                where_listed[one, other] = where_listed[other, one] = place
                listed[place, 0], listed[place, 1], counts[place] = one, other, 0
                state[0] += 1
            seen[place] = state[1]
        for pair in range(begin, end):
            place = where_listed[ones[pair], others[pair]]
            if place >= 0 and seen[place] < state[1]:
                _drop(place, kept)
        end = begin
    for place in range(state[0] - 1, -1, -1):
        if seen[place] < state[1]:
            _drop(place, kept)


@numba.njit(cache=True, error_model="numpy")
def _drop(place, kept) -> None:  # type: ignore[no-untyped-def]
    """Take a pair from the list; the last takes its place."""
    where_listed, listed, state, counts, points, seen = kept
    where_listed[listed[place, 0], listed[place, 1]] = -1
    where_listed[listed[place, 1], listed[place, 0]] = -1
    state[0] -= 1
    last = state[0]
    if place < last:
        listed[place], counts[place], points[place] = listed[last], counts[last], points[last]
        seen[place] = seen[last]
        where_listed[listed[place, 0], listed[place, 1]] = place
        where_listed[listed[place, 1], listed[place, 0]] = place


@numba.njit(cache=True, error_model="numpy")
def _overlap(geoms, one, other, shapes) -> bool:  # type: ignore[no-untyped-def]
    """Return whether the boxes of two geoms along the axes of the world overlap, as Bullet has them."""
    spots, turns, boxes, _ = geoms
    widths, plain, _, _, _, _ = shapes
    wide = 2 * WIDE if plain[one] and plain[other] else 0.0
    for k in range(3):
        apart = spots[one, k] - spots[other, k]
        reach = wide + widths[one] + widths[other]
        for axis in range(3):
            mine, theirs = turns[one, k, axis], turns[other, k, axis]
            apart += mine * boxes[one, 0, axis] - theirs * boxes[other, 0, axis]
            reach += abs(mine) * boxes[one, 1, axis] + abs(theirs) * boxes[other, 1, axis]
        if abs(apart) > reach:
            return False
    return True


@numba.njit(cache=True, error_model="numpy")
def _comes(poses, one, other, shapes) -> bool:  # type: ignore[no-untyped-def]
    """Return whether the boxes of two geoms overlap as seen from one's link, too: else they are not listed yet."""
    spots, turns, _, _, _ = poses
    _, plain, boxes, links, axes, centres = shapes
    if plain[one] and plain[other]:
        return True
    if plain[one] or (links[one] > links[other] and not plain[other]):
        one, other = other, one
    first, second = links[one], links[other]
    turn = turns[first].reshape(3, 3) @ axes[first]
    other_turn = turns[second].reshape(3, 3) @ axes[second]
    apart = spots[second] - spots[first]
    apart += turns[second].reshape(3, 3) @ centres[second] + other_turn @ boxes[other, 0]
    apart -= turns[first].reshape(3, 3) @ centres[first] + turn @ boxes[one, 0]
    gap = np.abs(turn.T @ apart) - boxes[one, 1] - np.abs(turn.T @ other_turn) @ boxes[other, 1]
    return bool(np.max(gap) <= 0.0)


@numba.njit(cache=True, error_model="numpy")
def _write_all(places, start, geoms, skins, links, kept, found) -> int:  # type: ignore[no-untyped-def]
    """Write points as contacts of MuJoCo's, in Bullet's order, and return how many they are.

    Points that are farther apart than shapes move in a physics step count for the order only.
    """
    turns, spots, _ = geoms
    surfaces, margins = skins
    counts, points = kept
    room, pairs, number = found
    order, keys = np.empty(number, np.int64), np.empty(number, np.int64)
    for i in range(number):
        one, other = links[pairs[i, 1]], links[pairs[i, 2]]
        keys[i] = (min(one, other) << 32) + max(one, other)
        at = i
        while at > 0 and pairs[order[at - 1], 0] > pairs[i, 0]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = i
    if number > 1:
        quicksort(keys, order)
    written, size = 0, room.shape[1]
    for i in order:
        place, one, other = pairs[i, 0], pairs[i, 1], pairs[i, 2]
        where = turns[one], spots[one], turns[other], spots[other]
        outs = surfaces[one, 3], surfaces[other, 3]
        for k in range(counts[place]):
            if points[place, k, GAP] + outs[0] + outs[1] > margins[one] + margins[other]:
                continue
            contact = real(start + written * places[native.CONTACT_SIZE], size)
            contact[:] = room[i]
            _write(places, contact, points[place, k], where, outs)
            written += 1
    return written


@numba.njit(cache=True, error_model="numpy")
def _see(places, here, outs, point) -> None:  # type: ignore[no-untyped-def]
    """Write a contact of MuJoCo's as a point, on the surfaces that Bullet has."""
    frame, middle = real(here + places[native.FRAME], 9), real(here + places[native.POS], 3)
    gap = real(here + places[native.DIST], 1)[0]
    for k in range(3):
        point[k] = middle[k] - (0.5 * gap - outs[0]) * frame[k]
        point[3 + k] = middle[k] + (0.5 * gap - outs[1]) * frame[k]
        point[6 + k] = frame[k]
    point[GAP] = gap - outs[0] - outs[1]


@numba.njit(cache=True, error_model="numpy")
def _bring(point, where) -> None:  # type: ignore[no-untyped-def]
    """Bring a point from the world into the frames of its shapes."""
    turn, spot, other_turn, other_spot = where
    one, other = point[ON_ONE] - spot, point[ON_OTHER] - other_spot
    for axis in range(3):
        point[axis] = turn[axis] * one[0] + turn[3 + axis] * one[1] + turn[6 + axis] * one[2]
        mine = other_turn[axis] * other[0] + other_turn[3 + axis] * other[1]
        point[3 + axis] = mine + other_turn[6 + axis] * other[2]


@numba.njit(cache=True, error_model="numpy")
def _add(points, count, point, slack):  # type: ignore[no-untyped-def]
    """Add a point in the place of the one that it is, or that can best be spared; return how many there are."""
    least, chosen = slack**2, -1
    for i in range(count):
        apart = 0.0
        for k in range(3):
            apart += (points[i, k] - point[k]) ** 2
        if apart < least:
            least, chosen = apart, i
    if chosen < 0:
        chosen = count if count < MOST else _spared(points, point)
    points[chosen] = point
    return max(count, chosen + 1)


@numba.njit(cache=True, error_model="numpy")
def _spared(points, point):  # type: ignore[no-untyped-def]
    """Return which of four points to give up for another, so that all span the most; never the deepest."""
    deepest, gap = -1, point[GAP]
    for i in range(MOST):
        if points[i, GAP] < gap:
            deepest, gap = i, points[i, GAP]
    chosen, most = 0, -1.0
    for i in range(MOST):
        area = 0.0
        if i != deepest:
            beside = 1 if i == 0 else 0
            low, high = (2, 3) if i < 2 else (1, 3) if i == 2 else (1, 2)
            one, other = (
                point[ON_ONE] - points[beside, ON_ONE],
                points[high, ON_ONE] - points[low, ON_ONE],
            )
            area = np.sum(np.cross(one, other) ** 2)
        if area > most:
            chosen, most = i, area
    return chosen


@numba.njit(cache=True, error_model="numpy")
def _refresh(points, count, where, slack):  # type: ignore[no-untyped-def]
    """Find the gaps of points as shapes are now; drop those that came apart, and return how many are left."""
    for i in range(count - 1, -1, -1):
        one, other, gap = _ends(points[i], where)
        points[i, GAP], aside = gap, 0.0
        for k in range(3):
            aside += (other[k] - one[k] - gap * points[i, 6 + k]) ** 2
        if gap > slack or aside > slack**2:
            count -= 1
            points[i] = points[count]
    return count


@numba.njit(cache=True, error_model="numpy")
def _ends(point, where):  # type: ignore[no-untyped-def]
    """Return where a point is on either shape, in the world, and the gap there."""
    turn, spot, other_turn, other_spot = where
    one, other, gap = np.empty(3), np.empty(3), 0.0
    for k in range(3):
        one[k], other[k] = spot[k], other_spot[k]
        for axis in range(3):
            one[k] += turn[3 * k + axis] * point[axis]
            other[k] += other_turn[3 * k + axis] * point[3 + axis]
        gap += (other[k] - one[k]) * point[6 + k]
    return one, other, gap


@numba.njit(cache=True, error_model="numpy")
def _write(places, contact, point, where, outs) -> None:  # type: ignore[no-untyped-def]
    """Write a point as a contact of MuJoCo's; which way its tangents are is left to `place_frictions`."""
    one, other, gap = _ends(point, where)
    whole_gap = gap + outs[0] + outs[1]
    contact[places[native.DIST] // 8] = whole_gap
    frame, middle = places[native.FRAME] // 8, places[native.POS] // 8
    for k in range(3):
        first = one[k] + (0.5 * whole_gap - outs[0]) * point[6 + k]
        second = other[k] - (0.5 * whole_gap - outs[1]) * point[6 + k]
        contact[middle + k], contact[frame + k] = 0.5 * (first + second), point[6 + k]
    x, y, z = point[6], point[7], point[8]
    a, b, c = (0.0, z, -y) if abs(x) < 0.6 else (-z, 0.0, x)  # normal x an axis that is far from it
    long = np.sqrt(a * a + b * b + c * c)
    a, b, c = a / long, b / long, c / long
    contact[frame + 3], contact[frame + 4], contact[frame + 5] = a, b, c
    contact[frame + 6], contact[frame + 7] = y * c - z * b, z * a - x * c
    contact[frame + 8] = x * b - y * a
