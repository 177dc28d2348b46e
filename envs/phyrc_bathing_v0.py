"""PettingZoo's way in: `phyrc_bathing_v0.parallel_env()`, with arguments as for `rcare_marl.make`."""

from functools import partial

from . import make

parallel_env = partial(make, "phyrc_bathing")

__all__ = ["parallel_env"]
