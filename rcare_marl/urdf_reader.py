"""Reads the links and joints of a URDF file that we did not write."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree as xml

from .errors import ConfigError, UnknownNameError
from .urdf import ZERO, Follow, Joint, Link, Model, Triple


def read(path: str | Path) -> Model:
    """Return the links and joints of a URDF file, without its shapes.

    Raises:
        ConfigError: If there is no such file, or it is no URDF that we can follow.
    """
    file = Path(path)
    if not file.is_file():
        raise ConfigError(f"no URDF at {file}")
    try:
        robot = xml.parse(file).getroot()
        links = {e.attrib["name"]: _read_link(e) for e in robot.findall("link")}
        joints = {e.attrib["name"]: _read_joint(e) for e in robot.findall("joint")}
        if not links:
            raise ValueError("it has no links")
        ordered = _parents_first(links, joints)
        children = {joint.child for joint in joints.values()}
        root = next((name for name in links if name not in children), next(iter(links)))
        links = {root: links[root], **links}
        return Model(robot.get("name") or file.stem, str(file), links, joints=ordered)
    except (xml.ParseError, KeyError, TypeError, ValueError, UnknownNameError) as error:
        raise ConfigError(f"{file} is not a URDF that can be used: {error}") from error


def _parents_first(links: Mapping[str, Link], joints: Mapping[str, Joint]) -> dict[str, Joint]:
    placed = set(links) - {joint.child for joint in joints.values()}
    left, out = dict(joints), {}
    while left:
        ready = {name: joint for name, joint in left.items() if joint.parent in placed}
        if not ready:
            raise ValueError(f"joints {sorted(left)} hang on no link")
        for name, joint in ready.items():
            out[name] = left.pop(name)
            placed.add(joint.child)
    return out


def _read_link(element: xml.Element) -> Link:
    mass = element.find("inertial/mass")
    if mass is None:
        return Link()
    at, _ = _read_origin(element.find("inertial/origin"))
    return Link(mass=float(mass.attrib["value"]), com=at)


def _read_joint(element: xml.Element) -> Joint:
    kind = element.attrib["type"]
    if kind not in ("fixed", "revolute", "continuous", "prismatic"):
        raise ValueError(f"joint {element.attrib['name']!r} is {kind}, which we do not drive")
    at, rpy = _read_origin(element.find("origin"))
    axis, limit, mimic = (element.find(tag) for tag in ("axis", "limit", "mimic"))
    limits = {} if limit is None else limit.attrib
    ends = [element.find(tag) for tag in ("parent", "child")]
    parent, child = (end.attrib["link"] for end in ends if end is not None)
    follows = None
    if mimic is not None:
        follows = Follow(
            mimic.attrib["joint"],
            float(mimic.get("multiplier", 1)),
            float(mimic.get("offset", 0)),
        )
    return Joint(
        kind=kind,  # type: ignore[arg-type]  # checked above
        parent=parent,
        child=child,
        at=at,
        rpy=rpy,
        axis=(1.0, 0.0, 0.0) if axis is None else _triple(axis.attrib["xyz"]),
        lower=float(limits.get("lower", 0)),
        upper=float(limits.get("upper", 0)),
        effort=float(limits.get("effort", 0)),
        velocity=float(limits.get("velocity", 0)),
        follows=follows,
    )


def _read_origin(element: xml.Element | None) -> tuple[Triple, Triple]:
    if element is None:
        return ZERO, ZERO
    return _triple(element.get("xyz", "0 0 0")), _triple(element.get("rpy", "0 0 0"))


def _triple(text: str) -> Triple:
    x, y, z = (float(word) for word in text.split())
    return x, y, z
