"""PettingZoo's way in: `group_coaching_v0.parallel_env()`, with arguments as for `rcare_marl.make`."""

from functools import partial

from . import make

parallel_env = partial(make, "group_coaching")

__all__ = ["parallel_env"]
