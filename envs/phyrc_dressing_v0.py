"""PettingZoo's way in: `phyrc_dressing_v0.parallel_env()`, with arguments as for `rcare_marl.make`."""

from functools import partial

from . import make

parallel_env = partial(make, "phyrc_dressing")

__all__ = ["parallel_env"]
