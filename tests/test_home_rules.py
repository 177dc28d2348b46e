"""Rules of accessibility, and the audit that holds a home against them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from io import StringIO

import pytest
from rich.console import Console

from rcare_marl.envs.homes.audit import Audit, audit, door_force, is_yard
from rcare_marl.envs.homes.audit_furniture import bars, handle_word, tap_word
from rcare_marl.envs.homes.care_home import CareHome
from rcare_marl.envs.homes.door import door_model
from rcare_marl.envs.homes.entrance import build_entrance
from rcare_marl.envs.homes.furnishing import Placed
from rcare_marl.envs.homes.ground import Ground
from rcare_marl.envs.homes.measurement import Measurement, Surroundings
from rcare_marl.envs.homes.palette import Palette
from rcare_marl.envs.homes.piece import Piece, Setting, make_piece
from rcare_marl.envs.homes.plan import (
    HINGED_LOSS,
    INNER_WALL,
    OUTSIDE,
    SLIDING_LOSS,
    Opening,
    Plan,
    Room,
    Wall,
)
from rcare_marl.envs.homes.rule import LEVELS, Rule, Rules
from rcare_marl.envs.homes.shell_canvas import Canvas
from rcare_marl.envs.rectangle import Rectangle
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Joint, Link, Model
from rcare_marl.pose import Pose, quaternion_from_rpy

SOUTH = -0.5 * math.pi  # of furniture that stands at a north wall and looks south
# Width and depth of bathroom, bedroom and kitchen [m].
SIZES = {1: (2.0, 2.7, 2.8, 2.6), 2: (3.0, 3.6, 3.4, 3.4), 3: (3.0, 3.6, 3.4, 3.4)}
ENTRANCE_X = sum(SIZES[3][:3]) + 3.5 * INNER_WALL + 2.4  # at level 3


def at(x: float, y: float, yaw: float = 0.0) -> Pose:
    return Pose((x, y, 0.0), tuple(quaternion_from_rpy(0, 0, yaw).tolist()))


def doorway(
    rules: Rules, name: str, rooms: tuple[str, str], x: float, y: float, *, rule: str
) -> Opening:
    """A door in a wall that runs east; it swings north."""
    hardware = rules.choice("door_hardware")
    loss = SLIDING_LOSS if hardware == "slider" else HINGED_LOSS
    threshold = "bathroom_threshold" if rule.startswith("bathroom") else "door_threshold"
    return Opening(
        name, "door", rooms, "x", (x, y), rules.figure(rule) + loss, INNER_WALL,
        hardware=hardware, hinge="high", threshold=rules.figure(threshold),
    )  # fmt: skip


def ring(inside: Rectangle) -> Iterator[Wall]:
    """Four walls round a room."""
    out = inside.grown(INNER_WALL)
    yield Wall(Rectangle(out.x0, out.y0, out.x1, inside.y0), "x", False)
    yield Wall(Rectangle(out.x0, inside.y1, out.x1, out.y1), "x", False)
    yield Wall(Rectangle(out.x0, out.y0, inside.x0, out.y1), "y", False)
    yield Wall(Rectangle(inside.x1, out.y0, out.x1, out.y1), "y", False)


def small_plan(rules: Rules) -> Plan:
    """Bathroom, bedroom and kitchen in a row north of a hall that starts at an entry in the east."""
    bath, bed, kitchen, deep = SIZES[rules.level]
    hall, gap = rules.figure("hallway_width"), INNER_WALL
    y, east = hall + gap, bath + bed + kitchen + 2 * gap
    starts = (0.0, bath + gap, bath + bed + 2 * gap)
    insides = {
        "bathroom_1": Rectangle(0.0, y, bath, y + deep),
        "bedroom_1": Rectangle(starts[1], y, starts[1] + bed, y + deep),
        "kitchen_1": Rectangle(starts[2], y, east, y + deep),
        "hall_1": Rectangle(0.0, 0.0, east, hall),
        "entry_1": Rectangle(east + gap, 0.0, east + gap + 2.4, 2.4),
    }
    kinds = {"hall_1": ("other", "hall"), "entry_1": ("other", "entry")}
    rooms = {}
    for name, inside in insides.items():
        kind, use = kinds.get(name, (name[:-2], name[:-2]))
        rooms[name] = Room(name, kind, use, inside)
    lever = "knob" if rules.level == 1 else "lever"
    wall = y - 0.5 * gap
    openings = [
        doorway(rules, "door_1", ("bathroom_1", "hall_1"), bath - 0.6, wall,
                rule="bathroom_door_clear_width"),
        doorway(rules, "door_2", ("bedroom_1", "hall_1"), starts[1] + bed - 0.9, wall,
                rule="door_clear_width"),
        doorway(rules, "door_3", ("kitchen_1", "hall_1"), starts[2] + 1.7, wall,
                rule="door_clear_width"),
        Opening("passage_1", "passage", ("hall_1", "entry_1"), "y", (east + 0.5 * gap, 0.5 * hall),
                rules.figure("door_clear_width"), gap, normal=(-1, 0)),
        Opening("entrance_1", "entrance", ("entry_1", OUTSIDE), "y", (east + 2.4 + 1.5 * gap, 1.2),
                rules.figure("entrance_clear_width") + HINGED_LOSS, gap, hardware=lever,
                threshold=rules.figure("entrance_threshold"), normal=(-1, 0)),
    ]  # fmt: skip
    walls = tuple(wall for inside in insides.values() for wall in ring(inside))
    outline = tuple(inside.grown(gap) for inside in insides.values())
    by_name = {opening.name: opening for opening in openings}
    return Plan("small", "A test", rules.level, rooms, walls, by_name, outline)


def small_home(level: int) -> CareHome:
    rules = Rules(level)
    plan, setting = small_plan(rules), Setting(rules)
    bath, bed, kitchen = (
        plan.rooms[name].inside for name in ("bathroom_1", "bedroom_1", "kitchen_1")
    )
    tub = make_piece(rules.choice("bathing"), setting)
    basin = make_piece("washbasin", setting)
    aside = 0.8 if level == 1 else 1.5
    placed = [
        ("toilet", make_piece("toilet", setting, {"wall": "right"}),
         at(rules.figure("toilet_centre_to_wall"), bath.y1, SOUTH)),
        ("washbasin", basin, at(bath.x1 + basin.footprint.y0, bath.y1, SOUTH)),
        (tub.kind, tub, at(0.0, bath.y0 - tub.footprint.y0)),
        ("bed", make_piece("bed", setting), at(bed.x0 + aside, bed.y1, SOUTH)),
        ("kitchen_run", make_piece("kitchen_run", setting, {"length": 2.4}),
         at(kitchen.centre[0], kitchen.y1, SOUTH)),
    ]  # fmt: skip
    rooms = {"bed": "bedroom_1", "kitchen_run": "kitchen_1"}
    furniture = []
    for kind, piece, pose in placed:
        room = rooms.get(kind, "bathroom_1")
        furniture.append(Placed(f"{room}.{kind}", piece, room, pose))
    return CareHome("small", level, plan, rules, Palette(), tuple(furniture))


@pytest.fixture(scope="module")
def homes() -> dict[int, CareHome]:
    return {level: small_home(level) for level in LEVELS}


def values(result: Audit, rule: str) -> list[float | str | None]:
    return [finding.value for finding in result.findings if finding.rule == rule]


def test_what_is_built_at_a_level_obeys_its_rules() -> None:
    for name, rule in Rules(1).items():
        for level in (2, 3):
            value = rule.built[level - 1]
            assert value is None or rule.allows(value, level), (name, level)
        assert rule.allows(rule.built[0], 1)
        assert len(rule.source) > 10 and rule.title, name


def test_what_level_one_builds_mostly_breaks_level_three() -> None:
    built = {name: rule for name, rule in Rules(1).items() if rule.built[0] is not None}
    allowed = [name for name, rule in built.items() if rule.allows(rule.built[0], 3)]
    assert len(allowed) < 0.2 * len(built), allowed


def test_level_three_allows_nothing_that_level_two_forbids() -> None:
    for name, rule in Rules(2).items():
        if rule.unit == "choice":
            assert set(rule.allowed_3) <= set(rule.allowed_2), name
            continue
        (low_2, high_2), (low_3, high_3) = (
            [None if end is None else float(end) for end in allowed]
            for allowed in (rule.allowed_2, rule.allowed_3)
        )
        assert low_2 is None or (low_3 is not None and low_3 >= low_2), name
        # 18 in is 0.457 m; the ADA rounds it to 0.455 m.
        assert high_2 is None or (high_3 is not None and high_3 <= high_2 + 0.0051), name


@pytest.mark.parametrize(
    ("unit", "allowed"),
    [("m", (1.0,)), ("m", ("wide", None)), ("choice", (1.0, None)), ("choice", ())],
)
def test_rules_that_cannot_be_are_refused(
    unit: str, allowed: tuple[float | str | None, ...]
) -> None:
    with pytest.raises(ConfigError, match="allows words, or a least and a greatest"):
        Rule("A rule", unit, (None, None, None), allowed, allowed, "nowhere")


def test_rules_say_what_they_allow() -> None:
    rules = Rules(3)
    assert rules["door_clear_width"].bounds(2) == "at least 0.815 m"
    assert rules["door_threshold"].bounds(3) == "at most 0.006 m"
    assert rules["table_height"].bounds(2) == "0.71 to 0.865 m"
    assert rules["door_hardware"].bounds(3) == "lever or slider"
    assert rules["ramp_slope"].bounds(3) == "at most 0.05"
    assert rules["bed_far_side_space"].bounds(2) == "anything"
    assert rules["door_clear_width"].bounds(1) == "anything"


def test_nothing_of_the_kind_obeys_only_rules_without_bounds() -> None:
    rules = Rules(2)
    assert not rules["counter_knee_height"].allows(None, 2)
    assert rules["bed_far_side_space"].allows(None, 2)
    assert not rules["bed_far_side_space"].allows(None, 3)
    with pytest.raises(ConfigError, match="about a number"):
        rules["door_clear_width"].allows("wide", 3)


@pytest.mark.parametrize("level", LEVELS)
def test_each_level_passes_its_own_rules(homes: dict[int, CareHome], level: int) -> None:
    result = audit(homes[level])
    assert result.level == level == result.built_level
    assert [(f.rule, f.what, f.value) for f in result.failures] == []
    assert result.share == 1.0 and len(result.findings) > 50


def test_level_three_also_obeys_level_two(homes: dict[int, CareHome]) -> None:
    assert audit(homes[3], 2).broken == ()


def test_level_one_fails_most_of_level_three(homes: dict[int, CareHome]) -> None:
    result = audit(homes[1], 3)
    assert result.share < 0.5
    assert len(result.broken) > 3 * len(result.kept)
    assert len(audit(homes[2], 3).failures) < len(result.failures)


def test_nearly_every_rule_is_measured(homes: dict[int, CareHome]) -> None:
    expected = {
        "bathtub_rim_height", "platform_lift_clear_width",
        "seat_height", "switch_height", "table_height",
        "table_knee_height", "wardrobe_rail_height", "cupboard_handle",
    }  # fmt: skip
    assert set(audit(homes[3]).unmeasured) <= expected


def crate(x: float, y: float, wide: float, deep: float, *, room: str = "bedroom_1") -> Placed:
    """A box that stands about a place [m]."""
    size = (wide, deep, 0.5)
    shape = Shape(kind="box", material="wood", at=(0.0, 0.0, 0.25), size=size)
    look = Palette().materials()
    model = Model("crate", "a test", {"body": Link(visual=(shape,), collision=(shape,))}, "", look)
    area = Rectangle(-0.5 * wide, -0.5 * deep, 0.5 * wide, 0.5 * deep)
    return Placed(f"{room}.crate", Piece("crate", model, area, 0.5), room, at(x, y))


def with_crate(home: CareHome, x: float, y: float, *, of: str) -> CareHome:
    """Put a crate of 0.5 m at a share of the width and depth of a room."""
    inside = home.plan.rooms[of].inside
    box = crate(inside.x0 + x * inside.width, inside.y0 + y * inside.depth, 0.5, 0.5, room=of)
    return replace(home, placed=(*home.placed, box))


def moved(home: CareHome, name: str, dx: float, dy: float) -> CareHome:
    there = [
        replace(p, pose=Pose((dx, dy, 0.0)) @ p.pose) if p.name == name else p for p in home.placed
    ]
    return replace(home, placed=tuple(there))


def remade(home: CareHome, kind: str, **options: object) -> CareHome:
    there = [
        replace(p, piece=make_piece(kind, Setting(home.rules), options))
        if p.piece.kind == kind
        else p
        for p in home.placed
    ]
    return replace(home, placed=tuple(there))


def changed(home: CareHome, name: str, **fields: object) -> CareHome:
    opening = replace(home.plan.openings[name], **fields)  # type: ignore[arg-type]
    plan = replace(home.plan, openings={**home.plan.openings, name: opening})
    return replace(home, plan=plan)


def rebuilt(home: CareHome, kind: str, level: int) -> CareHome:
    """Put in a piece of a kind as another level has it."""
    made = make_piece(kind, Setting(Rules(level)))
    there = [replace(p, piece=made) if p.piece.kind == kind else p for p in home.placed]
    return replace(home, placed=tuple(there))


def narrow_hall(home: CareHome) -> CareHome:
    hall = home.plan.rooms["hall_1"]
    inside = Rectangle(hall.inside.x0, 0.2, hall.inside.x1, hall.inside.y1)
    rooms = {**home.plan.rooms, "hall_1": replace(hall, inside=inside)}
    x, _ = home.plan.openings["passage_1"].centre
    narrowed = replace(home, plan=replace(home.plan, rooms=rooms))
    return changed(narrowed, "passage_1", centre=(x, inside.centre[1]))


FAULTS: dict[str, tuple[Callable[[CareHome], CareHome], set[str]]] = {
    "narrow door": (lambda h: changed(h, "door_2", width=0.9), {"door_clear_width"}),
    "narrow bathroom door": (lambda h: changed(h, "door_1", width=0.9), {"bathroom_door_clear_width"}),
    "high threshold": (lambda h: changed(h, "door_3", threshold=0.02), {"door_threshold"}),
    "knob": (lambda h: changed(h, "entrance_1", hardware="knob"), {"door_hardware"}),
    "hinges on the other side": (
        lambda h: changed(h, "entrance_1", centre=(ENTRANCE_X, 0.6), hinge="high"),
        {"latch_side_space"},
    ),
    "narrow hall": (narrow_hall, {"hallway_width"}),
    "crate beside the bed": (lambda h: with_crate(h, 0.1, 0.7, of="bedroom_1"), {"bed_far_side_space"}),
    "crate to turn round": (
        lambda h: with_crate(h, 0.78, 0.51, of="bedroom_1"),
        {"turning_diameter"},
    ),
    "crate before the kitchen": (lambda h: with_crate(h, 0.2, 0.5, of="kitchen_1"), {"kitchen_aisle"}),
    "toilet off its wall": (
        lambda h: moved(h, "bathroom_1.toilet", 0.1, 0.0),
        {"toilet_centre_to_wall", "grab_bar_gap"},
    ),
    "basin beside the toilet": (lambda h: moved(h, "bathroom_1.washbasin", -0.9, 0.0), {"toilet_side_space"}),
    "no wall for a bar": (lambda h: remade(h, "toilet", wall="none"), {"grab_bar_side_length"}),
    "low toilet without bars": (
        lambda h: rebuilt(h, "toilet", 1),
        {"toilet_seat_height", "grab_bars"},
    ),
    "high bed": (lambda h: rebuilt(h, "bed", 1), {"bed_height"}),
    "basin over a cupboard": (
        lambda h: rebuilt(h, "washbasin", 1),
        {"basin_knee_height", "tap", "cupboard_handle"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_the_audit_finds_what_is_wrong_and_nothing_else(
    homes: dict[int, CareHome], fault: str
) -> None:
    spoil, expected = FAULTS[fault]
    assert set(audit(spoil(homes[3])).broken) == expected


def test_a_door_is_as_wide_as_what_stands_in_it_leaves(homes: dict[int, CareHome]) -> None:
    home = homes[3]
    x, y = home.plan.openings["door_2"].centre
    blocked = replace(home, placed=(*home.placed, crate(x, y, 0.2, 0.05)))
    widths = values(audit(blocked), "door_clear_width")
    assert min(w for w in widths if isinstance(w, float)) == pytest.approx(
        0.5 * (0.93 - 0.2), abs=1e-6
    )


def test_free_floor_is_measured_and_not_taken_from_the_piece(homes: dict[int, CareHome]) -> None:
    home = homes[3]
    bed = next(p for p in home.placed if p.piece.kind == "bed")
    area = bed.footprint
    (better,) = values(audit(home), "bed_side_space")
    inside = home.plan.rooms["bedroom_1"].inside
    assert better == pytest.approx(max(area.x0 - inside.x0, inside.x1 - area.x1))
    spoilt = with_crate(home, 0.1, 0.7, of="bedroom_1")
    (worse,) = values(audit(spoilt), "bed_far_side_space")
    assert worse == pytest.approx(area.x0 - (inside.x0 + 0.1 * inside.width + 0.25))


def test_the_toilet_is_measured_to_the_wall_and_its_bars_to_their_tops(
    homes: dict[int, CareHome],
) -> None:
    rules, result = Rules(3), audit(homes[3])
    assert values(result, "toilet_centre_to_wall") == [pytest.approx(0.455)]
    assert values(result, "grab_bars") == ["wall_and_fold_down"]
    assert values(result, "grab_bar_side_length") == [pytest.approx(1.07, abs=0.003)]
    assert values(result, "grab_bar_rear_length") == [pytest.approx(0.92, abs=0.003)]
    heights = values(result, "grab_bar_height")
    assert heights == [pytest.approx(rules.figure("grab_bar_height"), abs=0.003)] * 3
    assert values(result, "grab_bar_gap") == [pytest.approx(0.038, abs=0.001)] * 2


def test_a_bar_that_folds_is_measured_as_it_is_unfolded() -> None:
    bar = Shape(kind="capsule", radius=0.02, points=((0.0, 0.0, 0.0), (0.0, 0.0, 0.6)))
    hinge = Joint(
        "revolute", "wall", "arm", at=(0.1, 0.0, 0.8), axis=(0.0, 1.0, 0.0), upper=0.5 * math.pi
    )
    model = Model(
        "bar", "a test", {"wall": Link(), "arm": Link(collision=(bar,))}, joints={"fold": hinge}
    )
    (found,) = bars(model)
    assert found.folds and found.is_level and found.runs(0) and not found.runs(1)
    assert found.top == pytest.approx(0.82)
    assert found.length == pytest.approx(0.64)


def test_the_largest_circle_is_exact() -> None:
    area = Rectangle(0.0, 0.0, 2.0, 3.0)
    assert Ground(area, ()).circle[0] == pytest.approx(2.0, abs=1e-3)
    post = Rectangle(0.0, 0.0, 2.0, 1.513)
    assert Ground(area, (post,)).circle[0] == pytest.approx(1.487, abs=1e-3)
    # A circle in the corner of a square, touching the corner of a square in the other corner.
    square, block = Rectangle(0.0, 0.0, 2.0, 2.0), Rectangle(0.0, 0.0, 1.0, 1.0)
    expected = 2 * math.sqrt(2) / (1 + math.sqrt(2))
    assert Ground(square, (block,)).circle[0] == pytest.approx(expected, abs=2e-3)
    assert Ground(square, (square,)).circle[0] == 0.0


def test_ways_are_as_wide_as_their_narrowest_place(homes: dict[int, CareHome]) -> None:
    home = homes[3]
    hall = home.plan.rooms["hall_1"].inside
    depth = hall.depth - 0.7
    box = crate(hall.centre[0], 0.5 * depth, 0.4, depth, room="hall_1")
    spoilt = audit(replace(home, placed=(*home.placed, box)))
    (width,) = [
        f.value for f in spoilt.findings if f.rule == "passage_width" and f.room == "hall_1"
    ]
    assert width == pytest.approx(0.7, abs=0.015)
    assert spoilt.broken == ("passage_width",)


def test_strips_end_where_something_stands(homes: dict[int, CareHome]) -> None:
    home = homes[3]
    inside = home.plan.rooms["hall_1"].inside
    around = Surroundings(home, "hall_1", at(1.0, 0.5, 0.5 * math.pi))
    assert around.free(0.0, (-0.1, 0.1), along="x") == pytest.approx(inside.y1 - 0.5)
    assert around.free(0.0, (-0.1, 0.1), along="x", sign=-1) == pytest.approx(0.5)
    assert around.free(0.0, (-0.1, 0.1), along="y") == pytest.approx(1.0)
    assert around.free(inside.y1 - 0.45, (-0.1, 0.1), along="x") == 0.0  # within the wall


@pytest.mark.parametrize("level", LEVELS)
def test_taps_and_handles_are_told_by_their_shape(level: int) -> None:
    rules = Rules(level)
    setting = Setting(rules)
    for kind in ("kitchen_run", "washbasin"):
        assert tap_word(make_piece(kind, setting)) == rules.choice("tap"), kind
    for kind in ("kitchen_run", "wardrobe", "nightstand"):
        assert handle_word(make_piece(kind, setting)) == rules.choice("cupboard_handle"), kind
    assert tap_word(make_piece("bed", setting)) is None
    assert handle_word(make_piece("bed", setting)) is None


@pytest.mark.parametrize("level", LEVELS)
def test_doors_need_no_more_force_than_the_rules_say(level: int) -> None:
    rules = Rules(level)
    door = small_plan(rules).openings["door_2"]
    force = door_force(door_model(door, rules, Palette()))
    assert 1.0 < force <= rules.figure("hardware_force")
    assert rules["hardware_force"].allows(force, 3) == (level > 1)


@pytest.mark.parametrize(
    ("level", "way", "slope"), [(1, "steps", None), (2, "ramp", 1 / 12), (3, "ramp", 0.05)]
)
def test_the_way_to_the_entrance_is_measured(
    homes: dict[int, CareHome], level: int, way: str, slope: float | None
) -> None:
    rules, result = Rules(level), audit(homes[level])
    assert values(result, "entrance_way") == [way]
    assert values(result, "entrance_rise") == [pytest.approx(rules.figure("entrance_rise"))]
    if slope is None:
        assert values(result, "ramp_slope") == values(result, "ramp_width") == []
        return
    assert values(result, "ramp_slope") == [pytest.approx(slope, rel=1e-3)]
    assert values(result, "ramp_width") == [pytest.approx(rules.figure("ramp_width"))]


def test_a_yard_within_the_house_is_level(homes: dict[int, CareHome]) -> None:
    home = homes[3]
    (x, y), thick = home.plan.openings["entrance_1"].centre, INNER_WALL
    canvas = Canvas()
    build_entrance(canvas, home.plan.openings["entrance_1"], home.plan, home.rules)
    landing = next(s for s in canvas.solids if s.kind == "box" and s.rpy == (0.0, 0.0, 0.0))
    area = Rectangle(*(landing.at[k] - 0.5 * landing.size[k] for k in (0, 1)),
                     *(landing.at[k] + 0.5 * landing.size[k] for k in (0, 1)))  # fmt: skip
    assert area.has(x + thick, y) and not is_yard(landing, home.plan)
    around = (
        Rectangle(area.x0, area.y1, area.x1, area.y1 + 1),
        Rectangle(area.x0, area.y0 - 1, area.x1, area.y0),
        Rectangle(area.x1, area.y0 - 1, area.x1 + 1, area.y1 + 1),
    )
    closed = replace(home.plan, outline=(*home.plan.outline, *around))
    assert is_yard(landing, closed)
    assert not is_yard(landing, replace(closed, outline=closed.outline[:-1]))


def test_what_was_measured_elsewhere_counts(homes: dict[int, CareHome]) -> None:
    switch = Measurement("switch_height", "hall_1", "switch", 1.3)
    result = audit(homes[3], measured=[switch])
    assert result.broken == ("switch_height",) and "switch_height" not in result.unmeasured
    with pytest.raises(UnknownNameError, match="switch_height"):
        audit(homes[3], measured=[Measurement("switch_hight", "hall_1", "switch", 1.0)])
    with pytest.raises(ConfigError, match="level must be"):
        audit(homes[3], 4)


def test_the_table_shows_what_fails(homes: dict[int, CareHome]) -> None:
    out = StringIO()
    console = Console(width=140, file=out)
    result = audit(homes[1], 3)
    console.print(result.table())
    text = out.getvalue()
    for part in (
        "small, built at level 1",
        "Clear width of interior doors",
        "0.660 m",
        "at least 0.915 m",
    ):
        assert part in text
    assert "door_2, door_3" in text and len(result.table().columns) == 4
    assert audit(homes[3]).table().row_count == 0
