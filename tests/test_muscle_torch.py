"""Muscles in torch: the same numbers as the kernel, gradients that are true, any device."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pytest
import torch
from variants import few

from rcare_marl.agents.people.actuation import muscle_kernel as kernel
from rcare_marl.agents.people.actuation import muscle_torch
from rcare_marl.agents.people.actuation.drive import fitted_musculature
from rcare_marl.agents.people.actuation.hill import (
    active_curve,
    inverse_tendon_force,
    passive_curve,
    passive_offset,
    speed_curve,
    tendon_curve,
)
from rcare_marl.agents.people.actuation.muscle_layout import crossing
from rcare_marl.agents.people.actuation.muscle_model import TENDONS, MuscleModel, Tendon
from rcare_marl.agents.people.actuation.muscle_torch import TorchMuscles, TorchState
from rcare_marl.agents.people.avatar import body_model, body_segments, expand_movable, load_avatar
from rcare_marl.agents.people.body.person_tree import person_tree
from rcare_marl.agents.people.body.skeleton import DOFS
from rcare_marl.errors import ActionError

Array = npt.NDArray[np.float64]

DT = 1 / 240
AGREEMENT = 1e-9  # of the greatest torque
ARM = ("right_shoulder", "right_elbow", "right_wrist")


@lru_cache
def model(
    name: str = "morgan",
    movable: tuple[str, ...] | None = None,
    tendon: Tendon = "quasi_static",
    most: int | None = None,
) -> tuple[MuscleModel, Array]:
    """Return the muscles of an avatar, or `most` of them, and the passive range of the DoFs."""
    avatar = load_avatar(name)
    path = avatar.body_path()
    names = expand_movable(movable)
    joints = body_model(path, avatar.height_m).joints
    segments = body_segments(path, avatar.height_m, avatar.mass_kg, avatar.sex)
    chain = person_tree(segments, joints, np.zeros(len(DOFS)), names)
    muscles = fitted_musculature(avatar, None)
    units = [muscles.units[m] for m in crossing(muscles.units, chain)][:most]
    share = np.linspace(0.3, 1.0, len(units))
    made = MuscleModel(units, muscles.joints, chain, tendon=tendon, strength=share)
    made.table[::3, kernel.REFLEX_GAIN] = 0.5
    made.table[::3, kernel.REFLEX_THRESHOLD] = 0.1
    ranges = avatar.profile.limits("passive")
    return made, np.array([ranges[dof] for dof in names])


def inputs(
    muscles: MuscleModel, ranges: Array, people: int, seed: int
) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    q = rng.uniform(ranges[:, 0], ranges[:, 1], (people, len(ranges)))
    qd = rng.normal(0, 2, q.shape)
    return q, qd, rng.uniform(0, 1, (people, len(muscles.names)))


def tensors(
    q: Array,
    qd: Array,
    excitation: Array,
    *,
    dtype: torch.dtype = torch.float64,
    device: str = "cpu",
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return q, qd and excitation as `step` wants them."""
    a, b, c = (torch.tensor(x, dtype=dtype, device=device) for x in (q, qd, excitation))
    return a, b, c


def test_curves_are_those_of_the_kernel() -> None:
    x = np.linspace(0.2, 2.2, 101)
    at = torch.tensor(x)
    passive = [passive_curve(v, 0.55, passive_offset(0.55))[0] for v in x]
    pairs: list[tuple[torch.Tensor, npt.ArrayLike]] = [
        (muscle_torch.force_length(at), [active_curve(v)[0] for v in x]),
        (muscle_torch.force_velocity(at - 1.2), [speed_curve(v - 1.2)[0] for v in x]),
        (muscle_torch.passive_force(at, torch.full_like(at, 0.55)), passive),
        (muscle_torch.tendon_force(at), [tendon_curve(v)[0] for v in x]),
        (muscle_torch.tendon_length(at), inverse_tendon_force(x)),
    ]
    for ours, theirs in pairs:
        np.testing.assert_allclose(ours.numpy(), np.array(theirs), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("tendon", TENDONS)
@pytest.mark.parametrize("name", few(["karan", "daniel", "natalia"], "daniel"))
def test_torques_and_states_agree_with_the_kernel(name: str, tendon: Tendon) -> None:
    muscles, ranges = model(name, tendon=tendon)
    people = 3
    q, qd, _ = inputs(muscles, ranges, people, 1)
    theirs, out = np.repeat(muscles.new_state()[None], people, 0), np.zeros_like(q)
    ours = TorchMuscles(muscles)
    state = ours.new_state(people)
    for step in range(4):
        excitation = inputs(muscles, ranges, people, 2 + step)[2]
        muscles.step_many(q, qd, excitation, theirs, DT, out)
        with torch.no_grad():
            torques, state = ours.step(*tensors(q, qd, excitation), state, DT)
        assert np.abs(out).max() > 10
        assert np.abs(torques.numpy() - out).max() <= AGREEMENT * np.abs(out).max()
        strongest = muscles.table[:, kernel.FORCE].max()
        for mine, row, scale in (
            (state.activation, kernel.ACTIVATION, 1.0),
            (state.tendon, kernel.TENDON, 1.0),
            (state.active, kernel.ACTIVE, strongest),
            (state.passive, kernel.PASSIVE, strongest),
        ):
            assert np.abs(mine.numpy() - theirs[:, row]).max() <= AGREEMENT * scale
        q = q + DT * qd


def test_lengths_and_moment_arms_agree_with_the_kernel() -> None:
    muscles, ranges = model()
    q = inputs(muscles, ranges, 3, 5)[0]
    ours = TorchMuscles(muscles)
    for person, (lengths, arms) in zip(
        q,
        zip(ours.lengths(torch.tensor(q)), ours.moment_arms(torch.tensor(q)), strict=True),
        strict=True,
    ):
        np.testing.assert_allclose(lengths.numpy(), muscles.lengths(person), atol=1e-13)
        np.testing.assert_allclose(arms.numpy(), muscles.moment_arms(person), atol=1e-13)


def test_moment_arms_are_the_gradient_of_length() -> None:
    muscles, ranges = model("karan")
    ours = TorchMuscles(muscles)
    q = torch.tensor(inputs(muscles, ranges, 1, 6)[0], requires_grad=True)
    arms, lengths = ours.moment_arms(q)[0], ours.lengths(q)[0]
    for m in range(0, len(muscles.names), 40):
        (slope,) = torch.autograd.grad(lengths[m], q, retain_graph=True)
        np.testing.assert_allclose(-slope[0].numpy(), arms[m].detach().numpy(), atol=1e-12)


def _bent(ranges: Array) -> Array:
    """Return a posture in the middle of the range, where nothing is clamped or slack."""
    return ranges.mean(axis=1)[None] + np.linspace(-0.1, 0.1, len(ranges))


@pytest.mark.parametrize(
    ("tendon", "wanted"),
    [
        pytest.param(
            tendon,
            wanted,  # what a tendon has to do with shows in excitation and slack
            marks=()
            if tendon == TENDONS[0] or wanted in ("excitation", "slack")
            else pytest.mark.slow,
        )
        for tendon in TENDONS
        for wanted in ("excitation", "q", "qd", "force", "fibre", "slack")
        if (tendon, wanted) != ("implicit", "qd")  # its torques do not depend on the rate of length
    ],
)
def test_gradients_are_those_of_finite_differences(tendon: Tendon, wanted: str) -> None:
    muscles, ranges = model(movable=("right_elbow",), tendon=tendon, most=4)
    ours = TorchMuscles(muscles)
    q = torch.tensor(_bent(ranges))
    given = {
        "q": q,
        "qd": torch.full_like(q, 0.3),
        "excitation": torch.linspace(0.3, 0.8, 4, dtype=q.dtype)[None],
    }
    lengths = torch.tensor(muscles.fibre_lengths(q[0].numpy(), 0.4))[None]
    tendons = lengths if tendon == "implicit" else torch.full((1, 4), 0.3, dtype=q.dtype)
    still = torch.zeros(1, 4, dtype=q.dtype)
    state = TorchState(torch.full((1, 4), 0.4, dtype=q.dtype), tendons, still, still)
    own = dict(ours.named_parameters())

    def torques(value: torch.Tensor) -> torch.Tensor:
        args = {**given, **({wanted: value} if wanted in given else {})}
        figures = {**own, **({wanted: value} if wanted in own else {})}
        call = (args["q"], args["qd"], args["excitation"], state, DT)
        out: torch.Tensor = torch.func.functional_call(
            _Step(ours), {f"muscles.{name}": figure for name, figure in figures.items()}, call
        )
        return out

    value = (given[wanted] if wanted in given else own[wanted]).detach().clone().requires_grad_()
    before = torques(value)
    assert before.abs().max() > 0.1
    assert torch.autograd.gradcheck(torques, (value,), eps=1e-7, atol=1e-4, rtol=1e-4)
    (slope,) = torch.autograd.grad(torques(value).sum(), value)
    assert slope.abs().max() > 1e-3


class _Step(torch.nn.Module):
    """Only the torques of a step, so that parameters can be put in from outside."""

    def __init__(self, muscles: TorchMuscles) -> None:
        super().__init__()
        self.muscles = muscles

    def forward(self, *args: object) -> torch.Tensor:
        step: Callable[..., tuple[torch.Tensor, TorchState]] = self.muscles.step
        return step(*args)[0]


@pytest.mark.slow
def test_excitations_can_be_learned_by_gradient() -> None:
    muscles, ranges = model(movable=ARM)
    ours = TorchMuscles(muscles)
    q = torch.tensor(_bent(ranges))
    still = torch.zeros_like(q)
    elbow = ours.dofs.index(next(dof for dof in ours.dofs if dof.startswith("right_elbow")))
    raw = torch.full((1, len(ours.names)), -2.0, dtype=q.dtype, requires_grad=True)
    search = torch.optim.Adam([raw], lr=0.2)

    def torque() -> torch.Tensor:
        state = ours.new_state(1)
        for _ in range(6):  # 25 ms
            out, state = ours.step(q, still, torch.sigmoid(raw), state, DT)
        return out[0, elbow]

    wanted = float(torque().detach()) + 5.0
    for _ in range(40):
        search.zero_grad()
        torch.autograd.backward((torque() - wanted) ** 2)
        search.step()
    assert abs(float(torque().detach()) - wanted) < 0.5


def test_all_figures_of_the_muscles_can_be_learned() -> None:
    muscles, ranges = model(movable=ARM)
    ours = TorchMuscles(muscles).requires_grad_()
    torques, _ = ours.step(*tensors(*inputs(muscles, ranges, 2, 3)), ours.new_state(2), DT)
    torch.autograd.backward(torques.square().sum())
    for name, figure in ours.named_parameters():
        assert figure.grad is not None and figure.grad.isfinite().all(), name
        assert figure.grad.abs().max() > 0, name


def test_float32_is_near_and_keeps_its_type() -> None:
    muscles, ranges = model()
    given = inputs(muscles, ranges, 4, 9)
    rounded = tensors(*given, dtype=torch.float32)
    exact, rough = TorchMuscles(muscles), TorchMuscles(muscles, dtype=torch.float32)
    fine, _ = exact.step(*tensors(*given), exact.new_state(4), DT)
    coarse, state = rough.step(*rounded, rough.new_state(4), DT)
    assert coarse.dtype == state.active.dtype == torch.float32
    assert (coarse - fine).abs().max() < 1e-3 * fine.abs().max()
    moved = TorchMuscles(muscles).to(torch.float32)
    np.testing.assert_array_equal(
        moved.step(*rounded, moved.new_state(4), DT)[0].numpy(), coarse.numpy()
    )


def test_wrong_shapes_are_named() -> None:
    muscles, ranges = model(movable=ARM)
    ours = TorchMuscles(muscles)
    q, qd, excitation = tensors(*inputs(muscles, ranges, 2, 3))
    with pytest.raises(ActionError, match="excitation must have shape"):
        ours.step(q, qd, excitation[:, :-1], ours.new_state(2), DT)
    with pytest.raises(ActionError, match="activation of the state must have shape"):
        ours.step(q, qd, excitation, ours.new_state(3), DT)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_a_gpu_gives_the_same_torques() -> None:
    muscles, ranges = model()
    given = inputs(muscles, ranges, 16, 9)
    here, there = TorchMuscles(muscles), TorchMuscles(muscles, device="cuda")
    exact, _ = here.step(*tensors(*given), here.new_state(16), DT)
    torques, state = there.step(*tensors(*given, device="cuda"), there.new_state(16), DT)
    assert state.active.is_cuda
    assert (torques.cpu() - exact).abs().max() <= AGREEMENT * exact.abs().max()
