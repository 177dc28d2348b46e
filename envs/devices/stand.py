"""A stand for a robot arm beside a bed or a wheelchair."""

from __future__ import annotations

from rcare_marl.agents.robots.robot import Robot
from rcare_marl.body import Body
from rcare_marl.pose import Pose
from rcare_marl.world import World

# Our own choice, in the look of a floor stand of steel.
COLUMN, PLATE = 0.11, (0.42, 0.42, 0.025)  # [m]
RGBA = (0.30, 0.32, 0.35, 1.0)


def needs_stand(robot: Robot) -> bool:
    """Return whether a robot is an arm without base or legs."""
    config = robot.config
    return config.base is None and config.mounts["floor"].position[2] == 0


def add_stand(world: World, base: Pose) -> tuple[Body, ...]:
    """Add a column from the floor up to the base of a robot, on a foot plate; nothing moves it.

    Args:
        world: Where to.
        base: Pose of the robot's root link.
    """
    x, y, z = base.position
    foot = PLATE[2]
    column = world.add_box(
        (COLUMN, COLUMN, z - foot),
        Pose((x, y, foot + (z - foot) / 2), base.quaternion),
        name="stand",
        rgba=RGBA,
    )
    plate = world.add_box(
        PLATE, Pose((x, y, foot / 2), base.quaternion), name="stand_foot", rgba=RGBA
    )
    return column, plate
