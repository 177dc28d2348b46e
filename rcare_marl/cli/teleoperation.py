"""The command `teleoperate`: people play roles of a task, each on a page of their own."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rcare_marl.console import print_line
from rcare_marl.errors import ConfigError, check_package

from .interruption import run_until_interrupted
from .parameter import (
    CaregiverModel,
    HomeLevel,
    HomeName,
    HomeRoom,
    Opens,
    Port,
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

if TYPE_CHECKING:
    from rcare_marl.envs.episode import RecordedEpisode


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
    port: Port = None,
    open_: Opens = True,
) -> None:
    """Play a role of a task by headset, keyboard, mouse, touch or gamepad, on a page, until Ctrl-C.

    Nothing moves unless you hold the clutch. Several people open the page once each.

    Example: rcare-marl teleoperate feeding --role robot --record runs/by_hand.hdf5

    Example: rcare-marl teleoperate feeding --role robot --role recipient
    """
    if not 0.05 <= speed <= 2:
        raise ConfigError(f"speed must lie in 0.05..2, got {speed:g}")
    scene = (
        task,
        tuple(role or ("robot",)),
        cast_of(robot, recipient, caregiver) | place_of(home, level, room),
        settings(option),
        pairs(role_policy, "--role-policy"),
        seed,
        record,
    )
    serve_scene(scene, port=port, opens=open_, speed=speed, waits=wait)


def serve_scene(
    scene: tuple[Any, ...],
    *,
    port: int | None,
    opens: bool,
    speed: float = 1.0,
    waits: bool = False,
    episodes: int = 0,
    replays: Sequence[RecordedEpisode] = (),
) -> None:
    """Serve the page of a scene until Ctrl-C, or until so many episodes were played.

    Args:
        scene: What `Scenario` takes.
        port: Where to serve.
        opens: Whether to open the page in a browser.
        speed: Simulated over real time.
        waits: Whether each step waits for all hands.
        episodes: How many; 0 goes on.
        replays: Recorded episodes of its task, to be shown again.
    """
    for package in ("aiohttp", "fast_simplification"):
        check_package(package, "the page of the scene", "coach")
    from rcare_marl.baselines.coaching.page.packages import packages_folder
    from rcare_marl.baselines.teleoperation.server import Server
    from rcare_marl.baselines.teleoperation.stage import Scenario

    scenario = replace(Scenario(*scene), replays=replays)
    three = packages_folder() / "three" / "build"

    async def serve() -> None:
        server = Server(
            scenario, speed=speed, waits=waits, three=three, episodes=episodes, told=print_line
        )
        record = scenario.record
        notes = () if record is None else (f"episodes are recorded to {record} when this ends",)
        page = serve_page(server, scenario.task, bound(LOOPBACK, port), notes=notes, opens=opens)
        serving = asyncio.create_task(page)
        ended = asyncio.create_task(server.done.wait())
        await asyncio.wait((serving, ended), return_when=asyncio.FIRST_COMPLETED)
        if serving.done():
            serving.result()
        for each in (serving, ended):
            each.cancel()
        await asyncio.gather(serving, ended, return_exceptions=True)

    run_until_interrupted(serve())
