"""Multi-agent caregiving environments: people with real mobility limitations, robots, care tasks.

Example:
    >>> import rcare_marl
    >>> env = rcare_marl.make("feeding")  # a PettingZoo parallel environment
    >>> observations, infos = env.reset(seed=0)
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium

if TYPE_CHECKING:
    from rcare_marl.agents.people.sampling.sampler import sample_person
    from rcare_marl.envs import (
        CareHome,
        home_names,
        make,
        policy_names,
        register_policy,
        register_task,
        task_names,
    )
    from rcare_marl.envs.learning import make_batch, make_vector

__version__ = "0.1.0"
__all__ = [
    "CareHome",
    "home_names",
    "make",
    "make_batch",
    "make_vector",
    "policy_names",
    "register_policy",
    "register_task",
    "sample_person",
    "task_names",
]
BATCHES = ("make_batch", "make_vector")


def __getattr__(name: str) -> object:
    if name == "sample_person":
        from rcare_marl.agents.people.sampling import sampler

        return sampler.sample_person
    # Loaded at first use, so that importing a single module of the package stays cheap (PEP 562).
    if name in BATCHES:
        from rcare_marl.envs import learning

        return getattr(learning, name)
    if name in __all__:
        from rcare_marl import envs

        return getattr(envs, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])


def _register_gymnasium_ids() -> None:
    """Make `gymnasium.make("rcare_marl/Feeding-v0")` work: one id a file of `envs/tasks`."""
    folder = Path(__file__).parent / "envs" / "tasks"
    if not folder.is_dir():  # an installed checkout without links maps the folder elsewhere
        from importlib.util import find_spec

        spec = find_spec("rcare_marl.envs")
        assert spec is not None and spec.origin is not None
        folder = Path(spec.origin).parent / "tasks"
    for file in sorted(folder.glob("[a-z]*.py")):
        title = "".join(word.capitalize() for word in file.stem.split("_"))
        gymnasium.register(
            f"rcare_marl/{title}-v0",
            entry_point="rcare_marl.envs.gym:SingleAgentEnv",
            kwargs={"task": file.stem},
        )


_register_gymnasium_ids()
