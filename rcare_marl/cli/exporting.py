"""What the command `export` does: the scene of a task for other simulators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Literal, get_args

from rcare_marl.agents.people.avatar import person_urdf
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.profile import Range
from rcare_marl.agents.robots.moveit import ignored_pairs, moveit_package, planned
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.atomic_file import draft
from rcare_marl.console import print_line
from rcare_marl.envs import make
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.scene.drawing import drawn
from rcare_marl.scene.mjcf import mjcf
from rcare_marl.scene.planning_scene import planning_scene
from rcare_marl.scene.scene import Scene, scene_of
from rcare_marl.scene.urdf_files import urdf_files

Format = Literal["mjcf", "urdf", "moveit"]


def run(
    task: str,
    cast: Mapping[str, Any],
    options: Mapping[str, Any],
    *,
    form: str,
    seed: int,
    draws: bool,
    output: Path,
) -> Path:
    """Write the scene of a task as it is after a reset into a new folder, and return that.

    Raises:
        ConfigError: If the folder has something in it, or cannot be written.
        UnknownNameError: If there is no such format.
    """
    check_name("format", form, get_args(Format))
    _check_empty(output)
    with closing(make(task, options=options, **cast)) as env:
        env.reset(seed=seed)
        scene = scene_of(env.world)
        drawings = drawn(env.world) if draws else None
        people = [agent for agent in env.cast.values() if isinstance(agent, Human)]
        robots = [agent for agent in env.cast.values() if isinstance(agent, Robot)]
        matter = [type(each).__name__ for each in env.world.matter]
    if form == "moveit":
        return _write_moveit(task, robots, scene, output)
    files = (mjcf if form == "mjcf" else urdf_files)(scene, drawings)
    if form == "urdf":
        for person in people:
            for kind in get_args(Range):
                files[f"{person.name}/{person.name}_{kind}.urdf"] = person_urdf(
                    person.avatar, kind
                ).text
    target = _write(files, output)
    main = target / ("scene.xml" if form == "mjcf" else "scene.yaml")
    print_line(f"{main}: {len(scene.bodies)} bodies, {len(files)} files")
    if matter:
        print_line(
            "not in it, since these formats have no such thing: cloth, sponge, water and flesh"
        )
    return main


def run_moveit(robot: str, output: Path) -> Path:
    """Write a robot alone, by name or YAML file, as a package for MoveIt 2; return its folder.

    Raises:
        ConfigError: If the folder has something in it or cannot be written, or no robot can be made.
        UnknownNameError: If there is no such robot.
    """
    _check_empty(output)
    model = planned(load_robot(robot))
    ignored = ignored_pairs(model)
    return _told(_write(moveit_package(model, ignored), output), ignored)


def _write_moveit(task: str, robots: Sequence[Robot], scene: Scene, output: Path) -> Path:
    if len(robots) != 1:
        raise ConfigError(f"{task} has {len(robots)} robots, and a package for MoveIt is of one")
    (robot,) = robots
    model = planned(robot.config)
    ignored = ignored_pairs(model)
    files = moveit_package(model, ignored)
    files[f"scene/{task}.scene"] = planning_scene(scene, robot.name, model.model.root)
    return _told(_write(files, output), ignored)


def _told(target: Path, ignored: Mapping[str, Sequence[object]]) -> Path:
    counts = ", ".join(f"{len(pairs)} {reason.lower()}" for reason, pairs in ignored.items())
    print_line(f"{target}: a package for MoveIt 2; pairs of links ignored: {counts}")
    return target


def _check_empty(output: Path) -> None:
    if output.is_dir() and any(output.iterdir()):
        raise ConfigError(f"{output} has something in it: choose a folder that is new or empty")


def _write(files: Mapping[str, str], output: Path) -> Path:
    with draft(output) as folder:
        for name, text in files.items():
            file = folder.path / name
            file.parent.mkdir(exist_ok=True)
            file.write_text(text, encoding="utf-8")
        return folder.publish()
