"""Several environments that are stepped one after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from .board import Board, Bools
from .learner_env import Floats, Layout, LearnerEnv
from .recipe import EnvRecipe

FIRST_SEED = 2**31  # evaluation has the seeds below


def episode_seed(seed: int, place: int, episode: int) -> int:
    """Return the seed of an episode, 2^31 to 2^32: never one that evaluation uses.

    Args:
        seed: Of the batch.
        place: Number of the environment in the batch.
        episode: Number of the episode in that environment.
    """
    drawn = np.random.SeedSequence([seed, place, episode]).generate_state(1)[0]
    return FIRST_SEED + (int(drawn) >> 1)


@dataclass
class Record:
    """What brings an environment back to where it is: its episode is replayed from it.

    Attributes:
        episode: Number of the running episode, -1 before the first.
        stage: The curriculum's stage that it was reset with.
        actions: Of each step so far, shape [all action values].
    """

    episode: int = -1
    stage: dict[str, float] = field(default_factory=dict)
    actions: list[Floats] = field(default_factory=list)


class Station:
    """Some of the environments of a batch; those whose episode is over begin the next one at once."""

    def __init__(self, recipe: EnvRecipe, seed: int, places: Sequence[int]) -> None:
        """Build the scenes.

        Args:
            recipe: What they are made of.
            seed: Of the batch.
            places: Their numbers in the batch.
        """
        self._seed, self._places = seed, tuple(places)
        self._stage: dict[str, float] = {}
        self._board: Board | None = None
        self._envs: list[LearnerEnv] = []
        try:
            for place in places:
                self._envs.append(LearnerEnv(recipe, place))
        except BaseException:
            self.close()
            raise
        self._records = [Record() for _ in places]
        # Whose `first` is what they show now: they have not been stepped since it was written.
        self._is_fresh = [False for _ in places]

    def layouts(self) -> list[Layout]:
        """Return the layout of each environment."""
        return [env.layout for env in self._envs]

    def attach(self, board: Board) -> None:
        """Use these arrays from now on."""
        self._board = board

    def seed(self, seed: int) -> None:
        """Begin again with the episodes of another seed, at the next `begin`."""
        self._seed = seed
        self._records = [Record() for _ in self._envs]
        self._is_fresh = [False for _ in self._envs]

    def set_stage(self, stage: Mapping[str, float]) -> None:
        """Use a curriculum's stage from the next episodes on."""
        for env in self._envs:
            env.prepare(stage)  # which refuses what cannot be
        self._stage = dict(stage)

    def begin(self, chosen: Bools | None) -> None:
        """Begin an episode in the chosen environments, in all if None.

        Those that were not stepped since their episode began stay in that.

        Args:
            chosen: For each environment of the batch, shape [count].
        """
        for k, place in enumerate(self._places):
            if (chosen is None or chosen[place]) and not self._is_fresh[k]:
                self._begin_next(k)

    def _begin_next(self, k: int) -> None:
        record = Record(self._records[k].episode + 1, dict(self._stage))
        self._records[k] = record
        self._reset(k)
        self._show_first(k)

    def _reset(self, k: int) -> None:
        record = self._records[k]
        seed = episode_seed(self._seed, self._places[k], record.episode)
        self._envs[k].reset(seed, record.stage)

    def _show_first(self, k: int) -> None:
        assert self._board is not None  # attached before the first episode
        self._board.first.show(self._places[k], self._envs[k])
        self._is_fresh[k] = True

    def step(self, _: None = None) -> None:
        """Take every environment's actions from the board and write what they lead to."""
        board = self._board
        assert board is not None
        for k, (place, env) in enumerate(zip(self._places, self._envs, strict=True)):
            actions = {group: values[place] for group, values in board.action.items()}
            self._records[k].actions.append(np.concatenate([a.ravel() for a in actions.values()]))
            env.step(actions)
            self._is_fresh[k] = False
            board.after.show(place, env)
            for group, reward in env.reward.items():
                board.reward[group][place, :, 0] = reward
            board.terminated[place] = env.terminated
            board.truncated[place] = env.truncated
            if env.terminated or env.truncated:
                self._begin_next(k)

    def records(self, _: None = None) -> list[dict[str, Any]]:
        """Return for each environment what `restore` needs, actions of shape [steps, all values]."""
        return [
            {
                "episode": record.episode,
                "stage": dict(record.stage),
                "actions": np.stack(record.actions) if record.actions else np.zeros((0, 0)),
                "state": env.state.copy(),
            }
            for record, env in zip(self._records, self._envs, strict=True)
        ]

    def restore(self, saved: tuple[int, Sequence[Mapping[str, Any]]]) -> list[int]:
        """Bring every environment to where it was, by replaying its episode.

        Return the places of those whose replay leads elsewhere: numbers differ in the last place
        between processors and versions, and contacts magnify that.

        Args:
            saved: The seed of the batch, and what `records` gave of each environment of the batch.
        """
        self._seed, rows = saved
        astray = []
        for k, place in enumerate(self._places):
            row = rows[place]
            actions = np.asarray(row["actions"], np.float32)
            self._records[k] = Record(row["episode"], dict(row["stage"]), list(actions))
            self._is_fresh[k] = False
            if row["episode"] < 0:
                continue
            self._reset(k)
            if not self._replay(k, actions) or not np.array_equal(
                self._envs[k].state, row["state"]
            ):
                astray.append(place)
            if not self._is_fresh[k]:
                self._show_first(k)
        return astray

    def _replay(self, k: int, actions: npt.NDArray[np.float32]) -> bool:
        """Step an environment through recorded actions; return False if its episode ends on the way."""
        env = self._envs[k]
        for row in actions:
            ends = np.cumsum([len(r) * env.action_sizes[g] for g, r in env.groups.items()])
            pieces = zip(env.groups.items(), np.split(row, ends[:-1]), strict=True)
            env.step({group: piece.reshape(len(roles), -1) for (group, roles), piece in pieces})
            if env.terminated or env.truncated:
                self._begin_next(k)
                return False
        return True

    def close(self) -> None:
        """Free all scenes; safe to call twice."""
        for env in self._envs:
            env.close()
