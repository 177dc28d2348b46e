"""The tree of a robot: joints in order from its root, and who follows whom, or what is wrong."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

from rcare_marl.errors import ConfigError, UnknownNameError

from .urdf import Follow, Joint


def parents_first(
    links: Collection[str], joints: Mapping[str, Joint], file: Path
) -> dict[str, Joint]:
    """Return the joints in an order in which each comes after the one that carries it.

    Raises:
        ConfigError: If joints and links are not one tree; it names `file`.
    """
    carried: dict[str, str] = {}
    for name, joint in joints.items():
        for end in (joint.parent, joint.child):
            if end not in links:
                raise ConfigError(f"{file}: {UnknownNameError(f'link (joint {name})', end, links)}")
        if joint.child in carried:
            raise ConfigError(
                f"{file}: link {joint.child!r} hangs on two joints, {carried[joint.child]!r} and "
                f"{name!r}; a URDF is a tree, each link hangs on one"
            )
        carried[joint.child] = name
    roots = [name for name in links if name not in carried]
    if len(roots) > 1:
        raise ConfigError(
            f"{file}: {len(roots)} links hang on no joint: {_listed(roots)}; a URDF is one tree "
            "and has one such link, its root"
        )
    placed, left, out = set(roots), dict(joints), dict[str, Joint]()
    while left:
        ready = {name: joint for name, joint in left.items() if joint.parent in placed}
        if not ready:
            raise ConfigError(f"{file}: joints make a loop: {_loop(left)}; a URDF is a tree")
        for name, joint in ready.items():
            out[name] = left.pop(name)
            placed.add(joint.child)
    return out


def resolved(joints: Mapping[str, Joint], file: Path) -> dict[str, Joint]:
    """Return the joints with each follower of a follower following the first of them.

    Raises:
        ConfigError: If a joint follows one that is not there or is fixed, or in the end itself.
    """
    return {
        name: replace(joint, follows=_followed(name, joints, file))
        for name, joint in joints.items()
    }


def _followed(name: str, joints: Mapping[str, Joint], file: Path) -> Follow | None:
    rule = joints[name].follows
    seen = [name]
    while rule is not None:
        if rule.joint not in joints:
            known = [other for other, joint in joints.items() if joint.kind != "fixed"]
            wrong = UnknownNameError("movable joint", rule.joint, known)
            raise ConfigError(f"{file}: joint {seen[-1]!r} mimics an unknown one: {wrong}")
        seen.append(rule.joint)
        if rule.joint in seen[:-1]:
            raise ConfigError(f"{file}: joints mimic each other in a loop: {' -> '.join(seen)}")
        if joints[rule.joint].kind == "fixed":
            raise ConfigError(f"{file}: joint {seen[-2]!r} mimics {rule.joint!r}, which is fixed")
        further = joints[rule.joint].follows
        if further is None:
            break
        rule = Follow(
            further.joint,
            rule.multiplier * further.multiplier,
            rule.multiplier * further.offset + rule.offset,
        )
    return rule


def _loop(joints: Mapping[str, Joint]) -> str:
    """Return the links of a loop, among joints that hang on no root."""
    above = {joint.child: joint.parent for joint in joints.values()}
    here, seen = next(iter(above)), list[str]()
    while here not in seen:
        seen.append(here)
        here = above[here]
    way = [*seen[seen.index(here) :], here]
    return " -> ".join(reversed(way))


def _listed(names: list[str]) -> str:
    return ", ".join(repr(name) for name in names[:5]) + (", ..." if len(names) > 5 else "")
