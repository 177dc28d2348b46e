"""The command `export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .parameter import (
    CaregiverModel,
    HomeLevel,
    HomeName,
    HomeRoom,
    RecipientModel,
    RobotModel,
    Seed,
    Task,
    TaskOptions,
    cast_of,
    place_of,
    settings,
)


def export(
    task: Task,
    form: Annotated[
        str,
        typer.Option("--format", metavar="FORMAT", help="mjcf (for MuJoCo), urdf or moveit."),
    ] = "mjcf",
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "--out",
            metavar="FOLDER",
            help="A new folder; runs/TASK-FORMAT if left out.",
        ),
    ] = None,
    robot: RobotModel = None,
    recipient: RecipientModel = None,
    caregiver: CaregiverModel = None,
    option: TaskOptions = None,
    home: HomeName = None,
    level: HomeLevel = None,
    room: HomeRoom = None,
    seed: Seed = 0,
    draws: Annotated[
        bool, typer.Option("--meshes/--no-meshes", help="Whether what is drawn is written, too.")
    ] = True,
) -> None:
    """Write the scene of a task as it stands after a reset, for other simulators.

    MJCF is one file with its meshes, and the start as the key frame "start". URDF is a file for each body,
    [bold]scene.yaml[/bold] with poses, bonds and who touches whom, and each person with all joints in
    active and in passive range. moveit is a package for MoveIt 2 of the robot, with everybody and all
    furniture as a planning scene; with the word moveit in place of a task, of the robot alone.

    Example: rcare-marl export feeding --format mjcf --output feeding

    Example: rcare-marl export moveit --robot pr2 --out pr2_moveit
    """
    from .exporting import run, run_moveit

    if task == "moveit":
        run_moveit(robot or "kinova_gen3", output or Path("runs") / "moveit")
        return
    cast = cast_of(robot, recipient, caregiver) | place_of(home, level, room)
    target = output or Path("runs") / f"{task}-{form}"
    run(task, cast, settings(option), form=form, seed=seed, draws=draws, output=target)
