"""Vessels for fluids: a round bottom and a wall that may lean; how near walls are, and the way out of them.

A vessel is a body of revolution: a flat bottom and a straight wall that may lean, both of one thickness. The
distance from the middle of either is exact. What a wall keeps free of fluid counts as filled with it, as in
D. Koschier and J. Bender, "Density Maps for Improved SPH Boundary Handling" (SCA 2017), here for a flat
wall, where the integral has a closed form.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numba
import numpy as np
import numpy.typing as npt

from ..body import Body
from ..errors import ConfigError
from ..pose import Array, Pose, Vector, conjugate, matrix_from_quaternion, rotate
from .collider import carry, turning
from .contact import PLACE, SLIDE, SPIN, TURN, add, note
from .kernel import line_point

# Columns of a vessel in the world: middle of its bottom [m], rotation and velocities [m/s, rad/s] as those of
# a shape in `contact`, then radii of the middle of the wall below and above [m], height [m], half its
# thickness [m].
LOW, HIGH, TALL, HALF = 18, 19, 20, 21
VESSEL = 22
OUTCOME = (
    6  # columns of what a vessel got: impulse [N·s], its moment about the world's origin [N·m·s]
)
# Columns of what a particle feels: gradient of its density, sum of squares, density, multiplier; gradient
# by walls [1/m]; shift [m].
GRADIENT, SQUARES, DENSITY, FACTOR, WALL, SHIFT = 0, 3, 4, 5, 6, 9
FEELING = 12
NOWHERE = -1

_LEAST = 1e-12
_NARROW = 1.2  # of what a wall hides as a continuum: whole layers miss more; measured


@dataclass(eq=False)
class Vessel:
    """The inside of a cup on a link, as fluids know it: a signed distance, open at the top.

    Its frame: origin in the middle of the bottom's inside, z up the axis.

    Attributes:
        body: The body that carries it.
        link: Its link; -1 for the base.
        pose: Of the vessel's frame in that of the link.
        bottom_radius: Of the inside, at the bottom [m].
        rim_radius: Of the inside, at the rim [m].
        depth: From the inside of the bottom to the rim [m].
        wall: Thickness of wall and bottom [m].

    Raises:
        ConfigError: If a size is not above 0.
    """

    body: Body
    link: int
    pose: Pose
    _: KW_ONLY
    bottom_radius: float
    rim_radius: float
    depth: float
    wall: float

    def __post_init__(self) -> None:
        sizes = (self.bottom_radius, self.rim_radius, self.depth, self.wall)
        if not min(sizes) > 0:
            raise ConfigError(f"radii, depth and wall of a vessel must be above 0, got {sizes}")
        at = self.body.inertial_pose(self.link).inverse() @ self.pose
        self._place = np.array((*at.position, *at.quaternion))

    @property
    def volume(self) -> float:
        """What it holds up to the rim [m³]."""
        a, b = self.bottom_radius, self.rim_radius
        return float(np.pi * self.depth * (a * a + a * b + b * b) / 3)

    def level(self, volume: float) -> float:
        """Return how high a volume [m³] stands in it [m].

        Raises:
            ConfigError: If it holds less.
        """
        if not 0 <= volume <= self.volume:
            raise ConfigError(
                f"the vessel holds {1e6 * self.volume:.0f} ml, got {1e6 * volume:.0f} ml"
            )
        slope = (self.rim_radius - self.bottom_radius) / self.depth
        heights = np.linspace(0.0, self.depth, 1001)
        a, b = self.bottom_radius, self.bottom_radius + slope * heights
        volumes = np.pi * heights * (a * a + a * b + b * b) / 3
        return float(np.interp(volume, volumes, heights))

    def frame(self) -> Pose:
        """Return its frame in the world: z up its axis."""
        return self.body.link_pose(self.link) @ self.pose

    def holds(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return which points of the world [m], shape [n, 3], are in it, shape [n]."""
        frame = self.frame()
        local = (points - np.array(frame.position)) @ matrix_from_quaternion(frame.quaternion)
        slope = (self.rim_radius - self.bottom_radius) / self.depth
        across = np.hypot(local[:, 0], local[:, 1])
        up = local[:, 2]
        return (up > -self.wall) & (up < self.depth) & (across < self.bottom_radius + slope * up)

    def rim_point(self, direction: Vector) -> Array:
        """Return the point of the rim that lies farthest in a direction of the world [m], shape [3]."""
        frame = self.frame()
        x, y, _ = rotate(conjugate(frame.quaternion), direction)
        length = max(float(np.hypot(x, y)), 1e-9)
        radius = self.rim_radius / length
        return rotate(frame.quaternion, (radius * x, radius * y, self.depth)) + frame.position

    def write(self, row: Array, state: Array) -> None:
        """Write its row of the kernel's table, for the state of its link, see `collider`."""
        set_vessel(
            state, self._place, self.bottom_radius, self.rim_radius, self.depth, self.wall, row
        )


@numba.njit(cache=True)
def set_vessel(state, place, low, high, depth, wall, row) -> None:  # type: ignore[no-untyped-def]
    """Write the row of a vessel whose frame is at `place` on a link with that state; sizes are inside [m]."""
    out = np.empty(13)
    carry(state, place, out)
    turn = turning(out[3:7])
    for k in range(9):
        row[TURN + k] = turn[k]
    for k in range(3):
        row[PLACE + k] = out[k] - 0.5 * wall * turn[3 * k + 2]
    for k in range(6):
        row[SLIDE + k] = out[7 + k]
    for k in range(3):  # the middle of the bottom is below the frame
        a, b = (k + 1) % 3, (k + 2) % 3
        row[SLIDE + k] += out[10 + a] * (row[PLACE + b] - out[b]) - out[10 + b] * (
            row[PLACE + a] - out[a]
        )
    row[LOW], row[HIGH], row[TALL] = low + 0.5 * wall, high + 0.5 * wall, depth + 0.5 * wall
    row[HALF] = 0.5 * wall


@numba.njit(cache=True)
def sum_up(got, row, period, out) -> None:  # type: ignore[no-untyped-def]
    """Write force [N] and a point of its line of action [m] for what a vessel got, shape [6]."""
    middle = np.empty(3)
    for k in range(3):
        middle[k] = row[PLACE + k] + 0.5 * row[TALL] * row[TURN + 3 * k + 2]
    line_point(got[:3], got[3:], middle, out[3:])
    apart = 0.0
    for k in range(3):
        out[k] = got[k] / period
        apart += (out[3 + k] - middle[k]) ** 2
    if apart > row[TALL] ** 2:  # hardly any force, and a couple
        for k in range(3):
            out[3 + k] = middle[k]


@numba.njit(cache=True, error_model="numpy", inline="always")
def _local(table, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return a point in the frame of a vessel: its place across x, y, and up its axis."""
    x, y, z = x - table[c, PLACE], y - table[c, PLACE + 1], z - table[c, PLACE + 2]
    return (
        table[c, TURN] * x + table[c, TURN + 3] * y + table[c, TURN + 6] * z,
        table[c, TURN + 1] * x + table[c, TURN + 4] * y + table[c, TURN + 7] * z,
        table[c, TURN + 2] * x + table[c, TURN + 5] * y + table[c, TURN + 8] * z,
    )


@numba.njit(cache=True, error_model="numpy", inline="always")
def _global(table, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return a direction of the frame of a vessel in the world."""
    return (
        table[c, TURN] * x + table[c, TURN + 1] * y + table[c, TURN + 2] * z,
        table[c, TURN + 3] * x + table[c, TURN + 4] * y + table[c, TURN + 5] * z,
        table[c, TURN + 6] * x + table[c, TURN + 7] * y + table[c, TURN + 8] * z,
    )


@numba.njit(cache=True, error_model="numpy", inline="always")
def speed_at(table, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return the velocity of a vessel at a point of the world [m/s]."""
    x, y, z = x - table[c, PLACE], y - table[c, PLACE + 1], z - table[c, PLACE + 2]
    wx, wy, wz = table[c, SPIN], table[c, SPIN + 1], table[c, SPIN + 2]
    return (
        table[c, SLIDE] + wy * z - wz * y,
        table[c, SLIDE + 1] + wz * x - wx * z,
        table[c, SLIDE + 2] + wx * y - wy * x,
    )


@numba.njit(cache=True, error_model="numpy", inline="always")
def _wall(table, c, across, up):  # type: ignore[no-untyped-def]
    """Return distance from the middle of the wall [m], the way from it, side, and how far over the rim."""
    slope, tall = table[c, HIGH] - table[c, LOW], table[c, TALL]
    length = np.sqrt(slope * slope + tall * tall)
    er, ez = slope / length, tall / length
    pr = across - table[c, LOW]
    along = pr * er + up * ez
    side = up * er - pr * ez  # above zero inside
    over = along - length
    kept = min(max(along, 0.0), length)
    dr, dz = pr - kept * er, up - kept * ez
    d = np.sqrt(dr * dr + dz * dz) + _LEAST
    return d, dr / d, dz / d, side, over, along


@numba.njit(cache=True, error_model="numpy")
def find_outside(x, active, vessels, margin, out) -> int:  # type: ignore[no-untyped-def]
    """Write the particles that are in no vessel, or within `margin` [m] of a rim; return how many."""
    count = 0
    for i in active:
        is_inside = False
        for c in range(vessels.shape[0]):
            a, b, up = _local(vessels, c, x[i, 0], x[i, 1], x[i, 2])
            _, _, _, side, _, _ = _wall(vessels, c, np.sqrt(a * a + b * b), up)
            is_inside = is_inside or (side > 0.0 and 0.0 < up < vessels[c, TALL] - margin)
        if not is_inside:
            out[count] = i
            count += 1
    return count


@numba.njit(cache=True, error_model="numpy", inline="always")
def hidden(s):  # type: ignore[no-untyped-def]
    """Return the share of the kernel beyond a flat wall at `s` of its reach, and what it falls by."""
    w = max(1.0 - max(s, 0.0), 0.0)
    w4 = w * w * w * w
    return w4 * w * (1.5 - w), w4 * (7.5 - 6.0 * w)


@numba.njit(cache=True, error_model="numpy")
def feel_walls(x, active, near, vessels, h, feel) -> None:  # type: ignore[no-untyped-def]
    """Begin the density of each particle with what walls keep free of fluid."""
    for i in active:
        for k in range(FEELING):
            feel[i, k] = 0.0
        near[i] = NOWHERE
        for c in range(vessels.shape[0]):
            a, b, up = _local(vessels, c, x[i, 0], x[i, 1], x[i, 2])
            across = np.sqrt(a * a + b * b) + _LEAST
            wide = max(vessels[c, LOW], vessels[c, HIGH])
            if across > wide + h or up < -h or up > vessels[c, TALL] + h:
                continue
            near[i] = c
            d, nr, nz, _, over, _ = _wall(vessels, c, across, up)
            share, fall = hidden((d - vessels[c, HALF]) / h)
            fade = _NARROW * min(max(1.0 - 2.0 * over / h, 0.0), 1.0)
            density, gr, gz = fade * share, -fade * fall / h * nr, -fade * fall / h * nz
            if across < vessels[c, LOW]:
                share, fall = hidden((abs(up) - vessels[c, HALF]) / h)
                density += _NARROW * share
                gz -= np.copysign(_NARROW * fall / h, up)
            gx, gy, gz = _global(vessels, c, gr * a / across, gr * b / across, gz)
            feel[i, DENSITY] = density
            feel[i, WALL], feel[i, WALL + 1], feel[i, WALL + 2] = gx, gy, gz
            for k in range(3):
                feel[i, GRADIENT + k] = feel[i, WALL + k]


@numba.njit(cache=True, error_model="numpy", inline="always")
def _way_out(table, former, c, x, previous, i, radius):  # type: ignore[no-untyped-def]
    """Return how deep a particle is in a vessel's wall or bottom [m], and the way out in the vessel's frame.

    Whoever has come through the middle of a wall since the last small step is sent back: a wall of a few
    millimetres must not depend on how far a particle goes in a step.
    """
    a, b, up = _local(table, c, x[i, 0], x[i, 1], x[i, 2])
    across = np.sqrt(a * a + b * b) + _LEAST
    p, q, was_up = _local(former, c, previous[i, 0], previous[i, 1], previous[i, 2])
    was_across = np.sqrt(p * p + q * q) + _LEAST
    thick, low = table[c, HALF] + radius, table[c, LOW]
    d, nr, nz, side, _, along = _wall(table, c, across, up)
    _, _, _, was_side, _, was_along = _wall(table, c, was_across, was_up)
    depth = thick - d
    if side * was_side < 0.0:
        share = was_side / (was_side - side)
        at = was_along + share * (along - was_along)
        tall, slope = table[c, TALL], table[c, HIGH] - low
        length = np.sqrt(tall * tall + slope * slope)
        if 0.0 <= at <= length:
            away = np.copysign(1.0, was_side)
            nr, nz, depth = -away * tall / length, away * slope / length, thick + abs(side)
    if abs(up) < thick and across < low and thick - abs(up) > depth:
        nr, nz, depth = 0.0, np.copysign(1.0, up), thick - abs(up)
    if up * was_up < 0.0:
        share = was_up / (was_up - up)
        if was_across + share * (across - was_across) <= low:
            nr, nz, depth = 0.0, np.copysign(1.0, was_up), thick + abs(up)
    return depth, nr * a / across, nr * b / across, nz


@numba.njit(cache=True, error_model="numpy")
def contain(x, previous, active, tables, step) -> None:  # type: ignore[no-untyped-def]
    """Push particles out of walls; what has been in a wall before comes out without speed.

    Args:
        x: Positions, shape [n, 4].
        previous: Positions before the small step, shape [n, 3].
        active: The particles that there are.
        tables: `fluid_kernel.Vessels`.
        step: `fluid_kernel.Step`.
    """
    vessels, former, outcome = tables
    dt, pull = step.dt, step.mass / step.dt
    for i in active:
        for c in range(vessels.shape[0]):
            square = 0.0
            for k in range(3):
                square += (x[i, k] - vessels[c, PLACE + k]) ** 2
            if square > 4.0 * (vessels[c, HIGH] + vessels[c, TALL]) ** 2:
                continue
            for _ in range(2):  # in a corner there are two ways out
                depth, nx, ny, nz = _way_out(vessels, former, c, x, previous, i, step.radius)
                if depth <= 0.0:
                    break
                nx, ny, nz = _global(vessels, c, nx, ny, nz)
                ux, uy, uz = speed_at(vessels, c, x[i, 0], x[i, 1], x[i, 2])
                along = (
                    (x[i, 0] - previous[i, 0] - dt * ux) * nx
                    + (x[i, 1] - previous[i, 1] - dt * uy) * ny
                    + (x[i, 2] - previous[i, 2] - dt * uz) * nz
                )
                push = min(depth, max(-along, 0.0))
                quiet = depth - push
                jolt = -pull * push
                note(outcome, c, x[i, 0], x[i, 1], x[i, 2], jolt * nx, jolt * ny, jolt * nz)
                add(x, i, 0, depth * nx, depth * ny, depth * nz)
                add(previous, i, 0, quiet * nx, quiet * ny, quiet * nz)
