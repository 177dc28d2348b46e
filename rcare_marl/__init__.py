"""Multi-agent caregiving environments: people with real mobility limitations, robots, care tasks.

Example:
    >>> import rcare_marl
    >>> env = rcare_marl.make("feeding")  # a PettingZoo parallel environment
    >>> observations, infos = env.reset(seed=0)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rcare_marl.envs import make, register_task, task_names

__version__ = "0.1.0"
__all__ = ["make", "register_task", "task_names"]


def __getattr__(name: str) -> object:
    # Loaded at first use, so that importing a single module of the package stays cheap (PEP 562).
    if name in __all__:
        from rcare_marl import envs

        return getattr(envs, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
