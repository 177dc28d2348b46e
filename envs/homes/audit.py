"""Checks a home against the rules of accessibility: what is measured, what is allowed, what fails."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

from rich.table import Table

from .audit_door import measure_openings
from .audit_entrance import measure_entrance
from .audit_furniture import measure_furniture, measure_sets
from .care_home import CareHome
from .doorway import gate
from .ground import Ground
from .measurement import Measurement, near
from .plan import Room
from .rule import Rule, Rules

TURNING = ("kitchen", "bedroom", "bathroom", "living", "dining")
REACHED_INTO = ("closet", "pantry")  # rooms that one reaches into, without ways of their own
_NAMED = 4  # places that a row of the table names; the others are counted


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
