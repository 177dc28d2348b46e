"""What a network sees of a repetition: it and what was asked, side by side, at as many times each."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.coaching.recognition.assessment import Motion
from rcare_marl.agents.coaching.recognition.feature import ANGLES, SIZE, VECTORS, feature, features
from rcare_marl.agents.coaching.recognition.segmenter import Segment
from rcare_marl.agents.coaching.recognition.template import MOVING, RATE, Template
from rcare_marl.pose import Array

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
    rest = feature(template.exercise.keys[0])
    return _at_steps(features(template.exercise.path(RATE))), rest


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
