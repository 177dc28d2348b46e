"""Reading muscles in the XML format of MASS (Lee et al. 2019, "Scalable muscle-actuated human
simulation and control", doi 10.1145/3306346.3322972).

    <Unit name="L_Bicep" f0="1000" lm="1.0" lt="0.2" pen_angle="0" lmax="-0.1">
      <Waypoint body="ArmL" p="0.35 1.4 -0.02"/> ...

A waypoint `p` is a place in the T-pose, in the global frame of MASS's own human [m] (x left, y up, z
forward). `lm` and `lt` are the optimal fibre and the tendon slack length as shares of the path's length in
the T-pose.

Beware: in MASS's own file 124 of 284 units, all of arms, neck and trunk, have the placeholder force
of 1000 N, `lm` and `lt` are nearly the same for all, and every pennation is 0. The paths are of use,
those strengths are not. MASS also blends waypoints near a joint between two segments; here each
waypoint stays with its own.
"""

from __future__ import annotations

import dataclasses
import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array
from rcare_marl.reading import read_xml

from ..body.skeleton import DOF_INDEX, DOFS, JOINT_INDEX, JOINTS, PARENTS, SIDES, forward_kinematics
from ..profile import clinical_norms
from .hill import PASSIVE_STRAIN
from .muscle_table import number
from .muscle_unit import MuscleUnit, PathPoint, Side, path_lengths, t_pose_length

# MASS's segments and the SMPL-X joint about which each one turns. MASS has two segments for the trunk
# above the pelvis; the upper one carries the arms, so it is spine3.
_AXIAL = {"Pelvis": "pelvis", "Spine": "spine1", "Torso": "spine3", "Neck": "neck", "Head": "head"}
_LEG = {"Femur": "hip", "Tibia": "knee", "Talus": "ankle", "FootThumb": "foot", "FootPinky": "foot"}
_LIMB = _LEG | {"Shoulder": "collar", "Arm": "shoulder", "ForeArm": "elbow", "Hand": "wrist"}
BODIES: dict[str, str] = _AXIAL | {
    body + side[0].upper(): f"{side}_{joint}" for side in SIDES for body, joint in _LIMB.items()
}
# Both arms 30 degrees from the body, where motions have their clinical names.
_ARM = math.radians(-60)
_STEP = 1e-4  # [rad], of the difference that is a moment arm


def read_mass_xml(
    file: Path, *, skeleton: Path | None, default: Array
) -> tuple[tuple[MuscleUnit, ...], Array]:
    """Return the units of a MASS muscle file and the joint centres that they are for [m], [55, 3].

    Args:
        file: MASS's muscle XML.
        skeleton: MASS's human XML with its joint centres, or None for `default`.
        default: Joint centres to use without one, or for joints that MASS does not have [m], [55, 3].

    Raises:
        ConfigError: If a file is no XML, a value is missing or out of range, a name stands twice, or a
            unit has fewer than two waypoints or no moment arm about any joint.
        UnknownNameError: If a body is not one of MASS's.
    """
    centres = default.copy() if skeleton is None else _mass_skeleton(skeleton, default)
    units = [_unit(element, centres, str(file)) for element in read_xml(file, "MASS").iter("Unit")]
    if not units:
        raise ConfigError(f"{file} has no element <Unit>")
    names = [unit.name for unit in units]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"{file}: the unit {name!r} stands twice")
    return _graded(units, centres, str(file)), centres


def _unit(element: ET.Element, centres: Array, file: str) -> MuscleUnit:
    name = element.get("name", "").strip()
    if not name:
        raise ConfigError(f"{file}: a <Unit> has no name")
    where = f"{file}, unit {name!r}"
    path = tuple(_waypoint(child, centres, where) for child in element.iter("Waypoint"))
    if len(path) < 2:
        raise ConfigError(f"{where}: a path needs at least two waypoints, got {len(path)}")
    length = t_pose_length(path, centres)
    if length <= 0:
        raise ConfigError(f"{where}: all waypoints are in the same place")
    return MuscleUnit(
        name=name,
        side="axial",
        region="mass",
        clinical_group="",
        max_isometric_force=number(element.attrib, "f0", where, 0.1, 20000.0),
        optimal_fiber_length=number(element.attrib, "lm", where, 0.01, 10.0) * length,
        tendon_slack_length=number(element.attrib, "lt", where, 0.0, 10.0) * length,
        pennation=number(element.attrib, "pen_angle", where, 0.0, 1.05),
        passive_strain=PASSIVE_STRAIN,  # as in De Groote et al. 2016: the file has none
        path=path,
        source=f"MASS XML {Path(file).name}; not checked; arm, neck and trunk forces there are "
        "placeholders",
    )


def _waypoint(element: ET.Element, centres: Array, where: str) -> PathPoint:
    body = element.get("body", "")
    check_name(f"MASS body ({where})", body, BODIES)
    joint = BODIES[body]
    x, y, z = (float(v) for v in _vector(element, "p", where) - centres[JOINT_INDEX[joint]])
    return PathPoint(joint, None, joint, (x, y, z))


def _vector(element: ET.Element, key: str, where: str) -> Array:
    try:
        values = np.array([float(part) for part in element.get(key, "").split()])
    except ValueError:
        values = np.zeros(0)
    if values.shape != (3,) or not (np.abs(values) < 10).all():
        raise ConfigError(
            f"{where}: {key} must be three numbers in metres, got {element.get(key)!r}"
        )
    return values


def _mass_skeleton(file: Path, default: Array) -> Array:
    """Return MASS's joint centres; joints that it lacks keep their place on the segment before."""
    known: dict[str, list[Array]] = {}
    for node in read_xml(file, "MASS").iter("Node"):
        name, where = node.get("name", ""), f"{file}, node {node.get('name')!r}"
        check_name(f"MASS body ({file})", name, BODIES)
        place = node.find("Joint/Transformation")
        if place is None:
            raise ConfigError(f"{where} has no <Joint> with a <Transformation>")
        known.setdefault(BODIES[name], []).append(_vector(place, "translation", where))
    missing = [body for body, joint in BODIES.items() if joint not in known]
    if missing:
        raise ConfigError(f"{file} lacks the nodes {', '.join(missing)}")
    out = default.copy()
    for j, name in enumerate(JOINTS):
        if name in known:
            out[j] = np.mean(known[name], axis=0)
        else:
            out[j] = out[PARENTS[j]] + default[j] - default[PARENTS[j]]
    spine = [JOINT_INDEX[name] for name in ("spine1", "spine2", "spine3")]
    out[spine[1]] = 0.5 * (out[spine[0]] + out[spine[2]])
    return out


def _graded(units: Sequence[MuscleUnit], centres: Array, file: str) -> tuple[MuscleUnit, ...]:
    """Give each unit the clinical group of the motion for which its moment arm is greatest."""
    paths, angles = [unit.path for unit in units], np.zeros(len(DOFS))
    for side in SIDES:
        angles[DOF_INDEX[f"{side}_shoulder_abduction"]] = _ARM
    arms = np.empty((len(units), len(DOFS)))
    for i in range(len(DOFS)):
        lengths = []
        for sign in (1, -1):
            turned = angles.copy()
            turned[i] += sign * _STEP
            lengths.append(path_lengths(paths, centres, *forward_kinematics(centres, turned)))
        arms[:, i] = (lengths[1] - lengths[0]) / (2 * _STEP)
    graded = []
    for unit, row in zip(units, arms, strict=True):
        best = int(np.argmax(np.abs(row)))
        if abs(row[best]) < 1e-4:
            raise ConfigError(f"{file}, unit {unit.name!r}: the path crosses no joint")
        dof = DOFS[best]
        motion = dof.positive if row[best] > 0 else dof.negative
        group, side = clinical_norms().motions[motion].group, cast(Side, dof.side)
        graded.append(dataclasses.replace(unit, side=side, clinical_group=group))
    return tuple(graded)
