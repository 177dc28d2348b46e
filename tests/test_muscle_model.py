"""Muscles without physics engine: lengths, moment arms, tension, torques."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from variants import every

from rcare_marl.agents.agent import Array
from rcare_marl.agents.people.actuation import muscle_kernel as kernel
from rcare_marl.agents.people.actuation.drive import fitted_musculature
from rcare_marl.agents.people.actuation.hill import (
    active_curve,
    inverse_tendon_force,
    passive_curve,
    passive_offset,
)
from rcare_marl.agents.people.actuation.muscle_model import TENDONS, MuscleModel, Tendon
from rcare_marl.agents.people.avatar import AvatarConfig, body_model, body_segments, load_avatar
from rcare_marl.agents.people.body.person_tree import person_tree
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS
from rcare_marl.errors import ActionError, ConfigError, UnknownNameError

AVATARS = ("caregiver", "daniel", "jose", "karan", "kim", "morgan", "natalia")
ALL_DOFS = [dof.name for dof in DOFS]


def muscle_model(
    avatar: AvatarConfig, *, movable: Sequence[str] = ALL_DOFS, tendon: Any = "quasi_static"
) -> MuscleModel:
    path = avatar.body_path()
    joints = body_model(path, avatar.height_m).joints
    segments = body_segments(path, avatar.height_m, avatar.mass_kg, avatar.sex)
    chain = person_tree(segments, joints, np.zeros(len(DOFS)), movable)
    return MuscleModel(fitted_musculature(avatar, None).units, joints, chain, tendon=tendon)


def in_range(avatar: AvatarConfig, rng: np.random.Generator) -> Array:
    limits = avatar.profile.limits("passive")
    low, high = np.array([limits[name] for name in ALL_DOFS]).T
    return rng.uniform(low, high)


# --- the model -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", every(3, AVATARS))
def test_torques_are_the_virtual_work_of_tension_over_length(name: str) -> None:
    avatar = load_avatar(name)
    model, step = muscle_model(avatar), 1e-4
    q = in_range(avatar, np.random.default_rng(3))
    forces = model.isometric_forces(q, 0.7)
    torques = model.isometric_torques(q, 0.7)
    for i in range(len(q)):
        e = np.zeros(len(q))
        e[i] = step
        near = model.lengths(q + e) - model.lengths(q - e)
        far = model.lengths(q + 2 * e) - model.lengths(q - 2 * e)
        slope = (8 * near - far) / (12 * step)
        assert torques[i] == pytest.approx(-slope @ forces, abs=1e-6), ALL_DOFS[i]


def test_lengths_are_the_same_where_fixed_joints_have_melted() -> None:
    avatar = load_avatar("karan")
    whole, arm = muscle_model(avatar), ["right_shoulder_flexion", "right_elbow_flexion"]
    melted = muscle_model(avatar, movable=[n for n in ALL_DOFS if n in arm])
    q = np.zeros(len(DOFS))
    q[[DOF_INDEX[n] for n in arm]] = 0.4, 1.1
    assert np.allclose(whole.lengths(q), melted.lengths(np.array([0.4, 1.1])), atol=1e-12)
    columns = [DOF_INDEX[n] for n in arm]
    assert np.allclose(whole.moment_arms(q)[:, columns], melted.moment_arms(np.array([0.4, 1.1])))


def test_isometric_tension_balances_fibre_and_tendon() -> None:
    model = muscle_model(load_avatar("karan"))
    q = np.zeros(len(DOFS))
    for activation in (0.0, 0.4, 1.0):
        tension = model.isometric_forces(q, activation)
        fibre = model.fibre_lengths(q, activation)
        table = model.table
        cosine = np.sqrt(1 - (table[:, kernel.PENNATION_SINE] / fibre) ** 2)
        passive = np.array(
            [
                passive_curve(x, s, passive_offset(s))[0]
                for x, s in zip(fibre, table[:, kernel.STRAIN], strict=True)
            ]
        )
        active = activation * np.array([active_curve(x)[0] for x in fibre])
        pulled = table[:, kernel.FORCE] * cosine * (active + passive)
        slack = fibre * cosine <= 0.021  # too short to pull: the fibre is not in balance
        assert np.allclose(pulled[~slack], tension[~slack], rtol=1e-6, atol=1e-3)


@pytest.mark.parametrize("tendon", TENDONS)
def test_a_step_at_rest_settles_on_the_isometric_tension(tendon: Tendon) -> None:
    model = muscle_model(load_avatar("karan"), tendon=tendon)
    q, still = np.zeros(len(DOFS)), np.zeros(len(DOFS))
    excitation, state, out = np.full(len(model.units), 0.5), model.settled_state(q), still.copy()
    for _ in range(800):
        model.step(q, still, excitation, state, 1 / 240, out)
    tension = state[kernel.ACTIVE] + state[kernel.PASSIVE]
    wanted = model.isometric_forces(q, 0.5)
    assert np.abs(tension - wanted).max() < 1e-3 * wanted.max()
    assert np.allclose(out, model.moment_arms(q).T @ tension, atol=1e-9)


def test_many_people_are_each_like_one() -> None:
    model, rng = muscle_model(load_avatar("kim")), np.random.default_rng(5)
    count, n, m = 3, len(DOFS), len(model.units)
    q = np.array([in_range(load_avatar("kim"), rng) for _ in range(count)])
    qd, excitation = rng.normal(size=(count, n)), rng.uniform(size=(count, m))
    states = np.stack([model.new_state()] * count)
    many = model.step_many(q, qd, excitation, states, 0.004, np.zeros((count, n)))
    for k in range(count):
        one = model.step(q[k], qd[k], excitation[k], model.new_state(), 0.004, np.zeros(n))
        assert np.array_equal(one, many[k])


def test_a_model_refuses_what_cannot_be() -> None:
    avatar = load_avatar("karan")
    model = muscle_model(avatar)
    with pytest.raises(UnknownNameError, match="Did you mean 'soleus_l'"):
        model.index("soleus_left")
    with pytest.raises(ActionError, match="excitations lie in \\[0, 1\\]"):
        model.isometric_forces(np.zeros(len(DOFS)), 1.5)
    with pytest.raises(ConfigError, match="must have shape"):
        model.lengths(np.zeros(3))
    with pytest.raises(UnknownNameError, match="rigid"):
        muscle_model(avatar, tendon="stiff")


@pytest.mark.parametrize(
    ("length", "active", "passive"),
    [
        (0.5, 0.054112, 0.000565),
        (0.7, 0.684233, 0.002391),
        (0.9, 0.937123, 0.009316),
        (1.0, 1.0, 0.018229),
        (1.2, 0.793690, 0.069401),
        (1.4, 0.380243, 0.263532),
    ],
)
@pytest.mark.parametrize("activation", [0.0, 0.3, 1.0])
def test_isometric_force_agrees_with_the_reference_points(
    length: float, active: float, passive: float, activation: float
) -> None:
    """A muscle of 1 N held still, its tendon rigid or in balance with it; figures of OpenSim 4.6."""
    units = np.zeros((1, kernel.UNIT_COLUMNS))
    units[0, [kernel.FORCE, kernel.FIBRE, kernel.SLACK, kernel.STRAIN]] = 1.0, 0.1, 0.2, 0.6
    units[0, [kernel.OFFSET, kernel.SPEED]] = passive_offset(0.6), 10.0
    wanted = activation * active + passive
    state = np.zeros((kernel.STATE_ROWS, 1))
    state[kernel.ACTIVATION] = activation
    state[kernel.LENGTH] = 0.2 + 0.1 * length
    kernel.pull(units, state, 0.0, kernel.RIGID)
    assert state[kernel.ACTIVE, 0] + state[kernel.PASSIVE, 0] == pytest.approx(wanted, abs=1e-6)
    # With an elastic tendon the fibre has that length where the tendon is longer by its strain.
    state[kernel.LENGTH] = 0.2 * inverse_tendon_force(wanted) + 0.1 * length
    state[kernel.TENDON] = wanted
    kernel.pull(units, state, 0.0, kernel.QUASI_STATIC)
    assert state[kernel.ACTIVE, 0] + state[kernel.PASSIVE, 0] == pytest.approx(wanted, abs=2e-6)
