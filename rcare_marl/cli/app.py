"""The commands and their options. What they do is in the modules beside this one, loaded on use."""

from __future__ import annotations

import signal
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import rcare_marl
from rcare_marl.console import print_error, print_line
from rcare_marl.errors import RcareError

from .coach import coach
from .export import export
from .interruption import postponed
from .parameter import (
    BenchAvatar,
    BenchDevice,
    BenchEpisodes,
    BenchPolicy,
    BenchQueries,
    BenchRooms,
    BenchSeconds,
    BenchTask,
    BestPolicyName,
    CaregiverModel,
    Episodes,
    HomeLevel,
    HomeName,
    HomeRoom,
    Json,
    Kind,
    OutputFile,
    Over,
    PlotFile,
    PolicyName,
    PolicyPatterns,
    Processes,
    ProtocolName,
    Randomise,
    RecipientModel,
    Record,
    RobotModel,
    RolePolicies,
    SavedEpisodes,
    Seed,
    Subject,
    Task,
    TaskOptions,
    WorkerCounts,
    cast_of,
    pairs,
    place_of,
    print_json,
    settings,
)
from .people import people
from .ros import ros
from .teleoperation import teleoperate
from .training import train
from .watching import play, replay

INTERRUPTED = 130  # exit status of a program that Ctrl-C ended, as shells have it
TERMINATED = 143  # the same for SIGTERM


class Guarded(TyperGroup):
    """Says what is wrong in one line, without a traceback, when the library refuses something."""

    def invoke(self, ctx: Any) -> Any:
        try:
            with warnings.catch_warnings():
                warnings.showwarning = lambda message, *_, **__: print_line(f"warning: {message}")
                return super().invoke(ctx)
        except RcareError as error:
            if ctx.params.get("debug"):
                raise
            print_error(str(error))
            raise typer.Exit(2) from None
        except ModuleNotFoundError as error:  # where only what environments need is installed
            if ctx.params.get("debug") or (error.name or "").startswith("rcare_marl"):
                raise
            print_error(f"this needs {error.name}, which is not installed: see docs/install.md")
            raise typer.Exit(2) from None
        except KeyboardInterrupt:
            print_line("interrupted")
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(
    cls=Guarded,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(invoke_without_command=True)
def root(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks of errors.")] = False,
) -> None:
    """Multi-agent caregiving: people with real mobility limitations, robots, care tasks.

    Start with: rcare-marl demo
    """
    if version:
        typer.echo(rcare_marl.__version__)
        raise typer.Exit()


@app.command("list")
def list_(
    kind: Annotated[
        Kind | None, typer.Argument(help="What to list; everything but licences if left out.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List what there is: tasks, people, robots, policies, devices, homes, sensors, randomisations and more.

    Example: rcare-marl list avatars
    """
    from . import listing

    kinds = [kind.value] if kind is not None else [e.value for e in Kind if e is not Kind.licences]
    rows = {name: listing.rows(name) for name in kinds}
    if as_json:
        print_json(rows[kinds[0]] if kind is not None else rows)
    else:
        listing.show(rows)


@app.command()
def describe(
    task: Task,
    robot: RobotModel = None,
    recipient: RecipientModel = None,
    caregiver: CaregiverModel = None,
    option: TaskOptions = None,
    as_json: Json = False,
) -> None:
    """Show who plays in a task, what each role does and sees, its settings and its constants.

    Example: rcare-marl describe feeding --recipient jose
    """
    from . import description

    facts = description.describe(task, cast_of(robot, recipient, caregiver), settings(option))
    if as_json:
        print_json(facts)
    else:
        description.show(facts)


@app.command()
def evaluate(
    context: typer.Context,
    task: Task,
    policy: PolicyName = "scripted",
    policies: PolicyPatterns = None,
    over: Over = None,
    protocol: ProtocolName = None,
    episodes: Episodes = None,
    seed: Seed = 0,
    processes: Processes = 1,
    role_policy: RolePolicies = None,
    robot: RobotModel = None,
    recipient: RecipientModel = None,
    caregiver: CaregiverModel = None,
    home: HomeName = None,
    level: HomeLevel = None,
    room: HomeRoom = None,
    option: TaskOptions = None,
    randomise: Randomise = None,
    as_json: Json = False,
    output: OutputFile = None,
    plot: PlotFile = None,
    save_episodes: SavedEpisodes = None,
    record: Record = None,
) -> None:
    """Run seeded episodes and report success, forces, spilling and returns.

    In the JSON, peak_force_n is the greatest force of all episodes and spilled the sum.

    Every metric of the task also has its _mean and _max over episodes.

    With --policies, --processes or --plot the JSON is that of a record over all policies; --output
    always writes one, which rcare-marl replay runs again. See docs/evaluation.md.

    Example: rcare-marl evaluate feeding --policy scripted --episodes 20 --json

    Example: rcare-marl evaluate feeding --policies 'runs/seed*/policy.npz' --out record.json

    Example: rcare-marl evaluate feeding --episodes 3 --record runs/feeding.hdf5

    Example: rcare-marl evaluate feeding --role-policy robot=learned --randomise delay_1

    Example: rcare-marl evaluate feeding --over people=six,robots=reachable --out matrix.json

    Example: rcare-marl evaluate feeding --protocol everybody --policies learned --out board.json
    """
    from . import assessment

    given: dict[str, Any] = {
        "seed": seed,
        "options": settings(option),
        "cast": cast_of(robot, recipient, caregiver) | place_of(home, level, room),
        "randomise": randomise,
    }
    others = pairs(role_policy, "--role-policy")
    if protocol is not None:
        from . import leaderboard

        _check_only(context, "protocol", "policy", "policies", "processes", "as_json", "output")
        names = policies or [policy]
        fine = leaderboard.run(
            task, protocol, names, processes=processes, output=output, as_json=as_json
        )
        raise typer.Exit(0 if fine else 1)
    if over:
        from . import matrix

        left_out = ("policies", "plot", "save_episodes", "record")
        _check_only(context, "over", *(name for name in context.params if name not in left_out))
        axes = matrix.parse_over(",".join(over))
        plan = matrix.MatrixPlan(task, axes, policy, others, episodes or 5, **given)
        fine = matrix.run(plan, processes=processes, output=output, as_json=as_json)
        raise typer.Exit(0 if fine else 1)
    given |= {"episodes": episodes or 100, "processes": processes, "save": save_episodes}
    found = assessment.run(task, policies or [policy], others, dataset=record, **given)
    of_one = not policies and plot is None and processes == 1
    assessment.report(found, output=output, plot=plot, as_json=as_json, of_one=of_one)


def _check_only(context: typer.Context, option: str, *others: str) -> None:
    """Refuse what was given beside an option and is none of the others that go with it."""
    for parameter in context.command.params:
        name, is_option = str(parameter.name), parameter.param_type_name == "option"
        source = context.get_parameter_source(name)
        given = source is not None and source.name == "COMMANDLINE"
        if is_option and given and name not in (option, *others):
            hint = max(parameter.opts, key=len)
            raise typer.BadParameter(f"does not go with --{option}", param_hint=hint)


@app.command()
def demo(
    episodes: Annotated[int, typer.Option(min=1, help="How many episodes to run.")] = 10,
    seed: Seed = 0,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Where to leave the files; runs/demo-1, -2, ... if left out."
        ),
    ] = None,
    video: Annotated[
        bool, typer.Option(help="Whether to film a meal in a dining room, too.")
    ] = True,
    policy: BestPolicyName = None,
    robot: RobotModel = None,
    recipient: RecipientModel = None,
) -> None:
    """Let a robot feed a person ten times; leave a video, a plot and a JSON record.

    Files appear whole or not at all, also if you press Ctrl-C.

    Example: rcare-marl demo --recipient jose --output runs/jose
    """
    from . import demonstration

    demonstration.run(
        episodes=episodes,
        seed=seed,
        output=output,
        video=video,
        policy=policy,
        cast=cast_of(robot, recipient, None),
    )


@app.command()
def gallery(
    kind: Annotated[
        str, typer.Argument(metavar="KIND", help="What to draw: robots, avatars or all.")
    ] = "all",
    name: Annotated[
        list[str] | None,
        typer.Option(
            "--name",
            help="Only this one, by name or YAML file; may be given several times.",
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Where to leave the pictures.")
    ] = Path("runs") / "gallery",
    meshes: Annotated[
        bool, typer.Option(help="Whether to draw real meshes of robots where they are installed.")
    ] = True,
    size: Annotated[
        tuple[int, int],
        typer.Option(min=64, max=4096, metavar="WIDTH HEIGHT", help="Of a picture [pixel]."),
    ] = (480, 600),
) -> None:
    """Draw every robot and every avatar, with names: one picture each, and a sheet of each kind.

    Example: rcare-marl gallery robots --output pictures
    """
    from . import gallery as pictures

    kinds = pictures.check_kind(kind)
    for file in pictures.make(output, kinds, name or (), meshes=meshes, size=size):
        typer.echo(file)


@app.command()
def home(
    name: Annotated[str, typer.Argument(metavar="HOUSE", help="Such as house_07.")],
    level: Annotated[
        int, typer.Option(min=1, max=3, help="1 usual, 2 partially barrier-free, 3 barrier-free.")
    ] = 1,
    room: Annotated[
        list[str] | None,
        typer.Option("--room", help="Draw this room as well; may be given several times."),
    ] = None,
    way: Annotated[
        tuple[str, str] | None,
        typer.Option("--way", metavar="FROM TO", help="Draw a wheelchair's way between two rooms."),
    ] = None,
    output: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Where to leave the pictures.")
    ] = Path("runs") / "homes",
) -> None:
    """Draw a house, its plan and a perspective, and say what keeps a wheelchair out.

    Example: rcare-marl home house_07 --level 3 --way bedroom_1 kitchen_1
    """
    from . import housing

    housing.show(name, level, rooms=room or (), way=way, output=output)


@app.command()
def validate(
    subject: Annotated[Subject, typer.Argument(help="What to check.")],
    family: Annotated[
        list[str] | None,
        typer.Option("--family", help="Only these checks; may be given several times."),
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Show every row, not only those out of band.")
    ] = False,
    output: OutputFile = None,
    page: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Leave all rows as a page in Markdown.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Compare simulated people with published figures, fitted and held-out ones apart.

    Example: rcare-marl validate people --family body --all
    """
    from . import validation

    validation.run(family or (), every=every, as_json=as_json, record=output, page=page)


app.command()(replay)
app.command()(play)
app.command()(teleoperate)
app.command()(train)
app.command()(export)
app.command()(people)
app.add_typer(coach, name="coach")
app.add_typer(ros, name="ros")


@app.command()
def bench(
    what: Annotated[
        str,
        typer.Argument(
            metavar="TASK|all|avatars|batch|homes|learning|parity|planning",
            help="A task, [bold]all[/bold] tasks, [bold]avatars[/bold] for people, "
            "[bold]homes[/bold] for houses, [bold]learning[/bold], [bold]planning[/bold], or "
            "[bold]batch[/bold] and [bold]parity[/bold] for MuJoCo beside Bullet.",
        ),
    ],
    of: BenchTask = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Control steps to time; 300 if left out.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of a task's resets and actions.")
    ] = None,
    robot: RobotModel = None,
    recipient: RecipientModel = None,
    caregiver: CaregiverModel = None,
    home: HomeName = None,
    level: HomeLevel = None,
    room: HomeRoom = None,
    avatar: BenchAvatar = None,
    seconds: BenchSeconds = None,
    task: Annotated[
        str | None, typer.Option(help="What `learning` measures; feeding if left out.")
    ] = None,
    device: BenchDevice = None,
    processes: WorkerCounts = None,
    queries: BenchQueries = None,
    rooms: BenchRooms = None,
    episodes: BenchEpisodes = None,
    policy: BenchPolicy = None,
    as_json: Json = False,
) -> None:
    """Measure speed: of a task or all of them, of people with and without muscles, of houses, of learning.

    A task: steps, resets, import, and what the environment costs on top of the physics;
    overhead_ratio is the time of a control step over that of its physics steps alone.

    all: every task, at every level where it has levels of its own.

    avatars: frames of 1/60 s per second of one whole person nodding, the muscle kernel, 1,024 people.

    homes: how long a house takes to load, and what it adds to a step of feeding.

    learning: steps per second with a policy, on one core and over processes, and updates per second.

    planning: how many paths are found in 2 s in furnished rooms with somebody seated, and what they touch.

    parity: how nearly MuJoCo does what Bullet does, each figure with its bound; batch: how fast.

    Example: rcare-marl bench feeding --json

    Example: rcare-marl bench parity feeding --policy learned --episodes 500 --json

    Example: rcare-marl bench all

    Example: rcare-marl bench homes --home house_07
    """
    from rcare_marl.baselines.benchmark import choice as speed

    options: dict[str, Any] = {"steps": steps, "seed": seed, "avatar": avatar, "seconds": seconds}
    if of is not None and what not in ("batch", "parity"):
        raise typer.BadParameter(f"bench {what} takes no task", param_hint="TASK")
    options |= {"task": of or task, "device": device, "processes": processes}
    options |= {"queries": queries, "rooms": rooms, "episodes": episodes, "policy": policy}
    options |= {**place_of(home, level, room), **cast_of(robot, recipient, caregiver)}
    given = {name: value for name, value in options.items() if value is not None}
    for name in speed.unwanted(what, given):
        raise typer.BadParameter(f"bench {what} does not take it", param_hint=f"--{name}")
    result = speed.measure(what, given)
    if as_json:
        print_json(result)
    else:
        speed.show(what, result)
    if not result.get("complete", True):
        raise typer.Exit(INTERRUPTED if result["interrupted"] else 1)


def _terminate(*_: object) -> None:
    raise SystemExit(TERMINATED)  # so that temporary files are removed on the way out


def main() -> None:
    """Run the command line."""
    signal.signal(signal.SIGTERM, postponed(_terminate))
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # ignored in the background
        signal.signal(signal.SIGINT, postponed(signal.default_int_handler))
    app()
