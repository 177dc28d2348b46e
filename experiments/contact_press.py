"""Measure how steadily arms press with 5 N under `impedance` and `admittance`, and draw their step responses.

Run: python experiments/contact_press.py tuned|judged [ROBOT ...]
     python experiments/contact_press.py flesh
     python experiments/contact_press.py plot docs/images/contact_steps.png

An arm goes onto a pad at 6 cm/s until its wrench limit of 5 N holds it, and presses for 4 s; the greatest
error of the last second counts. Pads and places that are judged are not those that were tuned on. Places
1 to 6 and pads of 0.5, 0.6, 0.8, 3, 4, 5, 10, 15, 20, 40, 50 and 60 kN/m were judged before: what Fetch, HSR,
Gen2 and Stretch did there led to mends of the admittance, so others took their place.

Flesh is that of lying people; the mean of the last second counts, and the flesh of nobody but Karan's right
thigh was tuned on.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.control import Compliance
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.body import Body
from rcare_marl.console import console, table
from rcare_marl.pose import Array, Pose, about_z, quaternion_from_matrix
from rcare_marl.world import World

FORCE, SPEED, SECONDS, DT = 5.0, 0.06, 4.0, 0.1  # [N], [m/s], [s], [s]
WAYS = {"down": (0.0, 0.0, -1.0), "forward": (1.0, 0.0, 0.0), "outward": (0.0, 1.0, 0.0)}
PAD_DAMPING = 50.0  # [N·s/m]
FLESH = (("karan", "right_hip"), ("natalia", "left_hip"), ("jose", "right_knee"))
FLESH_ROBOTS = (
    ("impedance", "kinova_gen3"),
    ("impedance", "franka_panda"),
    ("admittance", "ur5"),
    ("admittance", "fetch"),
)
BELOW = {
    f"{side}_{a}": f"{side}_{b}"
    for side in ("left", "right")
    for a, b in (("hip", "knee"), ("knee", "ankle"))
}
ABOVE = 0.18  # [m] of the tool over the bone


@dataclass(frozen=True)
class Split:
    """What is pressed by whom.

    Attributes:
        robots: Models by control mode.
        pads: Stiffness of pads [N/m].
        ways: Directions.
        places: Seeds of how far from the start posture the tool is, up to 8 cm along each axis; 0 is there.
    """

    robots: dict[str, tuple[str, ...]]
    pads: tuple[float, ...]
    ways: tuple[str, ...]
    places: tuple[int, ...]


OTHERS = ("fetch", "franka_panda", "hsr", "kinova_gen2", "pr2", "stretch_re1_dex")
SPLITS = {
    "tuned": Split(
        {"impedance": ("kinova_gen3",), "admittance": ("ur5",)}, (1e3, 30e3), tuple(WAYS), (0,)
    ),
    "judged": Split(
        {"impedance": (*OTHERS, "ur5"), "admittance": (*OTHERS, "kinova_gen3")},
        (700.0, 6e3, 25e3, 45e3),
        tuple(WAYS),
        (7, 8),
    ),
}


def spawned(world: World, model: str, control: str, compliance: Compliance, place: int) -> Robot:
    """Return a robot on the floor, its tool a little off where it starts."""
    robot = Robot("robot", load_robot(model), control=control, compliance=compliance)
    robot.spawn(world, robot.mount("floor"))
    if place:
        rng = np.random.default_rng(place)
        start = robot.tool_pose()
        for _ in range(100):
            at = np.add(start.position, rng.uniform(-0.08, 0.08, 3))
            found = robot.solve_ik(Pose(tuple(at.tolist()), start.quaternion))
            if found.distance < 0.01:
                robot.set_posture(found.posture)
                break
    return robot


def act(world: World, robot: Robot, action: Array, seconds: float) -> Iterator[None]:
    """Hold an action, and stop after each physics step."""
    for _ in range(round(seconds / DT)):
        robot.command(action, DT)
        for _ in range(24):
            robot.actuate()
            world.step()
            yield


def put_pad(world: World, robot: Robot, way: Array, stiffness: float) -> Body:
    """Return a pad across a way, 2 cm before what the robot touches it with."""
    side = np.roll(way, 1)
    turn = np.column_stack((side, np.cross(way, side), way))
    pad = world.add_box((0.16, 0.16, 0.04), Pose((9.0, 9.0, 9.0)), name="pad")
    pad.set_softness(stiffness=stiffness, damping=PAD_DAMPING)
    quaternion = tuple(quaternion_from_matrix(turn).tolist())
    for gap in np.arange(0.5, -0.1, -0.005):
        at = np.add(robot.tool_pose().position, (gap + 0.02) * way)
        pad.set_base(Pose(tuple(at.tolist()), quaternion))
        if world.separation(robot.body, pad, within=0.02) < 0.02:
            break
    return pad


def press(
    model: str, control: str, stiffness: float, way: str, place: int, seconds: float = SECONDS
) -> tuple[Array, Array]:
    """Return force on the pad [N] and the way of the tool [m], each physics step."""
    world, along = World(), np.array(WAYS[way])
    limit = np.where(along != 0, FORCE, 20.0)
    compliance = Compliance(wrench_limit=(*limit.tolist(), 4.0, 4.0, 4.0))
    robot = spawned(world, model, control, compliance, place)
    if way == "outward":
        along *= math.copysign(1.0, robot.tool_pose().position[1])
    pad = put_pad(world, robot, along, stiffness)
    start, forces, ways = np.array(robot.tool_pose().position), [], []
    for _ in act(world, robot, robot.tool_action(SPEED * along, np.zeros(3)), seconds):
        forces.append(world.contact_force(pad, robot.body))
        ways.append(along @ (robot.tool_pose().position - start))
    world.close()
    return np.array(forces), np.array(ways)


def show(split: Split, only: list[str]) -> None:
    """Print the greatest error of each press in its last second."""
    rows = []
    for control, robots in split.robots.items():
        for model in robots:
            if only and model not in only:
                continue
            errors = {}
            for pad, way, place in product(split.pads, split.ways, split.places):
                forces, _ = press(model, control, pad, way, place)
                errors[pad, way, place] = float(np.abs(forces[-240:] - FORCE).max())
                console().print(control, model, pad, way, place, f"{errors[pad, way, place]:.2f}")
            good = sum(error < 0.5 for error in errors.values())
            cells = [
                f"{max(e for k, e in errors.items() if k[0] == pad):.2f}" for pad in split.pads
            ]
            rows.append((control, model, f"{good} of {len(errors)}", *cells))
    columns = ("control", "robot", "within 0.5 N", *(f"{p / 1e3:g} kN/m" for p in split.pads))
    console().print(table("greatest error [N]", columns, rows))


def press_flesh(model: str, control: str, name: str, joint: str) -> Array:
    """Return the force of a robot from above on the middle of a limb [N], each physics step.

    It is no number where the robot would stand in the person.

    Args:
        model: The robot.
        control: Its mode.
        name: The avatar.
        joint: At the upper end of the limb.
    """
    world, limit = World(), (20.0, 20.0, FORCE, 4.0, 4.0, 4.0)
    person = Human(
        "person",
        load_avatar(name),
        posture=load_posture("bed_supine"),
        movable=(),
        tissue=[joint],
    )
    person.spawn(world, Pose())
    robot = spawned(world, model, control, Compliance(wrench_limit=limit), 0)
    ends = [person.joint_pose(each).position for each in (joint, BELOW[joint])]
    x, y, z = robot.tool_pose().position
    at = 0.5 * np.sum(ends, axis=0) + (y, -x, ABOVE - z)
    robot.place(Pose(tuple(at.tolist()), about_z(0.5 * math.pi)))
    down = robot.tool_action(np.array((0.0, 0.0, -SPEED)), np.zeros(3))
    gap = world.separation(robot.body, person.body, within=0.05)
    forces = [_lift(world, robot) for _ in act(world, robot, down, 5.0)]
    world.close()
    return np.array(forces) if gap > 0.02 else np.full(240, np.nan)


def _lift(world: World, robot: Robot) -> float:
    """Return the upward force of all that touches a robot [N]: round limbs push to the sides as well."""
    touches = world.touches(robot.body)
    return float(sum(touch.normal[2] * touch.force + touch.friction[2] for touch in touches))


def show_flesh() -> None:
    """Print the mean force of each press in its last second, and its greatest error."""
    for (name, joint), (control, model) in product(FLESH, FLESH_ROBOTS):
        last = press_flesh(model, control, name, joint)[-240:]
        error = np.abs(last - FORCE).max()
        told = f"mean {last.mean():.2f} N, greatest error {error:.2f} N"
        console().print(name, joint, control, model, told)


def plot(file: Path) -> None:
    """Draw how the tool follows a step of its rest in free space, and how it comes to press."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    for control, model in (("impedance", "kinova_gen3"), ("admittance", "ur5")):
        world = World()
        robot = spawned(world, model, control, Compliance(), 0)
        start, way = np.array(robot.tool_pose().position), []
        for k in range(2):
            speeds = np.array((0.0, 0.0 if k else 0.25, 0.0))
            for _ in act(world, robot, robot.tool_action(speeds, np.zeros(3)), 1.8 if k else 0.2):
                way.append(1e3 * (robot.tool_pose().position[1] - start[1]))
        world.close()
        axes[0].plot(np.arange(len(way)) / 240, way, label=f"{control}, {model}")
        for stiffness, style in ((1e3, "--"), (30e3, "-")):
            forces, _ = press(model, control, stiffness, "down", 0, 2.5)
            label = f"{control}, {stiffness / 1e3:g} kN/m"
            colour = axes[0].lines[-1].get_color()
            axes[1].plot(np.arange(len(forces)) / 240, forces, style, color=colour, label=label)
    rest = np.minimum(np.arange(480) / 240, 0.2) * 250
    axes[0].plot(np.arange(480) / 240, rest, "k:", label="rest of the spring")
    axes[1].axhline(FORCE, color="k", linestyle=":")
    for axis, title, unit in zip(
        axes, ("step of 50 mm in the air", "press with 5 N"), ("way [mm]", "force [N]"), strict=True
    ):
        axis.set(title=title, xlabel="time [s]", ylabel=unit)
        axis.legend(frameon=False, fontsize=8)
        axis.grid(alpha=0.3)
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    if sys.argv[1] == "plot":
        plot(Path(sys.argv[2]))
    elif sys.argv[1] == "flesh":
        show_flesh()
    else:
        show(SPLITS[sys.argv[1]], sys.argv[2:])
