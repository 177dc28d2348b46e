"""SAC, TQC and multi-agent SAC: that they learn, target what they should, and resume bit for bit."""

from __future__ import annotations

import importlib
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from point_reach import PointReach, mean_reward
from tensordict import TensorDict
from torchrl.envs.utils import ExplorationType, set_exploration_type
from torchrl.modules import TanhNormal
from variants import few

from rcare_marl.baselines.algorithms import algorithm as registry
from rcare_marl.baselines.algorithms import (
    algorithm_names,
    config_class,
    make_algorithm,
    register_algorithm,
)
from rcare_marl.baselines.algorithms.network import GroupShape, Normaliser
from rcare_marl.baselines.algorithms.off_policy import BehaviourCloning, OffPolicy, OffPolicyConfig
from rcare_marl.baselines.algorithms.sac import Masac, Sac, Tqc, TqcConfig
from rcare_marl.baselines.algorithms.shortcut import SquashedNormal
from rcare_marl.errors import ConfigError, UnknownNameError

SMALL: dict[str, Any] = {"hidden": (32, 32), "batch_size": 32, "warm_up": 40}
TEAM = {"robots": 2, "recipients": 1}


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    yield
    torch.set_num_threads(before)


def made(name: str, env: PointReach, **settings: Any) -> OffPolicy:
    algorithm = make_algorithm(name, config_class(name)(**{**SMALL, **settings}), env, seed=0)
    assert isinstance(algorithm, OffPolicy)
    return algorithm


def demonstrations(env: PointReach, steps: int = 40) -> TensorDict:
    """Each point goes straight to its goal."""

    def straight(now: TensorDict) -> TensorDict:
        for group in env.group_map:
            seen = now[group, "observation"]
            speed = ((seen[..., 2:] - seen[..., :2]) / 0.2).clamp(-1, 1)
            now[group, "action"] = env.low + (speed + 1) / 2 * (1 - env.low)
        return now

    return env.rollout(straight, steps).reshape(-1)


def transition(*, terminated: bool, done: bool, agents: int = 1) -> TensorDict:
    """One transition of reward 1 of a toy with 1 agent, flat."""
    return TensorDict(
        {
            "observation": torch.full((1, 4), 0.1),
            "action": torch.full((1, 2), 0.2),
            "next": {
                "observation": torch.full((1, 4), 0.3),
                "reward": torch.ones(1, 1),
                "terminated": torch.full((1, 1), terminated),
                "done": torch.full((1, 1), done),
            },
        },
        [1],
    )


@pytest.mark.parametrize(
    ("name", "groups", "batches"),
    [
        ("sac", {"robots": 1}, 12),
        pytest.param("tqc", {"robots": 1}, 12, marks=pytest.mark.slow),
        pytest.param("masac", {"robots": 1, "recipients": 1}, 20, marks=pytest.mark.slow),
    ],
)
def test_learning_brings_points_far_nearer_than_chance(
    name: str, groups: dict[str, int], batches: int
) -> None:
    env, trial = PointReach(groups, shared=True), PointReach(groups, shared=True, count=32, seed=1)
    quick = {"hidden": (64, 64), "batch_size": 64, "actor_lr": 3e-3, "critic_lr": 3e-3}
    algorithm = made(name, env, **quick, tau=0.02, alpha_init=0.05)
    before = mean_reward(trial, algorithm.policy())
    for _ in range(batches):
        algorithm.learn(env.rollout(algorithm.policy(), 5))
    assert mean_reward(trial, algorithm.policy()) > before + 0.35  # the best there is: about 0.5


def test_without_learning_nothing_comes_nearer() -> None:
    env = PointReach({"robots": 1})
    algorithm = made("sac", env, warm_up=10**6)
    before = algorithm.actor_arrays()["robots"].layers[0][0]
    figures = algorithm.learn(env.rollout(algorithm.policy(), 20))
    assert figures == {"updates": 0.0}
    assert np.array_equal(before, algorithm.actor_arrays()["robots"].layers[0][0])


def test_the_target_reaches_beyond_a_truncation_and_not_beyond_a_termination() -> None:
    algorithm = made("sac", PointReach({"robots": 1}), gamma=0.9)
    learner = algorithm.learners["robots"]
    loss: Any = learner.loss
    assert loss._compute_target_v2(transition(terminated=True, done=True)).item() == 1.0
    torch.manual_seed(5)
    cut = loss._compute_target_v2(transition(terminated=False, done=True)).item()
    torch.manual_seed(5)
    location, scale = learner.actor(torch.full((1, 4), 0.3))
    action, log_prob = SquashedNormal(location, scale, -1.0).rsample_and_log_prob()
    after = TensorDict({"observation": torch.full((1, 4), 0.3), "action": action}, [1])
    values = loss._vmap_qnetworkN0(after, loss.target_qvalue_network_params)["state_action_value"]
    wanted = 1 + 0.9 * (values.min() - 0.2 * log_prob).item()  # 0.2 is alpha to begin with
    assert cut == pytest.approx(wanted, abs=1e-6)
    assert abs(cut - 1) > 0.01


def test_central_critics_too_look_beyond_a_truncation_only() -> None:
    env = PointReach(TEAM)
    algorithm = made("masac", env)
    algorithm.learn(env.rollout(algorithm.policy(), 10))
    (batch,) = algorithm._minibatches("joint", 1, 0)
    loss: Any = algorithm.learners["robots"].loss
    after = batch["next", "robots"]
    after["done"] = torch.ones_like(after["done"])
    after["terminated"] = torch.zeros_like(after["terminated"])
    after["terminated"][:16] = True
    target = loss._compute_target_v2(algorithm._prepared("robots", batch))
    off = (target - after["reward"].squeeze(-1)).abs()
    assert off[:16].max() == 0
    assert off[16:].min() > 0


def test_the_highest_quantiles_of_the_pool_do_not_reach_the_target() -> None:
    env = PointReach({"robots": 1})
    algorithm = made("tqc", env, critics=3, quantiles=7, dropped=2, gamma=0.9)
    learner = algorithm.learners["robots"]
    loss: Any = learner.loss
    torch.manual_seed(5)
    target = loss.compute_target(transition(terminated=False, done=True))[0]
    assert target.shape == (3 * 7 - 3 * 2,)
    torch.manual_seed(5)
    after = {"observation": torch.full((1, 4), 0.3)}
    location, scale = learner.actor(after["observation"])
    action, log_prob = SquashedNormal(location, scale, -1.0).rsample_and_log_prob()
    pool = loss._vmap_qnetworkN0(
        TensorDict(after | {"action": action}, [1]), loss.target_qvalue_network_params
    )["state_action_value"]
    kept = pool.flatten().sort().values[:15]
    assert torch.allclose(target, 1 + 0.9 * (kept - 0.2 * log_prob), atol=1e-6)
    ended = loss.compute_target(transition(terminated=True, done=True))
    assert torch.equal(ended, torch.ones(1, 15))


@pytest.mark.parametrize("name", ["sac", "tqc", "masac"])
def test_half_of_a_minibatch_is_demonstrations(name: str) -> None:
    env = PointReach(TEAM)
    algorithm = made(name, env)
    shown = demonstrations(env)
    algorithm.add_demonstrations(shown)
    algorithm.learn(env.rollout(algorithm.policy(), 4))
    place = algorithm._memory_of("robots")
    batch = algorithm._minibatches(place, 3, 16)[2]
    assert batch.batch_size == (32,)
    known = algorithm._transitions(shown)[place]
    key = ("robots", "action") if name == "masac" else "action"
    known_rows = {tuple(row) for row in known[key].flatten(1).tolist()}
    found = [tuple(row) in known_rows for row in batch[key].flatten(1).tolist()]
    assert found == [False] * 16 + [True] * 16


def test_with_demonstrations_there_is_no_warm_up() -> None:
    env = PointReach({"robots": 1})
    algorithm = made("sac", env, warm_up=10**6)
    algorithm.add_demonstrations(demonstrations(env))
    assert algorithm.learn(env.rollout(algorithm.policy(), 2))["updates"] == 8


def test_copying_the_demonstrations_gives_their_actions() -> None:
    env, trial = PointReach({"robots": 1}, count=32), PointReach({"robots": 1}, count=32, seed=1)
    cloning = BehaviourCloning(updates=300)
    algorithm = made("sac", env, behaviour_cloning=cloning, actor_lr=3e-3, hidden=(64, 64))
    shown = demonstrations(env)
    critic = algorithm.learners["robots"].loss.qvalue_network_params
    before = critic["module", "layers", "0", "weight"].clone()
    figures = algorithm.add_demonstrations(shown)
    assert figures["copied_robots"] < 0.03
    assert torch.equal(before, critic["module", "layers", "0", "weight"])
    assert mean_reward(trial, algorithm.policy()) > -0.5


@pytest.mark.parametrize("name", ["sac", "masac"])
def test_what_is_copied_is_what_was_meant_not_its_noise(name: str) -> None:
    env = PointReach({"robots": 1})
    shown = demonstrations(env)
    shown["robots", "meant"] = shown["robots", "action"].clone()
    shown["robots", "action"] = -shown["robots", "action"]
    cloning = BehaviourCloning(updates=300)
    algorithm = made(name, env, behaviour_cloning=cloning, actor_lr=3e-3, hidden=(64, 64))
    assert algorithm.add_demonstrations(shown)["copied_robots"] < 0.05
    actor = algorithm.learners["robots"].actor
    location, _ = actor(shown["robots", "observation"])
    assert (actor.squash(location) * shown["robots", "action"]).mean() < 0


def test_the_pull_towards_demonstrations_decays_to_nothing() -> None:
    cloning = BehaviourCloning(weight=2.0, decay=10)
    assert [cloning.weight_at(update) for update in (0, 5, 10, 50)] == [2.0, 1.0, 0.0, 0.0]
    distances = []
    for weight in (0.0, 30.0):
        cloning = BehaviourCloning(weight=weight, decay=10**6)
        env = PointReach({"robots": 1})
        algorithm = made("sac", env, actor_lr=3e-3, behaviour_cloning=cloning)
        shown = demonstrations(env)
        algorithm.add_demonstrations(shown)
        algorithm.learn(shown[:80].reshape(8, 10))
        rows = algorithm._transitions(shown)["robots"]
        distances.append(algorithm.learners["robots"].distance(rows).item())
    assert distances[1] < 0.5 * distances[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", few(("sac", "tqc", "masac"), "sac", "tqc"))
def test_a_resumed_learner_goes_on_bit_for_bit(name: str) -> None:
    env = PointReach(TEAM, low=0.0)
    settings = {"buffer_size": 150, "update_to_data": 0.3}
    first = made(name, env, **settings)
    first.add_demonstrations(demonstrations(env))
    batches = [env.rollout(first.policy(), 7) for _ in range(8)]
    for batch in batches[:5]:
        first.learn(batch)
    file = io.BytesIO()
    torch.save(first.state_dict(), file)
    file.seek(0)
    second = made(name, env, **settings, gamma=0.97)
    second.load_state_dict(torch.load(file, weights_only=True))
    assert same(first.state_dict(), second.state_dict())
    ends = []
    for algorithm in (first, second):
        torch.manual_seed(11)
        figures = [algorithm.learn(batch) for batch in batches[5:]]
        acted = algorithm.policy()(batches[0][:, 0].select(*algorithm.policy().in_keys))
        ends.append((figures, acted["robots", "action"], algorithm.state_dict()))
    assert figures[0]["updates"] > 0
    assert same(ends[0], ends[1])


def same(one: Any, other: Any) -> bool:
    """Whether two trees of dicts, lists and tensors are equal, tensors bit for bit."""
    if isinstance(one, torch.Tensor):
        return torch.equal(one, other)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other)


def test_a_state_is_a_copy() -> None:
    env = PointReach({"robots": 1})
    algorithm = made("sac", env)
    algorithm.learn(env.rollout(algorithm.policy(), 10))
    state, again = algorithm.state_dict(), algorithm.state_dict()
    algorithm.learn(env.rollout(algorithm.policy(), 10))
    assert same(state, again)
    assert not same(state, algorithm.state_dict())


@pytest.mark.parametrize("low", few([-1.0, 0.0], 0.0))
def test_arrays_act_as_the_actor_does(low: float) -> None:
    env = PointReach(TEAM, low=low)
    algorithm = made("sac", env)
    for _ in range(3):
        algorithm.learn(env.rollout(algorithm.policy(), 10))
    batch = env.rollout(algorithm.policy(), 5, explore=False)
    for group, arrays in algorithm.actor_arrays().items():
        wanted = batch[group, "action"].numpy()
        assert arrays.layers[-1][0].shape[0] == wanted.shape[-1]
        assert np.abs(arrays.act(batch[group, "observation"].numpy()) - wanted).max() < 1e-5
        assert wanted.min() >= low and wanted.max() <= 1
        assert not np.allclose(arrays.mean, 0)


def test_the_policy_explores_only_where_told_and_by_chance_before_learning() -> None:
    env = PointReach({"robots": 1}, count=256, low=0.0)
    algorithm = made("sac", env, last_layer_scale=0.01, warm_up_scale=0.5)
    policy = algorithm.policy()
    seen = env.rollout(policy, 1)[:, 0].select(("robots", "observation"))

    def acted(kind: ExplorationType) -> torch.Tensor:
        with set_exploration_type(kind):
            return policy(seen.clone())["robots", "action"]

    chance = acted(ExplorationType.RANDOM)
    assert 0.25 <= chance.min() < 0.28 and 0.72 < chance.max() <= 0.75
    still = acted(ExplorationType.DETERMINISTIC)
    assert torch.equal(still, acted(ExplorationType.DETERMINISTIC))
    assert (still - 0.5).abs().max() < 0.01  # a small last layer begins in the middle


@pytest.mark.parametrize("low", [-1.0, 0.0])
def test_the_short_distribution_is_torchrls(low: float) -> None:
    location, scale = torch.randn(50, 3) * 2, torch.rand(50, 3) + 0.1
    torch.manual_seed(3)
    ours = SquashedNormal(location, scale, low).rsample_and_log_prob()
    torch.manual_seed(3)
    theirs = TanhNormal(
        location, scale, low=torch.tensor(low), high=torch.tensor(1.0), event_dims=1
    ).rsample_and_log_prob()
    assert torch.allclose(ours[0], theirs[0], atol=1e-6)
    assert torch.allclose(ours[1], theirs[1], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", few(["sac", "tqc", "masac"], "tqc", "masac"))
def test_the_short_way_to_the_critics_gives_torchrls_numbers(name: str) -> None:
    env = PointReach(TEAM)
    algorithm = made(name, env)
    algorithm.learn(env.rollout(algorithm.policy(), 10))  # weights and normalisers are no defaults
    learner = algorithm.learners["robots"]
    loss: Any = learner.loss
    (batch,) = algorithm._minibatches(algorithm._memory_of("robots"), 1, 0)
    short = loss._vmap_qnetworkN0(batch, loss.qvalue_network_params)[
        loss.tensor_keys.state_action_value
    ]
    loss._make_vmap()
    asked = batch.select(*loss.qvalue_network.in_keys)
    long = loss._vmap_qnetworkN0(asked, loss.qvalue_network_params)[
        loss.tensor_keys.state_action_value
    ]
    assert short.shape == long.shape
    assert torch.allclose(short, long, atol=1e-5)


def test_agents_of_a_group_are_all_remembered_with_their_own_rewards() -> None:
    env = PointReach(TEAM)
    batch = env.rollout(made("sac", env).policy(), 3)
    kept = made("sac", env, reward_scale=10.0)._transitions(batch.reshape(-1))["robots"]
    assert kept.batch_size == (8 * 3 * 2,)
    assert torch.equal(kept["next", "reward"][1], 10 * batch["next", "robots", "reward"][0, 0, 1])
    assert torch.equal(
        kept["next", "observation"][3], batch["next", "robots", "observation"][0, 1, 1]
    )


def test_central_critics_take_everybodys_action_into_account() -> None:
    env = PointReach(TEAM)
    algorithm = made("masac", env)
    algorithm.learn(env.rollout(algorithm.policy(), 10))
    loss: Any = algorithm.learners["robots"].loss
    (batch,) = algorithm._minibatches("joint", 1, 0)
    before = loss._vmap_qnetworkN0(batch, loss.qvalue_network_params)[
        "robots", "state_action_value"
    ]
    assert before.shape == (2, 32, 2, 1)
    batch["recipients", "action"] = -batch["recipients", "action"]
    after = loss._vmap_qnetworkN0(batch, loss.qvalue_network_params)["robots", "state_action_value"]
    assert not torch.allclose(before, after)


def test_updates_that_are_not_whole_are_owed() -> None:
    env = PointReach({"robots": 1}, count=1)
    algorithm = made("sac", env, warm_up=0, update_to_data=0.3)
    done = [algorithm.learn(env.rollout(algorithm.policy(), 1))["updates"] for _ in range(10)]
    assert sum(done) in (2.0, 3.0) and max(done) == 1.0


def test_a_normaliser_is_taken_once() -> None:
    normaliser = Normaliser(3)
    rows = torch.tensor([[0.0, 10.0, 7.0], [2.0, 30.0, 7.0]])
    normaliser.fit(rows)
    normaliser.fit(rows * 100)
    assert torch.equal(normaliser(rows), torch.tensor([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]]))
    assert torch.equal(normaliser(torch.tensor([0.0, 1e9, 7.0])), torch.tensor([-1.0, 10.0, 0.0]))


def test_the_algorithm_of_the_docs_is_known_by_name_once_its_module_is_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "_ALGORITHMS", dict(registry._ALGORITHMS))
    text = (Path(__file__).parents[1] / "docs" / "learning.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n((?:(?!```).)*register_algorithm.*?)```", text, re.DOTALL)
    (tmp_path / "robust_sac.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.import_module("robust_sac")
    assert "robust_sac" in algorithm_names()
    env = PointReach({"robots": 1})
    algorithm = made("robust_sac", env)
    figures = algorithm.learn(env.rollout(algorithm.policy(), 60))
    assert figures["updates"] > 0 and np.isfinite(figures["loss_qvalue"])
    with pytest.raises(ConfigError, match="'sac' already"):
        register_algorithm("sac", "robust_sac:RobustSac", "robust_sac:RobustSacConfig")


def test_the_entropy_to_keep_fits_the_range_of_actions() -> None:
    for low, wanted in ((-1.0, -2.0), (0.0, -2 - 2 * np.log(2))):
        algorithm = made("sac", PointReach({"robots": 1}, low=low))
        assert float(algorithm.learners["robots"].loss.target_entropy) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"gamma": 1.5}, "gamma must be between 0 and 1"),
        ({"batch_size": 0}, "batch_size must be positive"),
        ({"hidden": ()}, "hidden needs sizes"),
        ({"warm_up": -1}, "must not be negative"),
    ],
)
def test_settings_that_cannot_be_are_refused(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        OffPolicyConfig(**wrong)
    with pytest.raises(ConfigError, match="fewer dropped than quantiles"):
        TqcConfig(quantiles=2, dropped=2)
    with pytest.raises(ConfigError, match="behaviour_cloning"):
        BehaviourCloning(decay=0)


def test_names_are_checked() -> None:
    assert {"sac", "tqc", "masac"} <= set(algorithm_names())
    with pytest.raises(UnknownNameError, match="Did you mean 'sac'"):
        config_class("sacc")
    with pytest.raises(ConfigError, match="takes OffPolicyConfig, got TqcConfig"):
        make_algorithm("sac", TqcConfig(), PointReach({"robots": 1}), seed=0)


def test_the_same_seed_gives_the_same_first_weights_whatever_came_before() -> None:
    env = PointReach(TEAM)
    one = made("masac", env).state_dict()["learners"]
    torch.rand(3)
    assert same(one, made("masac", env).state_dict()["learners"])
    other = Masac(OffPolicyConfig(**SMALL), env, seed=1).state_dict()["learners"]
    assert not same(one, other)
    assert isinstance(Tqc(TqcConfig(**SMALL), env), Sac)
    assert (
        GroupShape("robots", 2, 4, 2, -1.0, 12)
        == Sac(OffPolicyConfig(**SMALL), env).shapes["robots"]
    )
