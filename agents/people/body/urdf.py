"""Writes the URDF of a person.

A segment whose joint does not move melts, in the angle of the posture, into the one that it hangs on:
the cost of a physics step follows the number of links, fixed ones too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from rcare_marl.pose import axis_rotation, rpy_from_matrix

from .segment import LEAST_INERTIA, Segment, Shape, combined
from .skeleton import DOF_INDEX, DOFS_OF, JOINT_INDEX, JOINTS, PARENTS

Array = npt.NDArray[np.float64]

# The first links of a joint with several axes have no flesh of their own. A trace of mass lets Bullet
# accept them, and a trace of inertia keeps the mass matrix regular where two axes align.
TRACE_MASS = 1e-6  # [kg]


@dataclass(eq=False)
class _Link:
    name: str
    parts: list[tuple[float, Array, Array]] = field(default_factory=list)  # mass, centre, inertia
    shapes: list[tuple[Shape, Array, Array]] = field(default_factory=list)  # with frame in the link


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
    effort: Mapping[str, float] | None = None,
) -> PersonUrdf:
    """Return the URDF of a person.

    Args:
        name: Name of the robot element.
        segments: The 55 segments by SMPL-X joint.
        joints: Joint centres in the T-pose [m], shape [55, 3].
        limits: For each movable DoF its lower and upper limit [rad]; the others melt.
        posture: Angle of every DoF [rad], shape [112]; fixed DoFs stay there.
        effort: Greatest torque of each movable DoF [N·m]; 1000 where none is given.
    """
    root = ElementTree.Element("robot", name=name)
    links = {"pelvis": _Link("pelvis")}
    frames: list[Frame] = []
    connections: list[ElementTree.Element] = []
    for j, joint in enumerate(JOINTS):
        if j == 0:
            frame = Frame("pelvis", np.eye(3), np.zeros(3))
        else:
            frame = _add_joint(
                joint, frames[PARENTS[j]], joints, limits, posture, effort or {}, links, connections
            )
        frames.append(frame)
        _add_flesh(links[frame.link], segments[joint], frame)
    for link in links.values():
        _write_link(root, link)
    root.extend(connections)
    ElementTree.indent(root)
    return PersonUrdf(ElementTree.tostring(root, encoding="unicode"), tuple(frames))


def _add_joint(
    joint: str,
    parent: Frame,
    centres: Array,
    limits: Mapping[str, tuple[float, float]],
    posture: Array,
    effort: Mapping[str, float],
    links: dict[str, _Link],
    connections: list[ElementTree.Element],
) -> Frame:
    j = JOINT_INDEX[joint]
    link = parent.link
    rotation = parent.rotation
    offset = parent.offset + parent.rotation @ (centres[j] - centres[PARENTS[j]])
    movable = [dof for dof in DOFS_OF[joint] if dof.name in limits]
    for dof in DOFS_OF[joint]:
        if dof.name not in limits:
            rotation = rotation @ axis_rotation(dof.axis, float(posture[DOF_INDEX[dof.name]]))
            continue
        is_last = dof is movable[-1]
        child = joint if is_last else f"{joint}_{movable.index(dof) + 1}"
        element = _joint(dof.name, link, child, rotation, offset)
        ElementTree.SubElement(element, "axis", xyz=_text(dof.axis))
        low, high = limits[dof.name]
        ElementTree.SubElement(
            element,
            "limit",
            lower=f"{low:.6f}",
            upper=f"{high:.6f}",
            effort=f"{effort.get(dof.name, 1000.0):.4f}",
            velocity="20",
        )
        connections.append(element)
        links[child] = _Link(child)
        if not is_last:
            links[child].parts.append((TRACE_MASS, np.zeros(3), LEAST_INERTIA * np.eye(3)))
        link, rotation, offset = child, np.eye(3), np.zeros(3)
    return Frame(link, rotation, offset)


def _add_flesh(link: _Link, segment: Segment, frame: Frame) -> None:
    r = frame.rotation
    link.parts.append((segment.mass, frame.offset + r @ segment.centre, r @ segment.inertia @ r.T))
    link.shapes.extend((shape, r, frame.offset) for shape in segment.shapes)


def _write_link(root: ElementTree.Element, link: _Link) -> None:
    element = ElementTree.SubElement(root, "link", name=link.name)
    mass, centre, inertia = combined(link.parts)
    inertial = ElementTree.SubElement(element, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=_text(centre), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=f"{mass:.8f}")
    rows = (
        (0, 0, "ixx"),
        (0, 1, "ixy"),
        (0, 2, "ixz"),
        (1, 1, "iyy"),
        (1, 2, "iyz"),
        (2, 2, "izz"),
    )
    ElementTree.SubElement(
        inertial, "inertia", {key: f"{inertia[a, b]:.10f}" for a, b, key in rows}
    )
    for shape, rotation, offset in link.shapes:
        collision = ElementTree.SubElement(element, "collision")
        ElementTree.SubElement(
            collision,
            "origin",
            xyz=_text(offset + rotation @ shape.centre),
            rpy=_text(rpy_from_matrix(rotation @ shape.rotation)),
        )
        geometry = ElementTree.SubElement(collision, "geometry")
        if shape.kind == "box":
            ElementTree.SubElement(geometry, "box", size=_text(shape.size))
        else:
            length, radius = shape.size
            ElementTree.SubElement(
                geometry, "capsule", length=f"{length:.6f}", radius=f"{radius:.6f}"
            )


def _joint(
    name: str, parent: str, child: str, rotation: Array, offset: Array
) -> ElementTree.Element:
    element = ElementTree.Element("joint", name=name, type="revolute")
    ElementTree.SubElement(element, "parent", link=parent)
    ElementTree.SubElement(element, "child", link=child)
    ElementTree.SubElement(
        element, "origin", xyz=_text(offset), rpy=_text(rpy_from_matrix(rotation))
    )
    return element


def _text(values: Array | tuple[float, ...]) -> str:
    return " ".join(f"{float(v):.8f}" for v in values)
