"""Episodes of scripted policies, or recorded ones, as the transitions that learning begins with."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import zip_longest
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from rcare_marl.config import load
from rcare_marl.envs.datasets import read
from rcare_marl.envs.episode import RecordedEpisode, facts_of
from rcare_marl.envs.learning import LearnerEnv
from rcare_marl.errors import ConfigError

from .config import Demonstrations

SEED = 2**30  # of the first demonstration: neither a training's nor an evaluation's


def demonstrate(env: LearnerEnv, wanted: Demonstrations, seed: int = 0) -> TensorDict:
    """Return the transitions of demonstrated episodes in the layout of a collected batch, shape [M].

    (group, "action") is what was done, noise and all, and (group, "meant") what would have been done without
    it: what a copy is to copy.

    Roles that correct the scripted policy demonstrate a correction of zero.

    Args:
        env: The environment.
        wanted: How many, how noisy.
        seed: Of the training; each has demonstrations of its own.

    Raises:
        ConfigError: If too few attempts succeed, or what is recorded does not fit the environment.
    """
    if wanted.path is not None:
        return _recorded(env, wanted, wanted.path)
    kept: list[TensorDict] = []
    tried = 0
    rng = np.random.default_rng([SEED, seed])
    while len(kept) < wanted.episodes:
        if tried >= wanted.attempts * wanted.episodes:
            raise ConfigError(
                f"only {len(kept)} of {tried} demonstrated episodes of {env.recipe.task!r} succeeded, "
                f"{wanted.episodes} are wanted: the scripted policy fits this cast badly, or there is too "
                "much noise"
            )
        episode, succeeded = _episode(env, SEED + 100_003 * seed + tried, wanted.noise, rng)
        tried += 1
        if succeeded or not wanted.only_successful:
            kept.append(episode)
    return torch.cat(kept)


def _episode(
    env: LearnerEnv, seed: int, noise: float, rng: np.random.Generator
) -> tuple[TensorDict, bool]:
    env.reset(seed)
    players = env.demonstrators()
    for number, player in enumerate(players.values()):
        player.reset(np.random.default_rng([seed, number]))
    rows: list[TensorDict] = []
    while True:
        root = _seen(env)
        actions, meant = {}, {}
        for group, roles in env.groups.items():
            low = env.layout.action_lows[group]
            each = np.stack([env.as_seen(role, players[role].act()) for role in roles])
            meant[group] = np.clip(each, low, 1.0).astype(np.float32)
            each = each + noise * rng.standard_normal(each.shape)
            actions[group] = np.clip(each, low, 1.0).astype(np.float32)
        env.step(actions)
        after = _seen(env)
        done = env.terminated or env.truncated
        for group, roles in env.groups.items():
            size = (len(roles), 1)
            root[group, "action"] = torch.from_numpy(actions[group])
            root[group, "meant"] = torch.from_numpy(meant[group])
            after[group, "reward"] = torch.from_numpy(env.reward[group].reshape(size).copy())
            for name, value in (("terminated", env.terminated), ("done", done)):
                after[group, name] = torch.full(size, bool(value))
        for name, value in (("terminated", env.terminated), ("done", done)):
            after[name] = torch.tensor([bool(value)])
        root["next"] = after
        rows.append(root)
        if done:
            return torch.stack(rows), bool(env.success)


def _recorded(env: LearnerEnv, wanted: Demonstrations, path: str) -> TensorDict:
    """Return the transitions of episodes in a dataset."""
    episodes = read(path)
    for episode in episodes:
        if (fault := _misfit(env, episode)) is not None:
            raise ConfigError(f"{path} does not fit this training: {fault}")
    good = [each for each in episodes if each.is_success or not wanted.only_successful]
    if len(good) < (wanted.episodes or 1):
        raise ConfigError(
            f"{path} has {len(good)} successful episodes among {len(episodes)}, "
            f"{wanted.episodes or 'at least 1'} are wanted"
        )
    return torch.cat([_transitions(env, each) for each in good[: wanted.episodes or None]])


def _misfit(env: LearnerEnv, episode: RecordedEpisode) -> str | None:
    """Return in what an episode does not fit an environment; None if it does."""
    header, scene = episode.header, env.care_env
    if env.recipe.residual:
        return "who corrects a script (residual) observes it, and it was not recorded"
    if header.setup["task"] != env.recipe.task:
        return f"it is of the task {header.setup['task']!r}, and not {env.recipe.task!r}"
    if list(scene.cast) != list(header.roles):
        return f"it was played by {', '.join(header.roles)}, here play {', '.join(scene.cast)}"
    if not header.facts or not set(header.roles) <= set(episode.observations):
        return "what was observed is not in it"
    now, then = facts_of(scene), header.facts
    for role in header.roles:
        model = then["agents"][role].get("model")  # of robots; people may be others
        if model != now["agents"][role].get("model"):
            return f"{role!r} was {model}, and is {now['agents'][role].get('model')}"
        for what in ("observes", "acts"):
            if then[what][role] != now[what][role]:
                return f"{role!r} {what} otherwise: {_first(then[what][role], now[what][role])}"
    given = header.eased or header.setup["options"]
    was = dataclasses.asdict(load(type(scene.task).Options, given, "options"))
    for name, value in dataclasses.asdict(scene.task.options).items():
        if was[name] != value:
            return (
                f"its option {name} was {was[name]!r}, and is {value!r} (--set options.{name}=...)"
            )
    return None


def _first(then: Sequence[Any], now: Sequence[Any]) -> str:
    """Return the first part that differs, as it was and as it is."""
    before, after = next(pair for pair in zip_longest(then, now) if pair[0] != pair[1])
    return f"was {before or 'nothing'}, is {after or 'nothing'}"


def _transitions(env: LearnerEnv, episode: RecordedEpisode) -> TensorDict:
    count = [episode.steps]
    last = torch.zeros(*count, 1, dtype=torch.bool)
    last[-1] = True
    state = np.concatenate([episode.observations[role] for role in env.care_env.cast], axis=1)
    ended = {"done": last, "terminated": last & episode.ending[0]}
    root = TensorDict({"state": torch.from_numpy(state[:-1])}, count)
    after = TensorDict({"state": torch.from_numpy(state[1:]), **ended}, count)
    for group, roles in env.groups.items():
        seen = torch.from_numpy(np.stack([episode.observations[role] for role in roles], axis=1))
        done = np.stack([episode.actions[role] for role in roles], axis=1)
        action = torch.from_numpy(
            np.clip(done, env.layout.action_lows[group], 1.0).astype(np.float32)
        )
        paid = np.stack([episode.rewards(role) for role in roles], axis=1)[..., None]
        own = {name: value[:, None].expand(-1, len(roles), 1) for name, value in ended.items()}
        own |= {"reward": torch.from_numpy(paid.astype(np.float32)), "observation": seen[1:]}
        parts = {"observation": seen[:-1], "action": action, "meant": action}
        root[group] = TensorDict(parts, count)
        after[group] = TensorDict(own, count)
    root["next"] = after
    return root


def _seen(env: LearnerEnv) -> TensorDict:
    """Return copies of what is observed now."""
    out = TensorDict({}, batch_size=[])
    for group in env.groups:
        out[group] = TensorDict(
            {"observation": torch.from_numpy(env.observation[group].copy())}, batch_size=[]
        )
    out["state"] = torch.from_numpy(env.state.copy())
    return out
