"""Reading a muscle table: one CSV row for each muscle-tendon unit, strictly.

`assets/muscles/whole_body.csv` is ours; a user's own table has the same columns. A path is written as
points separated by `;`, each `segment@reference:x,y,z` in metres, or `child+parent@child:x,y,z` for a
pulley at the child's joint. `|cylinder:radius:x,y,z` or `|sphere:radius` after a point makes it the centre
of a surface that the path goes round. See docs/muscles.md.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array
from rcare_marl.reading import read_text, refusing

from ..body.skeleton import CARRIERS, JOINT_INDEX, JOINTS, PARENTS
from ..profile import clinical_norms
from .hill import MAX_SPEED
from .muscle_unit import MuscleUnit, PathPoint, Side
from .muscle_wrap import KINDS, Surface

REQUIRED = (
    "name side region clinical_group fmax_N lopt_m lts_m pennation_deg passive_strain "
    "architecture_ref architecture_checked geometry_source path"
).split()
# What a row may say besides; most of it tells readers how its figures came about, and is not used.
OPTIONAL = (
    "action_group vmax_per_s fmax_published_N fmax_factor lopt_published_m lts_published_m calibration "
    "ma_rms_error_mm lm_norm_min lm_norm_max note"
).split()
_NUMBERS = {  # column: (least, greatest); bounds keep out a wrong unit, such as mm for m
    "fmax_N": (0.1, 20000.0),
    "lopt_m": (0.001, 1.0),
    "lts_m": (0.0, 1.0),
    "pennation_deg": (0.0, 60.0),
    "passive_strain": (0.05, 5.0),
}
LEAST_RADIUS = 1e-4  # [m] of a surface
_MIRROR = {"left": "right", "right": "left", "axial": "axial"}  # of every side


def read_table(file: str | Path) -> tuple[MuscleUnit, ...]:
    """Return the units of a muscle table.

    Raises:
        ConfigError: If the file cannot be read, a column is missing or stands twice, a value is
            missing or out of range, a path has fewer than two points, a name stands twice, or a
            unit of one side has no twin on the other.
        UnknownNameError: If a column, side, joint or clinical group is unknown.
    """
    rows = read_csv(Path(file), REQUIRED, OPTIONAL)
    if not rows:
        raise ConfigError(f"{file} has no rows")
    units = tuple(_unit(row, f"{file}, row {i}") for i, row in enumerate(rows, start=2))
    check_units(units, str(file))
    return units


def read_skeleton(file: str | Path) -> Array:
    """Return the T-pose joint centres of a skeleton table [m], shape [55, 3].

    The file has the columns `joint`, `x_m`, `y_m`, `z_m` and one row for each SMPL-X joint.

    Raises:
        ConfigError: If the file cannot be read, or a joint or a number is missing.
        UnknownNameError: If a joint is unknown.
    """
    with_columns = ("joint", "x_m", "y_m", "z_m")
    joints = np.full((len(JOINTS), 3), np.nan)
    for i, row in enumerate(read_csv(Path(file), with_columns), start=2):
        where = f"{file}, row {i}"
        check_name(f"joint ({where})", row["joint"], JOINTS)
        joints[JOINT_INDEX[row["joint"]]] = [number(row, key, where) for key in with_columns[1:]]
    missing = [name for name, row in zip(JOINTS, joints, strict=True) if np.isnan(row).any()]
    if missing:
        raise ConfigError(f"{file} lacks the joints {', '.join(missing)}")
    return joints


def check_units(units: tuple[MuscleUnit, ...], where: str) -> None:
    """Check names and sides of a whole table.

    Raises:
        ConfigError: If a name stands twice, or a unit of one side has no twin on the other.
    """
    by_name: dict[str, MuscleUnit] = {}
    for unit in units:
        if unit.name in by_name:
            raise ConfigError(f"{where}: the unit {unit.name!r} stands twice")
        by_name[unit.name] = unit
    for unit in units:
        ending = {"left": "_l", "right": "_r"}.get(unit.side)
        if ending and not unit.name.endswith(ending):
            raise ConfigError(
                f"{where}: {unit.name!r} is of the {unit.side} side, so its name must end in {ending}"
            )
        if unit.name.endswith(("_l", "_r")):
            twin = unit.name[:-1] + ("r" if unit.name.endswith("_l") else "l")
            if twin not in by_name or by_name[twin].side != _MIRROR[unit.side]:
                raise ConfigError(
                    f"{where}: {unit.name!r} has no twin {twin!r} on the other side of the body"
                )


def read_csv(
    file: Path, required: Sequence[str], optional: Sequence[str] = ()
) -> list[dict[str, str]]:
    """Return the rows of a CSV file by column.

    Raises:
        ConfigError: If the file cannot be read, a column is missing or stands twice, or a row has
            too few or too many cells.
        UnknownNameError: If a column is neither required nor optional.
    """
    lines = read_text(file, "a table (CSV)").splitlines()
    with refusing(file, "a table (CSV)"):
        header, *records = list(csv.reader(lines)) or [[]]
    for column in header:
        check_name(f"column ({file})", column, (*required, *optional))
        if header.count(column) > 1:
            raise ConfigError(f"{file}: the column {column!r} stands twice")
    missing = [column for column in required if column not in header]
    if missing:
        raise ConfigError(f"{file} lacks the columns {', '.join(missing)}")
    rows = []
    for i, cells in enumerate(records, start=2):
        if len(cells) != len(header):
            raise ConfigError(f"{file}, row {i}: expected {len(header)} cells, got {len(cells)}")
        rows.append(dict(zip(header, cells, strict=True)))
    return rows


def _unit(row: dict[str, str], where: str) -> MuscleUnit:
    name = row["name"].strip()
    if not name:
        raise ConfigError(f"{where}: the unit has no name")
    where = f"{where} ({name})"
    numbers = {key: number(row, key, where, *bounds) for key, bounds in _NUMBERS.items()}
    check_name(f"side ({where})", row["side"], _MIRROR)
    side, group = cast(Side, row["side"]), row["clinical_group"]
    check_name(f"clinical group ({where})", group, clinical_norms().groups)
    sources = [row[key].strip() for key in REQUIRED[-4:-1]]
    if not all(sources):
        raise ConfigError(
            f"{where}: {', '.join(REQUIRED[-4:-1])} must say where the figures are from"
        )
    prefix = "" if side == "axial" else f"{side}_"
    return MuscleUnit(
        name=name,
        side=side,
        region=row["region"],
        clinical_group=group,
        max_isometric_force=numbers["fmax_N"],
        optimal_fiber_length=numbers["lopt_m"],
        tendon_slack_length=numbers["lts_m"],
        pennation=math.radians(numbers["pennation_deg"]),
        passive_strain=numbers["passive_strain"],
        path=parse_path(row["path"], where),
        source="architecture: {}; checked: {}; geometry: {}".format(*sources),
        action_group=row.get("action_group", "").strip() or prefix + group,
        max_speed=number(row, "vmax_per_s", where, 1.0, 30.0)
        if row.get("vmax_per_s")
        else MAX_SPEED,
    )


def parse_path(text: str, where: str) -> tuple[PathPoint, ...]:
    """Return the points of a written path.

    Raises:
        ConfigError: If a point is not written as described above, a pulley is not between a joint
            and its parent, there are fewer than two points, or a surface has a wrong radius or axis or
            no point on either side.
        UnknownNameError: If a joint, segment or surface is unknown.
    """
    points = tuple(_point(part.strip(), where) for part in text.split(";") if part.strip())
    if len(points) < 2:
        raise ConfigError(f"{where}: a path needs at least two points, got {len(points)}")
    wraps = [k for k, point in enumerate(points) if point.surface is not None]
    if wraps and (wraps[0] == 0 or wraps[-1] == len(points) - 1):
        raise ConfigError(f"{where}: a path cannot start or end on a surface")
    if any(b - a == 1 for a, b in zip(wraps, wraps[1:], strict=False)):
        raise ConfigError(f"{where}: between two surfaces a path needs a point")
    return points


def _point(text: str, where: str) -> PathPoint:
    text, bar, surface = text.partition("|")
    carriers, at, rest = text.partition("@")
    reference, colon, offset = rest.partition(":")
    if not (at and colon):
        raise ConfigError(f"{where}: a point is written segment@reference:x,y,z, got {text!r}")
    joint, plus, parent = carriers.partition("+")
    check_name(f"segment in the path ({where})", joint, JOINTS if plus else CARRIERS)
    for name in (reference, *([parent] if plus else [])):
        check_name(f"joint in the path ({where})", name, JOINTS)
    if plus and bar:
        raise ConfigError(f"{where}: a surface is fixed to one segment, got {text!r}")
    if plus:
        before = PARENTS[JOINT_INDEX[joint]]
        if reference != joint or before < 0 or JOINTS[before] != parent:
            raise ConfigError(
                f"{where}: a pulley is written child+parent@child:x,y,z with the joint's own parent, "
                f"got {text!r}"
            )
    values = _numbers(offset)
    # 1 m keeps out millimetres: no attachment is that far from a joint of its own segment.
    if len(values) != 3 or not all(abs(value) < 1.0 for value in values):
        raise ConfigError(f"{where}: an offset is three numbers below 1 m, got {offset!r}")
    own = _surface(surface, where) if bar else None
    place = (values[0], values[1], values[2])
    return PathPoint(joint, parent if plus else None, reference, place, own)


def _surface(text: str, where: str) -> Surface:
    kind, *figures = text.split(":")
    check_name(f"surface in the path ({where})", kind, KINDS)
    form = {"cylinder": "cylinder:radius:x,y,z", "sphere": "sphere:radius"}[kind]
    if len(figures) != form.count(":"):
        raise ConfigError(f"{where}: a {kind} is written {form}, got {text!r}")
    radius = number({"radius": figures[0]}, "radius", where, LEAST_RADIUS, 0.5)
    if kind == "sphere":
        return Surface("sphere", radius)
    axis = _numbers(figures[1])
    if len(axis) != 3 or not all(map(math.isfinite, axis)) or math.hypot(*axis) < 1e-6:
        raise ConfigError(f"{where}: an axis is three numbers, not all 0, got {figures[1]!r}")
    return Surface("cylinder", radius, (axis[0], axis[1], axis[2]))


def _numbers(text: str) -> list[float]:
    """Return the numbers between commas; none if one of them is no number."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        return []


def number(
    row: dict[str, str], key: str, where: str, least: float = -10.0, greatest: float = 10.0
) -> float:
    """Return the number in a cell; ConfigError if it is none or lies outside the bounds."""
    text = row.get(key, "")
    try:
        value = float(text)
    except ValueError:
        raise ConfigError(f"{where}: {key} must be a number, got {text!r}") from None
    if not least <= value <= greatest:  # also false for nan
        raise ConfigError(f"{where}: {key} must lie in {least:g}..{greatest:g}, got {text}")
    return value
