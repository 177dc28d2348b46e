"""The command `teleoperate`: people play roles of a task, each on a page of their own."""

from __future__ import annotations

import asyncio
from typing import Annotated

import typer

from rcare_marl.console import print_line
from rcare_marl.errors import ConfigError, check_package

from .parameter import (
    CaregiverModel,
    HomeLevel,
    HomeName,
    HomeRoom,
    RecipientModel,
    Record,
    RobotModel,
    RolePolicies,
    Seed,
    Task,
    TaskOptions,
    cast_of,
    pairs,
    place_of,
    settings,
)
from .serving import LOOPBACK, bound, serve_page


def teleoperate(
    task: Task,
    role: Annotated[
        list[str] | None,
        typer.Option(
            "--role",
            metavar="ROLE",
            help="Role that a person plays: robot, recipient or caregiver; may be given several times, for "
            "several people. The robot if left out.",
        ),
    ] = None,
    role_policy: RolePolicies = None,
    seed: Seed = 0,
    robot: RobotModel = None,
    recipient: RecipientModel = None,
    caregiver: CaregiverModel = None,
    home: HomeName = None,
    level: HomeLevel = None,
    room: HomeRoom = None,
    option: TaskOptions = None,
    record: Record = None,
    speed: Annotated[
        float, typer.Option(help="Simulated over real time, 0.05 to 2: below 1 is slow motion.")
    ] = 1.0,
    wait: Annotated[
        bool, typer.Option("--wait", help="Let each step wait until every hand has answered.")
    ] = False,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Where to serve; 0 takes a free port.")
    ] = None,
    open_: Annotated[
        bool, typer.Option("--open/--no-open", help="Whether to open the page in your browser.")
    ] = True,
) -> None:
    """Play a role of a task by headset, keyboard, mouse, touch or gamepad, on a page of this computer, until Ctrl-C.

    Nothing moves unless you hold the clutch. Several people open the page once each.

    Example: rcare-marl teleoperate feeding --role robot --record runs/by_hand.hdf5

    Example: rcare-marl teleoperate feeding --role robot --role recipient
    """
    check_package("aiohttp", "the page of teleoperation", "coach")
    if not 0.05 <= speed <= 2:
        raise ConfigError(f"speed must lie in 0.05..2, got {speed:g}")
    from rcare_marl.baselines.coaching.page.three import three_folder
    from rcare_marl.baselines.teleoperation.server import Server
    from rcare_marl.baselines.teleoperation.stage import Scenario

    scenario = Scenario(
        task,
        tuple(role or ("robot",)),
        cast_of(robot, recipient, caregiver) | place_of(home, level, room),
        settings(option),
        pairs(role_policy, "--role-policy"),
        seed,
        record,
    )

    three = three_folder()

    async def serve() -> None:
        server = Server(scenario, speed=speed, waits=wait, three=three)
        notes = () if record is None else (f"episodes are recorded to {record} when this ends",)
        await serve_page(server, task, bound(LOOPBACK, port), notes=notes, opens=open_)

    try:
        asyncio.run(serve())
    except KeyboardInterrupt:  # the way to end it, so no failure
        print_line("stopped")
