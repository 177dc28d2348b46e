"""Hill curves against the reference values that OpenSim 4.6 prints (De Groote-Fregly 2016)."""

from collections.abc import Callable

import numpy as np
import pytest

from rcare_marl.agents.people.actuation import hill


def passive_curve(length: float, strain: float = hill.PASSIVE_STRAIN) -> tuple[float, float]:
    return hill.passive_curve(length, strain, hill.passive_offset(strain))


@pytest.mark.parametrize(
    ("curve", "points"),
    [
        (
            hill.active_curve,
            {
                0.5: 0.054112,
                0.7: 0.684233,
                0.9: 0.937123,
                1.0: 1.0,
                1.2: 0.793690,
                1.4: 0.380243,
                1.6: 0.124255,
            },
        ),
        (
            passive_curve,
            {
                0.5: 0.000565,
                0.7: 0.002391,
                0.9: 0.009316,
                1.0: 0.018229,
                1.2: 0.069401,
                1.4: 0.263532,
                1.6: 1.0,
            },
        ),
        (
            hill.speed_curve,
            {
                -1.0: 0.0,
                -0.5: 0.234036,
                -0.1: 0.745172,
                0.0: 1.0,
                0.1: 1.206509,
                0.5: 1.588423,
                1.0: 1.794343,
            },
        ),
        (
            hill.tendon_curve,
            {1.0: 0.0, 1.01: 0.088295, 1.02: 0.215569, 1.03: 0.399031, 1.04: 0.663486, 1.049: 1.0},
        ),
    ],
)
def test_curves_agree_with_the_reference_points(
    curve: Callable[[float], tuple[float, float]], points: dict[float, float]
) -> None:
    for at, value in points.items():
        assert curve(at)[0] == pytest.approx(value, abs=1e-6)


def test_passive_force_goes_on_straight_beyond_its_strain_and_is_capped() -> None:
    forces = [passive_curve(length)[0] for length in (1.6, 1.61, 1.62, 3.0)]
    assert forces[1] - forces[0] == pytest.approx(forces[2] - forces[1], rel=1e-9)
    assert forces[-1] == hill.PASSIVE_CAP
    assert passive_curve(1.8, 0.8)[0] == pytest.approx(1.0)


def test_slopes_are_the_derivatives_of_the_curves() -> None:
    step = 1e-6
    for curve in (hill.active_curve, hill.speed_curve, passive_curve, hill.tendon_curve):
        for x in (0.55, 0.83, 0.97):
            numeric = (curve(x + step)[0] - curve(x - step)[0]) / (2 * step)
            assert curve(x)[1] == pytest.approx(numeric, abs=1e-7)


def test_the_inverse_tendon_curve_inverts_it() -> None:
    forces = np.linspace(0, 2, 9)
    found = [hill.tendon_curve(float(x))[0] for x in hill.inverse_tendon_force(forces)]
    assert np.allclose(found, forces, atol=1e-12)


def after(activation: float, excitation: float, dt: float) -> float:
    times = hill.ACTIVATION_TIME, hill.DEACTIVATION_TIME
    return float(hill.next_activation(activation, excitation, dt, *times, hill.RESTING_ACTIVATION))


def test_activation_rises_and_falls_with_its_time_constants() -> None:
    rise, steps = 0.01, 400
    for _ in range(steps):
        rise = after(rise, 1.0, 0.1 / steps)
    fall = rise
    for _ in range(steps):
        fall = after(fall, 0.0, 0.1 / steps)
    assert rise == pytest.approx(1.0, abs=0.01)
    assert 0.01 <= fall < 0.15 < rise  # it falls more slowly than it rises
    assert after(0.01, 0.0, 10.0) == pytest.approx(0.01)


def test_activation_hardly_depends_on_the_step() -> None:
    def carried(steps: int) -> float:
        value = 0.01
        for _ in range(steps):
            value = after(value, 0.8, 0.024 / steps)
        return value

    fine = carried(2400)
    assert carried(24) == pytest.approx(fine, abs=0.001)
    assert carried(6) == pytest.approx(fine, abs=0.03)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="tendon's force"):
        hill.inverse_tendon_force(-1.0)
