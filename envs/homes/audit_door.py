"""Measures doors: clear width, threshold, what opens them, and the floor beside their latch."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rcare_marl.model.urdf import Model
from rcare_marl.pose import Array, Pose

from .care_home import CareHome
from .door import door_model, hinge_side
from .doorway import LATCH_DEPTH, OFF_WALL, latch_edge
from .measurement import Measurement, Surroundings, near
from .merging import link_poses
from .palette import Palette
from .plan import Opening

SLOWLY = 0.2  # [m/s] at which a hand moves a door; own choice
_HANDLES = ("handle", "panel")  # links that hands take hold of


def measure_openings(home: CareHome) -> Iterator[Measurement]:
    """Yield what is measured of doors, passages and the entrance."""
    for opening in home.plan.openings.values():
        if opening.kind == "window":
            continue
        room = opening.rooms[0]
        kinds = {home.plan.rooms[name].kind for name in opening.rooms if name in home.plan.rooms}
        width, threshold = "door_clear_width", "door_threshold"
        if opening.kind == "entrance":
            width, threshold = "entrance_clear_width", "entrance_threshold"
        elif "bathroom" in kinds:
            width, threshold = "bathroom_door_clear_width", "bathroom_threshold"
        yield Measurement(width, room, opening.name, _clear_width(home, opening))
        yield Measurement(threshold, room, opening.name, opening.threshold)
        if not opening.hardware:
            continue
        yield Measurement("door_hardware", room, opening.name, opening.hardware)
        door = door_model(opening, home.rules, Palette())
        yield Measurement("hardware_height", room, opening.name, _handle_height(door))
        yield Measurement("hardware_force", room, opening.name, door_force(door))
        if opening.hardware in ("knob", "lever"):
            yield Measurement("latch_side_space", room, opening.name, _latch_side(home, opening))


def _clear_width(home: CareHome, opening: Opening) -> float:
    """Return what is free between walls, lining and open leaf, at most what the door says itself [m]."""
    back, deep = opening.pose.inverse(), 0.5 * opening.thickness
    half = 0.5 * opening.width
    taken: list[tuple[float, float]] = []
    for obstacle in near(home.clearance, opening.gap):
        area = obstacle.area.moved(back)
        if area.y0 < deep - 1e-6 and area.y1 > -deep + 1e-6:
            taken.append((area.x0, area.x1))
    best, at = 0.0, -half
    for low, high in [*sorted(taken), (half, half)]:
        best = max(best, min(low, half) - at)
        at = max(at, high)
    return min(best, opening.clear_width)


def _latch_side(home: CareHome, opening: Opening) -> float:
    """Return the free floor beside the latch, on the side to which the door is pulled [m]."""
    room = opening.rooms[0]
    around = Surroundings(home, room, opening.pose)
    low = 0.5 * opening.thickness + OFF_WALL
    high = min(low + LATCH_DEPTH, around.inside.y1 - 0.01)
    sign = -hinge_side(opening)
    return around.free(latch_edge(opening), (low, high), along="x", sign=sign)


def _handle_height(door: Model) -> float:
    """Return the height of the middle of what a hand takes hold of [m]."""
    return float(np.mean([point[2] for point in _grips(door)]))


def door_force(door: Model) -> float:
    """Return the force of a hand that works a door and moves it slowly [N].

    That is the larger of the force at the end of the handle against its spring, and the force there
    against friction and damping of the door.
    """
    places = link_poses(door)
    forces = []
    for joint in door.joints.values():
        axis = places[joint.child].matrix()[:3, :3] @ np.array(joint.axis)
        if joint.kind == "prismatic":
            forces.append(joint.friction + joint.damping * SLOWLY)
            continue
        start = np.array(places[joint.child].position)
        arm = max(float(np.linalg.norm(np.cross(axis, point - start))) for point in _grips(door))
        spring = joint.effort if joint.child == "handle" else 0.0
        forces.append((spring + joint.friction + joint.damping * SLOWLY / arm) / arm)
    return max(forces)


def _grips(door: Model) -> list[Array]:
    """Return the ends of what a hand takes hold of, in the frame of the opening [m].

    Of a knob it is its rim.
    """
    places, out = link_poses(door), []
    for name in _HANDLES:
        link = door.links.get(name)
        for shape in link.collision if link is not None else ():
            if shape.kind == "capsule":
                out += [np.array((places[name] @ Pose(point)).position) for point in shape.points]
            elif shape.kind == "sphere":
                at = np.array((places[name] @ shape.pose()).position)
                out += [at + (shape.radius * sign, 0.0, 0.0) for sign in (-1, 1)]
    return out
