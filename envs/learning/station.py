"""Several environments that are stepped in one process, and the arrays that learners see of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np
import numpy.typing as npt

from .learner_env import Floats, Layout, LearnerEnv, step_together
from .recipe import EnvRecipe

FIRST_SEED = 2**31  # evaluation has the seeds below
# Steps after which a scene is made anew when its episode is over. In Bullet it keeps a trace of what was
# played in it: after eaten food, say, Bullet sorts contacts otherwise, and an episode in eight differs by
# 1e-8 m or less. So where an environment is follows from all that its scene has seen, and that must be
# short enough to be played again.
# Making a scene costs as much as 12 (PhyRC bathing) to 220 steps (limb repositioning). Our own choice.
RENEWAL = 1_500


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
    """From which an episode can be played again.

    Attributes:
        episode: Its number in the environment, -1 before the first.
        seed: Its seed.
        stage: The curriculum's stage that it was reset with.
        actions: Of each step so far, shape [all action values].
    """

    episode: int = -1
    seed: int = 0
    stage: dict[str, float] = field(default_factory=dict)
    actions: list[Floats] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """Return it with actions of shape [steps, all action values]."""
        actions = np.stack(self.actions) if self.actions else np.zeros((0, 0), np.float32)
        return {**vars(self), "stage": dict(self.stage), "actions": actions}

    @classmethod
    def from_dict(cls, row: Mapping[str, Any]) -> Record:
        """Return the record that `to_dict` gave."""
        actions = list(np.asarray(row["actions"], np.float32))
        return cls(row["episode"], row["seed"], dict(row["stage"]), actions)


Bools = npt.NDArray[np.bool_]
Allocator = Callable[[tuple[int, ...], type[Any]], npt.NDArray[Any]]
ALIGNMENT = 64  # [bytes] a cache line: no two arrays share one


class Face:
    """What learners see of `count` environments at one moment.

    Attributes:
        observation: For each group, shape [count, roles, observation size].
        cost: For each group, shape [count, roles, 1].
        state: Shape [count, state size].
        success: 1 where the goal is reached, shape [count, 1].
    """

    def __init__(self, layout: Layout, count: int, allocate: Allocator) -> None:
        """Allocate arrays for environments of one layout."""
        sizes = layout.observation_sizes
        self.observation: dict[str, Floats] = {
            group: allocate((count, len(roles), sizes[group]), np.float32)
            for group, roles in layout.groups.items()
        }
        self.cost: dict[str, Floats] = {
            group: allocate((count, len(roles), 1), np.float32)
            for group, roles in layout.groups.items()
        }
        self.state: Floats = allocate((count, layout.state_size), np.float32)
        self.success: Floats = allocate((count, 1), np.float32)

    def show(self, place: int, env: LearnerEnv) -> None:
        """Write what one environment shows now."""
        for group, seen in env.observation.items():
            self.observation[group][place] = seen
            self.cost[group][place, :, 0] = env.cost[group]
        self.state[place] = env.state
        self.success[place] = env.success


class Board:
    """All arrays of a batch of environments, in one block.

    Attributes:
        name: Of the shared memory; empty in memory of one's own.
        first: What is seen at the start of the running episode.
        after: What the last step led to, also where that was an episode's end.
        action: For each group, shape [count, roles, action size].
        reward: For each group, shape [count, roles, 1].
        terminated: Shape [count, 1].
        truncated: Shape [count, 1].
    """

    def __init__(
        self, layout: Layout, count: int, *, is_shared: bool = False, name: str = ""
    ) -> None:
        """Allocate a block, or attach to one.

        Args:
            layout: Of every environment.
            count: How many there are.
            is_shared: Whether to allocate memory that other processes can attach to.
            name: Of the shared memory to attach to.
        """
        self._memory: SharedMemory | None = None
        self._is_owner = not name
        if is_shared or name:
            size = 0

            def measure(shape: tuple[int, ...], kind: type[Any]) -> npt.NDArray[Any]:
                nonlocal size
                size = _aligned(size) + math.prod(shape) * np.dtype(kind).itemsize
                return np.empty(0, kind)

            self._lay_out(layout, count, measure)
            self._memory = SharedMemory(name=name or None, create=not name, size=max(size, 1))
        self.name = self._memory.name if self._memory is not None else ""
        self._lay_out(layout, count, np.zeros if self._memory is None else _carver(self._memory))

    def _lay_out(self, layout: Layout, count: int, allocate: Allocator) -> None:
        groups = layout.groups.items()
        self.first, self.after = Face(layout, count, allocate), Face(layout, count, allocate)
        self.action: dict[str, Floats] = {
            group: allocate((count, len(roles), layout.action_sizes[group]), np.float32)
            for group, roles in groups
        }
        self.reward: dict[str, Floats] = {
            group: allocate((count, len(roles), 1), np.float32) for group, roles in groups
        }
        self.terminated: Bools = allocate((count, 1), np.bool_)
        self.truncated: Bools = allocate((count, 1), np.bool_)

    def close(self) -> None:
        """Let go of the memory, and free it if it was allocated here; safe to call twice."""
        memory, self._memory = self._memory, None
        if memory is None:
            return
        for name in ("first", "after", "action", "reward", "terminated", "truncated"):
            delattr(self, name)  # shared memory cannot be closed while arrays lie in it
        memory.close()
        if self._is_owner:
            memory.unlink()


def _aligned(offset: int) -> int:
    return -(-offset // ALIGNMENT) * ALIGNMENT


def _carver(memory: SharedMemory) -> Allocator:
    """Return what cuts arrays from a block, always at the same places for the same layout."""
    offset = 0

    def carve(shape: tuple[int, ...], kind: type[Any]) -> npt.NDArray[Any]:
        nonlocal offset
        start = _aligned(offset)
        offset = start + math.prod(shape) * np.dtype(kind).itemsize
        return np.ndarray(shape, kind, buffer=memory.buf, offset=start)

    return carve


class Station:
    """Some of the environments of a batch; those whose episode is over begin the next one at once."""

    def __init__(self, recipe: EnvRecipe, seed: int, places: Sequence[int]) -> None:
        """Build the scenes.

        Args:
            recipe: What they are made of.
            seed: Of the batch.
            places: Their numbers in the batch.
        """
        self._recipe, self._seed, self._places = recipe, seed, tuple(places)
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
        self._past: list[list[Record]] = [[] for _ in places]  # what each scene has seen before
        is_new = all(env.care_env.company is not None for env in self._envs)  # in each episode
        self._keeps_traces = recipe.engine == "bullet" and not is_new
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
        for k in range(len(self._envs)):
            self._remember(k)
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
        self._remember(k)
        decisions = sum(len(record.actions) for record in self._past[k])
        if decisions * self._recipe.hold >= RENEWAL:
            self._renew(k)
        number = self._records[k].episode + 1
        seed = episode_seed(self._seed, self._places[k], number)
        self._records[k] = Record(number, seed, dict(self._stage))
        self._envs[k].reset(seed, self._records[k].stage)
        self._show_first(k)

    def _remember(self, k: int) -> None:
        """Put the running episode, if there is one, among what the scene has seen and keeps traces of."""
        if self._keeps_traces and self._records[k].episode >= 0:
            self._past[k].append(self._records[k])

    def _renew(self, k: int) -> None:
        """Make the scene of an environment anew, which has then seen nothing."""
        self._envs[k].close()
        self._envs[k] = LearnerEnv(self._recipe, self._places[k])
        self._past[k] = []

    def _show_first(self, k: int) -> None:
        assert self._board is not None  # attached before the first episode
        self._board.first.show(self._places[k], self._envs[k])
        self._is_fresh[k] = True

    def step(self, chosen: Bools | None) -> None:
        """Take actions from the board and write what they lead to, in the chosen environments.

        Args:
            chosen: For each environment of the batch, shape [count]; all of them if None.
        """
        board = self._board
        assert board is not None
        told: list[dict[str, Floats]] = []
        stepped = [k for k, at in enumerate(self._places) if chosen is None or chosen[at]]
        for k in stepped:
            actions = {group: values[self._places[k]] for group, values in board.action.items()}
            self._records[k].actions.append(np.concatenate([a.ravel() for a in actions.values()]))
            told.append(actions)
        step_together([self._envs[k] for k in stepped], told)
        for k in stepped:
            place, env = self._places[k], self._envs[k]
            self._is_fresh[k] = False
            board.after.show(place, env)
            for group, reward in env.reward.items():
                board.reward[group][place, :, 0] = reward
            board.terminated[place] = env.terminated
            board.truncated[place] = env.truncated
            if env.terminated or env.truncated:
                self._begin_next(k)

    def records(self, _: None = None) -> list[dict[str, Any]]:
        """Return for each environment what `restore` needs, actions of shape [steps, all values].

        `past` holds the episodes that its scene has seen before the running one.
        """
        return [
            {
                **record.to_dict(),
                "past": [each.to_dict() for each in past],
                "state": env.state.copy(),
            }
            for record, past, env in zip(self._records, self._past, self._envs, strict=True)
        ]

    def restore(self, saved: tuple[int, Sequence[Mapping[str, Any]]]) -> list[int]:
        """Bring every environment to where it was, by replaying in a new scene what its scene has seen.

        Return the places of those whose replay leads elsewhere: numbers differ in the last place
        between processors and versions, and contacts magnify that.

        Args:
            saved: The seed of the batch, and what `records` gave of each environment of the batch.
        """
        self._seed, rows = saved
        astray = []
        for k, place in enumerate(self._places):
            row = rows[place]
            if self._records[k].episode >= 0 or self._past[k]:
                self._renew(k)
            self._past[k] = [Record.from_dict(each) for each in row["past"]]
            self._records[k] = Record.from_dict(row)
            self._is_fresh[k] = False
            for record in self._past[k]:
                self._replay(k, record)
            if row["episode"] < 0:
                continue
            is_running = self._replay(k, self._records[k])
            if not is_running or not np.array_equal(self._envs[k].state, row["state"]):
                astray.append(place)
            if is_running:
                self._show_first(k)
            else:
                self._begin_next(k)
        return astray

    def _replay(self, k: int, record: Record) -> bool:
        """Play an episode again; return whether it still runs after its recorded actions.

        If it ends before, what is left of them is dropped.
        """
        env = self._envs[k]
        env.reset(record.seed, record.stage)
        for number, row in enumerate(record.actions):
            sizes = env.layout.action_sizes
            ends = np.cumsum([len(r) * sizes[g] for g, r in env.groups.items()])
            pieces = zip(env.groups.items(), np.split(row, ends[:-1]), strict=True)
            env.step({group: piece.reshape(len(roles), -1) for (group, roles), piece in pieces})
            if env.terminated or env.truncated:
                del record.actions[number + 1 :]
                return False
        return True

    def close(self) -> None:
        """Free all scenes; safe to call twice."""
        for env in self._envs:
            env.close()
