"""Print the paper's table of trained policies beside ours, from the records of our evaluations.

python experiments/paper_table.py [--markdown] [--evaluate] [--processes N] [--folder FOLDER]

Each row reads `<name>.json`, the record that `rcare-marl evaluate <task> --policies ... --out` left of the
policies of several training seeds when they were trained, and on the same episodes `<name>_shipped.json`
and `<name>_scripted.json`, of the one that ships and of the scripted policy. --evaluate makes these two
anew, with the code as it is. Without the former, what ships did in the first counts.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import typer

from rcare_marl.atomic_file import write_whole
from rcare_marl.baselines import trained
from rcare_marl.baselines.evaluation.model_card import beginning
from rcare_marl.baselines.evaluation.protocol import Plan, assess, digest, read_record, record_text
from rcare_marl.baselines.policy_file import SUFFIX
from rcare_marl.console import console, markdown_table, table
from rcare_marl.errors import ConfigError

SEEDS, EPISODES = 5, 100  # of the paper: policies a task, and trials of each
SCRIPTED, SHIPPED = "scripted", "shipped"
HEADS = (
    "task",
    "paper",
    "ours",
    "reward",
    "learned",
    "demonstrations",
    "steps",
    "trained in",
    "success (95 % interval)",
    "ships, anew",
    "scripted",
    "remark",
)


@dataclass(frozen=True)
class Row:
    """A row of the paper's table "Reinforcement Learning Simulation Results", or a task beside them.

    Attributes:
        task: Name of our task.
        level: Level of accessibility, where the paper's task has three; None elsewhere.
        algorithm: The paper's; None for a task that it does not have.
        success: The paper's success [%]; None where it is left blank.
    """

    task: str
    level: int | None
    algorithm: str | None
    success: int | None

    @property
    def name(self) -> str:
        """Name of the files of the row."""
        return self.task if self.level is None else f"{self.task}_level{self.level}"

    @property
    def title(self) -> str:
        """What to call it."""
        text = self.task.replace("_", " ")
        return text if self.level is None else f"{text}, level {self.level}"

    @property
    def paper(self) -> str:
        """What the paper has."""
        if self.algorithm is None:
            return "no such task"
        return self.algorithm + (", left blank" if self.success is None else f", {self.success} %")


# Ye et al., "RCareWorld: A Human-centric Simulation World for Caregiving Robots", table
# "Reinforcement Learning Simulation Results".
PAPER = (
    Row("feeding", None, "SAC", 92),
    Row("bathing", None, "SAC", 99),
    Row("dressing", None, "TQC", 93),
    Row("limb_repositioning", None, "SAC", 65),
    Row("ambulating", 1, "SAC", None),
    Row("ambulating", 2, "SAC", None),
    Row("ambulating", 3, "SAC", None),
    Row("toileting", None, "SAC", 83),
)
ROWS = (*PAPER, Row("drinking", None, None, None))


def cells(row: Row, folder: Path) -> tuple[str, ...]:
    """Return the texts of a row of the table."""
    file = folder / f"{row.name}.json"
    if not file.is_file():
        return (row.title, row.paper, *["-"] * 9, "no record yet")
    record = read_record(file)
    facts = [entry["file"] for entry in record["policies"]]
    if any(each is None for each in facts):
        named = ", ".join(e["policy"] for e in record["policies"] if e["file"] is None)
        raise ConfigError(f"{file}: not learned, but of that name: {named}")
    training = [each["training"] for each in facts]
    success = record["summary"]["success"]
    low, high = success["interval_95"]
    ships, script = (success_of(kind, row, record, folder) for kind in (SHIPPED, SCRIPTED))
    return (
        row.title,
        row.paper,
        _all(str(each.get("algorithm", "?")).upper() for each in training),
        _all(str(each.get("reward", "?")) for each in training),
        _all(beginning(each["residual"], each["training"]) for each in facts),
        _range([each.get("demonstrations") for each in training], "{:.0f} episodes", none="none"),
        _range([each.get("steps") for each in training], "{:,.0f}"),
        f"{_range([each.get('minutes') for each in training], '{:.0f}')} min, "
        + _all(str(each.get("machine", "machine not recorded")) for each in training),
        f"{100 * success['mean']:.1f} % ({100 * low:.1f} to {100 * high:.1f})",
        *("no record" if rate is None else f"{100 * rate:.1f} %" for rate in (ships, script)),
        "; ".join(remarks(row, record, script)) or "-",
    )


def remarks(row: Row, record: Mapping[str, Any], script: float | None) -> list[str]:
    """Return what a reader of the row must know, or nothing."""
    out = []
    mean, count = record["summary"]["success"]["mean"], len(record["policies"])
    if row.success is not None and mean < row.success / 100:
        out.append("below the paper")
    if script is not None and script > mean:
        out.append("the scripted policy is better")
    copies = sum(entry["file"]["training"].get("steps") == 0 for entry in record["policies"])
    if copies:
        out.append(f"{copies} of {count} copy the demonstrations: no later one was better")
    if (count, record["plan"]["episodes"]) != (SEEDS, EPISODES):
        out.append(f"{count} policies x {record['plan']['episodes']} episodes")
    given = {**record["plan"]["options"], **record["plan"]["cast"]}
    given.pop("reward", None)
    if row.level is not None and given.pop("level", 1) != row.level:
        out.append(f"evaluated at level {record['plan']['cast'].get('level', 1)}")
    if given:
        out.append("with " + ", ".join(f"{name} {value}" for name, value in given.items()))
    return out


def success_of(kind: str, row: Row, record: Mapping[str, Any], folder: Path) -> float | None:
    """Return the success of the scripted or shipped policy on the same episodes; None without a record.

    Raises:
        ConfigError: If its record is of other episodes.
    """
    file = folder / f"{row.name}_{kind}.json"
    ours = folder / f"{row.name}{SUFFIX}"
    if kind == SHIPPED and ours.is_file() and not file.is_file():
        ships = digest(ours)
        places = [i for i, e in enumerate(record["policies"]) if e["file"]["sha256"] == ships]
        return float(record["summary"]["success"]["runs"][places[0]]) if places else None
    if not file.is_file():
        return None
    other = read_record(file)
    for key in ("task", "episodes", "seed", "options", "cast", "others"):
        if other["plan"][key] != record["plan"][key]:
            raise ConfigError(
                f"{file.name} and {row.name}.json are of other episodes: {key} is "
                f"{other['plan'][key]!r} and {record['plan'][key]!r}"
            )
    return float(other["summary"]["success"]["mean"])


def run_again(row: Row, folder: Path, processes: int) -> None:
    """Play the scripted policy, and the one that ships, on the episodes of a row's record."""
    file = folder / f"{row.name}.json"
    if not file.is_file():
        return
    plan = Plan(**read_record(file)["plan"])
    ships = trained.SPECIALIST if trained.for_everybody(plan.task) else trained.NAME
    for kind, policy in ((SCRIPTED, SCRIPTED), (SHIPPED, ships)):
        record = assess(replace(plan, policies=(policy,)), processes=processes).to_dict()
        write_whole(folder / f"{row.name}_{kind}.json", record_text(record).encode())


def _all(values: Iterable[str]) -> str:
    """Return the one text of all, or the different ones."""
    return ", ".join(dict.fromkeys(values))


def _range(values: Sequence[float | None], form: str, none: str = "") -> str:
    """Return the least and greatest of numbers as a text."""
    known = [value for value in values if value is not None]
    if not known:
        return "?"
    low, high = form.format(min(known)), form.format(max(known))
    text = low if low == high else f"{low} to {high}"
    return none if none and max(known) == 0 else text


def main(
    markdown: bool = False,
    evaluate: bool = False,
    processes: int = 1,
    folder: Path = trained.FOLDER,
) -> None:
    """Print the table; with --evaluate shipped and scripted policies play anew first."""
    if evaluate:
        for row in ROWS:
            run_again(row, folder, processes)
    rows = [cells(row, folder) for row in ROWS]
    if markdown:
        print(markdown_table(HEADS, rows))
    else:
        wide = max(console().width, 170)
        console().print(table("Trained policies, the paper's and ours", HEADS, rows), width=wide)


if __name__ == "__main__":
    typer.run(main)
