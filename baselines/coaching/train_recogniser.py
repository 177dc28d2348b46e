"""Train the network that judges repetitions, on synthetic people of the development split.

    python -m rcare_marl.baselines.coaching.train_recogniser --processes 2

The same arguments give the same network on the same machine.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from .encoding import mirrored
from .examples import WRONG_SOMEHOW, Examples, gather
from .learned_recogniser import CLASSES, SHIPPED, RepetitionNetwork, save_network

# All our own choice.
PEOPLE = {"hands": 100, "joints": 16, "camera": 4}
HELD_OUT = 0.15  # share of the people whom nothing is learned from
EPOCHS, BATCH, RATE, DECAY = 60, 256, 2e-3, 1e-3
NOISE = 0.03  # added to what was seen in training
TRUST = 0.02  # of the labels: what is said of the other classes together


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
