"""What several commands take on their command line, and how it is read."""

from __future__ import annotations

import json
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from rcare_marl.errors import ConfigError, shown


class Kind(str, Enum):
    """What `list` can list."""

    tasks = "tasks"
    robots = "robots"
    avatars = "avatars"
    populations = "populations"
    postures = "postures"
    policies = "policies"
    devices = "devices"
    homes = "homes"
    sensors = "sensors"
    exercises = "exercises"
    algorithms = "algorithms"
    randomisations = "randomisations"
    licences = "licences"  # of what is installed


class Subject(str, Enum):
    """What `validate` can check."""

    people = "people"


Task = Annotated[str, typer.Argument(metavar="TASK", help="A task, see: rcare-marl list tasks")]
RobotModel = Annotated[
    str | None,
    typer.Option(
        "--robot", metavar="MODEL", help="Robot, by name or YAML file; else the task's own choice."
    ),
]
RecipientModel = Annotated[
    str | None,
    typer.Option(
        "--recipient",
        metavar="MODEL",
        help="Avatar who is cared for, by name or YAML file, or options in braces such as "
        "'{model: karan, actuation: muscle}'; else the task's own choice.",
    ),
]
CaregiverModel = Annotated[
    str | None,
    typer.Option("--caregiver", metavar="MODEL", help="Avatar who helps; nobody if left out."),
]
TaskOptions = Annotated[
    list[str] | None,
    typer.Option(
        "--option",
        metavar="NAME=VALUE",
        help="Setting of the task, such as reward=shaped; may be given several times. "
        "See: rcare-marl describe TASK",
    ),
]
Randomise = Annotated[
    Any,
    typer.Option(
        parser=lambda text: _entry("--randomise", text),
        metavar="NAME|FILE",
        help="Perturb each episode: masses, friction, motors, places, delay, noise. The name of one that "
        "ships, a YAML file, or in braces such as '{action_delay: {steps: 1}}'. See docs/randomisation.md.",
    ),
]
HomeName = Annotated[
    str | None,
    typer.Option(
        "--home", metavar="HOUSE", help="House in which it takes place, such as house_07."
    ),
]
HomeLevel = Annotated[
    int | None,
    typer.Option("--level", min=1, max=3, help="Its level of accessibility; 1 if left out."),
]
HomeRoom = Annotated[
    str | None, typer.Option("--room", help="The room; the first that suits if left out.")
]
PolicyName = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="Policy of the robot, see: rcare-marl list policies; or its file (.npz). Beside it the "
        "other roles are played by their default partner. Only with [bold]random[/bold] all roles act "
        "at random.",
    ),
]
BestPolicyName = Annotated[
    str | None,
    typer.Option(
        "--policy",
        metavar="NAME",
        help="Policy of the robot; if left out, [bold]learned[/bold] where a trained one ships for "
        "this task and robot, else [bold]scripted[/bold].",
    ),
]
PolicyPatterns = Annotated[
    list[str] | None,
    typer.Option(
        "--policies",
        metavar="PATTERN",
        help="In place of --policy: several, by name, file or pattern of files such as "
        "'runs/seed*/policy.npz'. Each plays the same seeds.",
    ),
]
RolePolicies = Annotated[
    list[str] | None,
    typer.Option(
        "--role-policy",
        metavar="ROLE=NAME",
        help="Policy of one role, such as recipient=still; may be given several times.",
    ),
]
Seed = Annotated[
    int, typer.Option(min=0, help="Seed of the first episode; episode i has the seed SEED + i.")
]
BenchTask = Annotated[
    str | None,
    typer.Argument(metavar="TASK", help="Of `batch` and `parity`; feeding if left out."),
]
BenchAvatar = Annotated[
    str | None, typer.Option(metavar="MODEL", help="Whom `avatars` measures; karan if left out.")
]
BenchQueries = Annotated[
    int | None, typer.Option(min=1, help="Paths that `planning` looks for in each room.")
]
BenchEpisodes = Annotated[
    int | None,
    typer.Option(
        min=1, help="Of each shipped policy on each engine, for `parity`; none if left out."
    ),
]
BenchPolicy = Annotated[
    str | None,
    typer.Option(
        "--policy", metavar="NAME", help="Of the episodes of `parity`; all that ship if left out."
    ),
]
BenchRooms = Annotated[
    int | None, typer.Option(min=1, max=16, help="Rooms of `planning`, each in another house.")
]
BenchSeconds = Annotated[
    float | None,
    typer.Option(
        min=0.1,
        help="Simulated time for `avatars`, 5 if left out; time of each part of `learning`, 10; "
        "of all of `planning`, as long as it takes.",
    ),
]
BenchDevice = Annotated[str | None, typer.Option(help="Where `batch` lets MuJoCo run: cpu.")]
WorkerCounts = Annotated[
    str | None,
    typer.Option(
        metavar="COUNTS",
        help="Of workers, for `learning` (1,2 if left out), `planning`, `parity` and `batch` (1).",
    ),
]
Processes = Annotated[
    int, typer.Option(min=1, help="How many processes run them; the numbers are the same.")
]
OutputFile = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "--out",
        metavar="FILE",
        help="Also write a record, with every episode, to this file.",
    ),
]
PlotFile = Annotated[
    Path | None,
    typer.Option("--plot", metavar="FILE", help="Draw success, returns and forces as a PNG."),
]
ProtocolName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE",
        help="Judge --policies by the rows of a protocol, such as [bold]everybody[/bold]: strangers, "
        "partners, robots, homes, perturbations. See docs/leaderboard.md.",
    ),
]
Over = Annotated[
    list[str] | None,
    typer.Option(
        metavar="AXES",
        help="A matrix in place of one cast: [bold]people[/bold], [bold]robots[/bold], "
        "[bold]partners[/bold] and [bold]homes[/bold] with values joined by +, such as "
        "people=six,robots=reachable,partners=all,homes=2. May be given several times. "
        "See docs/evaluation.md.",
    ),
]
Episodes = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="How many episodes to run with each policy; 100 if left out, and 5 of each cell of --over.",
        show_default=False,
    ),
]
SavedEpisodes = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER", help="Leave each episode there, for [bold]rcare-marl replay[/bold]."
    ),
]
Record = Annotated[
    Path | None,
    typer.Option(
        metavar="PATH",
        help="Record all episodes there as a dataset: FILE.hdf5 for robomimic, FILE.mcap for MCAP, a folder "
        "NAME-v0 for Minari, another one for LeRobot.",
    ),
]
Port = Annotated[
    int | None, typer.Option(min=0, max=65535, help="Where to serve; 0 takes a free port.")
]
Opens = Annotated[
    bool, typer.Option("--open/--no-open", help="Whether to open the page in your browser.")
]
Demonstrated = Annotated[
    Path | None,
    typer.Option(
        metavar="PATH",
        help="Begin with recorded episodes in place of scripted ones: what --record wrote, in any of its "
        "formats. See docs/datasets.md.",
    ),
]
Which = Annotated[
    int | None, typer.Option("--episode", min=0, help="Only this one of a dataset, from 0 on.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON value and nothing else.")]


def cast_of(robot: str | None, recipient: str | None, caregiver: str | None) -> dict[str, Any]:
    """Return who plays, by role, as `rcare_marl.make` takes it."""
    entries = {"robot": robot, "recipient": recipient, "caregiver": caregiver}
    return {role: _entry(role, text) for role, text in entries.items() if text is not None}


def place_of(home: str | None, level: int | None, room: str | None) -> dict[str, Any]:
    """Return where it takes place, as `rcare_marl.make` takes it."""
    place = {"home": home, "level": level, "room": room}
    return {name: value for name, value in place.items() if value is not None}


def _entry(role: str, text: str) -> Any:
    """Return a model's name, or what stands in braces as a mapping of options."""
    from rcare_marl.config import parse_yaml

    if not text.lstrip().startswith("{"):
        return text
    try:
        return parse_yaml(text, role)
    except ConfigError as error:
        raise typer.BadParameter(
            f"not a mapping in YAML: {shown(text)}", param_hint=role
        ) from error


def pairs(values: Sequence[str] | None, flag: str) -> dict[str, str]:
    """Return texts NAME=VALUE as a mapping; BadParameter names the `flag` they came with."""
    out = {}
    for value in values or ():
        name, sign, rest = value.partition("=")
        if not (name and sign and rest):
            raise typer.BadParameter(f"expected NAME=VALUE, got {value!r}", param_hint=flag)
        out[name.strip()] = rest.strip()
    return out


def settings(values: Sequence[str] | None, flag: str = "--option") -> dict[str, Any]:
    """Return settings from texts NAME=VALUE, whose values are read as YAML; see `pairs`."""
    from rcare_marl.config import parse_yaml

    out: dict[str, Any] = {}
    for name, text in pairs(values, flag).items():
        try:
            out[name] = parse_yaml(text, name)  # so that 20 is a number and true is true
        except ConfigError:
            raise typer.BadParameter(f"cannot read {shown(text)}", param_hint=flag) from None
    return out


def print_json(value: Any) -> None:
    """Print a value as JSON on standard output."""
    typer.echo(json.dumps(value, indent=2, allow_nan=False))
