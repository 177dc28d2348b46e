"""What every learning algorithm offers to the trainer, and which ones there are."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import entry_points
from typing import Any, Protocol

from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase

from rcare_marl.errors import ConfigError, check_name

from .network import ActorArrays

# Name -> algorithm, its settings. Loaded when asked for: TorchRL takes seconds to import.
_HERE = __package__
_ALGORITHMS = {
    "sac": (f"{_HERE}.sac:Sac", f"{_HERE}.off_policy:OffPolicyConfig"),
    "tqc": (f"{_HERE}.sac:Tqc", f"{_HERE}.sac:TqcConfig"),
    "masac": (f"{_HERE}.sac:Masac", f"{_HERE}.off_policy:OffPolicyConfig"),
    "ppo": (f"{_HERE}.on_policy:Ppo", f"{_HERE}.on_policy:OnPolicyConfig"),
    "ippo": (f"{_HERE}.on_policy:Ippo", f"{_HERE}.on_policy:OnPolicyConfig"),
    "mappo": (f"{_HERE}.on_policy:Mappo", f"{_HERE}.on_policy:OnPolicyConfig"),
    "dagger": (f"{_HERE}.dagger:Dagger", f"{_HERE}.dagger:DaggerConfig"),
}


class Algorithm(Protocol):
    """Learns the policies of all groups from collected batches.

    It is built as `Algorithm(config, env, seed=0)`; of the environment only its specs are read.
    Chance while learning comes from torch's global generator.
    """

    @property
    def updates(self) -> int:
        """How many updates were done, of all groups together."""
        ...

    def policy(self) -> TensorDictModuleBase:
        """Return the module that writes (group, "action"); it explores as TorchRL's type says."""
        ...

    def learn(self, batch: TensorDictBase) -> dict[str, float]:
        """Learn from a batch [environments, steps] and return losses and other figures."""
        ...

    def add_demonstrations(self, demonstrations: TensorDictBase) -> dict[str, float]:
        """Take transitions [M] of the layout of batches; return what learning from them gave."""
        ...

    def actor_arrays(self) -> dict[str, ActorArrays]:
        """Return each group's actor as arrays."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Return everything that changes, of tensors and plain values only."""
        ...

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take back what `state_dict` gave."""
        ...


def register_algorithm(name: str, algorithm: str, config: str) -> None:
    """Make an algorithm known by a name, for `--algo` and `TrainConfig`.

    A package that is installed makes its own known through the entry point group `rcare_marl.algorithms`:
    a module of it that calls this function.

    Args:
        name: What to call it.
        algorithm: Where its class is, an `Algorithm`: `module:Class`.
        config: Where the dataclass of its settings is, likewise.

    Raises:
        ConfigError: If the name is taken by another one.
    """
    given = (algorithm, config)
    if _ALGORITHMS.setdefault(name, given) != given:
        raise ConfigError(f"there is an algorithm {name!r} already: {_ALGORITHMS[name][0]}")


def algorithm_names() -> tuple[str, ...]:
    """Return the names of all algorithms."""
    _load_plugins()
    return tuple(_ALGORITHMS)


def algorithm_class(name: str) -> type[Any]:
    """Return the class of an algorithm.

    Raises:
        UnknownNameError: If there is no such algorithm.
    """
    return _load(_find(name)[0])


def config_class(name: str) -> type[Any]:
    """Return the dataclass of an algorithm's settings.

    Raises:
        UnknownNameError: If there is no such algorithm.
    """
    return _load(_find(name)[1])


def make_algorithm(name: str, config: Any, env: Any, *, seed: int) -> Algorithm:
    """Build an algorithm.

    Args:
        name: One of `algorithm_names()`.
        config: An instance of `config_class(name)`.
        env: The environment it will learn in; only its specs are read.
        seed: Of the first weights.

    Raises:
        UnknownNameError: If there is no such algorithm.
        ConfigError: If `config` is of another algorithm, or the environment does not suit.
    """
    wanted = config_class(name)
    if type(config) is not wanted:
        raise ConfigError(
            f"algorithm {name!r} takes {wanted.__name__}, got {type(config).__name__}"
        )
    return algorithm_class(name)(config, env, seed=seed)


def _find(name: str) -> tuple[str, str]:
    _load_plugins()
    check_name("algorithm", name, _ALGORITHMS)
    return _ALGORITHMS[name]


def _load(where: str) -> type[Any]:
    module, _, name = where.partition(":")
    return getattr(importlib.import_module(module), name)


@lru_cache(maxsize=1)
def _load_plugins() -> None:
    for plugin in entry_points(group="rcare_marl.algorithms"):
        plugin.load()
