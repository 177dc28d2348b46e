"""The commands `replay` and `play`, as the command line takes them; `replaying` does what they say."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .parameter import (
    BestPolicyName,
    CaregiverModel,
    HomeLevel,
    HomeName,
    HomeRoom,
    Json,
    Opens,
    Port,
    Processes,
    RecipientModel,
    Record,
    RobotModel,
    RolePolicies,
    Seed,
    Task,
    TaskOptions,
    Which,
    cast_of,
    pairs,
    place_of,
    settings,
)


def replay(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Recorded episodes (.npz), datasets of them, or records of evaluate --out (.json).",
        ),
    ],
    episode: Which = None,
    film: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Film the episode, as an MP4.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw how the episode ends, as a PNG.")
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            "--rerun", metavar="FILE", help="Log the episode for rerun's viewer, as an .rrd."
        ),
    ] = None,
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="Show it on the page of play: any moment, slow motion, overlays."
        ),
    ] = False,
    processes: Processes = 1,
    as_json: Json = False,
    port: Port = None,
    open_: Opens = True,
) -> None:
    """Run it again and say whether it is the same: the exit status is 1 if anything differs.

    A recorded episode is played by its actions alone, with no policy, and compared bit for bit. Datasets are
    what --record writes: LeRobot, Minari, robomimic, MCAP.

    A record is played by its policies, and every number of every episode is compared.

    Example: rcare-marl replay runs/episodes/*.npz

    Example: rcare-marl replay runs/episodes/seed-0.npz --film again.mp4

    Example: rcare-marl replay runs/feeding.hdf5 --live

    Example: rcare-marl replay runs/feeding.hdf5 --episode 3 --rerun runs/feeding.rrd

    Example: rcare-marl replay record.json
    """
    from . import replaying

    if live:
        if film or picture or log or len(files) > 1:
            raise typer.BadParameter("--live shows one file, and its page saves pictures and films")
        replaying.show(files[0], which=episode, port=port, opens=open_)
        return
    is_equal = replaying.run(
        files,
        which=episode,
        film=film,
        picture=picture,
        log=log,
        processes=processes,
        as_json=as_json,
    )
    if not is_equal:
        raise typer.Exit(1)


def play(
    task: Task,
    policy: BestPolicyName = None,
    seed: Seed = 0,
    episodes: Annotated[
        int, typer.Option(min=0, help="How many episodes to show; 0 goes on until Ctrl-C.")
    ] = 0,
    role_policy: RolePolicies = None,
    robot: RobotModel = None,
    recipient: RecipientModel = None,
    caregiver: CaregiverModel = None,
    home: HomeName = None,
    level: HomeLevel = None,
    room: HomeRoom = None,
    option: TaskOptions = None,
    record: Record = None,
    port: Port = None,
    open_: Opens = True,
) -> None:
    """Show episodes live in your browser, in real time, until Ctrl-C.

    On the page other tasks, people, robots, homes, policies and seeds can be chosen, the episode slowed down,
    and any moment of it seen again.

    Example: rcare-marl play feeding
    """
    from .teleoperation import serve_scene

    wanted = pairs(role_policy, "--role-policy")
    if policy:
        from rcare_marl.baselines.evaluation.evaluate import lead_policies

        wanted = lead_policies(task, policy, wanted)
    cast = cast_of(robot, recipient, caregiver) | place_of(home, level, room)
    scene = (task, (), cast, settings(option), wanted, seed, record)
    serve_scene(scene, port=port, opens=open_, episodes=episodes)
