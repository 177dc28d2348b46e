"""What every learning algorithm offers to the trainer, and which ones there are."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any, Protocol

from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase

from rcare_marl.errors import ConfigError, UnknownNameError

from .network import ActorArrays

# Name -> module, class, config class. Loaded when asked for: TorchRL takes seconds to import.
_ALGORITHMS = {
    "sac": ("sac", "Sac", "SacConfig"),
    "tqc": ("tqc", "Tqc", "TqcConfig"),
    "masac": ("masac", "Masac", "MasacConfig"),
    "ppo": ("ppo", "Ppo", "PpoConfig"),
    "ippo": ("ippo", "Ippo", "IppoConfig"),
    "mappo": ("mappo", "Mappo", "MappoConfig"),
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


def algorithm_names() -> tuple[str, ...]:
    """Return the names of all algorithms."""
    return tuple(_ALGORITHMS)


def config_class(name: str) -> type[Any]:
    """Return the dataclass of an algorithm's settings.

    Raises:
        UnknownNameError: If there is no such algorithm.
    """
    module, _, config = _find(name)
    found: type[Any] = getattr(importlib.import_module(f"{__package__}.{module}"), config)
    return found


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
    module, cls, _ = _find(name)
    wanted = config_class(name)
    if not isinstance(config, wanted):
        raise ConfigError(
            f"algorithm {name!r} takes {wanted.__name__}, got {type(config).__name__}"
        )
    made: Algorithm = getattr(importlib.import_module(f"{__package__}.{module}"), cls)(
        config, env, seed=seed
    )
    return made


def _find(name: str) -> tuple[str, str, str]:
    if name not in _ALGORITHMS:
        raise UnknownNameError("algorithm", name, _ALGORITHMS)
    return _ALGORITHMS[name]
