"""Kinematics of a serial chain: tool pose, Jacobian, gravity and inverse kinematics, compiled.

No physics state is touched: a chain is built from a model's data. Everything is in the world frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, quaternion_from_matrix, rotate
from rcare_marl.urdf import Joint, Model, joint_pose

GRAVITY = 9.81  # [m/s²]
DAMPING = 0.02  # of the least squares; keeps steps small near singular postures


@dataclass(frozen=True)
class IkResult:
    """What inverse kinematics found.

    Attributes:
        posture: Joint positions [rad or m], shape [n].
        distance: What is left of the position error [m].
        angle: What is left of the orientation error [rad].
    """

    posture: Array
    distance: float
    angle: float

    def is_within(self, distance: float = 1e-3, angle: float = 0.01) -> bool:
        """Return whether both errors are small enough."""
        return self.distance <= distance and self.angle <= angle


class Chain:
    """The joints from the root of a model to one link, with all mass that they carry.

    Attributes:
        joints: Names of the joints that move the chain, root first.
        telescope: Names of the sliding joints on the way that follow one of them.
        lags: Mass of a telescope's segments times the share of the tip's way that they stay behind,
            by joint [kg], shape [n].
    """

    def __init__(
        self,
        model: Model,
        joints: Sequence[str],
        tip: str,
        *,
        others: Mapping[str, float] | None = None,
        root: str | None = None,
    ) -> None:
        """Collect the chain.

        Args:
            model: The robot.
            joints: The joints that move, root first; all other joints count as frozen.
            tip: The link at the end.
            others: Positions of frozen joints [rad or m]; zero where not named.
            root: Link that the chain starts from; the model's root if None.

        Raises:
            ConfigError: If a joint is not on the way from the root to `tip`, or one there follows
                another in a way that is no telescope.
        """
        self.joints = tuple(joints)
        frozen = dict(others or {})
        carried_by = {joint.child: (name, joint) for name, joint in model.joints.items()}
        path: list[tuple[str, Joint]] = []
        link = tip
        while link in carried_by and link != root:
            path.insert(0, carried_by[link])
            link = path[0][1].parent
        on_path = [name for name, _ in path if name in self.joints]
        if on_path != list(self.joints):
            raise ConfigError(f"joints {joints} do not lie, in order, between the root and {tip!r}")
        moving = [model.joints[name] for name in self.joints]
        axes = np.array([j.axis for j in moving], np.float64).reshape(-1, 3)
        self.axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        self.slides = np.array([j.kind == "prismatic" for j in moving])
        origins, here = [], Pose()
        telescope: dict[str, float] = {}  # how much farther each segment goes than the one before
        lengths = np.ones(len(moving))
        for name, joint in path:
            if name in self.joints:
                origins.append((here @ joint_pose(joint)).matrix()[:3])
                here = Pose()
            elif joint.follows is not None and joint.follows.joint in self.joints:
                longer = self._lengthening(name, joint, here, len(origins) - 1)
                lengths[len(origins) - 1] += longer
                telescope[name] = longer
                here = here @ joint_pose(joint, joint.follows.offset)
            else:
                here = here @ joint_pose(joint, frozen.get(name, 0.0))
        origins.append(here.matrix()[:3])
        self.origins = np.ascontiguousarray(origins)
        self.axes *= lengths[:, None]  # a telescope moves its tip by several times its first joint
        self.telescope = telescope
        self.masses, self.centres, self.lags = self._carried(model, frozen, lengths)
        self.base = Pose().matrix()[:3]

    def _lengthening(self, name: str, joint: Joint, here: Pose, last: int) -> float:
        """Return how far the tip moves by a follower for each metre of its leader, joint `last`."""
        assert joint.follows is not None
        along = rotate((here @ joint_pose(joint)).quaternion, joint.axis)
        is_last = last >= 0 and self.joints[last] == joint.follows.joint
        if not (is_last and self.slides[last] and joint.kind == "prismatic"):
            raise ConfigError(
                f"joint {name!r} follows {joint.follows.joint!r} on the way to the tool: only sliding "
                "joints that directly follow a sliding one can, as in a telescope"
            )
        if joint.follows.offset != 0 or joint.follows.multiplier == 0:
            raise ConfigError(f"joint {name!r} of a telescope needs a multiplier and no offset")
        scale = float(np.dot(along, self.axes[last]) / np.linalg.norm(joint.axis))
        if abs(abs(scale) - 1) > 1e-6:
            raise ConfigError(f"joint {name!r} is not parallel to {joint.follows.joint!r}")
        return joint.follows.multiplier * scale

    def _carried(
        self, model: Model, frozen: Mapping[str, float], lengths: Array
    ) -> tuple[Array, Array, Array]:
        """Return mass [kg] and centre [m] of what each joint carries, in its child, and `lags` [kg].

        The centre is that of a telescope pushed together, whose segments lag behind from there.
        """
        # What carries each link, where it is in that, and how far it goes for a metre of that.
        place: dict[str, tuple[int, Pose, float]] = {model.root: (-1, Pose(), 1.0)}
        masses, moments = np.zeros(len(self.joints)), np.zeros((len(self.joints), 3))
        lags = np.zeros(len(self.joints))
        for name, joint in model.joints.items():  # parents come before children
            holder, pose, way = place[joint.parent]
            if name in self.joints:
                holder, pose, way = self.joints.index(name), Pose(), 1.0
            else:
                start = 0.0 if name in self.telescope else frozen.get(name, 0.0)
                pose, way = pose @ joint_pose(joint, start), way + self.telescope.get(name, 0.0)
            place[joint.child] = (holder, pose, way)
            if holder >= 0:
                link = model.links[joint.child]
                masses[holder] += link.mass
                moments[holder] += link.mass * np.asarray((pose @ Pose(link.com)).position)
                lags[holder] += link.mass * (1 - way / lengths[holder])
        return masses, moments / np.maximum(masses, 1e-12)[:, None], lags

    def place(self, base: Pose) -> None:
        """Put the root link at `base` in the world."""
        self.base = np.ascontiguousarray(base.matrix()[:3])

    def tip_pose(self, positions: Array) -> Pose:
        """Return the pose of the tip at joint `positions` [rad or m], shape [n]."""
        tip, _, _, _ = forward(self.base, self.origins, self.axes, self.slides, positions)
        return Pose(tuple(tip[:, 3].tolist()), tuple(quaternion_from_matrix(tip[:, :3]).tolist()))

    def jacobian(self, positions: Array) -> Array:
        """Return the geometric Jacobian of the tip, three linear rows first, shape [6, n]."""
        parts = forward(self.base, self.origins, self.axes, self.slides, positions)
        out: Array = jacobian(parts[0], parts[1], parts[2], self.slides)
        return out

    def gravity_torques(self, positions: Array) -> Array:
        """Return the torques that hold the chain still [N·m or N], shape [n]."""
        parts = forward(self.base, self.origins, self.axes, self.slides, positions)
        out: Array = holding(
            parts[1], parts[2], parts[3], self.slides, self.masses, self.centres, self.lags
        )
        return out

    def solve(
        self,
        goal: Pose,
        seed: Array,
        lower: Array,
        upper: Array,
        *,
        rest: Array | None = None,
        turn_weight: float = 1.0,
        iterations: int = 60,
    ) -> IkResult:
        """Move the tip to `goal` from the posture `seed` by damped least squares within limits.

        Args:
            goal: Pose of the tip in the world.
            seed: Where the search starts, shape [n].
            lower: Lower limits, shape [n].
            upper: Upper limits, shape [n].
            rest: Posture preferred where the goal leaves a choice; the seed if None.
            turn_weight: Weight of a radian against a metre; zero ignores orientation.
            iterations: Greatest number of steps.
        """
        posture, distance, angle = _solve(
            self.base,
            self.origins,
            self.axes,
            self.slides,
            np.ascontiguousarray(goal.matrix()[:3]),
            np.asarray(seed, np.float64),
            lower,
            upper,
            np.asarray(seed if rest is None else rest, np.float64),
            turn_weight,
            iterations,
        )
        return IkResult(posture, distance, angle)


@numba.njit(cache=True)
def forward(base, origins, axes, slides, q):  # type: ignore[no-untyped-def]
    """Return tip frame [3, 4], joint points [n, 3], joint axes [n, 3], joint frames [n, 3, 4]."""
    n = len(q)
    points, directions = np.empty((n, 3)), np.empty((n, 3))
    frames = np.empty((n, 3, 4))
    now, moved = base.copy(), np.empty((3, 4))
    for i in range(n):
        _compose(now, origins[i], moved)
        for r in range(3):
            points[i, r] = moved[r, 3]
            directions[i, r] = (
                moved[r, 0] * axes[i, 0] + moved[r, 1] * axes[i, 1] + moved[r, 2] * axes[i, 2]
            )
        if slides[i]:
            now[:] = moved
            for r in range(3):
                now[r, 3] += directions[i, r] * q[i]
        else:
            _turn_about(moved, axes[i], q[i], now)
        frames[i] = now
    _compose(now, origins[n], moved)
    return moved, points, directions, frames


@numba.njit(cache=True)
def jacobian(tip, points, directions, slides):  # type: ignore[no-untyped-def]
    """Return the geometric Jacobian [6, n] from what `forward` returns."""
    n = len(points)
    out = np.zeros((6, n))
    for i in range(n):
        d = directions[i]
        if slides[i]:
            out[:3, i] = d
            continue
        x, y, z = tip[0, 3] - points[i, 0], tip[1, 3] - points[i, 1], tip[2, 3] - points[i, 2]
        out[0, i] = d[1] * z - d[2] * y
        out[1, i] = d[2] * x - d[0] * z
        out[2, i] = d[0] * y - d[1] * x
        out[3:, i] = d
    return out


@numba.njit(cache=True)
def holding(points, directions, frames, slides, masses, centres, lags):  # type: ignore[no-untyped-def]
    """Return the joint torques [n] that balance gravity, from what `forward` returns.

    They are the slopes of the potential energy along the joints.
    """
    n = len(points)
    out = np.zeros(n)
    mass, mx, my = 0.0, 0.0, 0.0  # of all that joint i carries
    for i in range(n - 1, -1, -1):
        f, c, m = frames[i], centres[i], masses[i]
        mass += m
        mx += m * (f[0, 0] * c[0] + f[0, 1] * c[1] + f[0, 2] * c[2] + f[0, 3])
        my += m * (f[1, 0] * c[0] + f[1, 1] * c[1] + f[1, 2] * c[2] + f[1, 3])
        d, p = directions[i], points[i]
        if slides[i]:
            # The segments of a telescope stay behind its tip.
            mx -= lags[i] * (f[0, 3] - p[0])
            my -= lags[i] * (f[1, 3] - p[1])
            out[i] = GRAVITY * (mass - lags[i]) * d[2]
        else:
            out[i] = GRAVITY * (d[0] * (my - mass * p[1]) - d[1] * (mx - mass * p[0]))
    return out


@numba.njit(cache=True)
def _compose(a, b, out):  # type: ignore[no-untyped-def]
    for r in range(3):
        for c in range(4):
            value = a[r, 0] * b[0, c] + a[r, 1] * b[1, c] + a[r, 2] * b[2, c]
            out[r, c] = value + (a[r, 3] if c == 3 else 0.0)


@numba.njit(cache=True)
def _turn_about(frame, axis, angle, out):  # type: ignore[no-untyped-def]
    """Write `frame` turned by `angle` about its own `axis` into `out`."""
    x, y, z = axis
    s, c = math.sin(angle), math.cos(angle)
    k = 1 - c
    turn = np.zeros((3, 4))
    turn[0, 0], turn[0, 1], turn[0, 2] = c + k * x * x, k * x * y - s * z, k * x * z + s * y
    turn[1, 0], turn[1, 1], turn[1, 2] = k * x * y + s * z, c + k * y * y, k * y * z - s * x
    turn[2, 0], turn[2, 1], turn[2, 2] = k * x * z - s * y, k * y * z + s * x, c + k * z * z
    _compose(frame, turn, out)


@numba.njit(cache=True)
def rotation_between(a, b):  # type: ignore[no-untyped-def]
    """Return the rotation vector [3] that turns the axes of frame `a` into those of `b`."""
    rotation = np.zeros((3, 3))
    for r in range(3):
        for c in range(3):
            rotation[r, c] = b[r, 0] * a[c, 0] + b[r, 1] * a[c, 1] + b[r, 2] * a[c, 2]
    out = np.array(
        (
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        )
    )
    sine = 0.5 * math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    cosine = 0.5 * (rotation[0, 0] + rotation[1, 1] + rotation[2, 2] - 1)
    if sine < 1e-9:
        if cosine > 0:
            return 0.5 * out
        axis = np.zeros(3)  # a half turn: any column of R + 1 lies along the axis
        k = np.argmax(np.diag(rotation))
        axis[:] = rotation[:, k]
        axis[k] += 1
        return math.pi * axis / math.sqrt((axis**2).sum())
    return out * (0.5 * math.atan2(sine, cosine) / sine)


@numba.njit(cache=True)
def rotated(frame, vector, out):  # type: ignore[no-untyped-def]
    """Write `frame` turned in place about the world `vector` [rad] into `out`; the origin stays."""
    angle = math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    position = frame[:, 3].copy()
    if angle < 1e-12:
        out[:] = frame
        return
    turn = np.zeros((3, 4))
    turn[0, 0], turn[1, 1], turn[2, 2] = 1.0, 1.0, 1.0
    full = np.zeros((3, 4))
    _turn_about(turn, vector / angle, angle, full)
    turn[:, :3] = frame[:, :3]
    _compose(full, turn, out)
    out[:, 3] = position


@numba.njit(cache=True)
def least_squares(matrix, wanted, free, damping):  # type: ignore[no-untyped-def]
    """Return x [n] of least |matrix x - wanted|² + damping² |x|², zero where not `free`."""
    rows, n = matrix.shape
    a = np.zeros((rows, rows))
    for i in range(rows):
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                if free[k]:
                    total += matrix[i, k] * matrix[j, k]
            a[i, j] = total
        a[i, i] += damping * damping
    for i in range(rows):  # Cholesky, in place
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            a[i, j] = math.sqrt(max(total, 1e-14)) if i == j else total / a[j, j]
    y = wanted.copy()
    for i in range(rows):
        for k in range(i):
            y[i] -= a[i, k] * y[k]
        y[i] /= a[i, i]
    for i in range(rows - 1, -1, -1):
        for k in range(i + 1, rows):
            y[i] -= a[k, i] * y[k]
        y[i] /= a[i, i]
    x = np.zeros(n)
    for k in range(n):
        if free[k]:
            for i in range(rows):
                x[k] += matrix[i, k] * y[i]
    return x


@numba.njit(cache=True)
def bounded_step(matrix, wanted, q, lower, upper, pull, damping):  # type: ignore[no-untyped-def]
    """Return a joint step [n] towards `wanted` [6] that stays within limits.

    A joint that would leave its limits goes onto the limit and the others are solved again. `pull`
    [n] is a wish for the joints, honoured as far as it does not move the tool.
    """
    n = len(q)
    step, free = np.zeros(n), np.ones(n, np.bool_)
    rest = wanted.copy()
    for _ in range(n):
        step_free = least_squares(matrix, rest - matrix @ np.where(free, pull, 0.0), free, damping)
        blocked = False
        for i in range(n):
            if not free[i]:
                continue
            step[i] = step_free[i] + pull[i]
            bounded = min(max(step[i], lower[i] - q[i]), upper[i] - q[i])
            if bounded != step[i]:
                step[i], free[i], blocked = bounded, False, True
                for r in range(6):
                    rest[r] -= matrix[r, i] * bounded
        if not blocked:
            break
    return step


@numba.njit(cache=True)
def _solve(  # type: ignore[no-untyped-def]
    base, origins, axes, slides, goal, seed, lower, upper, rest, turn_weight, iterations
):
    q = np.minimum(np.maximum(seed, lower), upper)
    error = np.zeros(6)
    distance, angle = 0.0, 0.0
    for k in range(iterations + 1):
        tip, points, directions, _ = forward(base, origins, axes, slides, q)
        error[:3] = goal[:, 3] - tip[:, 3]
        error[3:] = rotation_between(tip, goal)
        distance = math.sqrt((error[:3] ** 2).sum())
        angle = math.sqrt((error[3:] ** 2).sum())
        if (distance < 1e-5 and turn_weight * angle < 1e-4) or k == iterations:
            break
        scale = min(1.0, 0.15 / max(distance, 1e-9), 0.5 / max(angle * turn_weight, 1e-9))
        matrix = jacobian(tip, points, directions, slides)
        matrix[3:] *= turn_weight
        wanted = error * scale
        wanted[3:] *= turn_weight
        pull = 0.05 * (rest - q) if k < iterations // 2 else np.zeros(len(q))
        # Far away the damping calms, close by it would only slow the last steps down.
        damping = DAMPING if distance + angle > 0.1 else 0.1 * DAMPING
        q = q + bounded_step(matrix, wanted, q, lower, upper, pull, damping)
    return q, distance, angle
