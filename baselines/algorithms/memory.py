"""Transitions kept for learning, in TorchRL's replay buffer."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from tensordict import TensorDict, TensorDictBase
from torchrl.data import LazyTensorStorage, ReplayBuffer

_TORCHRL = logging.getLogger("torchrl")


class Memory:
    """The latest transitions, drawn from uniformly with torch's global generator.

    Args:
        capacity: How many are kept.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._buffer = ReplayBuffer(storage=LazyTensorStorage(capacity))

    def __len__(self) -> int:
        return len(self._buffer)

    def extend(self, transitions: TensorDictBase) -> None:
        """Add transitions [M]; the oldest give way."""
        level = _TORCHRL.level
        _TORCHRL.setLevel(logging.WARNING)  # it announces each storage on the terminal
        try:
            self._buffer.extend(transitions[-self.capacity :])
        finally:
            _TORCHRL.setLevel(level)

    def sample(self, count: int) -> TensorDictBase:
        """Return `count` transitions, with replacement."""
        sample: TensorDictBase = self._buffer.sample(count)
        return sample

    def all(self) -> TensorDictBase:
        """Return all transitions, as they lie."""
        kept: TensorDictBase = self._buffer[:]
        return kept

    def state_dict(self) -> dict[str, Any]:
        """Return a copy of what is kept, and where the next one goes."""
        kept = self.all().clone().to_dict() if len(self) else {}
        return {"transitions": kept, "count": len(self), "writer": self._buffer.writer.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take back what `state_dict` gave."""
        self._buffer.empty()
        if state["count"]:
            self.extend(TensorDict.from_dict(state["transitions"], batch_size=[state["count"]]))
        self._buffer.writer.load_state_dict(state["writer"])
