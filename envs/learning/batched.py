"""Many environments as one TorchRL environment."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from rcare_marl.errors import ActionError, ConfigError, EpisodeError, check_name

from .learner_env import STAGE
from .recipe import EnvRecipe
from .station import Face
from .worker import Crew, check_batch, check_whole

DONE = ("done", "terminated", "truncated")


class BatchedEnv(EnvBase):
    """A batch of environments of one recipe; see docs/learning_environments.md for its keys.

    An episode that is over is followed by the next one at once: `next` holds its true end, and the
    reset that TorchRL asks for then hands over what the next one begins with.

    Attributes:
        recipe: What the environments are made of.
        count: How many there are.
        layout: What the arrays hold: groups, observed quantities, sizes.
        groups: The learned roles by group.
    """

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
            ConfigError: If a number is impossible, a learner observes pictures, or the spaces of two
                variants differ.
            UnknownNameError: If a name does not exist.
            WorkerError: If a worker fails otherwise.
        """
        check_batch(recipe, count, workers, seed)
        super().__init__(device=torch.device("cpu"), batch_size=torch.Size([count]))
        self._crew = Crew(recipe, count=count, workers=workers, seed=seed)
        self.is_closed = False
        self.recipe, self.count = recipe, count
        self.layout, self.groups = self._crew.layout, self._crew.layout.groups
        self._seed, self._stage = seed, dict[str, float]()
        self._make_specs()

    @property
    def group_map(self) -> dict[str, list[str]]:
        """The learned roles by group, as TorchRL's multi-agent environments have it."""
        return {group: list(roles) for group, roles in self.groups.items()}

    def _make_specs(self) -> None:
        lay, root = self.layout, self.batch_size
        seen, acts, rewards = Composite(shape=root), Composite(shape=root), Composite(shape=root)
        ends = Composite({name: _flag(_joined(root, 1)) for name in DONE}, shape=root)
        seen["state"] = Unbounded(_joined(root, lay.state_size))
        seen["success"] = Unbounded(_joined(root, 1))
        for group, roles in lay.groups.items():
            shape = _joined(root, len(roles))
            seen[group] = Composite(
                observation=Unbounded(_joined(shape, lay.observation_sizes[group])),
                mask=Binary(shape=shape, dtype=torch.bool),
                cost=Unbounded(_joined(shape, 1)),
                shape=shape,
            )
            low, size = lay.action_lows[group], lay.action_sizes[group]
            acts[group] = Composite(action=Bounded(low, 1.0, _joined(shape, size)), shape=shape)
            rewards[group] = Composite(reward=Unbounded(_joined(shape, 1)), shape=shape)
            ends[group] = Composite({name: _flag(_joined(shape, 1)) for name in DONE}, shape=shape)
        self.observation_spec, self.action_spec = seen, acts
        self.reward_spec = rewards
        self.done_spec = ends  # type: ignore[misc]  # its setter is not seen

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        """Begin episodes where `_reset` says so, in all environments without it.

        Environments that were not stepped since their episode began stay in it.
        """
        self._check_open()
        wanted = None if tensordict is None else tensordict.get("_reset", None)
        self._crew.call("begin", None if wanted is None else wanted.numpy().reshape(-1))
        running = np.zeros((self.count, 1), np.bool_)
        return self._told(self._crew.board.first, running, running)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        self._check_open()
        board = self._crew.board
        for group, place in board.action.items():
            given = tensordict.get((group, "action")).detach().numpy()
            if not np.isfinite(given).all():  # before anything moves
                raise ActionError(f"actions of {group!r} must be finite")
            place[...] = given
        self._crew.call("step")
        out = self._told(board.after, board.terminated, board.truncated)
        for group, reward in board.reward.items():
            out[group].set("reward", torch.from_numpy(reward.copy()))
        return out

    def _told(self, face: Face, terminated: Any, truncated: Any) -> TensorDict:
        """Return copies of what the environments show, and whether their episodes are over."""
        root: dict[str, Any] = {
            "state": torch.from_numpy(face.state.copy()),
            "success": torch.from_numpy(face.success.copy()),
        }
        ends = dict(zip(DONE, (terminated | truncated, terminated, truncated), strict=True))
        for group, roles in self.groups.items():
            shape = (self.count, len(roles))
            root[group] = TensorDict(
                {
                    "observation": torch.from_numpy(face.observation[group].copy()),
                    "mask": torch.ones(shape, dtype=torch.bool),  # all stay to the end
                    "cost": torch.from_numpy(face.cost[group].copy()),
                    **{
                        k: torch.from_numpy(v[:, None].repeat(shape[1], 1)) for k, v in ends.items()
                    },
                },
                shape,
            )
        root |= {name: torch.from_numpy(value.copy()) for name, value in ends.items()}
        return TensorDict(root, self.batch_size)

    def _set_seed(self, seed: int | None) -> None:
        self._check_open()
        check_whole("seed", seed, 0)
        assert seed is not None
        self._seed = seed
        self._crew.call("seed", seed)

    def set_stage(self, stage: Mapping[str, float]) -> None:
        """Set what a curriculum changes, in each environment from its next episode on.

        Args:
            stage: `spread`, the share of the randomisation at reset; `tolerance` and `force`, factors
                on what counts as success and on the force limit. What is left out is 1.

        Raises:
            UnknownNameError: If there is another key.
            ConfigError: If a value is out of its range, or the task has no stages.
        """
        self._check_open()
        for key, value in stage.items():
            check_name("key of a stage", key, STAGE)
            if not isinstance(value, int | float) or not np.isfinite(value):
                raise ConfigError(f"{key} of a stage must be a finite number, got {value!r}")
        values = {key: float(value) for key, value in stage.items()}
        self._crew.call("set_stage", values)
        self._stage = values

    def state_dict(self) -> dict[str, Any]:  # type: ignore[override]  # it has no parameters
        """Return where every environment is: numbers, and tensors for what is long.

        What a scene shows is a function of the seed, the stage and the actions of each episode that it
        has seen since it was made, so these are enough; see `station.RENEWAL`.
        """
        self._check_open()
        rows = [row for each in self._crew.call("records") for row in each]
        for row in rows:
            for each in (row, *row["past"]):
                each["actions"] = torch.from_numpy(each["actions"])
            row["state"] = torch.from_numpy(row["state"])
        return {"seed": self._seed, "stage": dict(self._stage), "environments": rows}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:  # type: ignore[override]
        """Bring every environment to where it was; the next full `reset` hands that over.

        It takes the time of as many steps as the scenes have seen, some 1500 of each at most.

        Args:
            state: What `state_dict` gave, of a batch of the same recipe and count.

        Raises:
            ConfigError: If it does not fit.

        Warns:
            RuntimeWarning: If a replay leads elsewhere, as on another processor.
        """
        self._check_open()
        rows = [self._row(state, place) for place in range(len(state["environments"]))]
        if len(rows) != self.count:
            raise ConfigError(f"the state is of {len(rows)} environments, here are {self.count}")
        lay = self.layout
        width = sum(len(roles) * lay.action_sizes[g] for g, roles in lay.groups.items())
        for row in rows:
            shapes = (each["actions"].shape for each in (row, *row["past"]))
            found = next((size for steps, size in shapes if steps), width)
            if (found, len(row["state"])) != (width, lay.state_size):
                raise ConfigError(
                    f"the state is of environments with {found} action values and {len(row['state'])} "
                    f"state values, these have {width} and {lay.state_size}: another recipe"
                )
        self._seed, self._stage = state["seed"], dict(state["stage"])
        self._crew.call("set_stage", self._stage)
        astray = [
            place for each in self._crew.call("restore", (self._seed, rows)) for place in each
        ]
        if astray:
            warnings.warn(
                f"environments {astray} do not replay alike here: training will not go on bit for bit",
                RuntimeWarning,
                stacklevel=2,
            )

    @staticmethod
    def _row(state: Mapping[str, Any], place: int) -> dict[str, Any]:
        """Return what `Station.restore` takes, of one environment in what `state_dict` gave."""
        row = dict(state["environments"][place])
        past = [{**each, "actions": each["actions"].numpy()} for each in row["past"]]
        now = {"actions": row["actions"].numpy(), "state": row["state"].numpy(), "past": past}
        return {**row, **now}

    def _check_open(self) -> None:
        if self.is_closed:
            raise EpisodeError("the environments are closed: make new ones")

    def close(self, *, raise_if_closed: bool = False) -> None:
        """End the workers and free the scenes; safe to call twice.

        Args:
            raise_if_closed: Whether the second call is an error.

        Raises:
            EpisodeError: If it is.
        """
        if raise_if_closed:
            self._check_open()
        self.is_closed = True
        self._crew.close()


def _joined(shape: torch.Size, last: int) -> torch.Size:
    return torch.Size([*shape, last])


def _flag(shape: torch.Size) -> Binary:
    return Binary(shape=shape, dtype=torch.bool)
