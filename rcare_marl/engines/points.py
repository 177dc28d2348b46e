"""The points of two shapes that touch, kept by Bullet's rules; see `manifolds`.

A point is where it is on either shape, in its frame, the normal in the world from one to the other, and
the gap.
"""

from __future__ import annotations

import numba
import numpy as np

from . import native
from .boxes import boxes_touch

MOST = 4  # points of two shapes that Bullet keeps
ON_ONE, ON_OTHER, GAP = slice(0, 3), slice(3, 6), 9


@numba.njit(cache=True, error_model="numpy")
def keep_pair(points, count, where, boxes, slack, fresh) -> int:  # type: ignore[no-untyped-def]
    """Add points of two geoms to those that are kept, and return how many these are then."""
    count, new = refresh(points, count, where, slack), 1
    (edges, other_edges), are_boxes = boxes
    if are_boxes:
        turn, spot, other_turn, other_spot = where
        box = turn.reshape(3, 3), spot, edges
        new = boxes_touch(box, (other_turn.reshape(3, 3), other_spot, other_edges), fresh)
        for i in range(new):
            _bring(fresh[i], where)
    for i in range(new):
        if fresh[i, GAP] <= slack:
            count = _add(points, count, fresh[i], slack)
    return refresh(points, count, where, slack)


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
    """Add a point in the place of the one that it is, or that can best be spared; return their number."""
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
def refresh(points, count, where, slack):  # type: ignore[no-untyped-def]
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
def write_point(places, contact, point, where, outs) -> None:  # type: ignore[no-untyped-def]
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
