"""Where two boxes overlap, as Bullet finds it.

Of the fifteen axes that can part two boxes that along which they overlap least is taken: a face of one, or
what is square to an edge of each. Edges touch in one point. Of a face the nearest face of the other box is
cut to its size, and the corners that lie behind it touch, four at most: the deepest, and those in the
directions that are nearest to right angles from it. (The method of D. Gottschalk et al. 1996, with contacts
as the Open Dynamics Engine has them, R. Smith 2004; written anew.)
"""

from __future__ import annotations

import numba
import numpy as np

FACES_FIRST = 1.05  # how much less than along a face boxes must overlap along edges, to touch there
BLUNT = (
    1e-5  # added to cosines, so that edges that are about parallel count for no axis of their own
)
CORNERS = 8  # of a face that is cut to another's size
PUSHED = 4  # of them that touch


@numba.njit(cache=True, error_model="numpy")
def boxes_touch(first, second, points):  # type: ignore[no-untyped-def]
    """Find where two boxes touch, and return how many points there are.

    Args:
        first: How a box is turned, shape [3, 3], where it is [m] and its half edges [m], shapes [3].
        second: The same of the other.
        points: Where it is on the first box and on the second, in the world, the normal from the first to the
            second, and the gap, below 0, shape [4, 10]; written.
    """
    turn, spot, half = first
    other_turn, other_spot, other_half = second
    way, axes = np.empty(3), np.zeros((3, 3))
    for k in range(3):
        way[k] = other_spot[k] - spot[k]
    for i in range(3):
        for j in range(3):
            for k in range(3):
                axes[i, j] += turn[k, i] * other_turn[k, j]
    normal, gap, code = _least_overlap(turn, half, other_turn, other_half, way, axes)
    if code < 0:
        return 0
    if code >= 6:
        _edges_touch(first, second, normal, gap, divmod(code - 6, 3), points[0])
        return 1
    own, theirs = (first, second) if code < 3 else (second, first)
    return _face_touches(own, theirs, normal, code, points)


@numba.njit(cache=True, error_model="numpy")
def _least_overlap(turn, half, other_turn, other_half, way, axes):  # type: ignore[no-untyped-def]
    """Return the axis along which two boxes overlap least, from one to the other, and how far.

    Its number comes with it: those of faces are 0 to 5, those of edges 6 to 14; -1 if the boxes are apart.
    """
    normal, best, code = np.zeros(3), -np.inf, -1
    for face in range(6):
        i = face % 3
        own, theirs = (half, other_half) if face < 3 else (other_half, half)
        reach, along = own[i], 0.0
        for k in range(3):
            reach += theirs[k] * abs(axes[i, k] if face < 3 else axes[k, i])
            along += way[k] * (turn[k, i] if face < 3 else other_turn[k, i])
        gap = abs(along) - reach
        if gap > 0.0:
            return normal, gap, -1
        if gap > best:
            best, code = gap, face
            for k in range(3):
                side = turn[k, i] if face < 3 else other_turn[k, i]
                normal[k] = -side if along < 0.0 else side
    for i in range(3):
        for j in range(3):
            x = turn[1, i] * other_turn[2, j] - turn[2, i] * other_turn[1, j]
            y = turn[2, i] * other_turn[0, j] - turn[0, i] * other_turn[2, j]
            z = turn[0, i] * other_turn[1, j] - turn[1, i] * other_turn[0, j]
            reach = along = 0.0
            for k in range(3):
                if k != i:
                    reach += half[k] * (abs(axes[3 - i - k, j]) + BLUNT)
                if k != j:
                    reach += other_half[k] * (abs(axes[i, 3 - j - k]) + BLUNT)
            along = way[0] * x + way[1] * y + way[2] * z
            gap, long = abs(along) - reach, np.sqrt(x * x + y * y + z * z)
            if gap > 1e-15:
                return normal, gap, -1
            if long > 1e-15 and gap / long * FACES_FIRST > best:
                best, code = gap / long, 6 + 3 * i + j
                side = -1.0 if along < 0.0 else 1.0
                normal[0], normal[1], normal[2] = side * x / long, side * y / long, side * z / long
    return normal, best, code


@numba.njit(cache=True, error_model="numpy")
def _edges_touch(first, second, normal, gap, edges, point) -> None:  # type: ignore[no-untyped-def]
    """Write the point in which an edge of one box is nearest to one of the other."""
    turn, spot, half = first
    other_turn, other_spot, other_half = second
    one, other = spot.copy(), other_spot.copy()
    for axis in range(3):
        side = half[axis] if np.sum(normal * turn[:, axis]) > 0.0 else -half[axis]
        across = (
            -other_half[axis] if np.sum(normal * other_turn[:, axis]) > 0.0 else other_half[axis]
        )
        one += side * turn[:, axis]
        other += across * other_turn[:, axis]
    along, beside = turn[:, edges[0]], other_turn[:, edges[1]]
    apart = other - one
    cosine, near, far = np.sum(along * beside), np.sum(along * apart), -np.sum(beside * apart)
    share = 1.0 - cosine**2
    if share > 1e-4:
        one += (near + cosine * far) / share * along
        other += (cosine * near + far) / share * beside
    for k in range(3):
        point[k], point[3 + k] = other[k] - gap * normal[k], other[k]
        point[6 + k] = normal[k]
    point[9] = gap


@numba.njit(cache=True, error_model="numpy")
def _face_touches(own, theirs, normal, code, points) -> int:  # type: ignore[no-untyped-def]
    """Write where a face of one box is touched by the other, and return in how many points."""
    turn, spot, half = own
    other_turn, other_spot, other_half = theirs
    out = normal if code < 3 else -normal  # of the face
    facing, most = 0, -1.0
    for axis in range(3):
        steep = abs(np.sum(other_turn[:, axis] * out))
        if steep > most or (steep == most and axis == 2):
            facing, most = axis, steep
    first, second = (1, 2) if facing == 0 else (0, 2) if facing == 1 else (0, 1)
    up = 1.0 if np.sum(other_turn[:, facing] * out) < 0.0 else -1.0
    middle = other_spot - spot + up * other_half[facing] * other_turn[:, facing]
    axis = code % 3
    one, other = (1, 2) if axis == 0 else (0, 2) if axis == 1 else (0, 1)
    x, y = np.sum(middle * turn[:, one]), np.sum(middle * turn[:, other])
    across = np.empty((2, 2))
    for i, mine in enumerate((one, other)):
        for j, side in enumerate((first, second)):
            across[i, j] = np.sum(turn[:, mine] * other_turn[:, side])
    corners = np.empty((2 * CORNERS, 2))
    for i, (a, b) in enumerate(((-1, -1), (-1, 1), (1, 1), (1, -1))):
        a, b = a * other_half[first], b * other_half[second]
        corners[i, 0] = x + a * across[0, 0] + b * across[0, 1]
        corners[i, 1] = y + a * across[1, 0] + b * across[1, 1]
    count = _cut(corners, half[one], half[other])
    area = across[0, 0] * across[1, 1] - across[0, 1] * across[1, 0]
    spots, depths, found = np.empty((CORNERS, 3)), np.empty(CORNERS), 0
    for i in range(count):
        a, b = corners[i, 0] - x, corners[i, 1] - y
        right = (across[1, 1] * a - across[0, 1] * b) / area
        ahead = (across[0, 0] * b - across[1, 0] * a) / area
        place = middle + right * other_turn[:, first] + ahead * other_turn[:, second]
        depth = half[axis] - np.sum(out * place)
        if depth >= 0.0:
            spots[found], depths[found], corners[found] = place + spot, depth, corners[i]
            found += 1
    chosen = _spread(corners[:found], depths[:found])
    for i, corner in enumerate(chosen):
        for k in range(3):
            touched = spots[corner, k] + depths[corner] * out[k]
            points[i, k] = touched if code < 3 else spots[corner, k]
            points[i, 3 + k] = spots[corner, k] if code < 3 else touched
            points[i, 6 + k] = normal[k]
        points[i, 9] = -depths[corner]
    return len(chosen)


@numba.njit(cache=True, error_model="numpy")
def _cut(corners, wide, high) -> int:  # type: ignore[no-untyped-def]
    """Cut a face of four corners to what lies within a rectangle round 0, and return how many it has then."""
    count, cut = 4, np.empty_like(corners)
    for axis, half in enumerate((wide, high)):
        for side in (-1.0, 1.0):
            found = 0
            for i in range(count):
                here, after = corners[i], corners[(i + 1) % count]
                is_in, goes_in = side * here[axis] < half, side * after[axis] < half
                if is_in:
                    cut[found] = here
                    found += 1
                if is_in != goes_in and found < CORNERS:
                    slope = (after[1 - axis] - here[1 - axis]) / (after[axis] - here[axis])
                    cut[found, axis] = side * half
                    cut[found, 1 - axis] = here[1 - axis] + slope * (side * half - here[axis])
                    found += 1
                if found == CORNERS:
                    break
            count = found
            corners[:count] = cut[:count]
    return count


@numba.njit(cache=True, error_model="numpy")
def _spread(corners, depths):  # type: ignore[no-untyped-def]
    """Return which corners touch: all, or the deepest and three in the directions that are best spread."""
    count = len(depths)
    if count <= PUSHED:
        return np.arange(count)
    area = x = y = 0.0
    for i in range(count):
        here, after = corners[i], corners[(i + 1) % count]
        turned = here[0] * after[1] - after[0] * here[1]
        area += turned
        x += turned * (here[0] + after[0])
        y += turned * (here[1] + after[1])
    x, y = (x / (3.0 * area), y / (3.0 * area)) if abs(area) > 1e-15 else (1e18 * x, 1e18 * y)
    angles, free = np.arctan2(corners[:, 1] - y, corners[:, 0] - x), np.ones(count, np.bool_)
    chosen = np.full(PUSHED, np.argmax(depths))
    free[chosen[0]] = False
    for i in range(1, PUSHED):
        wanted, least = angles[chosen[0]] + i * 2.0 * np.pi / PUSHED, np.inf
        if wanted > np.pi:
            wanted -= 2.0 * np.pi
        for corner in range(count):
            apart = abs(angles[corner] - wanted)
            apart = min(apart, 2.0 * np.pi - apart)
            if free[corner] and apart < least:
                chosen[i], least = corner, apart
        free[chosen[i]] = False
    return chosen
