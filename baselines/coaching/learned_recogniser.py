"""Recognition by a network that was shown synthetic people who do it right and wrong.

It sees what the rules see, found by the same segmenter, and decides what a repetition was; the green
window, how far and how even it was, and what is no movement at all stay with the rules.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from rcare_marl.agents.coaching.exercise import Exercise
from rcare_marl.agents.coaching.recognition.assessment import Motion
from rcare_marl.agents.coaching.recognition.recogniser import Repetition
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.recognition.segmenter import Segment
from rcare_marl.agents.coaching.recognition.template import (
    ANGLES,
    MOVING,
    RATE,
    SIZE,
    VECTORS,
    Template,
    feature,
    features,
)
from rcare_marl.atomic_file import read_arrays, write_arrays
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

SHIPPED = Path(__file__).with_name("recogniser.npz")
UNSEEN = "not_seen"
# What a repetition may be; all but the first are names of `recogniser.ERRORS`.
CLASSES = tuple(
    """
    right one_side range direction too_fast asymmetric head_only arms_only trunk_lean trunk_turn
    bent_elbows unknown_movement wrong_side other_exercise
    """.split()
)
WIDTH = 64  # our own choice
KIND, VERSION = "a network that judges repetitions", 1  # of its file


Floats = npt.NDArray[np.float32]

STEPS = 48  # times at which a repetition is looked at; our own choice
CHANNELS = 4 * SIZE  # seen, seen from rest, asked, asked from rest
PARTS = ("left_arm", "right_arm", "head", "trunk", "left_wrist", "right_wrist", "trunk_rotation")
FACTS = 3 + len(MOVING) + len(PARTS)
# Left for right, of the features, and which change their sign then.
_NAMES = [f"{name}.{axis}" for name in VECTORS for axis in "xyz"] + list(ANGLES)


def _other(name: str) -> str:
    for a, b in (("left", "right"), ("right", "left")):
        if name.startswith(a):
            return b + name.removeprefix(a)
    return name


_SWAP = np.array([_NAMES.index(_other(name)) for name in _NAMES])
_SIGN = np.array([-1.0 if n.endswith(".y") or n == "trunk_rotation" else 1.0 for n in _NAMES])
_FACT_NAMES = ["tempo", "duration", "returned", *MOVING, *(f"{part} " for part in PARTS)]
_SWAP_FACTS = np.array([_FACT_NAMES.index(_other(name)) for name in _FACT_NAMES])


@lru_cache(maxsize=8)  # by template, of which a recogniser keeps one an exercise
def asked_rows(template: Template) -> tuple[Array, Array]:
    """Return the features of what was asked, at `STEPS` times and at rest, shapes [48, 24] and [24]."""
    rest = feature(template.exercise.keys[0], template.bent)
    return _at_steps(features(template.exercise.path(RATE), template.bent)), rest


def encode(segment: Segment, template: Template) -> tuple[Floats, Floats]:
    """Return a repetition as a network takes it, shapes [96, 48] and [13].

    Args:
        segment: The repetition as it was found.
        template: What was asked.
    """
    motion = Motion.of(segment)
    rows = np.concatenate([motion.vectors[name] for name in VECTORS], axis=1)
    rows = np.concatenate((rows, *(motion.angles[name][:, None] for name in ANGLES)), axis=1)
    rest = np.concatenate([motion.rest[name] for name in VECTORS])
    rest = np.concatenate((rest, [motion.rest_angles[name] for name in ANGLES]))
    seen = _at_steps(rows)
    away = seen - rest
    path, path_rest = asked_rows(template)
    sequence = np.concatenate((seen, away, path, path - path_rest), axis=1).T
    columns = {**motion.vectors, **motion.angles}
    known = [bool(np.isfinite(columns[part]).all()) for part in PARTS]
    seconds = len(rows) / RATE
    facts = (
        math.log(seconds / template.exercise.duration),
        math.log(seconds / 5.0),
        float(segment.returned),
        *(float(part in template.ways) for part in MOVING),
        *map(float, known),
    )
    return np.nan_to_num(sequence).astype(np.float32), np.array(facts, np.float32)


def mirrored(sequences: Floats, facts: Floats) -> tuple[Floats, Floats]:
    """Return repetitions [n, 96, 48] and [n, 13] as a mirror shows them."""
    blocks = sequences.reshape(len(sequences), 4, SIZE, STEPS)[:, :, _SWAP]
    turned = blocks * _SIGN[:, None].astype(np.float32)
    return turned.reshape(sequences.shape), facts[:, _SWAP_FACTS]


def _at_steps(rows: Array) -> Array:
    """Return rows [n, 24] at `STEPS` times that are evenly spread over them, shape [48, 24]."""
    at = np.linspace(0, len(rows) - 1, STEPS)
    low = np.minimum(at.astype(int), max(len(rows) - 2, 0))
    share = (at - low)[:, None]
    high = np.minimum(low + 1, len(rows) - 1)
    return np.asarray((1 - share) * rows[low] + share * rows[high])


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
            sequences: Of `encode`, shape [n, 96, 48].
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


@cache
def _network(file: Path) -> RepetitionNetwork:
    return load_network(file)[0]


class LearnedRecogniser(RuleRecogniser):
    """Judges repetitions by a network.

    The measures of a repetition are those of the rules, and `right`: how sure the network is of that, 0 to 1.
    """

    def __init__(self, *, known: Sequence[Exercise] | None = None, file: Path = SHIPPED) -> None:
        """Prepare recognition.

        Args:
            known: Exercises that the rules may take a movement for; all there are if None.
            file: The network, of `train_recogniser`.

        Raises:
            ConfigError: If the file holds no such network.
        """
        super().__init__(known=known)
        self._network = _network(file)

    def _judged(self, template: Template, segment: Segment) -> Repetition | None:
        by_rules = super()._judged(template, segment)
        if by_rules is None or by_rules.errors[:1] == (UNSEEN,):
            return by_rules
        sequence, facts = encode(segment, template)
        with torch.inference_mode():
            logits = self._network(torch.from_numpy(sequence)[None], torch.from_numpy(facts)[None])
        chances = torch.softmax(logits[0], dim=0).tolist()
        right = chances[0]
        measures = {**by_rules.measures, "right": right}
        if right >= 0.5:
            return replace(by_rules, right=True, errors=(), measures=measures, nearly=False)
        worst = max(range(1, len(CLASSES)), key=lambda k: chances[k])
        return replace(by_rules, right=False, errors=(CLASSES[worst],), measures=measures)
