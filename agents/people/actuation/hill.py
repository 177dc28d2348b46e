"""The Hill muscle: a contractile element and a parallel elastic one in series with a tendon.

The curves are those of F. De Groote, A. L. Kinney, A. V. Rao & B. J. Fregly, "Evaluation of direct
collocation optimal control problem formulations for solving the muscle redundancy problem", Annals of
Biomedical Engineering 44(10), 2016, with the constants that OpenSim 4.6 prints. All of them are
normalised: lengths by optimal fibre length or tendon slack length, speed by ten optimal fibre lengths
a second, forces by the greatest isometric force. Activation follows D. G. Thelen, "Adjustment of
muscle mechanics model parameters to simulate dynamic contractions in older adults", 2003.

The force of a muscle is `F = F_max (a f_L(l) f_V(v) + f_PE(l) + beta v) cos(pennation)`, where fibres of
constant thickness turn as they shorten.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from rcare_marl.pose import Array

MAX_SPEED = 10.0  # [optimal fibre lengths/s] at which a fibre shortens without load
FIBRE_DAMPING = 0.01  # beta: of the fibre, a share of F_max at MAX_SPEED
DAMPING = (
    FIBRE_DAMPING / MAX_SPEED
)  # [F_max·s/optimal fibre length], whatever a unit's own greatest speed
PASSIVE_STRAIN = 0.6  # e_0: strain of the fibre at which passive force is F_max
PASSIVE_CAP = 2.0  # of F_max; the published exponential reaches 14 at twice the length
ACTIVATION_TIME, DEACTIVATION_TIME = 0.010, 0.040  # [s]; OpenSim's defaults, after Millard 2013
RESTING_ACTIVATION = 0.01

_B11, _B21, _B31, _B41 = 0.8150671134243542, 1.055033428970575, 0.162384573599574, 0.063303448465465
_B12, _B22, _B32, _B42 = 0.433004984392647, 0.716775413397760, -0.029947116970696, 0.200356847296188
_B13, _B23, _B33 = 0.1, 1.0, 0.353553390593274
_PER_B33 = 1.0 / _B33
_PASSIVE_SHAPE = 4.0  # k_PE
_PASSIVE_TOP = math.exp(_PASSIVE_SHAPE)
_PASSIVE_START = 0.2  # fibre length at which passive force is zero
_D2, _D3 = -8.149, -0.374
# d_1 and d_4 make f_V(-1) = 0 and f_V(0) = 1.
_AT_REST = math.log(_D3 + math.sqrt(_D3**2 + 1))
_D1 = 1.0 / (_AT_REST - math.log(_D3 - _D2 + math.sqrt((_D3 - _D2) ** 2 + 1)))
_D4 = 1.0 - _D1 * _AT_REST
_TENDON_C1, _TENDON_C2, _TENDON_C3 = 0.2, 1.0, 0.2
_TENDON_SHAPE = math.log((1 + _TENDON_C3) / _TENDON_C1) / 0.049  # F_max at 4.9 % strain

_LOG_2, _PER_LOG_2 = math.log(2.0), 1.0 / math.log(2.0)
_E2, _E3, _E4, _E5, _E6 = (1.0 / math.factorial(k) for k in range(2, 7))
_E7, _E8, _E9, _E10, _E11 = (1.0 / math.factorial(k) for k in range(7, 12))

SHORTEST = 0.02  # of the fibre along the tendon, in optimal lengths: a slack muscle


@numba.njit(cache=True, error_model="numpy", inline="always")
def _exp(x):  # type: ignore[no-untyped-def]
    """Return the exponential of x < 700 to 1e-14: unlike that of the C library the compiler can inline
    and vectorise it, 2^k by its bits and e^r by its series.
    """
    x = max(x, -700.0)
    k = math.floor(x * _PER_LOG_2 + 0.5)
    r = x - k * _LOG_2
    whole = np.int64((np.int64(k) + 1023) << 52).view(np.float64)
    r2 = r * r
    low = 1.0 + r + r2 * (_E2 + r * _E3 + r2 * (_E4 + r * _E5))
    high = _E6 + r * _E7 + r2 * (_E8 + r * _E9 + r2 * (_E10 + r * _E11))
    return whole * (low + r2 * r2 * r2 * high)


@numba.njit(cache=True, error_model="numpy", inline="always")
def active_curve(length):  # type: ignore[no-untyped-def]
    """Return f_L and its slope at a normalised fibre length."""
    s1, s2 = _B31 + _B41 * length, _B32 + _B42 * length
    i1, i2 = 1.0 / s1, 1.0 / s2
    z1, z2, z3 = (length - _B21) * i1, (length - _B22) * i2, (length - _B23) * _PER_B33
    g1 = _B11 * _exp(-0.5 * z1 * z1)
    g2 = _B12 * _exp(-0.5 * z2 * z2)
    g3 = _B13 * _exp(-0.5 * z3 * z3)
    slope = -g1 * z1 * (1 - z1 * _B41) * i1 - g2 * z2 * (1 - z2 * _B42) * i2 - g3 * z3 * _PER_B33
    return g1 + g2 + g3, slope


@numba.njit(cache=True, error_model="numpy", inline="always")
def speed_curve(speed):  # type: ignore[no-untyped-def]
    """Return f_V and its slope at a normalised fibre speed, positive where the fibre lengthens."""
    x = _D2 * speed + _D3
    root = math.sqrt(x * x + 1.0)
    return _D1 * math.log(x + root) + _D4, _D1 * _D2 / root


@numba.njit(cache=True, error_model="numpy", inline="always")
def passive_offset(strain):  # type: ignore[no-untyped-def]
    """Return what `passive_curve` subtracts so that a fibre of 0.2 optimal lengths is slack."""
    return math.exp(_PASSIVE_SHAPE * (_PASSIVE_START - 1.0) / strain)


@numba.njit(cache=True, error_model="numpy", inline="always")
def passive_curve(length, strain, offset):  # type: ignore[no-untyped-def]
    """Return f_PE and its slope at a normalised fibre length; `offset` is that of the strain."""
    scale = _PASSIVE_TOP - offset
    each = 1.0 / (strain * scale)
    if length <= 1.0 + strain:
        grown = _exp(_PASSIVE_SHAPE * (length - 1.0) * scale * each)
        return (grown - offset) * strain * each, grown * _PASSIVE_SHAPE * each
    slope = _PASSIVE_TOP * _PASSIVE_SHAPE * each
    force = 1.0 + slope * (length - 1.0 - strain)
    if force < PASSIVE_CAP:
        return force, slope
    return PASSIVE_CAP, 0.0


@numba.njit(cache=True, error_model="numpy", inline="always")
def tendon_curve(length):  # type: ignore[no-untyped-def]
    """Return f_T and its slope at a normalised tendon length."""
    grown = _TENDON_C1 * math.exp(_TENDON_SHAPE * (length - _TENDON_C2))
    return grown - _TENDON_C3, _TENDON_SHAPE * grown


@numba.njit(cache=True, error_model="numpy", inline="always")
def tendon_length(force):  # type: ignore[no-untyped-def]
    """Return the normalised tendon length at a normalised tendon force: the inverse of f_T."""
    return _TENDON_C2 + math.log((force + _TENDON_C3) / _TENDON_C1) / _TENDON_SHAPE


@numba.njit(cache=True, error_model="numpy", inline="always")
def next_activation(activation, excitation, dt, rise, fall, least):  # type: ignore[no-untyped-def]
    """Return the activation after `dt` [s]: an exact exponential with the midpoint's time constant."""
    wanted = max(excitation, least)
    span = 1.0 - least
    each = 1.0 / span
    now, end = (activation - least) * each, (wanted - least) * each
    step = end - now
    pace = 0.5 + 1.5 * now
    rate = 1.0 / (rise * pace) if step > 0.0 else pace / fall
    pace = 0.5 + 1.5 * (now + step * (1.0 - _exp(-0.5 * dt * rate)))
    rate = 1.0 / (rise * pace) if step > 0.0 else pace / fall
    return least + span * (now + step * (1.0 - _exp(-dt * rate)))


def inverse_tendon_force(force: npt.ArrayLike) -> Array:
    """Return the tendon length [slack lengths] at a tendon force [of F_max].

    Raises:
        ValueError: If a force is -0.2 or less, which no tendon has.
    """
    forces = np.asarray(force, np.float64)
    if (forces <= -_TENDON_C3).any():
        raise ValueError(f"a tendon's force is more than {-_TENDON_C3} F_max, got {forces.min()}")
    return np.vectorize(tendon_length, otypes="d")(forces)
