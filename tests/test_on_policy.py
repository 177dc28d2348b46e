"""PPO, IPPO and MAPPO: they learn, bootstrap where they should, and resume bit for bit."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs.utils import ExplorationType, set_exploration_type

from rcare_marl.baselines.algorithms import config_class, make_algorithm
from rcare_marl.baselines.algorithms.on_policy import OnPolicy, OnPolicyConfig, ReturnSpread
from rcare_marl.errors import ConfigError

TIME = 20  # steps until an episode of the toy is cut off
NEAR = 0.15
TWO_GROUPS = {"robots": (2, -1.0), "recipients": (1, 0.0)}
ONE_LEARNER = {"robots": (1, -1.0)}
QUICK = {
    "hidden": (32, 32),
    "epochs": 4,
    "minibatch": 320,
    "learning_rate": 3e-3,
    "initial_log_std": 0.0,
    "target_kl": None,
}


class Reaching:
    """Points in the plane that go to targets of their own; a batch of such scenes.

    Args:
        groups: Number of agents and lower bound of actions, by group.
        count: Scenes in the batch.
    """

    def __init__(self, groups: Mapping[str, tuple[int, float]], *, count: int = 16) -> None:
        self.lows = {name: low for name, (_, low) in groups.items()}
        self.group_map = {
            name: [f"{name}_{i}" for i in range(agents)] for name, (agents, _) in groups.items()
        }
        self.count = count
        self.full_action_spec = Composite()
        self.observation_spec = Composite()
        for name, (agents, low) in groups.items():
            self.full_action_spec[name, "action"] = Bounded(
                low, 1.0, torch.Size((count, agents, 2))
            )
            self.observation_spec[name, "observation"] = Unbounded(torch.Size((count, agents, 3)))
        total = sum(agents for agents, _ in groups.values())
        self.observation_spec["state"] = Unbounded(torch.Size((count, 3 * total)))
        self._generator = torch.Generator().manual_seed(1)
        self._gaps = {n: torch.zeros(count, len(r), 2) for n, r in self.group_map.items()}
        self._steps = torch.full((count,), TIME)
        self._reset(torch.ones(count, dtype=torch.bool))

    def _reset(self, over: torch.Tensor) -> None:
        for gap in self._gaps.values():
            new = 2 * torch.rand(gap.shape, generator=self._generator) - 1
            gap[over] = new[over]
        self._steps[over] = 0

    def _seen(self) -> TensorDict:
        left = 1 - self._steps / TIME
        seen = TensorDict({}, batch_size=[self.count])
        for name, gap in self._gaps.items():
            clock = left[:, None, None].expand(-1, gap.shape[1], 1)
            observation = torch.cat(
                [30 + 5 * gap, clock], dim=-1
            )  # neither centred nor of one scale
            seen[name, "observation"] = observation
        seen["state"] = torch.cat(
            [seen[name, "observation"].flatten(1) for name in self._gaps], dim=-1
        )
        return seen

    def _step(self, seen: TensorDict) -> TensorDict:
        far = torch.zeros(self.count)
        rewards = {}
        for name, gap in self._gaps.items():
            low = self.lows[name]
            action = seen[name, "action"]
            assert (action >= low).all() and (action <= 1).all()
            gap -= 0.25 * (2 * (action - low) / (1 - low) - 1)
            rewards[name] = -gap.norm(dim=-1, keepdim=True)
            far = torch.maximum(far, gap.norm(dim=-1).amax(dim=-1))
        self._steps += 1
        terminated = far < NEAR
        done = terminated | (self._steps >= TIME)
        after = self._seen()
        for name, reward in rewards.items():
            shape = reward.shape
            after[name, "reward"] = reward
            after[name, "done"] = done[:, None, None].expand(shape).clone()
            after[name, "terminated"] = terminated[:, None, None].expand(shape).clone()
        after["done"], after["terminated"] = done[:, None], terminated[:, None]
        self._reset(done)
        return after

    def batch(self, algorithm: OnPolicy, steps: int, *, explore: bool = True) -> TensorDict:
        """Return what came of so many steps of the policy, shape [count, steps]."""
        kind = ExplorationType.RANDOM if explore else ExplorationType.DETERMINISTIC
        rows = []
        with torch.no_grad(), set_exploration_type(kind):
            for _ in range(steps):
                seen = self._seen()
                algorithm.policy()(seen)
                after = self._step(seen)
                seen["next"] = after
                rows.append(seen)
        return torch.stack(rows, dim=1)


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Small networks are slower on several."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def make(name: str, env: Reaching, **settings: Any) -> OnPolicy:
    defaults = {"hidden": (64, 64), "minibatch": 128, "learning_rate": 1e-3}
    made = make_algorithm(name, config_class(name)(**{**defaults, **settings}), env, seed=3)
    assert isinstance(made, OnPolicy)
    return made


def reward_of(batch: TensorDict) -> float:
    """Return the mean reward of all agents and steps."""
    rewards = [value.flatten() for key, value in batch["next"].items(True) if key[-1] == "reward"]
    return float(torch.cat(rewards).mean())


def through_a_file(state: Any) -> Any:
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    return torch.load(file, weights_only=True)


def gae(rewards: Any, values: Any, nexts: Any, done: Any, terminated: Any) -> Any:
    """Return advantages [N, T, n, 1] by the sum in Schulman et al. 2016, step by step from the end."""
    gamma, decay = 0.9, 0.8
    advantages = np.zeros_like(rewards)
    for i in range(rewards.shape[0]):
        later = np.zeros_like(rewards[0, 0])
        for t in reversed(range(rewards.shape[1])):
            surprise = rewards[i, t] + gamma * nexts[i, t] * ~terminated[i, t] - values[i, t]
            later = surprise + gamma * decay * later * ~done[i, t]
            advantages[i, t] = later
    return advantages


EACH = pytest.mark.parametrize(
    "name, groups", [("ppo", ONE_LEARNER), ("ippo", TWO_GROUPS), ("mappo", TWO_GROUPS)]
)
SEVERAL = pytest.mark.parametrize("name", ["ippo", "mappo"])


@EACH
@pytest.mark.slow
def test_learning_beats_chance_by_far(name: str, groups: Mapping[str, tuple[int, float]]) -> None:
    torch.manual_seed(0)
    env = Reaching(groups)
    algorithm = make(name, env, **QUICK)
    before = reward_of(env.batch(algorithm, 2 * TIME))
    for _ in range(12):
        algorithm.learn(env.batch(algorithm, 2 * TIME))
    after = reward_of(env.batch(algorithm, 2 * TIME, explore=False))
    assert before < -0.75
    assert after > -0.4  # who stands still gets -0.76, the best possible is about -0.25


@EACH
def test_advantages_are_those_of_the_paper(
    name: str, groups: Mapping[str, tuple[int, float]]
) -> None:
    torch.manual_seed(1)
    env = Reaching(groups)
    algorithm = make(name, env, gamma=0.9, gae_lambda=0.8, scale_rewards=False)
    algorithm.learn(env.batch(algorithm, 8))
    batch = env.batch(algorithm, 2 * TIME + 5)
    for group, learner in algorithm.learners.items():
        data = algorithm.data_of(batch, group)
        after = data["next"]
        after["terminated"] = torch.rand(after["done"].shape) < 0.1
        after["done"] = after["terminated"] | (torch.rand(after["done"].shape) < 0.1)
        rewards, done, terminated = (
            after[k].clone().numpy() for k in ("reward", "done", "terminated")
        )
        assert (done & ~terminated).any() and terminated.any() and not done[:, -1].all()
        learner.estimate(data)
        values, nexts = data["state_value"].numpy(), data["next", "state_value"].numpy()
        assert values.std() > 1e-3
        expected = gae(rewards, values, nexts, done, terminated)
        np.testing.assert_allclose(data["advantage"].numpy(), expected, atol=1e-5)
        np.testing.assert_allclose(data["value_target"].numpy(), expected + values, atol=1e-5)


def test_a_time_limit_is_bootstrapped_and_an_end_is_not() -> None:
    torch.manual_seed(2)
    env = Reaching(ONE_LEARNER)
    algorithm = make("ppo", env, gamma=0.9, scale_rewards=False)
    learner = algorithm.learners["robots"]
    data = algorithm.data_of(env.batch(algorithm, 1), "robots")
    data["next", "done"][:] = True
    data["next", "terminated"][:] = False
    data["next", "terminated"][0] = True
    learner.estimate(data)
    reward, after = data["next", "reward"], data["next", "state_value"]
    target = data["value_target"]
    torch.testing.assert_close(target[0], reward[0])
    torch.testing.assert_close(target[1:], reward[1:] + 0.9 * after[1:])
    assert after[0].abs().item() > 1e-3


@pytest.mark.parametrize("group", ["robots", "recipients"])
def test_log_probabilities_are_of_the_squashed_normal_distribution(group: str) -> None:
    torch.manual_seed(3)
    env = Reaching(TWO_GROUPS)
    algorithm = make("ippo", env)
    learner = algorithm.learners[group]
    data = algorithm.data_of(env.batch(algorithm, 3), group)
    learner.estimate(data)
    low = env.lows[group]
    squashed = 2 * (data["action"].double() - low) / (1 - low) - 1
    with torch.no_grad():
        location, scale = learner.actor(data["observation"])
    normal: Any = torch.distributions.Normal(location.double(), scale.double())
    volume = torch.log((1 - low) / 2 * (1 - squashed**2))
    expected = (normal.log_prob(torch.atanh(squashed)) - volume).sum(-1)
    torch.testing.assert_close(data["action_log_prob"].double(), expected, atol=1e-3, rtol=1e-4)


@EACH
def test_a_saved_learner_goes_on_bit_for_bit(
    name: str, groups: Mapping[str, tuple[int, float]]
) -> None:
    torch.manual_seed(4)
    env = Reaching(groups)
    settings = {"entropy": 0.01, "epochs": 2, "target_kl": None}
    algorithm = make(name, env, **settings)
    for _ in range(3):
        algorithm.learn(env.batch(algorithm, 20))
    other = make_algorithm(
        name,
        config_class(name)(hidden=(64, 64), minibatch=128, learning_rate=1e-3, **settings),
        env,
        seed=99,
    )
    other.load_state_dict(through_a_file(algorithm.state_dict()))
    batch = env.batch(algorithm, 20)
    figures = []
    for one in (algorithm, other):
        torch.manual_seed(5)
        figures.append(one.learn(batch.clone()))
    assert figures[0] == figures[1]
    same(through_a_file(algorithm.state_dict()), through_a_file(other.state_dict()))


def same(left: Any, right: Any) -> None:
    if isinstance(left, Mapping):
        assert left.keys() == right.keys()
        for key in left:
            same(left[key], right[key])
    elif isinstance(left, torch.Tensor):
        assert torch.equal(left, right)
    else:
        assert left == right


def test_learning_leaves_the_batch_as_it_was() -> None:
    env = Reaching(TWO_GROUPS)
    algorithm = make("mappo", env, epochs=1)
    algorithm.learn(env.batch(algorithm, 10))
    batch = env.batch(algorithm, 10)
    before = batch.clone()
    algorithm.learn(batch)
    assert set(batch.keys(True, True)) == set(before.keys(True, True))
    assert (batch == before).all()


def test_the_first_batch_only_gives_the_scales() -> None:
    env = Reaching(ONE_LEARNER)
    algorithm = make("ppo", env)
    actor = algorithm.learners["robots"].actor
    weights = [p.clone() for p in actor.parameters()]
    batch = env.batch(algorithm, 2 * TIME)
    assert algorithm.learn(batch) == {"updates": 0.0}
    assert algorithm.updates == 0
    assert all(torch.equal(a, b) for a, b in zip(weights, actor.parameters(), strict=True))
    rows = batch["robots", "observation"].reshape(-1, 3)
    torch.testing.assert_close(actor.normaliser.mean, rows.mean(0))
    torch.testing.assert_close(actor.normaliser.scale, rows.std(0, correction=0))
    assert algorithm.learn(env.batch(algorithm, 10))["updates"] == algorithm.updates > 0
    torch.testing.assert_close(actor.normaliser.mean, rows.mean(0))


def test_the_spread_of_returns_is_that_of_all_batches() -> None:
    rng = np.random.default_rng(0)
    spread = ReturnSpread()
    assert spread.scale() == 1.0
    every = []
    for size in (3, 5):
        rewards, done = rng.normal(2, 3, (size, 7, 2, 1)), rng.random((size, 7, 2, 1)) < 0.2
        spread.update(torch.tensor(rewards), torch.tensor(done), 0.9)
        returns = rewards.copy()
        for t in range(5, -1, -1):
            returns[:, t] += 0.9 * returns[:, t + 1] * ~done[:, t]
        every.append(returns.ravel())
    assert spread.scale() == pytest.approx(np.concatenate(every).std(), rel=1e-9)


def test_actor_arrays_act_as_the_actor() -> None:
    torch.manual_seed(6)
    env = Reaching(TWO_GROUPS)
    algorithm = make("ippo", env)
    for _ in range(3):
        algorithm.learn(env.batch(algorithm, 20))
    batch = env.batch(algorithm, 5, explore=False)
    for group, arrays in algorithm.actor_arrays().items():
        action = arrays.act(batch[group, "observation"].numpy())
        np.testing.assert_allclose(action, batch[group, "action"].numpy(), atol=1e-5)


@SEVERAL
def test_only_the_central_critic_sees_the_others(name: str) -> None:
    torch.manual_seed(7)
    env = Reaching(TWO_GROUPS)
    algorithm = make(name, env)
    algorithm.learn(env.batch(algorithm, 20))
    batch = env.batch(algorithm, 1)
    changed = batch.clone()
    changed["recipients", "observation"] += 1.0
    changed["state"][..., -3:] += 1.0  # the recipient's part of it
    learner = algorithm.learners["robots"]
    found = []
    for each in (batch, changed):
        data = algorithm.data_of(each, "robots")
        learner.estimate(data)
        found.append(data)
    assert torch.equal(found[0]["action_log_prob"], found[1]["action_log_prob"])
    assert torch.equal(found[0]["state_value"], found[1]["state_value"]) == (name == "ippo")
    assert found[0]["state_value"].shape == (16, 1, 2, 1)


def test_too_large_a_step_ends_the_epochs() -> None:
    torch.manual_seed(8)
    env = Reaching(ONE_LEARNER)
    counts = []
    for target in (None, 1e-4):
        algorithm = make("ppo", env, target_kl=target, minibatch=80, epochs=3)
        algorithm.learn(env.batch(algorithm, 20))
        figures = algorithm.learn(env.batch(algorithm, 20))
        counts.append(algorithm.updates)
    assert counts[0] == 3 * 4
    assert 1 <= counts[1] < counts[0]
    assert figures["kl"] <= 1e-4


def test_demonstrations_are_imitated_only_if_asked() -> None:
    torch.manual_seed(9)
    env = Reaching(ONE_LEARNER)
    expert = make("ppo", env)
    demonstrations = env.batch(expert, 20).reshape(-1)
    gap = (demonstrations["robots", "observation"][..., :2] - 30) / 5
    demonstrations["robots", "action"] = (4 * gap).clamp(-1, 1)
    with pytest.raises(ConfigError, match="cloning_updates"):
        expert.add_demonstrations(demonstrations)
    copier = make("ppo", env, cloning_updates=200)
    before = reward_of(env.batch(copier, 2 * TIME, explore=False))
    error = copier.add_demonstrations(demonstrations)["loss_cloning"]
    assert error < 0.05
    assert reward_of(env.batch(copier, 2 * TIME, explore=False)) > before + 0.3
    assert copier.learn(env.batch(copier, 10))["updates"] > 0  # the scales are there already


def test_first_weights_come_from_the_seed_and_disturb_nobody() -> None:
    env = Reaching(ONE_LEARNER)
    state = torch.get_rng_state()
    one, two = make("ppo", env), make("ppo", env)
    assert torch.equal(state, torch.get_rng_state())
    same(one.state_dict(), two.state_dict())


def test_what_does_not_suit_is_refused() -> None:
    several = Reaching(TWO_GROUPS)
    with pytest.raises(ConfigError, match="one learner.*ippo or mappo"):
        make("ppo", several)
    del several.observation_spec["state"]
    with pytest.raises(ConfigError, match="state"):
        make("mappo", several)
    saved = make("ippo", several).state_dict()
    with pytest.raises(ConfigError, match="recipients"):
        make("ppo", Reaching(ONE_LEARNER)).load_state_dict(saved)


@pytest.mark.parametrize(
    "settings",
    [{"clip": 0.0}, {"gamma": 1.5}, {"hidden": ()}, {"target_kl": -1.0}, {"cloning_updates": -1}],
)
def test_impossible_settings_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(settings))):
        OnPolicyConfig(**settings)
