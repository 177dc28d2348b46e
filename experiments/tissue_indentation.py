"""Print the force of a sphere pressed into flesh, against a converged run, and what comes of it.

Run: python experiments/tissue_indentation.py [AVATAR]

A sphere of 20 mm radius is pressed 5, 8 and 12 mm into the middle of the forearm, from four sides. The
converged run has 40 substeps a frame of 1/60 s, cells half as long in each direction, and simulates the
whole segment. Newton's third law: what the bone bears, from the elastic forces on the particles that are
held, against what the sphere feels. The least volume ratio is det F; below 0 a cell would be inside out.
"""

from __future__ import annotations

import dataclasses
import time
from typing import Annotated

import numpy as np
import typer

from rcare_marl.agents.people.avatar import body_model, load_avatar, person_urdf
from rcare_marl.agents.people.body.skin import JointFrame
from rcare_marl.agents.people.body.tissue import Tissue, TissueConfig, attach_tissue, load_tissue
from rcare_marl.body import Body
from rcare_marl.cache import cached
from rcare_marl.console import console, table
from rcare_marl.pose import Pose
from rcare_marl.world import World

JOINT = "left_elbow"
RADIUS = 0.02  # [m]
DEPTHS = (0.005, 0.008, 0.012)  # [m]
SIDES = {"below": (0, 0, -1), "above": (0, 0, 1), "in front": (1, 0, 0), "behind": (-1, 0, 0)}
COLUMNS = (
    *("side", "depth [mm]", "force [N]", "converged [N]", "off by", "third law off by"),
    *("least det F", "twice E", "left after release [mm]", "time of usual / fine [s]"),
)
PRESS, HOLD, RELEASE = 24, 96, 160  # physics steps


def make(
    avatar_name: str, config: TissueConfig, refinement: float, substeps: int
) -> tuple[World, Tissue, Body]:
    """Return a world, the flesh of a forearm in the T-pose, and the sphere."""
    world, avatar = World(), load_avatar(avatar_name)
    model = body_model(avatar.body_path(), avatar.height_m)
    urdf = person_urdf(avatar, "passive", movable=(), tissue=(JOINT,))
    file = cached(f"{avatar_name}_flesh", ".urdf", urdf.text)
    body = world.load_urdf(file, Pose((0, 0, 1.0), (0.5, 0.5, 0.5, 0.5)))
    frames = [JointFrame(body.link_index(f.link), f.rotation, f.offset) for f in urdf.frames]
    tissue = attach_tissue(
        world,
        body,
        model,
        frames,
        (JOINT,),
        config=config,
        refinement=refinement,
        substeps=substeps,
    )
    return world, tissue, world.add_sphere(RADIUS, Pose((5, 5, 5)))


def press(
    world: World, tissue: Tissue, ball: Body, towards: tuple[int, int, int]
) -> list[tuple[float, float, float]]:
    """Return force on the sphere [N], load of the bone [N] and least volume ratio at each depth."""
    soft, rows, reached = tissue.bodies[JOINT], [], -0.004
    point, out = tissue.skin_point(JOINT, towards)
    for depth in DEPTHS:
        for k in range(PRESS):
            now = reached + (depth - reached) * (k + 1) / PRESS
            ball.set_base(Pose(tuple((point + (RADIUS - now) * out).tolist())))
            world.step()
        reached = depth
        for _ in range(HOLD):
            world.step()
        load = float(np.linalg.norm(soft.held_load()))
        rows.append((float(np.linalg.norm(soft.force)), load, soft.least_volume_ratio()))
    ball.set_base(Pose((5, 5, 5)))
    for _ in range(RELEASE):
        world.step()
    return rows


def main(avatar: Annotated[str, typer.Argument()] = "karan") -> None:
    """Press a sphere into a forearm from all sides, and print one table."""
    config = load_tissue()
    whole = dataclasses.replace(config, focus_m=None)
    stiff = dataclasses.replace(
        config, material=dataclasses.replace(config.material, youngs_modulus_pa=60e3)
    )
    usual = make(avatar, config, 1.0, 5)
    fine = make(avatar, whole, 2.0, 10)
    double = make(avatar, stiff, 1.0, 5)
    shown: list[tuple[str, ...]] = []
    worst = 0.0
    for side, towards in SIDES.items():
        begin = time.process_time()
        rows = press(*usual, towards)
        middle = time.process_time()
        good = press(*fine, towards)
        spent = f"{middle - begin:.1f} / {time.process_time() - middle:.1f}"
        twice = press(*double, towards)
        left = f"{usual[1].bodies[JOINT].deviation() * 1e3:.2f}"
        for k, depth in enumerate(DEPTHS):
            force, load, ratio = rows[k]
            off = force / good[k][0] - 1
            worst = max(worst, abs(off))
            forces = (
                f"{force:.2f}",
                f"{good[k][0]:.2f}",
                f"{off:+.1%}",
                f"{load / force - 1:+.2%}",
            )
            solid = (f"{ratio:.2f}", f"{twice[k][0] / force:.3f}", left)
            shown.append((side, f"{depth * 1e3:.0f}", *forces, *solid, "" if k else spent))
    title = f"{avatar}'s forearm under a sphere of {RADIUS * 1e3:.0f} mm radius"
    console().print(table(title, COLUMNS, shown, **dict.fromkeys(COLUMNS, True)), width=150)
    console().print(f"worst difference from the converged run: {worst:.1%}")


if __name__ == "__main__":
    typer.run(main)
