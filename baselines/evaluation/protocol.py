"""How policies of several training runs are judged: the same seeds for each, and a record to repeat.

Example:
    >>> plan = Plan("feeding", ("runs/a/policy.npz", "runs/b/policy.npz"), episodes=100)
    >>> record = assess(plan, processes=2)
    >>> record.summary()["success"]["mean"], record.summary()["success"]["interval_95"]
"""

from __future__ import annotations

import glob
import hashlib
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rcare_marl.config import load
from rcare_marl.envs.randomise import Randomisation
from rcare_marl.envs.registry import task_class
from rcare_marl.errors import ConfigError
from rcare_marl.provenance import changes, machine
from rcare_marl.reading import read_json

from .. import trained
from ..policy_file import SUFFIX, PolicyFile
from .evaluate import Episode, Evaluation, Job, joined, lead_policies, run_jobs, wilson_interval
from .statistic import hierarchical_interval, interquartile_mean, stratified_interval

FORMAT = 1  # of a record
CHUNK = 25  # episodes that share a scene, however many processes there are; our own choice
RESAMPLES = 10_000  # of the success rate
FEWER = 2_000  # of each other measure, of which there are many
# What policies of one training share that differ in seed.
SAME_TRAINING = ("algorithm", "reward", "residual", "demonstrations")

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Plan:
    """What is to be evaluated.

    Attributes:
        task: Name of the task.
        policies: Of the robots, one after the other: names or files. Those of one training with
            several seeds belong together.
        others: Policy of single other roles; their default partner where none is given.
        episodes: How many each policy plays.
        seed: Episode i of each has the seed `seed + i`, so that all meet the same.
        options: Settings of the task.
        cast: Who plays, by role, and where: `home`, `level`, `room`; see `rcare_marl.make`.
        randomise: What is another in each episode, see `rcare_marl.make`; kept as a mapping.

    Raises:
        ConfigError: If there is no policy, one stands there twice, or a number is impossible.
    """

    task: str
    policies: tuple[str, ...]
    others: dict[str, str] = field(default_factory=dict)
    episodes: int = 100
    seed: int = 0
    options: dict[str, Any] = field(default_factory=dict)
    cast: dict[str, Any] = field(default_factory=dict)
    randomise: Any = None

    def __post_init__(self) -> None:
        task_class(self.task)
        object.__setattr__(self, "randomise", Randomisation.of(self.randomise).to_dict())
        if not self.policies:
            raise ConfigError("an evaluation needs a policy")
        twice = sorted({name for name in self.policies if self.policies.count(name) > 1})
        if twice:
            raise ConfigError(f"policies stand there twice: {', '.join(twice)}")
        if self.episodes < 1 or self.seed < 0:
            raise ConfigError(
                f"episodes are at least 1 and a seed at least 0, got {self.episodes} and {self.seed}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        out = {**vars(self), "policies": list(self.policies)}
        return out if self.randomise else {k: v for k, v in out.items() if k != "randomise"}


@dataclass(frozen=True)
class Record:
    """What came of a plan, with all that it takes to repeat it.

    Attributes:
        plan: What was to be evaluated.
        runs: What came of each policy, in the order of the plan.
        files: Of each policy that is a file its SHA-256, as `sha256`, and how it was trained, as
            `training`.
        machine: Where it was run.
    """

    plan: Plan
    runs: tuple[Evaluation, ...]
    files: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    machine: Mapping[str, Any] = field(default_factory=lambda: machine())

    def summary(self) -> dict[str, Any]:
        """Return success, returns and all measures over the policies.

        Each has `runs`, the mean of each policy; `mean`, their mean, with its `interval_95` from
        resampling policies and then episodes; `iqm`, their interquartile mean, with its
        `iqm_interval_95` from resampling policies (None of a single one); and `max` over all episodes.
        An event that never came is in none of them.
        """
        episodes = [run.episodes for run in self.runs]
        first = episodes[0][0]
        out = {"success": _successes([[e.success for e in run] for run in episodes])}
        for role in first.returns:
            out[f"return_{role}"] = _summed([[e.returns[role] for e in run] for run in episodes])
        for role in first.costs:
            out[f"cost_{role}"] = _summed([[e.costs[role] for e in run] for run in episodes])
        for name in first.metrics:
            out[name] = _summed([run.values(name) for run in self.runs])
        out["steps"] = _summed([[e.steps for e in run] for run in episodes])
        return {name: numbers for name, numbers in out.items() if numbers}

    @property
    def is_one_training(self) -> bool:
        """Whether its policies are seeds of one training, so that a mean over them says something."""
        if len(self.runs) == 1:
            return True
        kinds = [
            tuple(self.files[name]["training"].get(key) for key in SAME_TRAINING)
            if name in self.files
            else None
            for name in self.plan.policies
        ]
        return None not in kinds and len(set(kinds)) == 1

    def other_rewards(self) -> dict[str, str]:
        """Return the policies that were trained on another reward than this evaluation's, with theirs."""
        here = self.plan.options.get("reward", task_class(self.plan.task).Options().reward)
        trained_on = {name: each["training"].get("reward") for name, each in self.files.items()}
        return {name: str(r) for name, r in trained_on.items() if r not in (None, here)}

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON: the summary, and every episode in columns."""
        return {
            "format": FORMAT,
            "plan": self.plan.to_dict(),
            "summary": self.summary(),
            "policies": [
                {
                    "policy": name,
                    "roles": dict(run.policies),
                    "models": dict(run.cast),
                    "success_rate": run.success_rate,
                    "success_interval_95": list(run.success_interval),
                    "file": dict(self.files[name]) if name in self.files else None,
                    "episodes": columns(run.episodes),
                }
                for name, run in zip(self.plan.policies, self.runs, strict=True)
            ],
            "people": {who: found for run in self.runs for who, found in run.people.items()},
            "refused": {who: why for run in self.runs for who, why in run.refused.items()},
            "place": dict(self.runs[0].place),
            "versions": dict(self.runs[0].versions),
            "machine": dict(self.machine),
        }


def assess(
    plan: Plan,
    *,
    processes: int = 1,
    on_progress: Progress | None = None,
    save: str | Path | None = None,
) -> Record:
    """Run a plan and return what came of it, the same however many processes there are.

    Args:
        plan: What to run.
        processes: How many at once, see `run_jobs`.
        on_progress: Called with the number of episodes that were done since.
        save: A folder for recorded episodes, `seed-<seed>.npz`, see `rcare_marl.envs.episode`; of several
            policies each has a folder in it, such as `1-scripted`.

    Raises:
        UnknownNameError: If a task, role, model, option or policy does not exist.
        ConfigError: If a value is impossible, or a file is no policy for this task.
    """
    files = {name: facts for name in plan.policies if (facts := file_facts(plan, name))}
    folder = None if save is None else Path(save)
    runs = run(plan, plan.policies, processes=processes, on_progress=on_progress, save=folder)
    return Record(plan, runs, files)


def read_record(path: str | Path) -> dict[str, Any]:
    """Return a record from its file.

    Raises:
        ConfigError: If there is no such file, or it holds no record of this format.
    """
    data = read_json(path, "a record")
    if not {"plan", "policies", "summary"} <= data.keys():
        raise ConfigError(f"{path} holds no record of an evaluation")
    if data.get("format") != FORMAT:
        raise ConfigError(
            f"{path} has format {data.get('format')!r} of a record; this package reads {FORMAT}"
        )
    return data


def record_text(record: Mapping[str, Any]) -> str:
    """Return a record as JSON in which a list of numbers takes one line."""
    return _text(record, 0) + "\n"


def _text(value: Any, depth: int) -> str:
    space = " " * (depth + 1)
    if isinstance(value, Mapping) and value:
        rows = [f"{json.dumps(name)}: {_text(each, depth + 1)}" for name, each in value.items()]
    elif isinstance(value, list) and any(isinstance(each, list | Mapping) for each in value):
        rows = [_text(each, depth + 1) for each in value]
    else:
        return json.dumps(value, allow_nan=False)
    left, right = ("{", "}") if isinstance(value, Mapping) else ("[", "]")
    body = f",\n{space}".join(rows)
    return f"{left}\n{space}{body}\n{' ' * depth}{right}"


def find_policies(patterns: Iterable[str]) -> tuple[str, ...]:
    """Return names and files of policies; a pattern such as `runs/seed*/policy.npz` stands for files.

    Files of a pattern come in the order of the numbers in their paths.

    Raises:
        ConfigError: If there is no file for a pattern.
    """
    out: list[str] = []
    for pattern in patterns:
        if not glob.has_magic(pattern):
            out.append(pattern)
            continue
        files = sorted(glob.glob(pattern, recursive=True), key=_in_order)
        if not files:
            raise ConfigError(f"no file of a policy matches {pattern!r}")
        out += files
    return tuple(out)


def columns(episodes: Sequence[Episode]) -> dict[str, Any]:
    """Return episodes as lists by name, for JSON; an event that never came is None."""
    rows = [episode.to_dict() for episode in episodes]
    out: dict[str, Any] = {}
    for name, value in rows[0].items():
        if isinstance(value, Mapping):
            out[name] = {key: [row[name][key] for row in rows] for key in value}
        else:
            out[name] = [row[name] for row in rows]
    return out


def run(
    plan: Plan,
    policies: Sequence[str],
    *,
    processes: int = 1,
    on_progress: Progress | None = None,
    save: Path | None = None,
) -> tuple[Evaluation, ...]:
    """Return what came of each policy of a plan; `policies` are those, or where their files are now."""
    pieces = [
        (which, start) for which in range(len(policies)) for start in range(0, plan.episodes, CHUNK)
    ]
    jobs = [
        Job(
            plan.task,
            lead_policies(plan.task, policies[which], plan.others),
            min(CHUNK, plan.episodes - start),
            plan.seed + start,
            plan.options,
            plan.cast,
            plan.randomise,
            None if save is None else _folder(plan, which, save),
        )
        for which, start in pieces
    ]
    done = run_jobs(jobs, processes, on_progress)
    out = []
    for number, name in enumerate(plan.policies):
        parts = [part for (which, _), part in zip(pieces, done, strict=True) if which == number]
        shown = {
            role: name if used == policies[number] else used
            for role, used in parts[0].policies.items()
        }
        out.append(replace(joined(parts), policies=shown))
    return tuple(out)


def _folder(plan: Plan, which: int, save: Path) -> Path:
    """Return where the episodes of a policy go: a folder of its own where there are several."""
    name = f"{which + 1}-{Path(plan.policies[which]).stem}"
    return save / name if len(plan.policies) > 1 else save


def saved_files(plan: Plan, save: Path) -> list[Path]:
    """Return where `assess` left each episode of each policy below a folder, in order."""
    seeds = range(plan.seed, plan.seed + plan.episodes)
    folders = [_folder(plan, which, save) for which in range(len(plan.policies))]
    return [folder / f"seed-{seed}.npz" for folder in folders for seed in seeds]


def _summed(runs: Sequence[Sequence[float]], resamples: int = FEWER) -> dict[str, Any]:
    """Return the numbers of one measure, see `Record.summary`; none where it never had a value."""
    runs = [run for run in runs if len(run)]
    if not runs:
        return {}
    means = [float(np.mean(run)) for run in runs]
    return {
        "mean": float(np.mean(means)),
        "interval_95": _ends(hierarchical_interval(runs, resamples=resamples)),
        "iqm": float(interquartile_mean(means)),
        "iqm_interval_95": _ends(stratified_interval([means], resamples=resamples)),
        "max": float(max(max(run) for run in runs)),
        "runs": means,
    }


def _successes(runs: Sequence[Sequence[bool]]) -> dict[str, Any]:
    """Return the numbers of success.

    Where all episodes or none succeeded there is nothing to resample, but that is no certainty: the
    interval is Wilson's, of all episodes together.
    """
    out = _summed(runs, RESAMPLES)
    count, total = sum(map(sum, runs)), sum(map(len, runs))
    if count in (0, total):
        out["interval_95"] = list(wilson_interval(count, total))
    return out


def _ends(interval: tuple[float, float] | None) -> list[float] | None:
    return None if interval is None else list(interval)


def file_facts(plan: Plan, policy: str) -> dict[str, Any] | None:
    """Return what to keep of a policy's file; None of a policy that is none."""
    path: Path | None = None
    if Path(policy).suffix == SUFFIX:
        path = Path(policy)
    elif policy in (trained.NAME, trained.ANYWAY, trained.SPECIALIST):
        level, specialist = int(plan.cast.get("level") or 1), policy == trained.SPECIALIST
        path = trained.file_for(plan.task, level, specialist=specialist)
    if path is None:
        return None
    file = PolicyFile.read(path)
    return {
        "sha256": digest(path),
        "bytes": path.stat().st_size,
        "residual": file.residual,
        "training": dict(file.training),
        "recipe": dict(file.recipe),
    }


def digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _in_order(path: str) -> list[tuple[int, str]]:
    """Return a key by which seed2 comes before seed10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path)]


@dataclass(frozen=True)
class Repetition:
    """What came of running a record once more.

    Attributes:
        episodes: How many episodes were run again.
        repeated: The policies that were.
        missing: Those that were not, and why.
        differences: Every number that came out otherwise, as a text; none if all are the same.
        elsewhere: Versions and facts of the machine that differ, as texts: what may explain it.
    """

    episodes: int
    repeated: tuple[str, ...]
    missing: tuple[str, ...]
    differences: tuple[str, ...]
    elsewhere: tuple[str, ...]


def repeat(
    record: Mapping[str, Any], *, processes: int = 1, on_progress: Progress | None = None
) -> Repetition:
    """Run a record once more and compare every episode.

    A file that is not where it was is looked for among those that ship, by its SHA-256.

    Args:
        record: As `read_record` returns it.
        processes: As for `assess`.
        on_progress: As for `assess`.

    Raises:
        ConfigError: If no policy of it is here.
    """
    plan = load(Plan, record["plan"], "plan of the record")
    found: dict[str, str] = {}
    missing: list[str] = []
    for entry in record["policies"]:
        try:
            found[entry["policy"]] = _same_policy(entry)
        except ConfigError as error:
            missing.append(str(error))
    if not found:
        raise ConfigError(f"nothing to repeat: {'; '.join(missing)}")
    here = replace(plan, policies=tuple(found))
    runs = run(here, tuple(found.values()), processes=processes, on_progress=on_progress)
    kept = [entry for entry in record["policies"] if entry["policy"] in found]
    differences = [
        text
        for entry, again in zip(kept, runs, strict=True)
        for text in _differences(entry["policy"], entry["episodes"], columns(again.episodes))
    ]
    then = {**record["versions"], **record["machine"]}
    elsewhere = changes(then, {**runs[0].versions, **machine()})
    count = plan.episodes * len(runs)
    return Repetition(count, tuple(found), tuple(missing), tuple(differences), elsewhere)


def _same_policy(entry: Mapping[str, Any]) -> str:
    """Return where the policy of a record is now; ConfigError if it is not, or is another one."""
    name, facts = entry["policy"], entry["file"]
    if facts is None:
        return str(name)
    path, wanted = Path(name), facts["sha256"]
    if path.is_file() and digest(path) == wanted:
        return str(name)
    for shipped in sorted(trained.FOLDER.glob(f"*{SUFFIX}")):
        if digest(shipped) == wanted:
            return str(shipped)
    why = "is another file than it was" if path.is_file() else "is not here"
    raise ConfigError(f"{name} {why}")


def _differences(policy: str, then: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield what came out otherwise, column by column: the first episode of each."""
    for name in (*then, *(extra for extra in now if extra not in then)):
        old, new = then.get(name), now.get(name)
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            yield from _differences(f"{policy}, {name}", old, new)
        elif old is None or new is None:
            yield f"{policy}: {name} is in one of them only"
        elif old != new:
            others = [i for i, pair in enumerate(zip(old, new, strict=False)) if pair[0] != pair[1]]
            if others:
                i = others[0]
                yield (
                    f"{policy}: {name} of episode {i} is {new[i]}, was {old[i]}; {len(others)} of "
                    f"{len(old)} differ"
                )
            else:
                yield f"{policy}: {name} of {len(new)} episodes, were {len(old)}"
