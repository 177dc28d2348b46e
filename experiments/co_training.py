"""Co-training: what a robot learns with a scripted person, through muscles, and with one who learns too.

Scenarios, each with a config in `experiments/configs/co_training`:

    a  behaviour_tree    feeding; the robot learns, a behaviour tree plays the recipient
    b  muscles           the same, and the tree acts through muscles
    c  together          robot and recipient learn together
    p  population        as a, with trees of three temperaments, five individuals
    d  three_learn       dressing; robot, recipient and caregiver learn
    m  muscle_recipient  the recipient learns through muscles, fed by the scripted robot
    e  bodies            as a, through the view of everybody, with another body in each episode
    f  bodies_and_trees  as e, with trees of three temperaments, five individuals
    g  together_bodies   robot and recipient learn together, with another body in each episode
    h  together_muscles  as g, through muscles
    k  bodies_and_learners  as e, with three trees and recipients who learned in two trainings of g
    without_<avatar>     as a, with the five other avatars in turn

Run everything, side by side, and see what came of it (docs/co_training.md):

    python experiments/co_training.py all --processes 32 --minutes 12.5 --out runs/co_training
    python experiments/co_training.py report --out runs/co_training

or a part: `train --scenario a --seed 0`, `cross-play`, `leave-one-out`, `dressing`. Trainings that were
interrupted go on where they were.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from rcare_marl.baselines.evaluation.cross_play import cross_play
from rcare_marl.baselines.evaluation.evaluate import evaluate
from rcare_marl.baselines.evaluation.matrix import MatrixPlan, run_matrix
from rcare_marl.baselines.partners import (
    TEMPERAMENTS,
    Partner,
    learned_partner,
    partner_zoo,
)
from rcare_marl.config import read_yaml
from rcare_marl.provenance import versions

CONFIGS = Path(__file__).resolve().parent / "configs" / "co_training"
SCENARIOS = {
    "a": "behaviour_tree",
    "b": "muscles",
    "c": "together",
    "p": "population",
    "d": "three_learn",
    "m": "muscle_recipient",
    "e": "bodies",
    "f": "bodies_and_trees",
    "g": "together_bodies",
    "h": "together_muscles",
    "k": "bodies_and_learners",
}
SEEDS = {"a": 5, "b": 3, "c": 5, "p": 3, "d": 2, "m": 2, "e": 2, "f": 3, "g": 3, "h": 1, "k": 3}
TEACHERS = ("g_10", "g_11")  # whose recipients the robots of k meet, and nobody else does
HELD_OUT_SEEDS = 2  # of the trainings without an avatar
BODIES = ("e_", "f_", "g_", "h_", "k_")  # with another body in each episode
STRANGERS, STRANGERS_FROM = "population:test:0-9", 65800  # and the first seed
TASK, ROLE = "feeding", "recipient"
OPTIONS = {"reward": "paper"}
AVATARS = ("daniel", "jose", "karan", "kim", "morgan", "natalia")
DEFAULT = "karan"  # who is fed where nobody is named
EPISODES, DRESSINGS = 10, 6  # of each pair
GRACE = 3.0  # [min] that building, demonstrating and the last evaluation may take beside
ONE_CORE = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Run:
    """One training.

    Attributes:
        scenario: Letter of the scenario, or `without_<avatar>`.
        seed: Of everything random.
    """

    scenario: str
    seed: int

    @property
    def name(self) -> str:
        """Name of its folder and files."""
        return f"{self.scenario}_{self.seed}"

    def config(self, minutes: float | None, out: Path) -> dict[str, Any]:
        """Return the fields of its `TrainConfig`; `out` is where the policies of others lie."""
        if self.scenario in SCENARIOS:
            fields = read_yaml(CONFIGS / f"{SCENARIOS[self.scenario]}.yaml")
            if self.scenario == "k":
                learned = (out / "policies" / f"{name}_recipients.npz" for name in TEACHERS)
                fields["partners"][ROLE] += [str(file.resolve()) for file in learned]
        else:
            held_out = self.scenario.removeprefix("without_")
            if held_out not in AVATARS:
                raise SystemExit(
                    f"no scenario {self.scenario!r}: {', '.join(SCENARIOS)}, or without_<avatar>"
                )
            fields = read_yaml(CONFIGS / "five_avatars.yaml")
            fields["variants"] = [{ROLE: avatar} for avatar in AVATARS if avatar != held_out]
        return fields | {"seed": self.seed, "minutes": minutes}


def plan(scenarios: Sequence[str]) -> list[Run]:
    """Return the trainings of some scenarios, all if there are none; the slowest first."""
    runs = [Run(letter, seed) for letter in "hgkdcbmpefa" for seed in range(SEEDS[letter])]
    runs += [Run(f"without_{a}", seed) for seed in range(HELD_OUT_SEEDS) for a in AVATARS]
    return [run for run in runs if not scenarios or run.scenario in scenarios]


def train(run: Run, out: Path, minutes: float | None, steps: int | None = None) -> None:
    """Train one run, and put its policies and its record where the evaluation looks for them."""
    from rcare_marl.baselines.training.config import load_config
    from rcare_marl.baselines.training.trainer import Trainer

    fields = run.config(minutes, out)
    if steps is not None:
        fields["steps"] = steps
    config = load_config(fields)
    result = Trainer(config, out / "runs" / run.name).run()
    record = dataclasses.asdict(result)
    record["policies"] = {group: path.name for group, path in result.policies.items()}
    record |= {"run": run.name, "config": config.to_dict(), "versions": versions()}
    _write(out / "records" / f"train_{run.name}.json", record)
    _collect(run, out)


def _collect(run: Run, out: Path) -> None:
    """Copy the policies of a run, named by run and group, and its curve."""
    from rcare_marl.baselines.policy_file import PolicyFile

    folder = out / "runs" / run.name
    for kind in ("policies", "curves"):
        (out / kind).mkdir(parents=True, exist_ok=True)
    for file in [*folder.glob("policy.npz"), *folder.glob("policy_*.npz")]:
        if not file.stem.startswith("policy_last"):
            group = PolicyFile.read(file).group
            shutil.copyfile(file, out / "policies" / f"{run.name}_{group}.npz")
    if (folder / "progress.csv").is_file():
        shutil.copyfile(folder / "progress.csv", out / "curves" / f"{run.name}.csv")


def train_all(
    runs: Sequence[Run], out: Path, minutes: float, processes: int, grace: float
) -> list[str]:
    """Train side by side, each in a process and on a core of its own; return the runs that failed.

    What has not ended `grace` minutes after its time is stopped; the policies of its latest interval count.
    """
    environment = {**os.environ, **dict.fromkeys(ONE_CORE, "1"), "RL_WARNINGS": "0"}
    (out / "logs").mkdir(parents=True, exist_ok=True)

    def fails(run: Run) -> bool:
        command = [sys.executable, __file__, "train", "--scenario", run.scenario]
        command += ["--seed", str(run.seed), "--minutes", str(minutes), "--out", str(out)]
        with (out / "logs" / f"{run.name}.txt").open("wb") as log:
            told: dict[str, Any] = {"stdout": log, "stderr": subprocess.STDOUT, "env": environment}
            try:
                code = subprocess.run(command, timeout=60 * (minutes + grace), **told).returncode
                _say(f"{run.name}: ended with {code}")
            except subprocess.TimeoutExpired:
                code = None
                _say(f"{run.name}: stopped late")
        if code != 0:
            _collect(run, out)
        return code != 0

    with ThreadPoolExecutor(processes) as pool:
        return [run.name for run, failed in zip(runs, pool.map(fails, runs), strict=True) if failed]


def robots(out: Path, *prefixes: str) -> dict[str, str]:
    """Return the learned robots whose run begins so, by the name of the run."""
    files = sorted((out / "policies").glob("*_robots.npz"))
    found = {file.stem.removesuffix("_robots"): str(file) for file in files}
    return {name: path for name, path in found.items() if name.startswith(prefixes)}


def recipients(out: Path) -> list[Partner]:
    """Return the learned recipients of feeding: of scenario c, and through muscles."""
    files = sorted((out / "policies").glob("[cm]_*_recipients.npz"))
    return [
        learned_partner(TASK, ROLE, file, name=file.stem.replace("recipients", "recipient"))
        for file in files
    ]


def through_muscles() -> Partner:
    """Return the partner of scenario b."""
    (found,) = partner_zoo(
        TASK,
        ROLE,
        avatars=[DEFAULT],
        temperaments=["cooperative"],
        learned=(),
        entry={"actuation": "muscle", "excitation": "group"},
    )
    return dataclasses.replace(found, name=f"{DEFAULT}_muscles")


def play_all(out: Path, processes: int, episodes: int) -> None:
    """Let every robot of a, b, c and p meet everybody: the zoo, learned recipients, muscles."""
    policies = {**robots(out, "a_", "b_", "c_", "p_"), "scripted": "scripted"}
    learned, zoo = recipients(out), partner_zoo(TASK, ROLE, avatars=AVATARS, learned=())
    partners = [*learned, through_muscles(), *zoo]
    known = {partner.name for partner in partners}
    own = {}
    for name in policies:
        partner = {
            "a": f"{DEFAULT}_cooperative",
            "b": f"{DEFAULT}_muscles",
            "c": f"{name}_recipient",
            "p": f"{DEFAULT}_cooperative",
        }.get(name.split("_")[0])
        if partner in known:
            own[name] = [partner]
    _meet(policies, partners, own, out / "records" / "cross_play.json", processes, episodes)


def leave_one_out(out: Path, processes: int, episodes: int) -> None:
    """Let robots trained without one avatar, and with the default one alone, meet all six."""
    policies = {**robots(out, "without_", "a_"), "scripted": "scripted"}
    zoo = partner_zoo(TASK, ROLE, avatars=AVATARS, learned=())
    own: dict[str, list[str]] = {}
    for name in robots(out, "without_", "a_"):
        met = [DEFAULT] if name.startswith("a_") else [a for a in AVATARS if a not in name]
        own[name] = [f"{avatar}_cooperative" for avatar in met]
    _meet(policies, zoo, own, out / "records" / "leave_one_out.json", processes, episodes)


def _meet(
    policies: Mapping[str, str],
    partners: Sequence[Partner],
    own: Mapping[str, Sequence[str]],
    file: Path,
    processes: int,
    episodes: int,
) -> None:
    """Let all policies meet all partners; `own` are those of their training."""
    found = cross_play(
        TASK, policies, partners, episodes=episodes, own=own, processes=processes, options=OPTIONS
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    found.save(file)
    _say(found.table())


def meet_strangers(out: Path, processes: int) -> None:
    """Let the robots of e to k meet bodies and partners that nobody met in training, one episode each."""
    files = sorted((out / "policies").glob("g_?_recipients.npz"))
    names = {**{mood: mood for mood in TEMPERAMENTS}, **{str(f): f.stem[:3] for f in files}}
    over = {"people": (STRANGERS,), "partners": tuple(names)}
    found: dict[str, dict[str, list[tuple[bool, float]]]] = {}
    for robot, policy in {**robots(out, *BODIES), "scripted": "scripted"}.items():
        plan = MatrixPlan(TASK, over, policy, options=OPTIONS, episodes=1, seed=STRANGERS_FROM)
        found[robot] = {name: [] for name in names.values()}
        for outcome in run_matrix(plan, processes=processes).outcomes:
            if outcome.result is None:
                raise SystemExit(f"{robot}: {outcome.reason}")
            met = found[robot][names[outcome.cell.values()["partners"]]]
            met += [(e.success, e.metrics["peak_force_n"]) for e in outcome.result.episodes]
        done = {name: sum(success for success, _ in met) for name, met in found[robot].items()}
        _say(f"{robot}: {done}")
        _write(out / "records" / "strangers.json", {"found": found, "versions": versions()})


def dress(out: Path, processes: int, episodes: int) -> None:
    """Let each learned role of scenario d play with learned and with scripted others."""
    groups = {"robot": "robots", "recipient": "recipients", "caregiver": "caregivers"}
    jobs = []
    for seed, *learned in product(range(SEEDS["d"]), *(("script", "learned") for _ in groups)):
        kinds = dict(zip(groups, learned, strict=True))
        policies = {
            role: str(out / "policies" / f"d_{seed}_{groups[role]}.npz")
            for role, kind in kinds.items()
            if kind == "learned"
        }
        if all(Path(file).is_file() for file in policies.values()):
            jobs.append(({"seed": seed, **kinds}, policies, episodes))
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        rows = list(pool.map(_dress, jobs))
    _write(out / "records" / "dressing.json", {"rows": rows, "versions": versions()})


def _dress(job: tuple[dict[str, Any], dict[str, str], int]) -> dict[str, Any]:
    kinds, policies, episodes = job
    cast = read_yaml(CONFIGS / f"{SCENARIOS['d']}.yaml")["cast"]
    found = evaluate("dressing", policies, episodes=episodes, options=OPTIONS, cast=cast)
    numbers = found.to_dict()
    return {
        **kinds,
        **{k: numbers[k] for k in ("episodes", "successes", "peak_force_n", "steps_mean")},
        "return": numbers["mean_return"]["robot"],
    }


def _write(path: Path, record: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "command",
        choices="all train train-all evaluate cross-play leave-one-out strangers dressing report".split(),
        help="what to do; all is train-all and evaluate, which is the next four",
    )
    parser.add_argument("--scenario", action="append", default=[], help="of the trainings; all")
    parser.add_argument("--seed", type=int, default=0, help="of `train`")
    parser.add_argument("--minutes", type=float, default=8.0, help="for each training")
    parser.add_argument("--grace", type=float, default=GRACE, help="minutes until it is stopped")
    parser.add_argument("--steps", type=int, help="for `train`, in place of the config's")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--episodes", type=int, default=EPISODES, help="of each pair")
    parser.add_argument("--dressings", type=int, default=DRESSINGS, help="of each combination")
    parser.add_argument("--out", type=Path, default=Path("runs/co_training"))
    parser.add_argument("--docs", type=Path, help="`report` fills in this page, and its images/")
    given = parser.parse_args()
    out: Path = given.out
    failed: list[str] = []
    if given.command == "train":
        if len(given.scenario) != 1:
            parser.error("train takes one --scenario")
        train(Run(given.scenario[0], given.seed), out, given.minutes, given.steps)
    if given.command in ("all", "train-all"):
        runs = plan(given.scenario)
        failed = train_all(runs, out, given.minutes, given.processes, given.grace)
    if given.command in ("all", "evaluate", "cross-play"):
        play_all(out, given.processes, given.episodes)
    if given.command in ("all", "evaluate", "leave-one-out"):
        leave_one_out(out, given.processes, given.episodes)
    if given.command in ("all", "evaluate", "strangers"):
        meet_strangers(out, given.processes)
    if given.command in ("all", "evaluate", "dressing"):
        dress(out, given.processes, given.dressings)
    if given.command == "report":
        from co_training_report import report  # it needs matplotlib

        _say(report(out, given.docs))
    if failed:
        raise SystemExit(f"these trainings failed, see {out / 'logs'}: {', '.join(failed)}")


if __name__ == "__main__":
    main()
