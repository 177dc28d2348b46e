"""Episodes of scripted policies, as the transitions that learning begins with."""

from __future__ import annotations

import numpy as np
import torch
from tensordict import TensorDict

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
        ConfigError: If too few attempts succeed.
    """
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
            each = np.stack([players[role].act() for role in roles])
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


def _seen(env: LearnerEnv) -> TensorDict:
    """Return copies of what is observed now."""
    out = TensorDict({}, batch_size=[])
    for group in env.groups:
        out[group] = TensorDict(
            {"observation": torch.from_numpy(env.observation[group].copy())}, batch_size=[]
        )
    out["state"] = torch.from_numpy(env.state.copy())
    return out
