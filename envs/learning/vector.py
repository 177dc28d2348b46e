"""Many environments as one of Gymnasium's vector environments, for a single learner."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from rcare_marl.errors import ActionError, ConfigError, EpisodeError

from .learner_env import Floats
from .recipe import EnvRecipe
from .station import Face
from .worker import Crew, check_batch, check_whole

Flags = npt.NDArray[np.bool_]
Step = tuple[Floats, npt.NDArray[np.float64], Flags, Flags, dict[str, Any]]
MASK = "reset_mask"  # Gymnasium's name of the one option of `reset`


class CareVectorEnv(gymnasium.vector.VectorEnv[Floats, Floats, npt.NDArray[Any]]):
    """A batch of environments of one recipe with one learner, N of them.

    The step after the end of an episode begins the next one (`AutoresetMode.NEXT_STEP`): its action
    counts for nothing, its reward is 0.

    `infos` holds arrays of shape [N], and under `_name` which of them are new: `success`, 1 where the
    goal is reached, and `cost`, see docs/safety.md.

    Attributes:
        recipe: What the environments are made of.
        role: The role that is learned.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self, recipe: EnvRecipe, *, count: int = 8, workers: int = 0, seed: int = 0
    ) -> None:
        """Build the scenes.

        Args:
            recipe: What they are made of.
            count: How many environments.
            workers: Over how many processes they are spread; 0 runs them all in this one.
            seed: Of the batch, from which each episode has its own.

        Raises:
            ConfigError: If a number is impossible, several roles are left to learn, the learner observes
                pictures, or the spaces of two variants differ.
            UnknownNameError: If a name does not exist.
            WorkerError: If a worker fails otherwise.
        """
        check_batch(recipe, count, workers, seed)
        if len(learning := recipe.learning_roles()) != 1:
            raise ConfigError(
                f"one role must be left to learn here, left are {', '.join(learning)}: name one as "
                "`learners`, or take BatchedEnv for several"
            )
        self._crew = Crew(recipe, count=count, workers=workers, seed=seed)
        self.recipe, self.num_envs, (self.role,) = recipe, count, learning
        layout = self._crew.layout
        (self._group,) = layout.groups
        seen, acts = layout.observation_sizes[self._group], layout.action_sizes[self._group]
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (seen,), np.float32)
        low = layout.action_lows[self._group]
        self.single_action_space = spaces.Box(low, 1.0, (acts,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, count)
        self.action_space = batch_space(self.single_action_space, count)
        self._is_over = np.zeros(count, np.bool_)  # whose next step begins an episode
        self._is_first = np.zeros(count, np.bool_)  # who has just begun one
        self._has_begun = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin episodes in all environments; those that were not stepped since theirs began stay in it.

        Args:
            seed: Of the batch from now on, from which each episode has its own; as it was if None.
            options: `reset_mask`, shape [N]: begin only where it is true, the others go on.

        Raises:
            ConfigError: If the seed is no whole number from 0 on, or there is another option.
            EpisodeError: If the environments are closed, or some of them have yet to begin.
        """
        self._check_open()
        chosen = self._chosen(options or {})
        if seed is not None:
            check_whole("seed", seed, 0)
            if not chosen.all():
                raise ConfigError(f"a seed is of the whole batch: give none beside {MASK!r}")
        if not (self._has_begun or chosen.all()):
            raise EpisodeError(
                "some environments have not begun: call reset() without a mask first"
            )
        super().reset(seed=seed)
        if seed is not None:
            self._crew.call("seed", seed)
        self._crew.call("begin", chosen)
        self._has_begun = True
        self._is_over, self._is_first = self._is_over & ~chosen, self._is_first | chosen
        return self._told()

    def _chosen(self, options: dict[str, Any]) -> Flags:
        if strange := sorted(options.keys() - {MASK}):
            raise ConfigError(f"the only option of reset is {MASK!r}, got {', '.join(strange)}")
        if MASK not in options:
            return np.ones(self.num_envs, np.bool_)
        mask = np.asarray(options[MASK])
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ConfigError(
                f"{MASK} must be {self.num_envs} truth values, got {mask.dtype} of shape {mask.shape}"
            )
        return mask

    def step(self, actions: Floats) -> Step:
        """Let everybody act for one control step, and begin episodes where the last one is over.

        Args:
            actions: Shape [N, action size].

        Raises:
            EpisodeError: If no episode has begun, or the environments are closed.
            ActionError: If the shape is another one or a number is not finite; nothing has moved then.
        """
        self._check_open()
        if not self._has_begun:
            raise EpisodeError("no episode is running: call reset() first")
        given, shape = np.asarray(actions), self.action_space.shape
        if given.shape != shape or not np.isfinite(given).all():
            raise ActionError(f"actions must be finite numbers of shape {shape}, got {given.shape}")
        begun, board = self._is_over, self._crew.board
        board.action[self._group][:, 0] = given
        self._crew.call("step", ~begun if begun.any() else None)
        self._is_first = begun
        observations, infos = self._told()
        rewards = np.where(begun, 0.0, board.reward[self._group][:, 0, 0].astype(np.float64))
        ended, late = board.terminated[:, 0] & ~begun, board.truncated[:, 0] & ~begun
        self._is_over = ended | late
        return observations, rewards, ended, late, infos

    def _told(self) -> tuple[Floats, dict[str, Any]]:
        """Return what is seen and told, of the beginning of an episode or of the last step."""
        first, after, group = self._crew.board.first, self._crew.board.after, self._group

        def of(face: Face) -> tuple[Floats, Floats, Floats]:
            return face.observation[group][:, 0], face.success[:, 0], face.cost[group][:, 0, 0]

        pairs = zip(of(first), of(after), strict=True)
        begun = self._is_first
        seen, success, cost = (
            np.where(begun.reshape(-1, *[1] * (new.ndim - 1)), new, old) for new, old in pairs
        )
        all_new = np.ones(self.num_envs, np.bool_)
        infos = {"success": success, "cost": cost}
        return seen, {**infos, **{f"_{name}": all_new.copy() for name in infos}}

    def _check_open(self) -> None:
        if self.closed:
            raise EpisodeError("the environments are closed: make new ones")

    def render(self) -> None:
        """Refuse: a batch is numbers only.

        Raises:
            EpisodeError: Always.
        """
        raise EpisodeError(
            "a batch draws no pictures: use rcare_marl.make(render_mode='rgb_array')"
        )

    def close_extras(self, **_: Any) -> None:
        """End the workers and free the scenes."""
        self._crew.close()
