"""A leaderboard: policies of a task judged by one protocol, whoever trained them.

A protocol is data, `assets/protocols/<name>.yaml`: rows, each a matrix with its own seeds. What comes of it
is one record; those in `baselines/leaderboard/` are the board, which `check` compares with the protocol as
it is, so that nobody is listed by other people, seeds or rules.

Example:
    >>> protocol = Protocol.find("everybody")
    >>> record = judge(protocol, "feeding", ("learned", "scripted"), processes=2)
    >>> record["policies"]["learned"]["rows"]["strangers"]["success_rate_of_feasible"]
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from rcare_marl import assets
from rcare_marl.agents.people.sampling.population import find_avatar, people_named, person_hash
from rcare_marl.config import load
from rcare_marl.envs.company import model_of
from rcare_marl.errors import ConfigError, RcareError, check_name
from rcare_marl.provenance import MEASURED_WITH, machine, versions
from rcare_marl.reading import read_json

from .axes import RECIPIENT
from .matrix import Matrix, MatrixPlan, Outcome, Progress, run_cells
from .protocol import Plan, file_facts

FORMAT = 1  # of a record
NONE = "No record stands here yet.\n"
FOLDER = Path(__file__).resolve().parents[1] / "leaderboard"


@dataclass(frozen=True)
class Row:
    """One row of a protocol; attributes as of `MatrixPlan`, with the same seeds for everybody."""

    seed: int
    episodes: int
    over: dict[str, tuple[str, ...]] = field(default_factory=dict)
    cast: dict[str, Any] = field(default_factory=dict)
    randomise: Any = None

    def plan(self, task: str, policy: str) -> MatrixPlan:
        """Return what is to be run for a policy; errors as of `MatrixPlan`."""
        return MatrixPlan(task, policy=policy, own_seeds=False, **vars(self))

    @property
    def people(self) -> tuple[str, ...]:
        """Whom it names: people, or populations."""
        named = model_of(self.cast.get(RECIPIENT))
        return (*self.over.get("people", ()), *([] if named is None else [str(named)]))


@dataclass(frozen=True)
class Protocol:
    """Rows by name.

    Attributes:
        version: Raised by whoever changes a row.
        rows: What is to be run.
        reference: The row that others are compared with.

    Raises:
        UnknownNameError: If the reference is no row.
    """

    version: int
    rows: dict[str, Row]
    reference: str
    name: str = ""

    def __post_init__(self) -> None:
        check_name("row of a protocol", self.reference, self.rows)

    @classmethod
    def find(cls, name: str | Path) -> Protocol:
        """Return a protocol by name or YAML file.

        Raises:
            UnknownNameError: If there is none of that name.
            ConfigError: If it is none.
        """
        path = assets.find("protocols", name)
        return replace(load(cls, path), name=path.stem)

    def digest(self) -> str:
        """Return the SHA-256 of its rows and of everything that the people in them are."""
        named = {
            one for row in self.rows.values() for who in row.people for one in people_named(who)
        }
        facts = {
            "protocol": asdict(self),
            "people": {name: person_hash(find_avatar(name)) for name in sorted(named)},
        }
        return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()

    def plans(self, task: str, policy: str) -> tuple[dict[str, MatrixPlan], dict[str, str]]:
        """Return the rows that a task has, and why it has not the others.

        Raises:
            UnknownNameError: If there is no such task or policy.
        """
        MatrixPlan(task, {}, policy)  # so that what follows can only be the row's own
        plans, others = dict[str, MatrixPlan](), dict[str, str]()
        for name, row in self.rows.items():
            try:
                plans[name] = row.plan(task, policy)
            except RcareError as error:  # such as a partner whom nobody plays in this task
                others[name] = str(error)
        return plans, others


def judge(
    protocol: Protocol,
    task: str,
    policies: Sequence[str],
    *,
    processes: int = 1,
    on_start: Callable[[int], None] | None = None,
    on_progress: Progress | None = None,
    on_cell: Callable[[dict[str, Any], Outcome], None] | None = None,
) -> dict[str, Any]:
    """Run a protocol for policies and return the record, the same however many processes there are.

    Args:
        protocol: What to run.
        task: Name of the task.
        policies: Of the robot: names or files.
        processes: How many at once; the longest cells go first.
        on_start: Told how many episodes there will be.
        on_progress: Called with the number of episodes that were done since.
        on_cell: Called after each cell with the record so far and with it.

    Returns:
        Plain values for JSON: by policy its file and, by row, counts and figures as of `Matrix.total`.

    Raises:
        UnknownNameError: If there is no such task or policy.
        ConfigError: If there is no policy, one stands there twice, or a file is none for this task.
    """
    facts = Plan(task, tuple(policies))  # refuses none, and one twice
    files = {name: file_facts(facts, name) for name in policies}
    plans = {name: protocol.plans(task, name) for name in policies}
    cells = [
        (policy, row, cell)
        for policy, (rows, _) in plans.items()
        for row, plan in rows.items()
        for cell in plan.cells()
    ]
    cells.sort(key=lambda each: -each[2].plan.episodes)  # stable, so always the same
    if on_start is not None:
        on_start(sum(cell.plan.episodes for *_, cell in cells))
    digest = protocol.digest()

    def record(done: Mapping[int, Outcome]) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "kind": "protocol",
            "protocol": protocol.name,
            "version": protocol.version,
            "sha256": digest,
            "task": task,
            "complete": len(done) == len(cells),
            "policies": {
                policy: {
                    "file": files[policy],
                    "rows": {
                        row: _figures(
                            plan, [o for i, o in done.items() if cells[i][:2] == (policy, row)]
                        )
                        for row, plan in rows.items()
                    },
                    "not_in_this_task": missing,
                }
                for policy, (rows, missing) in plans.items()
            },
            "versions": versions(),
            "machine": machine(),
        }

    def tell(done: Mapping[int, Outcome], last: Outcome) -> None:
        if on_cell is not None:
            on_cell(record(dict(sorted(done.items()))), last)

    found = run_cells([cell for *_, cell in cells], processes, on_progress, tell)
    return record(dict(enumerate(found)))


def _figures(plan: MatrixPlan, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    reasons = sorted({each.reason for each in outcomes if each.reason})
    return {**Matrix(plan, tuple(outcomes)).total(), "reasons": reasons}


def read_entry(path: str | Path) -> dict[str, Any]:
    """Return a record of the board, if it may stand there.

    Raises:
        ConfigError: If it is no record, is not whole, or was not made by its protocol as it is, with the
            policy that it names; the message says which.
    """
    entry = read_json(path, "a record of a protocol")
    if entry.get("kind") != "protocol" or entry.get("format") != FORMAT:
        raise ConfigError(f"{path} holds no record of a protocol, of format {FORMAT}")
    protocol = Protocol.find(str(entry.get("protocol")))
    if entry.get("sha256") != protocol.digest():
        raise ConfigError(
            f"{path} was made with other people, seeds or rows than protocol {protocol.name!r} has, which "
            f"is of version {protocol.version}: judge the policies anew"
        )
    if entry.get("complete") is not True:
        raise ConfigError(f"{path} is not complete: some cells were not run")
    if missing := sorted({"rcare_marl", "python", *MEASURED_WITH} - set(entry.get("versions", ()))):
        raise ConfigError(
            f"{path} does not say which versions of {', '.join(missing)} it was made with"
        )
    for policy, found in entry["policies"].items():
        _check_policy(f"{path}: {policy}", protocol, entry["task"], policy, found)
    return entry


def _check_policy(
    where: str, protocol: Protocol, task: str, policy: str, found: Mapping[str, Any]
) -> None:
    is_named = not Path(policy).suffix
    if is_named:
        now = file_facts(Plan(task, (policy,)), policy)
        if (now or {}).get("sha256") != (found["file"] or {}).get("sha256"):
            raise ConfigError(f"{where} is another file now: judge it anew")
    elif not (found["file"] or {}).get("sha256"):
        raise ConfigError(f"{where} has no SHA-256 of its file")
    if "population:test" in json.dumps((found["file"] or {}).get("recipe", {})):
        raise ConfigError(
            f"{where} was trained with people of population:test, whom it is judged with"
        )
    # Whether a file is here or not, its rows are those of any policy of the task.
    plans, _ = protocol.plans(task, policy if is_named else "scripted")
    if list(found["rows"]) != list(plans):
        raise ConfigError(f"{where} has the rows {list(found['rows'])}, and not {list(plans)}")
    for name, row in found["rows"].items():
        cells = len(plans[name].cells())
        rates = (row["successes"], row["feasible_episodes"], row["episodes"])
        whole = row["cells"] == cells == row["done"] + row["refused"]
        if not whole or row["episodes"] != row["done"] * plans[name].episodes:
            raise ConfigError(f"{where}: row {name!r} is not whole, {row['crashed']} cells crashed")
        if not 0 <= rates[0] <= rates[1] <= rates[2]:
            raise ConfigError(f"{where}: row {name!r} has more successes than episodes")


def rows_of(entries: Iterable[Mapping[str, Any]]) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return the heads and rows of a table of records of one task, a column a policy."""
    policies = [pair for entry in entries for pair in entry["policies"].items()]
    names = list(dict.fromkeys(row for _, found in policies for row in found["rows"]))
    heads = ["row", *(name for name, _ in policies)]
    return heads, [
        (row, *(_shown(found["rows"].get(row)) for _, found in policies)) for row in names
    ]


def _shown(row: Mapping[str, Any] | None) -> str:
    if row is None or not row["cells"]:
        return "-"
    parts = [f"{row[name]} {name}" for name in ("crashed", "refused") if row[name]]
    if row["feasible_episodes"]:
        low, high = (round(100 * end) for end in row["success_interval_95"])
        parts.insert(0, f"{row['successes']} of {row['feasible_episodes']}, {low} to {high} %")
    if row["peak_force_n_greatest"] is not None:
        parts.append(f"{row['peak_force_n_greatest']:.0f} N")
    return "; ".join(parts) or "-"


def board(folder: Path = FOLDER) -> str:
    """Return the board in Markdown: a table a task, of all records in a folder.

    Raises:
        ConfigError: If one of them may not stand there, see `read_entry`.
    """
    entries = [read_entry(path) for path in sorted(folder.glob("*.json"))]
    out = []
    for task in sorted({entry["task"] for entry in entries}):
        heads, rows = rows_of(entry for entry in entries if entry["task"] == task)
        lines = [heads, ["---"] * len(heads), *rows]
        out += [f"## {task}", "", *(f"| {' | '.join(line)} |" for line in lines), ""]
    return "\n".join(out) or NONE
