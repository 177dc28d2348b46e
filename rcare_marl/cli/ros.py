"""The command `ros`: environments as robots on ROS 2, and policies on the topics of robots."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rcare_marl.console import print_line
from rcare_marl.errors import MissingPackageError, check_package

from .parameter import (
    CaregiverModel,
    RecipientModel,
    RobotModel,
    Seed,
    Task,
    TaskOptions,
    cast_of,
    settings,
)

ros = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Serve an environment as a robot on ROS 2, play a policy on the topics of one, or record them.",
    context_settings={"help_option_names": ["-h", "--help"]},
)
Namespace = Annotated[
    str, typer.Option(metavar="NAME", help="Of the robot's topics, where there are several.")
]
Count = Annotated[int, typer.Option(min=0, help="How many episodes; 0 goes on until Ctrl-C.")]


@ros.command()
def serve(
    task: Task,
    episodes: Count = 0,
    seed: Seed = 0,
    speed: Annotated[float, typer.Option(min=0.01, help="Times real time.")] = 1.0,
    namespace: Namespace = "",
    prefix: Annotated[str, typer.Option(help="Before the names of frames on /tf.")] = "",
    robot: RobotModel = None,
    recipient: RecipientModel = None,
    caregiver: CaregiverModel = None,
    option: TaskOptions = None,
) -> None:
    """Serve a task as a robot in real time: topics, actions and services, see docs/ros.md.

    Nothing moves until something is told. Needs ROS 2: an installation of it, or make ros.

    Example: rcare-marl ros serve feeding --episodes 20
    """
    _check_ros()
    from rcare_marl.baselines.ros import server
    from rcare_marl.baselines.ros.pace import Pace
    from rcare_marl.baselines.ros.served import ServedRobot

    def tell(pace: Pace) -> None:
        well = f"{sum(served.outcomes.values())} of {len(served.outcomes)} ended well"
        print_line(f"{well}; {pace.told()}")

    cast = cast_of(robot, recipient, caregiver)
    served = ServedRobot(task, cast=cast, options=settings(option), seed=seed)
    print_line(f"{task} is served; Ctrl-C ends")
    try:
        server.serve(
            served,
            episodes=episodes,
            speed=speed,
            namespace=namespace,
            prefix=prefix,
            on_end=tell,
        )
    finally:
        served.close()


@ros.command()
def play(
    task: Task = "feeding",
    policy: Annotated[
        str, typer.Option(metavar="POLICY", help="scripted, learned, or a policy file.")
    ] = "learned",
    episodes: Count = 0,
    namespace: Namespace = "",
    force: Annotated[float, typer.Option(help="On the tool that stops it [N].")] = 30.0,
    workspace: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(
            metavar="X0 Y0 Z0 X1 Y1 Z1", help="Corners between which the tool may be [m]."
        ),
    ] = None,
    patience: Annotated[
        float, typer.Option(help="How much later than usual a message may come [s].")
    ] = 0.08,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say what the robot would be told, and tell nothing.")
    ] = False,
    robot: RobotModel = None,
    recipient: RecipientModel = None,
    caregiver: CaregiverModel = None,
    option: TaskOptions = None,
) -> None:
    """Play a policy on the topics of a robot, behind a safety layer; the exit status is 1 after a stop.

    Example: rcare-marl ros play feeding --policy learned --episodes 20
    """
    _check_ros()
    from rcare_marl.baselines.evaluation import evaluate as baseline
    from rcare_marl.baselines.ros import player
    from rcare_marl.baselines.ros.safety import SafetyLimits
    from rcare_marl.baselines.ros.twin import Twin
    from rcare_marl.envs import make

    policies = baseline.lead_policies(task, policy)
    played = baseline.played_cast(task, cast_of(robot, recipient, caregiver), policies)
    env = make(task, options=settings(option), **played)
    given: dict[str, Any] = {"force": force, "patience": patience}
    if workspace is not None:
        given["workspace"] = workspace[:3], workspace[3:]
    try:
        twin = Twin(env)
        _, players = baseline.make_players(env, task, policies)
        found = player.play(
            twin,
            players["robot"],
            SafetyLimits(**given),
            episodes=episodes,
            namespace=namespace,
            dry_run=dry_run,
        )
    finally:
        env.close()
    print_line(f"{sum(found.outcomes.values())} of {len(found.outcomes)} ended well")
    if found.ages:
        ages = sorted(1e3 * age for age in found.ages)
        print_line(
            f"answers went out {ages[len(ages) // 2]:.1f} ms after the scene was told (median), "
            f"{ages[-1]:.0f} ms at most"
        )
    if found.stops:
        raise typer.Exit(1)


@ros.command()
def record(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Of MCAP, such as feeding.mcap.")],
    namespace: Namespace = "",
    seconds: Annotated[
        float, typer.Option(min=0.0, help="How long from the first scene on [s]; 0 goes on.")
    ] = 0.0,
) -> None:
    """Write what is told on all topics of a robot, /tf and /clock to an MCAP file.

    Example: rcare-marl ros record feeding.mcap
    """
    _check_ros()
    check_package("mcap", "recording", "data")
    from rcare_marl.baselines.ros.recorder import record as write

    counts = write(file, namespace, seconds)
    print_line(f"{file}: {sum(counts.values())} messages of {len(counts)} topics")


def _check_ros() -> None:
    from importlib.util import find_spec

    for module in ("rclpy", "control_msgs", "tf2_msgs"):
        if find_spec(module) is None:
            raise MissingPackageError("ROS 2", "ros")
