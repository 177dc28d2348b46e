"""Muscles of many people at once: each as if alone, none disturbing another."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pytest

from rcare_marl.agents.people.actuation import muscle_kernel as kernel
from rcare_marl.agents.people.actuation.muscle_model import TENDONS, MuscleModel, Tendon
from rcare_marl.agents.people.validation.reference_muscles import muscle_model
from rcare_marl.errors import ActionError

Array = npt.NDArray[np.float64]
Inputs = tuple[Array, Array, Array, Array, Array]

DT = 1 / 240
PEOPLE = 5


@lru_cache
def model(tendon: Tendon = "quasi_static") -> MuscleModel:
    return muscle_model("karan", tendon)


def crowd(muscles: MuscleModel, people: int = PEOPLE) -> Inputs:
    """Return angles, rates, excitations, states and room for torques of different people."""
    rng = np.random.default_rng(3)
    q = rng.normal(0, 0.3, (people, len(muscles.dofs)))
    excitation = rng.uniform(0, 1, (people, len(muscles.names)))
    return q, rng.normal(0, 1, q.shape), excitation, muscles.new_states(people), np.zeros_like(q)


@pytest.mark.parametrize("tendon", TENDONS)
def test_each_of_many_people_is_as_if_alone(tendon: Tendon) -> None:
    muscles = model(tendon)
    q, qd, excitation, states, torques = crowd(muscles)
    alone, out = [muscles.new_state() for _ in q], np.zeros(q.shape[1])
    for _ in range(3):
        muscles.step_many(q, qd, excitation, states, DT, torques)
        for k in range(PEOPLE):
            muscles.step(q[k], qd[k], excitation[k], alone[k], DT, out)
            np.testing.assert_allclose(torques[k], out, rtol=1e-10, atol=1e-10)
            np.testing.assert_allclose(states[k], alone[k], rtol=1e-8, atol=1e-8)
        q = q + DT * qd
    assert np.abs(torques).max() > 10
    assert np.abs(torques[0] - torques[1]).max() > 1


def test_order_of_people_does_not_matter() -> None:
    muscles = model()
    q, qd, excitation, states, torques = crowd(muscles)
    muscles.step_many(q, qd, excitation, states, DT, torques)
    back = np.zeros_like(torques)
    q, qd, excitation = (np.ascontiguousarray(x[::-1]) for x in (q, qd, excitation))
    muscles.step_many(q, qd, excitation, muscles.new_states(PEOPLE), DT, back)
    np.testing.assert_array_equal(back[::-1], torques)


def test_batched_torques_are_virtual_work() -> None:
    muscles = model()
    q, qd, excitation, states, torques = crowd(muscles)
    muscles.step_many(q, qd, excitation, states, DT, torques)
    for k in range(PEOPLE):
        tension = states[k, kernel.ACTIVE] + states[k, kernel.PASSIVE]
        for dof in (0, 30, 60, 111):
            step = np.zeros(q.shape[1])
            step[dof] = 1e-6
            slope = (muscles.lengths(q[k] + step) - muscles.lengths(q[k] - step)) / 2e-6
            assert abs(torques[k, dof] + slope @ tension) < 1e-6


def test_nobody_at_all_is_no_work() -> None:
    muscles = model()
    q, excitation = np.zeros((0, 112)), np.zeros((0, len(muscles.names)))
    out = muscles.step_many(q, q, excitation, muscles.new_states(0), DT, np.zeros((0, 112)))
    assert out.shape == (0, 112)


def test_wrong_shapes_are_named() -> None:
    muscles = model()
    q, qd, excitation, states, torques = crowd(muscles)
    with pytest.raises(ActionError, match=r"excitation must have shape \(5, 324\), got \(5, 323\)"):
        muscles.step_many(q, qd, excitation[:, :-1], states, DT, torques)
    with pytest.raises(
        ActionError, match=r"state must have shape \(5, 9, 324\), got \(4, 9, 324\)"
    ):
        muscles.step_many(q, qd, excitation, states[:4], DT, torques)
    with pytest.raises(ActionError, match="out must have shape"):
        muscles.step_many(q, qd, excitation, states, DT, torques[:, :7])
