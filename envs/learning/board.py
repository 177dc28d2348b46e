"""The arrays through which environments and learner pass numbers, in shared memory where need be."""

from __future__ import annotations

import math
from collections.abc import Callable
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np
import numpy.typing as npt

from .learner_env import Floats, Layout, LearnerEnv

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
