"""The network that tells what a repetition was: convolutions over time, and its file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import nn

from rcare_marl.array_file import read_arrays, write_arrays
from rcare_marl.errors import ConfigError

from .encoding import CHANNELS, FACTS

# What a repetition may be; all but the first are names of `recogniser.ERRORS`.
CLASSES = tuple(
    """
    right one_side range direction too_fast asymmetric head_only arms_only trunk_lean trunk_turn
    bent_elbows unknown_movement wrong_side other_exercise
    """.split()
)
WIDTH = 64  # our own choice
KIND, VERSION = "a network that judges repetitions", 1  # of its file


class RepetitionNetwork(nn.Module):
    """Sees a repetition beside what was asked; says what it was."""

    def __init__(self) -> None:
        super().__init__()
        self.over_time = nn.Sequential(
            nn.Conv1d(CHANNELS, WIDTH, 5, stride=2, padding=2),
            nn.GELU(),
            nn.Conv1d(WIDTH, WIDTH, 5, stride=2, padding=2),
            nn.GELU(),
            nn.Conv1d(WIDTH, WIDTH, 3, padding=1),
            nn.GELU(),
        )
        self.told = nn.Sequential(
            nn.Dropout(0.1),
            nn.Linear(2 * WIDTH + FACTS, WIDTH),
            nn.GELU(),
            nn.Linear(WIDTH, len(CLASSES)),
        )

    def forward(self, sequences: torch.Tensor, facts: torch.Tensor) -> torch.Tensor:
        """Return the logits of `CLASSES`, shape [n, classes].

        Args:
            sequences: Of `encoding.encode`, shape [n, 96, 48].
            facts: Likewise, shape [n, 13].
        """
        found = self.over_time(sequences)
        pooled = torch.cat((found.mean(dim=2), found.amax(dim=2), facts), dim=1)
        return torch.as_tensor(self.told(pooled))


def save_network(network: RepetitionNetwork, about: Mapping[str, Any], file: Path) -> None:
    """Write a network and what there is to say of it as NPZ, without pickle."""
    arrays = {name: value.numpy() for name, value in network.state_dict().items()}
    write_arrays(file, {**about, "version": VERSION}, arrays)


def load_network(file: Path) -> tuple[RepetitionNetwork, dict[str, Any]]:
    """Return a network and what its file says of it.

    Raises:
        ConfigError: If the file cannot be read or holds no such network.
    """
    network = RepetitionNetwork()
    about, arrays = read_arrays(file, KIND, VERSION)
    try:
        network.load_state_dict({name: torch.from_numpy(part) for name, part in arrays.items()})
    except RuntimeError as error:
        raise ConfigError(f"{file} is no file of {KIND}: {error}") from error
    network.eval()
    return network, about
