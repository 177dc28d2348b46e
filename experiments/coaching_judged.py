"""Coached sessions on the same seeds: by the tree alone, led by a learned style, and by a constant one.

    python experiments/coaching_judged.py play out.jsonl --policy POLICY.npz --part 0 --of 4 --seconds 170
    python experiments/coaching_judged.py table out*.jsonl

Each session is written as it ends, so that a run may be cut off anywhere; part I of N plays its own sessions.
Who is coached was kept for judging: Jose, Kim, Morgan, Natalia, people of `population:test`, and learners of
the kinds `forgetful` and `frail`. Intervals resample pairs.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import rcare_marl
from rcare_marl.agents.coaching.style import BRISK, Style
from rcare_marl.baselines.policy_file import LearnedPolicy, PolicyFile
from rcare_marl.baselines.scripted.social_coaching import ScriptedCoaching
from rcare_marl.envs.care_env import CareEnv

PEOPLE = (
    "population:test",
    "kim",
    "population:test",
    "natalia",
    "population:test",
    "jose",
    "morgan",
)
KINDS = ("forgetful", "frail")
OTHERS = ("learned", "brisk")
SEED = 9600
MEASURES = ("right_per_minute", "wrong_repetitions", "mean_pain", "fatigue", "right", "success")


def coach(env: CareEnv, name: str, path: Path | None) -> Any:
    """Return one of the three coaches."""
    if name == "learned":
        assert path is not None  # else it does not play
        return LearnedPolicy(env, "robot", PolicyFile.read(path))
    return ScriptedCoaching(env, "robot", BRISK if name == "brisk" else Style())


def session(env: CareEnv, name: str, path: Path | None, seed: int) -> dict[str, Any]:
    """Return what came of one session with a coach."""
    env.reset(seed=seed)
    player = coach(env, name, path)  # only now: with people who take turns the task is another
    player.reset(np.random.default_rng(seed))
    ended = late = False
    while not (ended or late):
        *_, ends, lates, infos = env.step({"robot": player.act().astype(np.float32)})
        ended, late = any(ends.values()), any(lates.values())
    metrics = next(iter(infos.values()))
    out = {name: float(metrics[name]) for name in MEASURES if name in metrics}
    share = metrics["right_repetitions"] / metrics["wanted_repetitions"]
    return {**out, "right": float(share)}


def play(
    path: Path | None,
    out: Path,
    *,
    people: Sequence[str],
    kinds: Sequence[str],
    others: Sequence[str],
    part: int,
    of: int,
    seconds: float,
    seed: int,
) -> None:
    """Play sessions until the time is over."""
    until, envs = time.monotonic() + seconds, dict[str, CareEnv]()
    for k in range(part, 10_000, of):
        person = people[k % len(people)]
        if person not in envs:
            envs[person] = rcare_marl.make(
                "social_coaching",
                recipient=person,
                policies={"recipient": "learner"},
                options={"learners": list(kinds)},
                physics_dt=1 / 30,
            )
        for name in ("scripted", *others):
            if time.monotonic() > until:
                return
            found = session(envs[person], name, path, seed + k)
            line = {
                "person": person,
                "kinds": "+".join(kinds),
                "seed": seed + k,
                "coach": name,
                **found,
            }
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")


def table(files: Sequence[Path]) -> None:
    """Print means, and differences to the tree over pairs with their 95 % intervals."""
    rows = [json.loads(line) for file in files for line in file.read_text().splitlines()]
    by_seed: dict[tuple[str, int], dict[str, Any]] = {}
    for row in rows:
        by_seed.setdefault((row["person"], row["seed"]), {})[row["coach"]] = row
    rng = np.random.default_rng(0)
    groups = {"all": lambda _: True} | {
        p: (lambda k, p=p: k[0] == p) for p in sorted({person for person, _ in by_seed})
    }
    for group, holds in groups.items():
        for name in OTHERS:
            pairs = [v for k, v in by_seed.items() if holds(k) and {"scripted", name} <= set(v)]
            if not pairs:
                continue
            print(f"{group}: {name} against the tree, {len(pairs)} pairs")
            for measure in MEASURES:
                a, b = (np.array([p[who][measure] for p in pairs]) for who in ("scripted", name))
                draws = rng.integers(len(pairs), size=(10_000, len(pairs)))
                low, high = np.percentile((b - a)[draws].mean(axis=1), (2.5, 97.5))
                print(
                    f"  {measure}: {a.mean():.3f} -> {b.mean():.3f}, "
                    f"difference {np.mean(b - a):.3f} ({low:.3f} to {high:.3f})"
                )


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("play")
    one.add_argument("out", type=Path)
    one.add_argument("--policy", type=Path)
    one.add_argument("--part", type=int, default=0)
    one.add_argument("--of", type=int, default=1)
    one.add_argument("--seconds", type=float, default=600.0)
    one.add_argument("--seed", type=int, default=SEED)
    one.add_argument("--people", nargs="+", default=PEOPLE)
    one.add_argument("--kinds", nargs="+", default=KINDS)
    one.add_argument("--beside", nargs="+", choices=OTHERS, default=OTHERS, help="the tree")
    commands.add_parser("table").add_argument("files", type=Path, nargs="+")
    given = parser.parse_args()
    if given.command == "play":
        play(
            given.policy,
            given.out,
            people=given.people,
            kinds=given.kinds,
            others=[name for name in given.beside if name != "learned" or given.policy],
            part=given.part,
            of=given.of,
            seconds=given.seconds,
            seed=given.seed,
        )
    else:
        table(given.files)


if __name__ == "__main__":
    main()
