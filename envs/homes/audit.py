"""Checks a home against the rules of accessibility; measures rooms, doors and what leads up to it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from rich.table import Table

from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Model
from rcare_marl.pose import Array, Pose

from ..rectangle import Rectangle
from .audit_furniture import measure_furniture, measure_sets
from .care_home import CareHome
from .door import door_model, hinge_side
from .doorway import LATCH_DEPTH, OFF_WALL, gate, latch_edge
from .entrance import build_entrance
from .ground import Ground
from .measurement import Measurement, Surroundings, near
from .merging import link_poses
from .palette import Palette
from .plan import Opening, Plan, Room
from .rule import Rule, Rules
from .shell_canvas import Canvas

TURNING = ("kitchen", "bedroom", "bathroom", "living", "dining")
REACHED_INTO = ("closet", "pantry")  # rooms that one reaches into, without ways of their own
_NAMED = 4  # places that a row of the table names; the others are counted
SLOWLY = 0.2  # [m/s] at which a hand moves a door; own choice
_HANDLES = ("handle", "panel")  # links that hands take hold of
TILTED = math.radians(0.5)  # least tilt of a ramp; own choice
RIM = 0.05  # [m] beyond a floor at which one looks for the house; own choice
FLUSH = 0.013  # [m], most rise that is no step: ADA 303.3


@dataclass(frozen=True)
class Finding(Measurement):
    """One thing that was measured, and whether the rules allow it.

    Attributes:
        allowed: What the level allows, in words.
        ok: Whether it does.
    """

    allowed: str
    ok: bool


@dataclass(frozen=True)
class Audit:
    """All findings in one home.

    Attributes:
        home: Name of the house.
        built_level: The level that it is built for.
        level: The level whose rules it was held against.
        findings: One for each thing measured.
        unmeasured: Rules for which the home has nothing to measure.
    """

    home: str
    built_level: int
    level: int
    findings: tuple[Finding, ...]
    unmeasured: tuple[str, ...]

    @cached_property
    def failures(self) -> tuple[Finding, ...]:
        """What the rules do not allow."""
        return tuple(finding for finding in self.findings if not finding.ok)

    @property
    def passed(self) -> int:
        """How many findings the rules allow."""
        return len(self.findings) - len(self.failures)

    @property
    def share(self) -> float:
        """Share of the findings that the rules allow, in [0, 1]; 1 if there are none."""
        return self.passed / len(self.findings) if self.findings else 1.0

    @cached_property
    def broken(self) -> tuple[str, ...]:
        """Names of the rules that fail somewhere, in the order of the table of rules."""
        return tuple(dict.fromkeys(finding.rule for finding in self.failures))

    @cached_property
    def kept(self) -> tuple[str, ...]:
        """Names of the rules that were measured and hold everywhere."""
        measured = dict.fromkeys(finding.rule for finding in self.findings)
        return tuple(name for name in measured if name not in self.broken)

    def table(self) -> Table:
        """Return what fails, grouped by rule and value, for a console."""
        table = Table(
            title=f"{self.home}, built at level {self.built_level}: {len(self.failures)} of "
            f"{len(self.findings)} findings fail level {self.level}",
        )
        for head in ("rule", "measured", "allowed", "where"):
            table.add_column(head)
        rules = Rules(self.level)
        for name in self.broken:
            rule = rules[name]
            groups: dict[str, list[Finding]] = {}
            for finding in self.failures:
                if finding.rule == name:
                    groups.setdefault(_text(finding.value, rule), []).append(finding)
            first = True
            for value, group in groups.items():
                where = list(dict.fromkeys(f.what or f.room for f in group))
                more = f" and {len(where) - _NAMED} more" if len(where) > _NAMED else ""
                title, allowed = (rule.title, group[0].allowed) if first else ("", "")
                table.add_row(title, value, allowed, ", ".join(where[:_NAMED]) + more)
                first = False
            table.add_section()
        return table


def audit(
    home: CareHome, level: int | None = None, *, measured: Iterable[Measurement] = ()
) -> Audit:
    """Check a home against the rules of a level.

    Everything is measured from the home as it stands: from walls, openings, the poses and the solids
    of its furniture, and the floor that they leave free.

    Args:
        home: The home.
        level: The level whose rules count; its own if None.
        measured: What was measured elsewhere and counts as well, such as forces in a simulation.

    Raises:
        ConfigError: If `level` is not 1, 2 or 3.
        UnknownNameError: If something is measured that no rule is about.
    """
    rules = Rules(home.level if level is None else level)
    order = {name: k for k, name in enumerate(rules)}
    taken = [
        *measure_openings(home),
        *measure_entrance(home),
        *_measure_rooms(home),
        *measure_furniture(home),
        *measure_sets(home),
        *measured,
    ]
    judged = [
        Finding(
            **vars(each),
            allowed=rules[each.rule].bounds(rules.level),
            ok=rules[each.rule].allows(each.value, rules.level),
        )
        for each in taken
    ]
    judged.sort(key=lambda finding: order[finding.rule])
    seen = {finding.rule for finding in judged}
    unmeasured = tuple(name for name in rules if name not in seen)
    return Audit(home.plan.name, home.level, rules.level, tuple(judged), unmeasured)


def _text(value: float | str | None, rule: Rule) -> str:
    if value is None:
        return "none"
    if isinstance(value, str):
        return value.replace("_", " ")
    return f"{value:.3f}" if rule.unit == "1" else f"{value:.3f} {rule.unit}"


def _measure_rooms(home: CareHome) -> Iterator[Measurement]:
    """Yield what is measured of the floor of rooms."""
    for room in home.plan.rooms.values():
        if room.use == "hall":
            narrow = min(room.inside.width, room.inside.depth)
            yield Measurement("hallway_width", room.name, room.name, narrow)
        things = [thing.area for thing in near(home.wheel_clearance, room.inside)]
        ground = Ground(room.inside, things)
        if room.kind in TURNING:
            yield Measurement("turning_diameter", room.name, room.name, ground.circle[0])
        if room.use not in REACHED_INTO:
            width = _passage(home, room, ground)
            if width is not None:
                yield Measurement("passage_width", room.name, room.name, width)


def _passage(home: CareHome, room: Room, ground: Ground) -> float | None:
    """Return the free width of the ways from each door of a room to its freest place [m].

    A way starts in line with its door, so a leaf that stands open there makes it narrower.
    None for a room without doors.
    """
    ways = [o for o in home.plan.openings_of(room.name) if o.kind != "window"]
    return ground.width([gate(way, room.name) for way in ways]) if ways else None


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


def measure_entrance(home: CareHome) -> Iterator[Measurement]:
    """Yield how one comes up to each entrance, how high, how steep and how wide."""
    for opening in home.plan.openings.values():
        if opening.kind != "entrance":
            continue
        canvas = Canvas()
        build_entrance(canvas, opening, home.plan, home.rules)
        boxes = [shape for shape in canvas.solids if shape.kind == "box"]
        ramps = [box for box in boxes if _tilt(box) > TILTED]
        level = [box for box in boxes if box not in ramps and not is_yard(box, home.plan)]
        rise = max((0.5 * box.size[2] - box.at[2] for box in level), default=0.0)
        room, name = opening.rooms[0], opening.name
        word = "ramp" if ramps else "steps" if rise > FLUSH else "level"
        yield Measurement("entrance_way", room, name, word)
        yield Measurement("entrance_rise", room, name, rise)
        if ramps:
            yield Measurement("ramp_slope", room, name, max(math.tan(_tilt(b)) for b in ramps))
            yield Measurement("ramp_width", room, name, ramp_width(ramps))


def ramp_width(ramps: Sequence[Shape]) -> float:
    """Return the free width of a ramp between its curbs, all boxes with the same turn [m].

    The widest box is what one goes on; those that stand higher are curbs.
    """
    deck = max(ramps, key=lambda box: box.size[1])
    back = deck.pose().inverse()
    low, high = -0.5 * deck.size[1], 0.5 * deck.size[1]
    for box in ramps:
        _, y, z = (back @ box.pose()).position
        if z + 0.5 * box.size[2] <= 0.5 * deck.size[2] + 1e-6:
            continue
        if y > 0:
            high = min(high, y - 0.5 * box.size[1])
        else:
            low = max(low, y + 0.5 * box.size[1])
    return high - low


def is_yard(box: Shape, plan: Plan) -> bool:
    """Return whether the house stands on all sides of a level floor, so that nobody steps off it."""
    (x, y, _), (wide, deep, _) = box.at, box.size
    area = Rectangle(x - 0.5 * wide, y - 0.5 * deep, x + 0.5 * wide, y + 0.5 * deep)
    rim = area.grown(RIM)
    xs, ys = (np.linspace(a, b, 40).tolist() for a, b in ((area.x0, area.x1), (area.y0, area.y1)))
    beside = [(x, y) for x in xs for y in (rim.y0, rim.y1)]
    beside += [(x, y) for y in ys for x in (rim.x0, rim.x1)]
    return all(any(part.has(*point) for part in plan.outline) for point in beside)


def _tilt(box: Shape) -> float:
    """Return the angle between the top of a box and the level [rad]."""
    up: Array = box.pose().matrix()[:3, 2]
    return math.atan2(math.hypot(float(up[0]), float(up[1])), float(up[2]))
