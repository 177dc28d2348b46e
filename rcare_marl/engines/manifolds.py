"""Points in which shapes touch, kept from step to step and in order, as Bullet keeps them.

In a physics step Bullet finds one point of two shapes, where they are nearest or overlap most (of two boxes
several), and keeps those of the steps before, four at most, for as long as they stay on each other. So an
arm that is laid on a plate touches at one end, then at both. MuJoCo finds both ends at once, and forgets
them. Here the deepest point that MuJoCo finds is that of Bullet's step, and the others are kept by Bullet's
rules.

Bullet has a list of shapes whose boxes overlap: what comes is added at its end, and the last takes the place
of what goes. Those that touch are sorted by their links with a quicksort that is not stable, so that the
shapes of two links come in an order that depends on all others. The solver's sweeps do not converge, so it
shows.

Of a ball no point is kept but the newest, nor is it listed: what Bullet keeps besides of food is within
0.2 mm of it, and costs time.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numba
import numpy as np

from rcare_marl.pose import Array

from . import native
from .native import real, whole, word
from .points import GAP, MOST, keep_pair, refresh, write_point
from .row_order import quicksort

# Of the reach of the smaller link from its centre of mass, how far points may come apart: Bullet's.
LOOSE = 0.02
WIDE = 0.02  # [m] by which Bullet's boxes of links are wider than they are
Frames = list[tuple[Array, Array]]
PAIRS, BALLS, CONTACTS = 1024, 1024, 2048  # our own choice; more of them are a MemoryError
# What is written of pairs that touch: their place in the list, their geoms, whether points are not as MuJoCo
# found them, which contact of MuJoCo's it was, and what they are sorted by.
PLACE, ONE, OTHER, IS_NEW, FOUND, KEY = range(6)


class Manifolds:
    """What is kept of the contacts of a scene.

    Attributes:
        loose: How far apart points in which each geom touches may come [m], shape [ngeom].
        compiled: What `keep_points` takes. Of each geom how loose its points may be [m], how wide its box is
            beyond MuJoCo's, whether it is a link by itself, whether it is a ball, its box along its link,
            and the link; main axes of links; where pairs of geoms are in the list, shape [ngeom, ngeom], -1
            if their boxes are apart; the list, shape [pairs, 2]; how many are in it, and a clock; the
            points of each: how many, where they are on either geom, in its frame, the normal in the world
            and the gap, shape [pairs, 4, 10]; when boxes were last seen to overlap; and room.
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
            np.zeros(PAIRS + BALLS, np.int64),
            np.zeros((PAIRS + BALLS, MOST, 10)),
            np.zeros(PAIRS, np.int64),
        )
        size = native.contact_size() // 8
        boxes = _boxes(model, roundings, frames)
        axes = np.array([frame[0] for frame in frames])
        self.loose = LOOSE * _reaches(model, boxes)
        links = model.geom_bodyid.astype(np.int64)
        room = np.zeros((model.ngeom, 2, 3)), np.zeros(model.ngeom, np.int64), np.zeros((2, 3, 3))
        balls = model.geom_type == int(mujoco.mjtGeom.mjGEOM_SPHERE)
        shapes = roundings, _plain(model, frames), balls, boxes, links, axes, room
        self.compiled = (
            (self.loose, shapes),
            self._kept,
            (
                np.zeros((CONTACTS, size)),
                np.zeros((PAIRS + BALLS, 6), np.int64),
                np.zeros(PAIRS + BALLS, np.int64),
                np.zeros((MOST, 10)),
            ),
        )

    def forget(self) -> None:
        """Keep nothing."""
        self._kept[0][:] = -1
        self._kept[2][0] = 0


def _boxes(model: Any, widths: Array, frames: Frames) -> Array:
    """Return the boxes of geoms along the main axes of their links, from their centres of mass.

    Middle and half edges [m], shape [ngeom, 2, 3].
    """
    turn, found = np.zeros(9), np.empty((model.ngeom, 2, 3))
    for geom, link in enumerate(model.geom_bodyid):
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        middle, half = model.geom_aabb[geom].reshape(2, 3)
        turned, (axes, centre) = turn.reshape(3, 3), frames[link]
        found[geom, 0] = axes.T @ (model.geom_pos[geom] + turned @ middle - centre)
        found[geom, 1] = np.abs(axes.T @ turned) @ (half + widths[geom])
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


@numba.njit(cache=True, error_model="numpy", inline="always")
def keep_points(places, geoms, surfaces, links, near, kept) -> None:  # type: ignore[no-untyped-def]
    """Put the contacts that Bullet would have in the place of those that MuJoCo has found.

    Most shapes touch in one point, which is where they touched before. That is worked out here and not in a
    function: to hand it arrays would take as long.

    Args:
        places: See `native.addresses`.
        geoms: How geoms are turned, shape [ngeom, 9], where they are [m] and half edges of boxes [m], shapes
            [ngeom, 3].
        surfaces: See `physics_step`.
        links: The link of each geom.
        near: See `Neighbours.compiled`.
        kept: See `Manifolds.compiled`, written.
    """
    (loose, shapes), lists, (room, found, now, fresh) = kept
    where_listed, listed, state, counts, points, _ = lists
    turns, spots, sizes = geoms
    _list_pairs(near, shapes, lists, now)
    count = whole(places[native.DATA] + places[native.NCON], 1)
    start = word(places[native.DATA] + places[native.CONTACT])
    first = number = 0
    is_same, before, margins, balls = True, -1, near[5][2], shapes[2]
    while first < count[0]:
        one, other, end, deepest, gap = _deepest(places, start, first, count[0])
        is_same &= end == first + 1
        first = end
        out, across, slack = surfaces[one, 3], surfaces[other, 3], min(loose[one], loose[other])
        here, place = start + deepest * places[native.CONTACT_SIZE], where_listed[one, other]
        is_ball = balls[one] or balls[other]
        key = (min(links[one], links[other]) << 32) + max(links[one], links[other])
        if is_ball:
            if number == BALLS:
                raise MemoryError("more shapes touch than there is room for")
            place = PAIRS + number
            counts[place], points[place, 0, GAP] = 1, gap - out - across
        elif place < 0:
            is_same = False
            continue
        frame, middle = real(here + places[native.FRAME], 3), real(here + places[native.POS], 3)
        gap -= out + across
        for axis in range(0 if is_ball else 3):
            mine = theirs = 0.0
            for k in range(3):
                half = 0.5 * (gap - out + across) * frame[k]
                mine += turns[one, 3 * k + axis] * (middle[k] - half - spots[one, k])
                half = 0.5 * (gap + out - across) * frame[k]
                theirs += turns[other, 3 * k + axis] * (middle[k] + half - spots[other, k])
            fresh[0, axis], fresh[0, 3 + axis], fresh[0, 6 + axis] = mine, theirs, frame[axis]
        fresh[0, GAP] = gap
        many, apart = counts[place], 0.0
        if many > 0 and not is_ball:
            for k in range(3):
                apart += (points[place, 0, k] - fresh[0, k]) ** 2
        are_boxes = surfaces[one, 4] > 0.0 and surfaces[other, 4] > 0.0
        if is_ball:
            found[number, IS_NEW] = 0
        elif not are_boxes and gap <= slack and (many == 0 or (many == 1 and apart < slack**2)):
            for k in range(10):
                points[place, 0, k] = fresh[0, k]
            counts[place], found[number, IS_NEW] = 1, 0
        else:
            where = turns[one], spots[one], turns[other], spots[other]
            edges = sizes[one] + out, sizes[other] + across
            counts[place] = keep_pair(points[place], many, where, (edges, are_boxes), slack, fresh)
            found[number, IS_NEW], is_same = 1, False
        now[place] = state[1]
        is_same &= counts[place] > 0
        if counts[place] > 0:
            is_same &= key > before or (is_ball and key == before)
            is_same &= gap <= margins[one] + margins[other] - out - across
            before = key
            found[number, PLACE], found[number, ONE], found[number, OTHER] = place, one, other
            found[number, FOUND], found[number, KEY] = deepest, key
            number += 1
    _refresh_others(geoms, loose, listed, state, counts, points, now)
    if not is_same:
        skins, held = (surfaces, margins), (counts, points)
        count[0] = _write_all(places, start, geoms, skins, held, (room, found, number))


@numba.njit(cache=True, error_model="numpy")
def _deepest(places, start, first, count):  # type: ignore[no-untyped-def]
    """Return the geoms of a contact of MuJoCo's, the end of theirs, the deepest of them and its gap [m]."""
    size = places[native.CONTACT_SIZE]
    pair = whole(start + first * size + places[native.GEOM], 2)
    end, deepest, gap = first, first, np.inf
    while end < count:
        also = whole(start + end * size + places[native.GEOM], 2)
        if also[0] != pair[0] or also[1] != pair[1]:
            break
        depth = real(start + end * size + places[native.DIST], 1)[0]
        if depth < gap:
            deepest, gap = end, depth
        end += 1
    return pair[0], pair[1], end, deepest, gap


@numba.njit(cache=True, error_model="numpy", inline="always")
def _refresh_others(geoms, loose, listed, state, counts, points, now) -> None:  # type: ignore[no-untyped-def]
    """Find the gaps of pairs that are kept, but of which MuJoCo found nothing."""
    turns, spots, _ = geoms
    for place in range(state[0]):
        if counts[place] > 0 and now[place] < state[1]:
            one, other = listed[place, 0], listed[place, 1]
            where, slack = (
                (turns[one], spots[one], turns[other], spots[other]),
                min(loose[one], loose[other]),
            )
            counts[place] = refresh(points[place], counts[place], where, slack)


@numba.njit(cache=True, error_model="numpy", inline="always")
def _list_pairs(near, shapes, kept, now) -> None:  # type: ignore[no-untyped-def]
    """Add pairs of geoms to the list whose boxes overlap now, and drop those of which they no longer do.

    Bullet goes through pairs of links from the last to the first, and after each drops what it must. What
    comes must overlap as seen from a link as well.
    """
    where_listed, listed, state, counts, _, seen = kept
    _, ones, others, signatures, _, _ = near[6]
    spots, turns, boxes, _ = near[3]
    widths, plain, balls, local, links, axes, (corners, when, turned) = shapes
    end = whole(near[0], 1)[0]
    state[1] += 1
    clock = state[1]
    for pair in range(end):
        for geom in (ones[pair], others[pair]):
            if when[geom] == clock or balls[ones[pair]] or balls[others[pair]]:
                continue
            when[geom] = clock
            for k in range(3):
                middle, half, wide = spots[geom, k], 0.0, widths[geom]
                for axis in range(3):
                    middle += turns[geom, k, axis] * boxes[geom, 0, axis]
                    half += abs(turns[geom, k, axis]) * (boxes[geom, 1, axis] + wide)
                corners[geom, 0, k], corners[geom, 1, k] = middle - half, middle + half
    while end > 0:
        begin, are_left = end - 1, False
        while begin > 0 and signatures[begin - 1] == signatures[begin]:
            begin -= 1
        for pair in range(begin, end):
            one, other = ones[pair], others[pair]
            if balls[one] or balls[other]:
                continue
            wide = 2 * WIDE if plain[one] and plain[other] else 0.0
            overlap = True
            for k in range(3):
                overlap &= corners[one, 0, k] - wide <= corners[other, 1, k]
                overlap &= corners[other, 0, k] - wide <= corners[one, 1, k]
            place = where_listed[one, other]
            if not overlap:
                are_left |= place >= 0
                continue
            if place < 0:
                first, second = one, other
                if plain[one] or (links[one] > links[other] and not plain[other]):
                    first, second = other, one
                if not _comes(near[2][1], first, second, local, links, axes, corners, turned):
                    continue
                place = state[0]
                if place == len(listed):
                    raise MemoryError("more shapes are near each other than there is room for")
                where_listed[one, other] = where_listed[other, one] = place
                listed[place, 0], listed[place, 1], counts[place], now[place] = one, other, 0, 0
                state[0] += 1
            seen[place] = clock
        for pair in range(begin, end if are_left else begin):
            place = where_listed[ones[pair], others[pair]]
            if place >= 0 and seen[place] < clock:
                _drop(place, kept)
        end = begin
    for place in range(state[0] - 1, -1, -1):
        if seen[place] < clock:
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
def _comes(turns, one, other, boxes, links, axes, corners, turned) -> bool:  # type: ignore[no-untyped-def]
    """Return whether the boxes of two geoms overlap as seen from the first one's link."""
    for i, geom in enumerate((one, other)):
        link = links[geom]
        for k in range(3):
            for axis in range(3):
                turned[i, k, axis] = 0.0
                for side in range(3):
                    turned[i, k, axis] += turns[link, 3 * k + side] * axes[link, side, axis]
    for axis in range(3):
        apart, reach = 0.0, boxes[one, 1, axis]
        for k in range(3):
            far = (
                corners[other, 0, k]
                + corners[other, 1, k]
                - corners[one, 0, k]
                - corners[one, 1, k]
            )
            apart += 0.5 * far * turned[0, k, axis]
        for side in range(3):
            slope = 0.0
            for k in range(3):
                slope += turned[0, k, axis] * turned[1, k, side]
            reach += abs(slope) * boxes[other, 1, side]
        if abs(apart) > reach:
            return False
    return True


@numba.njit(cache=True, error_model="numpy")
def _write_all(places, start, geoms, skins, kept, found) -> int:  # type: ignore[no-untyped-def]
    """Write points as contacts of MuJoCo's, in Bullet's order, and return how many they are.

    Points that are farther apart than shapes move in a physics step count for the order only.
    """
    turns, spots, _ = geoms
    surfaces, margins = skins
    counts, points = kept
    room, pairs, number = found
    order, keys = np.empty(number, np.int64), pairs[:number, KEY].copy()
    for i in range(number):
        at = i
        while at > 0 and pairs[order[at - 1], PLACE] > pairs[i, PLACE]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = i
    if number > 1:
        quicksort(keys, order)
    size, length, written = places[native.CONTACT_SIZE], room.shape[1], 0
    for i in order:  # where each begins; those that stay where they are need not be copied
        place, one, other = pairs[i, PLACE], pairs[i, ONE], pairs[i, OTHER]
        wide = margins[one] + margins[other] - surfaces[one, 3] - surfaces[other, 3]
        begin = written
        for point in range(counts[place]):
            written += points[place, point, GAP] <= wide
        if pairs[i, IS_NEW] == 0 and begin == pairs[i, FOUND] and written > begin:
            pairs[i, PLACE] = -1
        elif written > begin:
            contact = real(start + pairs[i, FOUND] * size, length)
            for k in range(length):
                room[i, k] = contact[k]
    written = 0
    for i in order:
        place, one, other = pairs[i, PLACE], pairs[i, ONE], pairs[i, OTHER]
        if place < 0:
            written += 1
            continue
        out, across = surfaces[one, 3], surfaces[other, 3]
        for point in range(counts[place]):
            if points[place, point, GAP] > margins[one] + margins[other] - out - across:
                continue
            contact = real(start + written * size, length)
            for k in range(length):
                contact[k] = room[i, k]
            if pairs[i, IS_NEW] == 1:
                where = turns[one], spots[one], turns[other], spots[other]
                write_point(places, contact, points[place, point], where, (out, across))
            written += 1
    return written
