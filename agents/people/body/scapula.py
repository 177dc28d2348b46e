"""How the shoulder blade follows the arm: turned by the direction of the humerus in the frame of the collar.

Protraction, upward rotation and posterior tilt are those of the regression of J.H. de Groot & R. Brand 2001
(A three-dimensional regression model of the shoulder rhythm, Clin Biomech 16:735), with its slopes by
elevation and plane of elevation and a rest of 32, 11 and -10 degrees; figures as the open Delft shoulder
model quotes them. The plane has no meaning where the arm hangs, so each angle is instead a polynomial of
the humerus' direction, which has no singularity: least squares over 30 to 150 degrees of elevation from
the side to the front, at most 2.8 degrees off. Upward rotation begins slowly, gains 0.39 degrees a degree
between 30 and 150, and 58 of 180 in all: two to one.

The centre of the shoulder does not rise with the arm, as a person's does by 4 to 6 cm. So the bone has two
carriers of one rotation: the humerus sees a `scapula` that turns about the centre of the shoulder, and the
trunk a `blade` that turns about its middle, near where a person's does (from the root of its spine to the
acromion: S.D. Bagg & W.J. Forrest 1988, from memory; the place is our own choice).
"""

from __future__ import annotations

import numba
import numpy as np

from rcare_marl.pose import Array

# By rows: protraction, upward rotation, posterior tilt [rad]. Columns: constant; of the humerus' direction
# upwards and its cube; forwards less sideways.
ANGLES = (
    (0.5160, -0.0475, -0.0148, 0.1261),
    (0.6911, 0.3841, 0.1197, -0.0711),
    (0.1190, 0.1785, 0.0556, -0.0252),
)
_P, _U, _T = ANGLES
# From the shoulder to where the blade turns: sideways, up and forward [distances from collar to shoulder].
PIVOT = (-0.5, -0.1, -0.3)


def pivot(carrier: str, collar: Array, shoulder: Array) -> Array:
    """Return from the shoulder to where a carrier turns, in the frame of the collar [m], shape [3].

    Args:
        carrier: A scapula or a blade.
        collar, shoulder: Joint centres, in any posture [m], shape [3].
    """
    if not carrier.endswith("blade"):
        return np.zeros(3)
    side = 1.0 if carrier.startswith("left") else -1.0
    size = float(np.linalg.norm(shoulder - collar))
    return size * np.array((side * PIVOT[0], *PIVOT[1:]))


def scapula_angles(direction: Array) -> Array:
    """Return protraction, upward rotation and posterior tilt [rad], shape [3].

    Args:
        direction: Of the humerus: sideways, up and forward, a unit vector, shape [3].
    """
    side, up, front = direction
    return np.array(ANGLES) @ np.array((1.0, up, up**3, front - side))


@numba.njit(cache=True, error_model="numpy")
def _turned(protraction, upward, tilt, out) -> None:  # type: ignore[no-untyped-def]
    """Write the rotation of a left blade: about y, then its own z, then its own x."""
    sp, cp = np.sin(-protraction), np.cos(-protraction)
    su, cu = np.sin(upward), np.cos(upward)
    st, ct = np.sin(-tilt), np.cos(-tilt)
    out[0, 0], out[0, 1], out[0, 2] = cp * cu, -cp * su * ct + sp * st, cp * su * st + sp * ct
    out[1, 0], out[1, 1], out[1, 2] = su, cu * ct, -cu * st
    out[2, 0], out[2, 1], out[2, 2] = -sp * cu, sp * su * ct + cp * st, -sp * su * st + cp * ct


def _t_pose() -> Array:
    out, (protraction, upward, tilt) = np.zeros((3, 3)), scapula_angles(np.array((1.0, 0.0, 0.0)))
    _turned.py_func(protraction, upward, tilt, out)  # so that an import compiles nothing
    return out


T_POSE = _t_pose()  # of a left blade: its carrier's frame is that of the collar there


@numba.njit(cache=True, error_model="numpy")
def turn_scapula(side, x, y, z, turn, spin) -> None:  # type: ignore[no-untyped-def]
    """Write how a blade is turned, and how it turns with the humerus, in the frame of the collar.

    Args:
        side: 1 of the left, -1 of the right, which is its mirror image.
        x, y, z: Direction of the humerus, of length 1.
        turn: Rotation from the T-pose, shape [3, 3].
        spin: Angular velocity by that of the direction, shape [3, 3].
    """
    d = side * x
    square, aim = y * y, z - d
    protraction = _P[0] + y * (_P[1] + _P[2] * square) + _P[3] * aim
    upward = _U[0] + y * (_U[1] + _U[2] * square) + _U[3] * aim
    tilt = _T[0] + y * (_T[1] + _T[2] * square) + _T[3] * aim
    _turned(protraction, upward, tilt, spin)
    ax, ay, az = spin[0, 0], spin[1, 0], spin[2, 0]  # axis of tilt
    zx, zz = np.sin(-protraction), np.cos(-protraction)  # of upward rotation
    for a in range(3):
        for b in range(3):
            value = 0.0
            for c in range(3):
                value += spin[a, c] * T_POSE[b, c]
            # A mirror image turns the other way about y and z, and x is the other way.
            turn[a, b] = value if (a == 0) == (b == 0) else side * value
    by_up = (
        _P[1] + 3.0 * _P[2] * square,
        _U[1] + 3.0 * _U[2] * square,
        _T[1] + 3.0 * _T[2] * square,
    )
    for b in range(3):
        if b == 1:
            p, u, t = by_up
        elif b == 2:
            p, u, t = _P[3], _U[3], _T[3]
        else:
            p, u, t = -side * _P[3], -side * _U[3], -side * _T[3]
        spin[0, b] = u * zx - t * ax
        spin[1, b] = side * (-p - t * ay)
        spin[2, b] = side * (u * zz - t * az)
