"""Learning algorithms on TorchRL's losses, with config dataclasses."""

from .algorithm import (
    Algorithm,
    algorithm_class,
    algorithm_names,
    config_class,
    make_algorithm,
    register_algorithm,
)
from .network import ActorArrays, GroupShape

__all__ = [
    "ActorArrays",
    "Algorithm",
    "GroupShape",
    "algorithm_class",
    "algorithm_names",
    "config_class",
    "make_algorithm",
    "register_algorithm",
]
