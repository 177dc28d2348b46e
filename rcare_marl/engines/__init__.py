"""What computes the motion: Bullet, the reference, or MuJoCo."""

from __future__ import annotations

from rcare_marl.errors import MissingPackageError, check_name
from rcare_marl.world import World

ENGINES = ("bullet", "mujoco")


def make_world(engine: str, physics_dt: float) -> World:
    """Return an empty world of an engine, one of `ENGINES`.

    Raises:
        UnknownNameError: If there is no such engine.
        MissingPackageError: If MuJoCo is asked for and not installed.
    """
    check_name("engine", engine, ENGINES)
    if engine == "bullet":
        return World(physics_dt)
    try:
        import mujoco as mujoco
    except ImportError as error:
        raise MissingPackageError("the engine 'mujoco'", "batch") from error
    from .mujoco_world import MujocoWorld

    return MujocoWorld(physics_dt)
