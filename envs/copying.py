"""Copies of an environment: made anew by its recipe, then played up to where it stands."""

from __future__ import annotations

import copy
import inspect
import pickle
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from rcare_marl.agents.agent import Array
from rcare_marl.errors import ConfigError, EpisodeError

if TYPE_CHECKING:
    from .care_env import CareEnv


class Past:
    """How an environment was made, and what the learners did since its reset.

    Policies are made anew and decide again, so that what they remember is copied too.
    """

    def __init__(self, env: CareEnv, make: partial[CareEnv]) -> None:
        """Begin to watch an environment that `make` makes again."""
        self.make = make
        self._options: Any = None
        self._actions: list[dict[str, Array]] = []
        env.watchers.append(self._note)

    def _note(self, env: CareEnv) -> None:
        if env.world.step_count == 0:
            self._options, self._actions = env.task.options, []
        else:
            self._actions.append({role: env.commands[role] for role in env.possible_agents})

    def __str__(self) -> str:
        """Return the call that makes it again, without what is as usual."""
        usual = {
            name: each.default
            for name, each in inspect.signature(self.make.func).parameters.items()
        }
        given = {n: v for n, v in self.make.keywords.items() if n not in usual or v != usual[n]}
        said = [*map(repr, self.make.args), *(f"{name}={value!r}" for name, value in given.items())]
        return f"rcare_marl.make({', '.join(said)})"

    def state(self, env: CareEnv) -> tuple[Any, ...]:
        """Return the arguments of `made_again`; EpisodeError if the environment is closed."""
        if env.world.client < 0:
            raise EpisodeError("the environment is closed: there is nothing to copy")
        begun = None
        if env.has_begun:
            begun = env.seed, self._options, tuple(self._actions), _everything(env)
        return self.make, copy.deepcopy(env.seeds), begun


class ByRecipe:
    """Lets an environment be copied and pickled by its recipe, and closed by `with`.

    Attributes:
        past: How it was made and played; None if `rcare_marl.make` did not make it.
    """

    past: Past | None = None

    def close(self) -> None:
        """Free what it holds."""

    def __repr__(self) -> str:
        return object.__repr__(self) if self.past is None else f"<{self.past}>"

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _state(self) -> tuple[Any, ...]:
        if self.past is None:
            raise ConfigError(
                "only environments of rcare_marl.make() can be copied or pickled: this one has no recipe"
            )
        return self.past.state(self)  # type: ignore[arg-type]

    def __copy__(self) -> Any:
        return made_again(*self._state())

    def __deepcopy__(self, _: Mapping[int, Any]) -> Any:
        return made_again(*self._state())

    def __reduce__(self) -> tuple[Any, ...]:
        state = self._state()
        try:
            pickle.dumps(state)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise ConfigError(
                f"this environment cannot be pickled, for it was made with what cannot: {error}. Name "
                "policies, or send an EnvRecipe of rcare_marl.envs.learning"
            ) from error
        return made_again, state


def made_again(make: Callable[[], CareEnv], seeds: np.random.Generator, begun: Any) -> CareEnv:
    """Return a new environment in the state of another one.

    Args:
        make: Makes it.
        seeds: Draws its coming seeds.
        begun: Seed, settings, actions of the learners and state of the running episode; None before it.

    Raises:
        EpisodeError: If that does not lead there: it was changed by more than `reset` and `step`.
    """
    env = make()
    try:
        if begun is not None:
            seed, options, actions, wanted = begun
            if options != env.task.options:
                env.task.change_options(options)
            env.reset(seed=seed)
            for action in actions:
                env.step(action)
            if not np.array_equal(_everything(env), wanted, equal_nan=True):
                raise EpisodeError(
                    "this environment cannot be copied: its seed and its actions do not lead to where it "
                    "stands, so something beside reset() and step() changed it"
                )
        env.seeds = seeds
    except BaseException:
        env.close()
        raise
    return env


def _everything(env: CareEnv) -> Array:
    """Return what all roles observe and where all bodies are."""
    return np.concatenate([env.state(), *(body.state().ravel() for body in env.world.bodies)])
