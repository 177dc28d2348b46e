"""Imitation of a script on one's own episodes, with what the script keeps in mind."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs.utils import ExplorationType, set_exploration_type

from rcare_marl.baselines.algorithms import make_algorithm
from rcare_marl.baselines.algorithms.dagger import DaggerConfig
from rcare_marl.baselines.policy_file import LearnedPolicy, PolicyFile
from rcare_marl.baselines.training.config import load_config
from rcare_marl.envs.learning import EnvRecipe, LearnerEnv
from rcare_marl.errors import ConfigError

COUNT, STEP = 16, 0.15


class ToAndFro:
    """Points on a line whose teacher goes right until 1, then left until 0, and so on.

    Where it is says nothing of where it goes: that has to be kept in mind.
    """

    def __init__(self, memory: int) -> None:
        self.memory, size = memory, 1 + memory
        observed = (("place", 1), *((("memory", 1),) if memory else ()), ("scripted_action", size))
        self.layout = SimpleNamespace(observed={"robots": observed})
        self.group_map = {"robots": ["robot"]}
        self.batch_size = torch.Size([COUNT])
        seen = Unbounded(torch.Size((COUNT, 1, 1 + memory + size)))
        acts = Bounded(-1.0, 1.0, torch.Size((COUNT, 1, size)))
        self.observation_spec = Composite({"robots": Composite({"observation": seen})})
        self.full_action_spec = Composite({"robots": Composite({"action": acts})})
        self.place = torch.rand(COUNT, 1, 1, generator=torch.Generator().manual_seed(1))
        self.goes = torch.ones(COUNT, 1, 1)
        self.kept = torch.zeros(COUNT, 1, memory)

    def observe(self) -> TensorDict:
        self.goes = torch.where(self.place > 1, -1.0, torch.where(self.place < 0, 1.0, self.goes))
        shown = [self.goes * 0.8, *([self.goes] if self.memory else [])]
        seen = torch.cat([self.place, self.kept, *shown], dim=-1)
        inner = TensorDict({"observation": seen}, batch_size=[COUNT, 1])
        return TensorDict({"robots": inner}, batch_size=[COUNT])

    def step(self, action: torch.Tensor) -> None:
        self.place = self.place + STEP * action[..., :1]
        self.kept = action[..., 1:]


def taught(memory: int) -> float:
    """Return how often a network that learned goes where its teacher would."""
    torch.manual_seed(0)
    env = ToAndFro(memory)
    config = DaggerConfig(handover=1_500, warm_up=100, hidden=(64, 64), learning_rate=1e-3)
    algorithm = make_algorithm("dagger", config, env, seed=0)
    for _ in range(40):
        rows = []
        for _ in range(8):
            rows.append(algorithm.policy()(env.observe()))
            env.step(rows[-1]["robots", "action"])
        algorithm.learn(torch.stack(rows, dim=1))
    right = []
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        for _ in range(60):
            row = algorithm.policy()(env.observe())
            right.append((row["robots", "action"][..., :1] * env.goes > 0).float().mean())
            env.step(row["robots", "action"])
    return float(torch.stack(right).mean())


@pytest.mark.slow
def test_with_a_memory_it_does_what_the_teacher_does_where_the_present_does_not_tell() -> None:
    assert taught(memory=1) > 0.95
    assert taught(memory=0) < 0.85


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "recipient", "told"),
    [  # on offer or not, and three flags of a beat
        ("scratching", "karan", [1, -1, 1, 1]),
        ("bathing", "population:train:0-1", [1]),
    ],
)
def test_a_learner_reads_what_it_wrote_and_is_told_what_to_do_and_to_keep(
    task: str, recipient: str, told: list[int]
) -> None:
    env = LearnerEnv(EnvRecipe(task, cast={"recipient": recipient}, taught=True))
    env.reset(seed=1)
    size, kept = 6, len(told)  # of an action, and of what the script keeps in mind
    assert env.layout.action_sizes["robots"] == size + kept
    assert env.layout.observed["robots"][-2:] == (
        ("memory", kept),
        ("scripted_action", size + kept),
    )
    assert not env.observation["robots"][0, -size - 2 * kept : -size - kept].any()
    action = np.linspace(-0.5, 0.5, size + kept, dtype=np.float32)
    env.step({"robots": action[None]})
    seen = env.observation["robots"][0]
    # What holds or not is kept as 1 or -1.
    np.testing.assert_array_equal(seen[-size - 2 * kept : -size - kept], np.sign(action[size:]))
    assert seen[-kept:].tolist() == told
    env.close()


def test_who_corrects_a_script_keeps_nothing_in_mind_for_it_and_is_not_taught() -> None:
    env = LearnerEnv(EnvRecipe("bathing", residual={"robot": 0.2}))
    assert env.layout.action_sizes["robots"] == 6
    assert env.layout.observed["robots"][-1] == ("scripted_action", 6)
    env.close()
    with pytest.raises(ConfigError, match="cannot be taught"):
        EnvRecipe("bathing", residual={"robot": 0.2}, taught=True)


def test_who_is_taught_is_shown_what_the_script_of_its_bases_would_do() -> None:
    shown = {}
    for base in ("scripted", "still"):
        env = LearnerEnv(EnvRecipe("scratching", taught=True, bases={"robot": base}))
        env.reset(seed=1)
        size = dict(env.layout.observed["robots"])["scripted_action"]
        shown[base] = env.observation["robots"][0, -size:].copy()
        env.close()
    assert shown["scripted"].any()
    assert not shown["still"].any()


def test_a_policy_file_keeps_in_mind_what_it_wrote(bathing: Any) -> None:
    parts = (("sponge_to_target", 3), ("memory", 1))
    weights = np.zeros((7, 4), np.float32)
    weights[6, 3], weights[0, 3] = 1.0, 1.0
    biases = np.zeros(7, np.float32)
    biases[6] = 0.5
    file = PolicyFile(
        task="bathing",
        group="robots",
        roles=("robot",),
        observed=parts,
        action_size=6,
        action_low=-1.0,
        layers=((weights, biases),),
        mean=np.zeros(4, np.float32),
        scale=np.ones(4, np.float32),
        view={"parts": ["sponge_to_target"]},
        memory=1,
    )
    bathing.reset(seed=1)
    policy = LearnedPolicy(bathing, "robot", file)
    policy.reset(np.random.default_rng(0))
    first, second = float(np.tanh(0.5)), float(np.tanh(0.5 + np.tanh(0.5)))
    written = [policy.act()[0] for _ in range(3)]
    np.testing.assert_allclose(written, np.tanh((0.0, first, second)), atol=1e-6)
    policy.reset(np.random.default_rng(0))
    assert policy.act()[0] == 0.0


@pytest.fixture(scope="module")
def bathing() -> Any:
    env = EnvRecipe("bathing").make()
    yield env
    env.close()


def test_demonstrations_are_refused_where_a_script_shows_all_along() -> None:
    config = {"task": "bathing", "algo": "dagger", "demonstrations": {"episodes": 3}}
    with pytest.raises(ConfigError, match="leave demonstrations out"):
        load_config(config)


def test_a_resumed_pupil_goes_on_bit_for_bit() -> None:
    env = ToAndFro(1)
    config = DaggerConfig(warm_up=0, hidden=(8,))
    one, other = (make_algorithm("dagger", config, env, seed=k) for k in (0, 1))
    batch = torch.stack([one.policy()(env.observe()) for _ in range(4)], dim=1)
    torch.manual_seed(2)
    one.learn(batch)
    other.load_state_dict(one.state_dict())
    for each in (one, other):
        torch.manual_seed(3)
        each.learn(batch)
    for a, b in zip(
        one.actor_arrays()["robots"].layers, other.actor_arrays()["robots"].layers, strict=True
    ):
        np.testing.assert_array_equal(a[0], b[0])


def test_a_script_that_strokes_goes_on_from_the_beat_that_its_pupil_wrote_down() -> None:
    env = LearnerEnv(EnvRecipe("scratching", taught=True))
    env.reset(seed=1)
    size, flags = 6, 4  # of an action; on offer or not, and three of the beat

    def next_beat(first: float, second: float, third: float) -> list[float]:
        action = np.array([0.0] * size + [1.0, first, second, third], np.float32)
        env.step({"robots": action[None]})
        return [float(value) for value in env.observation["robots"][0, -flags + 1 :]]

    assert next_beat(1, 1, 1) == [-1, 1, 1]
    assert next_beat(1, 1, 1) == [-1, 1, 1]
    assert next_beat(-1, -1, -1) == [1, -1, -1]
    assert next_beat(1, -1, 1) == [-1, -1, -1]  # nowhere in the cycle
    env.close()
