"""A person's musculature: all muscle-tendon units, and how they fit another skeleton.

The whole-body table that ships has 324 units; docs/muscles.md says where its figures come from.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from rcare_marl import assets
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array

from ..body.skeleton import FINGERS, JOINT_INDEX, JOINTS, PARENTS, SIDES
from .mass_xml import read_mass_xml
from .muscle_table import read_skeleton, read_table
from .muscle_unit import MuscleUnit, PathPoint, t_pose_length, t_pose_position
from .muscle_wrap import Surface

_TABLE = assets.ROOT / "muscles" / "whole_body.csv"
_TRUNK = ("pelvis", "spine1", "spine2", "spine3")
_VERTEBRAL = _TRUNK[1:]
_SPINE = (*_TRUNK, "neck")
# [m] in front of the spine's joints, from where the trunk no longer follows their curve.
_BELLY = 0.08


def _bones() -> dict[str, tuple[str, str]]:
    """Return the bone of each limb segment as (start, end); a fingertip borrows the one before."""
    bones = {"neck": ("neck", "head")}
    for side in SIDES:
        for limb in (("hip", "knee", "ankle", "foot"), ("shoulder", "elbow", "wrist", "middle1")):
            for start, end in zip(limb, limb[1:], strict=False):
                bones[f"{side}_{start}"] = (f"{side}_{start}", f"{side}_{end}")
        bones[f"{side}_ulna"] = bones[f"{side}_elbow"]
        bones[f"{side}_foot"] = (f"{side}_ankle", f"{side}_foot")
        for finger in FINGERS:
            for own, (first, second) in {1: (1, 2), 2: (2, 3), 3: (2, 3)}.items():
                bones[f"{side}_{finger}{own}"] = (
                    f"{side}_{finger}{first}",
                    f"{side}_{finger}{second}",
                )
    return bones


_BONES = _bones()


@dataclass(frozen=True, eq=False)
class SkeletonFit:
    """Carries path points from one skeleton to another.

    Points keep their place in the body. On a limb they keep their place along the bone, which grows
    with its length; what is beside the bone, or beyond its ends, grows with the stature. On the trunk
    heights follow the way from hips to neck and widths those of hips and shoulders, because two
    skeletons can put the spine's joints at different heights of the same back. The rules are our own
    choice.

    Attributes:
        old: Joint centres in the T-pose that the points are for [m], shape [55, 3].
        new: Those that they are to fit [m], shape [55, 3].
    """

    old: Array
    new: Array

    def path(self, path: Sequence[PathPoint]) -> tuple[PathPoint, ...]:
        """Return the path on the new skeleton."""
        out = []
        for point in path:
            offset = self._offset(point)
            carrier = self._carrier(point, offset)
            out.append(
                dataclasses.replace(
                    point, joint=carrier, offset=offset, surface=self._surface(point)
                )
            )
        return tuple(out)

    def _surface(self, point: PathPoint) -> Surface | None:
        """Return a surface of a radius that grows with the stature, turned with the bone it is on."""
        if point.surface is None:
            return None
        axis = np.array(point.surface.axis)
        if point.joint in _BONES:
            start, end = _BONES[point.joint]
            bones = [_at(joints, end) - _at(joints, start) for joints in (self.old, self.new)]
            axis = _turn(*bones) @ axis
        radius = point.surface.radius * self._stature()
        return Surface(point.surface.kind, radius, (float(axis[0]), float(axis[1]), float(axis[2])))

    def _carrier(self, point: PathPoint, offset: tuple[float, float, float]) -> str:
        """Return the segment for a vertebra or rib: above the next joint the next segment moves it."""
        if point.joint not in _VERTEBRAL or point.parent is not None:
            return point.joint
        height, carrier = _at(self.new, point.reference)[1] + offset[1], point.joint
        for joint in _VERTEBRAL[_VERTEBRAL.index(carrier) + 1 :]:
            if height > _at(self.new, joint)[1]:
                carrier = joint
        return carrier

    def _offset(self, point: PathPoint) -> tuple[float, float, float]:
        if point.joint in _TRUNK:
            moved = self._on_trunk(point)
        elif point.joint in _BONES:
            moved = self._on_bone(point, *_BONES[point.joint])
        else:
            moved = self._on_block(point)
        x, y, z = (float(v) for v in moved)
        return (x, y, z)

    def _ratio(self, start: str, end: str, *, axes: slice | int = slice(None)) -> float:
        lengths = [
            float(np.linalg.norm(_at(joints, end)[axes] - _at(joints, start)[axes]))
            for joints in (self.old, self.new)
        ]
        return lengths[1] / lengths[0]

    def _stature(self) -> float:
        return self._ratio("left_ankle", "head", axes=1)

    def _on_bone(self, point: PathPoint, start: str, end: str) -> Array:
        old, new = (_at(joints, end) - _at(joints, start) for joints in (self.old, self.new))
        length, size = float(np.linalg.norm(old)), self._stature()
        direction, stretch = old / length, self._ratio(start, end)
        from_start = np.asarray(point.offset)
        if point.reference in (start, end):
            from_start = from_start + _at(self.old, point.reference) - _at(self.old, start)
        along = float(from_start @ direction)
        across = from_start - along * direction
        if point.reference not in (start, end):  # a knuckle, or a bone that borrows its direction
            return _turn(old, new) @ (stretch * along * direction + size * across)
        # The shaft grows with the bone; joint ends, a heel or an elbow's tip with the stature.
        beyond = along - min(max(along, 0.0), length)
        lengthwise = stretch * (along - beyond) + size * beyond
        moved = _turn(old, new) @ (lengthwise * direction + size * across)
        return np.asarray(moved - (new if point.reference == end else 0.0))

    def _on_trunk(self, point: PathPoint) -> Array:
        position, size = t_pose_position(point, self.old), self._stature()
        hips, necks = (
            [_at(joints, name)[1] for joints in (self.old, self.new)]
            for name in ("left_hip", "neck")
        )
        height = (position[1] - hips[0]) / (necks[0] - hips[0])
        y = hips[1] + height * (necks[1] - hips[1])
        there = _at(self.new, point.reference)
        if point.reference not in _SPINE:
            x, z = there[[0, 2]] + size * np.asarray(point.offset)[[0, 2]]
            return np.array((x, y, z)) - there
        # Where the hip joints are is only half of a pelvis's breadth; bodies place them differently.
        pelvis = math.sqrt(size * self._ratio("pelvis", "left_hip", axes=0))
        share = min(max(height, 0.0), 1.0)
        width = (1 - share) * pelvis + share * self._ratio("spine3", "left_shoulder", axes=0)
        forward = (position[2] - _spine(self.old, position[1])) / _BELLY
        least = 0.3 if point.joint == "pelvis" else 0.0  # a bone bends less than the curve above it
        straight = min(max(forward, least), 1.0)
        old = _spine(self.old, position[1], straight=straight)
        new = _spine(self.new, y, straight=straight)
        return np.array((position[0] * width, y, new + size * (position[2] - old))) - there

    def _on_block(self, point: PathPoint) -> Array:
        """Head, jaw and shoulder girdle: as the stature; a girdle's breadth as its own length."""
        scale = np.full(3, self._stature())
        side, _, kind = point.joint.partition("_")
        if kind in ("collar", "scapula", "blade"):
            scale[0] = self._ratio(f"{side}_collar", f"{side}_shoulder", axes=0)
        return scale * point.offset


@dataclass(frozen=True, eq=False)
class Musculature:
    """Muscle-tendon units over one skeleton.

    Attributes:
        units: The units, in the order of every array over muscles.
        joints: T-pose joint centres that offsets and lengths are for [m], shape [55, 3], in the
            order of `agents.people.body.skeleton.JOINTS`.
    """

    units: tuple[MuscleUnit, ...]
    joints: Array

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the units."""
        return tuple(unit.name for unit in self.units)

    def index(self, name: str) -> int:
        """Return the place of a unit.

        Raises:
            UnknownNameError: If there is no such unit.
        """
        check_name("muscle", name, self.names)
        return self.names.index(name)

    def groups(self) -> dict[str, tuple[int, ...]]:
        """Return the units of each action group, such as `left_elbow_flexors`, by their places.

        Most are clinical groups of one side. Clinical groups of trunk, neck and jaw hold
        antagonists, so those are split by what they do (`trunk_flexors`, `neck_extensors_left`).
        Every unit is in exactly one group.
        """
        found: dict[str, list[int]] = {}
        for i, unit in enumerate(self.units):
            side = "" if unit.side == "axial" else f"{unit.side}_"
            group = unit.action_group or side + unit.clinical_group
            found.setdefault(group, []).append(i)
        return {name: tuple(found[name]) for name in sorted(found)}

    def fitted(self, joints: Array) -> Musculature:
        """Return the musculature on another skeleton.

        Path points move as `SkeletonFit` describes. Optimal fibre and tendon slack lengths are then
        multiplied by the unit's path length in the T-pose, new over old: the rule of OpenSim's
        scale tool (Delp et al. 2007, doi 10.1109/TBME.2007.901024), which keeps the normalised
        fibre length of that pose. Forces stay.

        Args:
            joints: Joint centres in the T-pose [m], shape [55, 3].

        Raises:
            ConfigError: If `joints` has another shape, a value that is not finite, or two joints of a
                bone in one place.
        """
        new = np.array(joints, dtype=np.float64)
        if new.shape != (len(JOINTS), 3) or not np.isfinite(new).all():
            raise ConfigError(
                f"joints must be finite joint centres of shape ({len(JOINTS)}, 3), got {new.shape}"
            )
        for j, parent in enumerate(PARENTS):
            if parent >= 0 and np.linalg.norm(new[j] - new[parent]) < 1e-4:
                raise ConfigError(f"the joints {JOINTS[parent]} and {JOINTS[j]} are in one place")
        fit, units = SkeletonFit(self.joints, new), []
        for unit in self.units:
            path = fit.path(unit.path)
            scale = t_pose_length(path, new) / t_pose_length(unit.path, self.joints)
            units.append(
                dataclasses.replace(
                    unit,
                    path=path,
                    optimal_fiber_length=unit.optimal_fiber_length * scale,
                    tendon_slack_length=unit.tendon_slack_length * scale,
                )
            )
        return Musculature(tuple(units), _frozen(new))


def load_musculature(
    path: str | Path | None = None, *, skeleton: str | Path | None = None
) -> Musculature:
    """Return a musculature on the skeleton that it was written for.

    Args:
        path: None for the table that ships, a CSV table in the same format, or a MASS XML (`.xml`).
        skeleton: Joint centres that the table is for. For a CSV table: a skeleton table; if None,
            `<name>_skeleton.csv` beside it, else ours. For a MASS XML: MASS's own skeleton XML; if
            None, ours.

    Raises:
        ConfigError: If a file is missing or wrong; the message names file, row and what is allowed.
        UnknownNameError: If a column, joint, side or clinical group is unknown.
    """
    file = _TABLE if path is None else Path(path).expanduser()
    joints = None if skeleton is None else Path(skeleton).expanduser()
    if file.suffix.lower() == ".xml":
        units, centres = read_mass_xml(file, skeleton=joints, default=_skeleton(_TABLE))
        return Musculature(units, _frozen(centres))
    if file == _TABLE and joints is None:
        return _ours()
    centres = read_skeleton(joints) if joints else _skeleton(file)
    return Musculature(read_table(file), _frozen(centres))


@lru_cache(maxsize=1)
def _ours() -> Musculature:
    return Musculature(read_table(_TABLE), _frozen(_skeleton(_TABLE)))


def _skeleton(table: Path) -> Array:
    beside, ours = (file.with_name(f"{file.stem}_skeleton.csv") for file in (table, _TABLE))
    return read_skeleton(beside if beside.is_file() else ours)


def _frozen(joints: Array) -> Array:
    joints.setflags(write=False)
    return joints


def _at(joints: Array, name: str) -> Array:
    return np.asarray(joints[JOINT_INDEX[name]])


def _spine(joints: Array, height: float, *, straight: float = 0.0) -> float:
    """Return how far forward the spine is at a height [m], its curve straightened by a share."""
    spine = np.array([_at(joints, name) for name in _SPINE])
    ends = spine[[0, -1]]
    curve, line = (float(np.interp(height, row[:, 1], row[:, 2])) for row in (spine, ends))
    return (1 - straight) * curve + straight * line


def _turn(old: Array, new: Array) -> Array:
    """Return the smallest rotation that turns one direction into another, shape [3, 3]."""
    a, b = old / np.linalg.norm(old), new / np.linalg.norm(new)
    axis, cosine = np.cross(a, b), float(a @ b)
    k = np.array(((0, -axis[2], axis[1]), (axis[2], 0, -axis[0]), (-axis[1], axis[0], 0)))
    return np.asarray(np.eye(3) + k + (k @ k) / (1 + cosine))
