"""Measure every robot and print the table of docs/robots.md: mass, loading, posture, reach, grip, feeding.

python experiments/robot_table.py [--robot NAME ...] [--seeds N]

Loading is timed in a process of its own, with an empty cache and again with a full one.
"""

from __future__ import annotations

import math

import typer

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.robots.control import CONTROLS
from rcare_marl.agents.robots.robot_check import (
    find_overlaps,
    measure_grip,
    measure_posture,
    measure_reach,
    spawned,
)
from rcare_marl.agents.robots.robot_config import RobotConfig, load_robot
from rcare_marl.baselines.benchmark.homes import load_times
from rcare_marl.baselines.evaluation.evaluate import evaluate
from rcare_marl.errors import ConfigError

HEADS = (
    *("robot", "arms", "base", "mass (published) [kg]", "load, first / again [s]"),
    *("overlaps at home", "drift in 5 s [deg / mm]", "worst of 20 poses [mm / deg]"),
    *("opens [mm]", "slip of 0.5 kg in 3 s [mm]", "fed"),
)
LOADING = """
import sys, time
from rcare_marl.agents.robots.robot import Robot, load_robot
from rcare_marl.world import World
start = time.perf_counter()
robot = Robot("robot", load_robot(sys.argv[1]))
robot.spawn(World(), robot.mount("floor"))
print(time.perf_counter() - start)
"""


def row(name: str, seeds: int) -> list[str]:
    """Return the table's row of a robot."""
    config = load_robot(name)
    first, again = load_times(LOADING, name, starts=1)
    world, robot = spawned(config)
    mass = robot.files.model.mass
    world.close()
    published = config.published_mass.value if config.published_mass is not None else math.nan
    turned, slid = zip(*(measure_posture(config, control=mode) for mode in CONTROLS), strict=True)
    reaches = [measure_reach(config, arm) for arm in config.arms]
    grips = [measure_grip(config, arm) for arm, data in config.arms.items() if data.gripper]
    base = config.base.kind if config.base is not None else "bolted down"
    joints = " + ".join(str(len(arm.joints)) for arm in config.arms.values())
    distance = max(float(reach.distances.max()) for reach in reaches)
    angle = max(float(reach.angles.max()) for reach in reaches)
    return [
        f"`{name}`",
        joints,
        base,
        f"{mass:.2f} ({published:g})",
        f"{first:.2f} / {again:.2f}",
        str(len(find_overlaps(config))),
        f"{math.degrees(max(turned)):.3f} / {1e3 * max(slid):.2f}",
        f"{1e3 * distance:.2f} / {math.degrees(angle):.2f}",
        f"{1e3 * min(grip.opened for grip in grips):.0f}",
        f"{1e3 * max(grip.slip for grip in grips):.1f}",
        fed(name, config, seeds),
    ]


def fed(name: str, config: RobotConfig, seeds: int) -> str:
    """Return in how many episodes the scripted robot feeds Karan."""
    if "wheelchair_right" not in config.mounts:
        try:
            rcare_marl.make("feeding", robot=name)
        except ConfigError:
            return "no arm that reaches"
    cast = {"robot": {"model": name, "policy": "scripted"}, "recipient": {"policy": "cooperative"}}
    found = evaluate("feeding", episodes=seeds, cast=cast)
    return f"{sum(episode.success for episode in found.episodes)} of {seeds}"


def main(robot: list[str] = [], seeds: int = 10) -> None:  # noqa: B006  (typer's way)
    """Print the table in Markdown, a row as soon as it is measured; `seeds` are episodes of feeding."""
    print("| " + " | ".join(HEADS) + " |")
    print("|" + "---|" * len(HEADS))
    for name in robot or assets.names("robots"):
        print("| " + " | ".join(row(name, seeds)) + " |", flush=True)


if __name__ == "__main__":
    typer.run(main)
