"""Batches by name: `make_batch` for TorchRL, `make_vector` for Gymnasium."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcare_marl.errors import ConfigError, check_name

from .recipe import PLACE, EnvRecipe, Scale
from .vector import CareVectorEnv

if TYPE_CHECKING:
    from .batched import BatchedEnv

DEVICES = ("cpu",)


def make_batch(
    task: str,
    *,
    num_envs: int = 8,
    processes: int = 0,
    device: str = "cpu",
    engine: str = "mujoco",
    seed: int = 0,
    learners: Sequence[str] = (),
    options: Mapping[str, Any] | None = None,
    policies: Mapping[str, Any] | None = None,
    residual: Mapping[str, Scale] | None = None,
    randomise: Any = None,
    **cast: Any,
) -> BatchedEnv:
    """Return many environments as one of TorchRL's; for its keys see docs/learning_environments.md.

    Args:
        task: A task name, see `rcare_marl.task_names()`.
        num_envs: How many environments.
        processes: Over how many processes they are spread; 0 runs them all in this one.
        device: Where they run: `cpu`.
        engine: What computes the motion: `mujoco` or `bullet`.
        seed: Of the batch, from which each episode has its own.
        learners: Roles that learn; the robots if empty.
        options: Settings of the task.
        policies: Of roles that do not learn: a policy's name or file, or several, of which one is drawn
            for each episode. The default partner where none is given.
        residual: Of roles that learn, the scale of their action on top of the scripted policy's.
        randomise: What is another in each episode, as for `rcare_marl.make`.
        **cast: Who plays and where, as for `rcare_marl.make`. Of a list of several, such as
            `recipient=["karan", "kim"]`, environments take one in turn; of several lists, one of all pairs.

    Raises:
        UnknownNameError: If a name does not exist, or there is no such device.
        ConfigError: If a value is impossible, or the task does not run on the engine.
        MissingPackageError: If MuJoCo is asked for and not installed.
        WorkerError: If a worker fails otherwise.

    Example:
        >>> env = rcare_marl.make_batch("feeding", num_envs=64, processes=2, recipient=["karan", "kim"])
        >>> batch = env.rollout(20, break_when_any_done=False)
    """
    check_name("device of a batch", device, DEVICES)
    recipe = batch_recipe(task, engine, learners, options, policies, residual, cast, randomise)
    from .batched import BatchedEnv  # only now, for it loads torch

    return BatchedEnv(recipe, count=num_envs, workers=processes, seed=seed)


def make_vector(
    task: str,
    *,
    num_envs: int = 8,
    processes: int = 0,
    device: str = "cpu",
    engine: str = "mujoco",
    seed: int = 0,
    role: str = "robot",
    options: Mapping[str, Any] | None = None,
    policies: Mapping[str, Any] | None = None,
    residual: Mapping[str, Scale] | None = None,
    randomise: Any = None,
    **cast: Any,
) -> CareVectorEnv:
    """Return many environments as one Gymnasium `VectorEnv` for a single learner, without torch.

    An episode that is over is followed by the next one in the step after (`AutoresetMode.NEXT_STEP`).

    Args:
        task: A task name.
        num_envs: How many environments.
        processes: Over how many processes they are spread.
        device: Where they run: `cpu`.
        engine: What computes the motion.
        seed: Of the batch, until `reset` is given another one.
        role: The role that learns.
        options: Settings of the task.
        policies: Of the other roles, as for `make_batch`.
        residual: As for `make_batch`.
        randomise: As for `make_batch`.
        **cast: As for `make_batch`.

    Raises:
        UnknownNameError: If a name does not exist, or there is no such device.
        ConfigError: If a value is impossible, or the task does not run on the engine.
        MissingPackageError: If MuJoCo is asked for and not installed.
        WorkerError: If a worker fails otherwise.

    Example:
        >>> env = rcare_marl.make_vector("feeding", num_envs=8, processes=2)
        >>> observations, infos = env.reset(seed=1)
    """
    check_name("device of a batch", device, DEVICES)
    recipe = batch_recipe(task, engine, (role,), options, policies, residual, cast, randomise)
    return CareVectorEnv(recipe, count=num_envs, workers=processes, seed=seed)


def batch_recipe(
    task: str,
    engine: str,
    learners: Sequence[str],
    options: Mapping[str, Any] | None,
    policies: Mapping[str, Any] | None,
    residual: Mapping[str, Scale] | None,
    cast: Mapping[str, Any],
    randomise: Any = None,
) -> EnvRecipe:
    """Return the recipe of a batch; for the arguments see `make_batch`.

    Raises:
        UnknownNameError: If a name does not exist.
        ConfigError: If a value is impossible, or a list of a cast is empty.
    """
    several = {name: value for name, value in cast.items() if isinstance(value, list | tuple)}
    for name, values in several.items():
        if not values or name in PLACE:
            what = "needs at least one entry" if name not in PLACE else "must be one"
            raise ConfigError(f"{name} of a batch {what}, got {values!r}")
    pairs = itertools.product(*several.values()) if several else ()
    given = {} if policies is None else policies
    if not isinstance(given, Mapping):
        raise ConfigError(f"policies must be a mapping, got {type(given).__name__} {given!r}")
    return EnvRecipe(
        task,
        options={} if options is None else options,
        cast={name: value for name, value in cast.items() if name not in several},
        variants=tuple(dict(zip(several, values, strict=True)) for values in pairs),
        learners=tuple(learners),
        partners={role: _named(role, policy) for role, policy in given.items()},
        residual={} if residual is None else residual,
        engine=engine,
        randomise=randomise,
    )


def _named(role: str, policy: Any) -> str | tuple[str, ...]:
    """Return the names of policies of a role, which travel to other processes."""
    if isinstance(policy, str | Path):
        return str(policy)
    if isinstance(policy, list | tuple) and all(isinstance(each, str | Path) for each in policy):
        return tuple(str(each) for each in policy)
    raise ConfigError(
        f"the policy of {role!r} in a batch must be a name, a file, or a list of them, got {policy!r}"
    )
