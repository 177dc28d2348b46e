"""A scene as what MoveIt plans around: a text file that its planning scene imports."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rcare_marl.model.shape import Shape
from rcare_marl.pose import Pose

from .scene import Scene, SceneBody, link_poses

GREY = "0.7 0.7 0.7 1.0"


def planning_scene(scene: Scene, robot: str, root: str) -> str:
    """Return all bodies but a robot and what it holds, each an object, in the frame of its root link.

    Hulls of meshes are left out: the format has boxes, spheres and cylinders.

    Args:
        scene: The scene.
        robot: The body that is planned for.
        root: Its link in whose frame all poses are.
    """
    held = {bond.child[0] for bond in scene.bonds if bond.parent[0] == robot and bond.is_active}
    frame = link_poses(scene.bodies[robot])[root].inverse()
    lines = [f"{robot}"]
    for name, body in scene.bodies.items():
        if name == robot or name in held:
            continue
        shapes = list(_shapes(body, frame))
        if shapes:
            # Version 2: an object has a pose, its shapes theirs, and no subframes.
            lines += [f"* {name}", *_pose(Pose()), str(len(shapes))]
            for kind, sizes, pose in shapes:
                lines += [kind, " ".join(f"{value:.6g}" for value in sizes), *_pose(pose), GREY]
            lines.append("0")
    return "\n".join([*lines, "."]) + "\n"


def _shapes(body: SceneBody, frame: Pose) -> Iterator[tuple[str, tuple[float, ...], Pose]]:
    poses = link_poses(body)
    for name, link in body.model.links.items():
        for shape in link.collision:
            yield from _solids(shape, frame @ poses[name] @ shape.pose())


def _solids(shape: Shape, pose: Pose) -> Iterator[tuple[str, tuple[float, ...], Pose]]:
    if shape.kind == "box":
        yield "box", shape.size, pose
    elif shape.kind == "sphere":
        yield "sphere", (shape.radius,), pose
    else:
        yield "cylinder", (shape.radius, shape.span()), pose
        if shape.kind == "capsule":
            for end in (-shape.span() / 2, shape.span() / 2):
                yield "sphere", (shape.radius,), pose @ Pose((0.0, 0.0, end))


def _pose(pose: Pose) -> tuple[str, str]:
    place, turn = np.asarray(pose.position), np.asarray(pose.quaternion)
    return " ".join(f"{v:.6f}" for v in place), " ".join(f"{v:.6f}" for v in turn)
