"""Writes the URDF of a person.

A segment whose joint does not move melts, in the angle of the posture, into the one that it hangs on:
the cost of a physics step follows the number of links, fixed ones too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from rcare_marl.pose import Array, rpy_from_matrix

from .person_tree import Mass, melted
from .segment import LEAST_INERTIA, Segment, Shape, combined
from .skeleton import DOFS_OF, JOINTS

# The first links of a joint with several axes have no flesh of their own. A trace of mass lets Bullet
# accept them, and a trace of inertia keeps the mass matrix regular where two axes align.
_TRACE = (1e-6, np.zeros(3), LEAST_INERTIA * np.eye(3))  # [kg], [m], [kg·m²]


@dataclass(frozen=True, eq=False)
class Frame:
    """Where the frame of an SMPL-X joint is found: a link by name, and a fixed transform in it."""

    link: str
    rotation: Array
    offset: Array


@dataclass(frozen=True, eq=False)
class PersonUrdf:
    """A person's URDF and where each SMPL-X joint is found in it."""

    text: str
    frames: tuple[Frame, ...]


def write_urdf(
    name: str,
    segments: Mapping[str, Segment],
    joints: Array,
    *,
    limits: Mapping[str, tuple[float, float]],
    posture: Array,
    effort: Mapping[str, float],
) -> PersonUrdf:
    """Return the URDF of a person.

    Args:
        name: Name of the robot element.
        segments: The 55 segments by SMPL-X joint.
        joints: Joint centres in the T-pose [m], shape [55, 3].
        limits: For each movable DoF its lower and upper limit [rad]; the others melt.
        posture: Angle of every DoF [rad], shape [112]; fixed DoFs stay there.
        effort: Greatest torque of each movable DoF [N·m].
    """
    body = melted(segments, joints, posture, limits)
    names = ["pelvis"]
    for dof in body.dofs:
        movable = [other for other in DOFS_OF[dof.joint] if other.name in limits]
        place = movable.index(dof) + 1
        names.append(dof.joint if place == len(movable) else f"{dof.joint}_{place}")
    frames = tuple(Frame(names[part + 1], r, offset) for part, r, offset in body.frames)
    root = ElementTree.Element("robot", name=name)
    links = {}
    for link, parts in zip(names, body.flesh, strict=True):
        links[link] = ElementTree.SubElement(root, "link", name=link)
        _write_inertial(links[link], parts or [_TRACE])
    for joint, frame in zip(JOINTS, frames, strict=True):
        for shape in segments[joint].shapes:
            _write_collision(links[frame.link], shape, frame)
    for k, (dof, (part, rotation, offset)) in enumerate(zip(body.dofs, body.places, strict=True)):
        element = ElementTree.SubElement(root, "joint", name=dof.name, type="revolute")
        ElementTree.SubElement(element, "parent", link=names[part + 1])
        ElementTree.SubElement(element, "child", link=names[k + 1])
        _write_origin(element, offset, rotation)
        ElementTree.SubElement(element, "axis", xyz=_text(dof.axis))
        low, high = limits[dof.name]
        ElementTree.SubElement(
            element,
            "limit",
            lower=f"{low:.6f}",
            upper=f"{high:.6f}",
            effort=f"{effort[dof.name]:.4f}",
            velocity="20",
        )
    ElementTree.indent(root)
    return PersonUrdf(ElementTree.tostring(root, encoding="unicode"), frames)


def _write_inertial(element: ElementTree.Element, parts: Sequence[Mass]) -> None:
    mass, centre, inertia = combined(parts)
    inertial = ElementTree.SubElement(element, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=_text(centre), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=f"{mass:.8f}")
    pairs = [(a, b) for a in range(3) for b in range(a, 3)]
    values = {f"i{'xyz'[a]}{'xyz'[b]}": f"{inertia[a, b]:.10f}" for a, b in pairs}
    ElementTree.SubElement(inertial, "inertia", values)


def _write_collision(element: ElementTree.Element, shape: Shape, frame: Frame) -> None:
    collision = ElementTree.SubElement(element, "collision")
    centre = frame.offset + frame.rotation @ shape.centre
    _write_origin(collision, centre, frame.rotation @ shape.rotation)
    if shape.kind == "box":
        size = {"size": _text(shape.size)}
    else:
        size = {"length": f"{shape.size[0]:.6f}", "radius": f"{shape.size[1]:.6f}"}
    ElementTree.SubElement(ElementTree.SubElement(collision, "geometry"), shape.kind, size)


def _write_origin(element: ElementTree.Element, place: Array, turn: Array) -> None:
    xyz, rpy = _text(place), _text(rpy_from_matrix(turn))
    ElementTree.SubElement(element, "origin", xyz=xyz, rpy=rpy)


def _text(values: Array | tuple[float, ...]) -> str:
    return " ".join(f"{float(v):.8f}" for v in values)
