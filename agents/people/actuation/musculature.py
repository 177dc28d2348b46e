"""A person's musculature: all muscle-tendon units, and how they fit another skeleton.

The whole-body table that ships has 324 units; docs/muscles.md says where its figures come from.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from rcare_marl import assets
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array

from ..body.skeleton import JOINTS, PARENTS
from .mass_xml import read_mass_xml
from .muscle_fit import SkeletonFit
from .muscle_table import read_skeleton, read_table
from .muscle_unit import MuscleUnit, t_pose_length

_TABLE = assets.ROOT / "muscles" / "whole_body.csv"


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

        Path points move as `muscle_fit` describes. Optimal fibre and tendon slack lengths are then
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
