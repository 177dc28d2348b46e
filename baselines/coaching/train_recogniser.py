"""Train the network that judges repetitions, on synthetic people of the development split.

    python -m rcare_marl.baselines.coaching.train_recogniser --processes 2

The same arguments give the same network on the same machine.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch.nn import functional

from rcare_marl.agents.coaching.exercise import Exercise, Reach, exercise_names, load_exercises
from rcare_marl.agents.coaching.recognition.recogniser import Repetition
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.recognition.segmenter import Segment
from rcare_marl.agents.coaching.recognition.template import Template
from rcare_marl.agents.coaching.upper_body import ARM, MOTION_INDEX, MOTIONS, SIDES

from ..workers import run_all
from .evaluation import judge_performance, make_sensor, usual_noise
from .learned_recogniser import (
    CLASSES,
    SHIPPED,
    Floats,
    RepetitionNetwork,
    encode,
    mirrored,
    save_network,
)
from .performance import WRONG, Performance, idle, perform
from .synthetic_user import SPLITS, SyntheticUser, draw_person

# All our own choice.
PEOPLE = {"hands": 100, "joints": 16, "camera": 4}
HELD_OUT = 0.15  # share of the people whom nothing is learned from
EPOCHS, BATCH, RATE, DECAY = 60, 256, 2e-3, 1e-3
NOISE = 0.03  # added to what was seen in training
TRUST = 0.02  # of the labels: what is said of the other classes together


ERROR_OF = {
    "one_arm": "one_side",
    "half_range": "range",
    "wrong_plane": "direction",
    "too_fast": "too_fast",
    "asymmetric": "asymmetric",
    "one_after_other": "asymmetric",
    "trunk_lean": "trunk_lean",
    "trunk_turn": "trunk_turn",
    "bent_elbows": "bent_elbows",
    "unknown_movement": "unknown_movement",
    "wrong_arm": "wrong_side",
    "other_exercise": "other_exercise",
}
WRONG_SOMEHOW = -1  # something else than the exercise, of no kind
# All our own choice.
RIGHT_REPETITIONS = 8
IDLE_TIME = 12.0  # [s]
ADAPTED = 0.4  # share of the exercises that are adapted to a reach and shown faster or slower
NOISES = (0.5, 1.6)  # of the sensors, times the usual


@dataclass(frozen=True, eq=False)
class Examples:
    """Repetitions and what they were.

    Attributes:
        sequences: Shape [n, 96, 48].
        facts: Shape [n, 13].
        labels: Of `CLASSES`, or `WRONG_SOMEHOW`, shape [n].
        people: Who did it, shape [n].
    """

    sequences: Floats
    facts: Floats
    labels: npt.NDArray[np.int64]
    people: npt.NDArray[np.int64]


class _Watcher(RuleRecogniser):
    """Recognition by rules that keeps what it judged."""

    def begin(self, exercise: Exercise) -> None:
        super().begin(exercise)
        self.kept: list[tuple[float, float, Floats, Floats]] = []

    def _judged(self, template: Template, segment: Segment) -> Repetition | None:
        found = super()._judged(template, segment)
        if found is not None and found.errors[:1] != ("not_seen",):
            self.kept.append((segment.start, segment.end, *encode(segment, template)))
        return found


def _reach(rng: np.random.Generator) -> Reach:
    """Return what somebody with stiff joints reaches: of some, part of what an exercise asks for."""
    low, high = np.full(len(MOTIONS), -np.pi), np.full(len(MOTIONS), np.pi)
    for side in SIDES:
        high[ARM[side].start] = np.radians(rng.uniform(60, 170))
    turn = np.radians(rng.uniform(25, 60))
    column = MOTION_INDEX["neck_rotation_left"]
    low[column], high[column] = -turn, turn
    return Reach(low, high)


def _exercises(rng: np.random.Generator) -> Iterator[Exercise]:
    for exercise in load_exercises():
        if rng.random() < ADAPTED:
            changed = exercise.adapted(_reach(rng)).faster(float(rng.uniform(0.6, 1.3)))
            yield changed if changed.can_do else exercise
        else:
            yield exercise


def _performances(
    user: SyntheticUser, exercise: Exercise, rng: np.random.Generator
) -> Iterator[tuple[Performance, int]]:
    """Yield what a person does with an exercise, and what that is of `CLASSES`."""
    names = exercise_names()
    for kind in ("right", *WRONG):
        if kind == "standing_still":
            continue
        often = RIGHT_REPETITIONS if kind == "right" else 1
        done = perform(user, exercise, kind, rng, others=names, repetitions=often)
        if done is None:
            continue
        is_head = exercise.parts == ("head",)
        error = "arms_only" if is_head else "head_only"
        yield done, CLASSES.index("right" if kind == "right" else ERROR_OF.get(kind, error))
    yield idle(user, exercise, rng, seconds=IDLE_TIME), WRONG_SOMEHOW


def examples_of(number: int, source: str, seed: int) -> Examples:
    """Return the repetitions of one person of the development split, seen by one source."""
    user = draw_person(number, seed=seed, split="development")
    rng = np.random.default_rng((SPLITS.index("development"), seed, number, 2))
    level = float(rng.uniform(*NOISES))
    noise = usual_noise(source).scaled(level, "position", "angle_deg", "dropout", "pixel")
    sensor, watcher = make_sensor(source, noise), _Watcher()
    found: list[tuple[Floats, Floats, int]] = []
    for exercise in _exercises(rng):
        for performance, label in _performances(user, exercise, rng):
            judge_performance(performance, user, sensor, watcher, rng)
            for start, end, sequence, facts in watcher.kept:
                belongs = any(start < b and end > a for a, b in performance.spans)
                if belongs or label == WRONG_SOMEHOW:
                    found.append((sequence, facts, label))
    return Examples(
        np.stack([sequence for sequence, _, _ in found]),
        np.stack([facts for _, facts, _ in found]),
        np.array([label for *_, label in found]),
        np.full(len(found), number),
    )


def gather(
    people: dict[str, int], *, seed: int, processes: int, progress: Callable[[int], None]
) -> Examples:
    """Return the repetitions of many people, so many of each source; the same for the same seed."""
    wanted = [(source, i) for source, many in people.items() for i in range(many)]
    numbered = [(number, source) for number, (source, _) in enumerate(wanted)]
    calls = [partial(examples_of, number, source, seed) for number, source in numbered]
    finished = count(1)
    done = run_all(calls, processes, lambda _: progress(next(finished)))
    return Examples(
        *(
            np.concatenate([getattr(each, name) for each in done])
            for name in ("sequences", "facts", "labels", "people")
        )
    )


def train(
    examples: Examples, *, seed: int, epochs: int = EPOCHS
) -> tuple[RepetitionNetwork, dict[str, Any]]:
    """Return a network that has learned from examples, and how it does with people it has not seen.

    Args:
        examples: Of many people.
        seed: Of the network, of what is held out and of the order of examples.
        epochs: How often each example is seen.
    """
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    everybody = np.unique(examples.people)
    held = rng.choice(everybody, size=max(1, round(HELD_OUT * len(everybody))), replace=False)
    is_held = np.isin(examples.people, held)
    sequences, facts, labels = _with_mirrored(examples, ~is_held)
    network = RepetitionNetwork()
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY)
    steps = epochs * (-(-len(labels) // BATCH))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=steps)
    for _ in range(epochs):
        for chosen in _batches(len(labels), rng):
            seen = sequences[chosen]
            seen = seen + NOISE * torch.randn(seen.shape)
            loss = loss_of(network(seen, facts[chosen]), labels[chosen])
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
    network.eval()
    return network, _measured(network, examples, is_held)


def loss_of(logits: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
    """Return the mean loss; what is `WRONG_SOMEHOW` must only not be right."""
    known = labels != WRONG_SOMEHOW
    chances = functional.log_softmax(logits, dim=1)
    total = functional.nll_loss(chances[known], labels[known], reduction="sum") * (1 - TRUST)
    total = total - TRUST * chances[known].mean(dim=1).sum()
    others = torch.logsumexp(chances[~known][:, 1:], dim=1)
    return (total - others.sum()) / len(labels)


def _with_mirrored(
    examples: Examples, chosen: np.ndarray[Any, np.dtype[np.bool_]]
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    sequences, facts = examples.sequences[chosen], examples.facts[chosen]
    turned, turned_facts = mirrored(sequences, facts)
    return (
        torch.from_numpy(np.concatenate((sequences, turned))),
        torch.from_numpy(np.concatenate((facts, turned_facts))),
        torch.from_numpy(np.tile(examples.labels[chosen], 2)),
    )


def _batches(count: int, rng: np.random.Generator) -> Iterator[torch.Tensor]:
    order = torch.from_numpy(rng.permutation(count))
    for start in range(0, count, BATCH):
        yield order[start : start + BATCH]


def _measured(
    network: RepetitionNetwork, examples: Examples, held: np.ndarray[Any, np.dtype[np.bool_]]
) -> dict[str, Any]:
    """Return shares of repetitions that are told rightly, of people held out."""
    with torch.inference_mode():
        logits = network(
            torch.from_numpy(examples.sequences[held]), torch.from_numpy(examples.facts[held])
        )
    says_right = torch.softmax(logits, dim=1)[:, 0].numpy() >= 0.5
    labels = examples.labels[held]
    right, named = labels == 0, labels > 0
    kinds = logits[:, 1:].argmax(dim=1).numpy() + 1
    return {
        "held_out_people": len(np.unique(examples.people[held])),
        "right_recognised": round(float(says_right[right].mean()), 5),
        "wrong_detected": round(float(1 - says_right[~right].mean()), 5),
        "errors_named": round(float((kinds == labels)[named].mean()), 5),
        "repetitions": len(labels),
    }


def main() -> None:
    """Gather repetitions, train, and write the network."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=1, help="of the people and the network")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=SHIPPED)
    given = parser.parse_args()
    total = sum(PEOPLE.values())
    print(f"{total} people, {given.processes} at once")
    examples = gather(
        PEOPLE,
        seed=given.seed,
        processes=given.processes,
        progress=lambda done: print(f"\r{done} of {total}", end="", flush=True),
    )
    print(f"\n{len(examples.labels)} repetitions")
    network, measured = train(examples, seed=given.seed)
    print(measured)
    about = {"people": PEOPLE, "seed": given.seed, "classes": CLASSES, "measured": measured}
    save_network(network, about, given.out)
    print(f"wrote {given.out}")


if __name__ == "__main__":
    main()
