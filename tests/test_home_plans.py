"""The sixteen floor plans at the three levels: rooms, walls, doors and windows."""

from __future__ import annotations

from collections import Counter
from functools import cache
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.envs.homes.layout import (
    HouseConfig,
    lay_out,
    load_house,
    reachable,
    use_of,
)
from rcare_marl.envs.homes.plan import JAMB, OUTSIDE, Opening, Plan
from rcare_marl.envs.homes.rule import Rules
from rcare_marl.envs.rectangle import Rectangle
from rcare_marl.errors import ConfigError, UnknownNameError

HOUSES = assets.names("homes")
# The counts of the RCareWorld paper.
COUNTS = {
    "kitchen": 17,
    "bedroom": 59,
    "bathroom": 70,
    "living": 17,
    "dining": 16,
    "lounge": 18,
    "other": 41,
}
EVERY = pytest.mark.parametrize("level", (1, 2, 3))


@cache
def plan_of(name: str, level: int) -> Plan:
    return lay_out(load_house(name), level)


def plans(level: int) -> list[Plan]:
    return [plan_of(name, level) for name in HOUSES]


def doors(plan: Plan) -> list[Opening]:
    return [opening for opening in plan.openings.values() if opening.kind != "window"]


def beside(opening: Opening, low: float, high: float) -> Rectangle:
    """The floor in line with an opening, from `low` to `high` along its wall [m]."""
    gap = opening.gap
    if opening.axis == "x":
        return Rectangle(low, gap.y0, high, gap.y1)
    return Rectangle(gap.x0, low, gap.x1, high)


def ends(area: Rectangle, axis: str) -> tuple[float, float]:
    return (area.x0, area.x1) if axis == "x" else (area.y0, area.y1)


def front(opening: Opening, *, into: int, depth: float) -> Rectangle:
    """The floor in front of an opening: of its first room where `into` is 1, its second where -1."""
    gap, (nx, ny) = opening.gap, opening.normal
    nx, ny = into * nx, into * ny
    if ny:
        y = gap.y1 if ny > 0 else gap.y0
        return Rectangle(gap.x0, min(y, y + ny * depth), gap.x1, max(y, y + ny * depth))
    x = gap.x1 if nx > 0 else gap.x0
    return Rectangle(min(x, x + nx * depth), gap.y0, max(x, x + nx * depth), gap.y1)


def sweep(opening: Opening) -> Rectangle:
    """The square that the leaf of a hinged door moves in."""
    leaf = opening.width - 2 * JAMB
    whole = front(opening, into=1, depth=leaf)
    low, high = ends(opening.gap, opening.axis)
    if opening.axis == "x":
        return Rectangle(low + JAMB, whole.y0, high - JAMB, whole.y1)
    return Rectangle(whole.x0, low + JAMB, whole.x1, high - JAMB)


def hinged(plan: Plan) -> list[Opening]:
    return [opening for opening in doors(plan) if opening.hardware in ("knob", "lever")]


@EVERY
def test_the_houses_have_as_many_rooms_of_each_kind_as_the_paper_says(level: int) -> None:
    assert len(HOUSES) == 16
    kinds = Counter(room.kind for plan in plans(level) for room in plan.rooms.values())
    assert kinds == COUNTS


@EVERY
def test_rooms_and_walls_fill_each_house_without_overlap(level: int) -> None:
    for plan in plans(level):
        pieces = [room.inside for room in plan.rooms.values()] + [w.area for w in plan.walls]
        for parts in (pieces, list(plan.outline)):
            box = np.array([(p.x0, p.y0, p.x1, p.y1) for p in parts])
            shared = np.minimum(box[:, None, 2:], box[None, :, 2:]) - np.maximum(
                box[:, None, :2], box[None, :, :2]
            )
            overlaps = (shared > 1e-6).all(axis=2)
            assert overlaps.sum() == len(parts), f"parts of {plan.name} overlap"
        covered = 0.0  # what the outline shares with the pieces
        for piece in pieces:
            for part in plan.outline:
                x = min(piece.x1, part.x1) - max(piece.x0, part.x0)
                y = min(piece.y1, part.y1) - max(piece.y0, part.y0)
                covered += max(x, 0) * max(y, 0)
        whole = sum(part.area for part in plan.outline)
        assert sum(piece.area for piece in pieces) == pytest.approx(whole, abs=1e-6)
        assert covered == pytest.approx(whole, abs=1e-6)


@EVERY
def test_each_opening_is_a_gap_in_one_wall_between_the_rooms_it_names(level: int) -> None:
    for plan in plans(level):
        for opening in plan.openings.values():
            walls = [w for w in plan.walls if w.area.contains(opening.gap, by=1e-6)]
            assert len(walls) == 1, f"{plan.name} {opening.name}"
            assert walls[0].axis == opening.axis
            assert walls[0].is_outer == (OUTSIDE in opening.rooms)
            across = ends(walls[0].area, "y" if opening.axis == "x" else "x")
            assert across[1] - across[0] == pytest.approx(opening.thickness)
            for name, into in zip(opening.rooms, (1, -1), strict=True):
                strip = front(opening, into=into, depth=0.05)
                if name != OUTSIDE:
                    assert plan.rooms[name].inside.contains(strip, by=1e-6)
                else:
                    assert not any(part.overlaps(strip, by=1e-6) for part in plan.outline)
        for a, b in combinations(plan.openings.values(), 2):
            assert not a.gap.grown(0.02).overlaps(b.gap), f"{plan.name} {a.name} {b.name}"


@EVERY
def test_each_leaf_swings_in_its_room_and_meets_no_other_door(level: int) -> None:
    for plan in plans(level):
        for door in hinged(plan):
            assert plan.rooms[door.rooms[0]].inside.contains(sweep(door), by=1e-6)
            assert door.kind == "entrance" or plan.rooms[door.rooms[0]].use != "hall"
            for other in doors(plan):
                if other is door:
                    continue
                for into in (1, -1):
                    assert not sweep(door).overlaps(front(other, into=into, depth=0.3))
        for a, b in combinations(hinged(plan), 2):
            assert not sweep(a).overlaps(sweep(b)), f"{plan.name}: {a.name} strikes {b.name}"


@EVERY
def test_there_is_free_wall_beside_the_latch(level: int) -> None:
    rules = Rules(level)
    for plan in plans(level):
        for door in hinged(plan):
            low, high = ends(plan.rooms[door.rooms[0]].inside, door.axis)
            start, end = ends(door.gap, door.axis)
            free = high - end if door.hinge == "low" else start - low
            assert rules["latch_side_space"].allows(free, level)
            assert free >= rules.figure("latch_side_space") - 1e-6


def test_sliding_panels_vanish_into_their_wall_beside_no_other_opening() -> None:
    count = 0
    for plan in plans(3):
        for door in (d for d in doors(plan) if d.hardware == "slider"):
            start, end = ends(door.gap, door.axis)
            reach = door.width + 0.05
            span = (start - reach, start) if door.hinge == "low" else (end, end + reach)
            pocket = beside(door, *span)
            assert sum(wall.area.contains(pocket, by=1e-6) for wall in plan.walls) == 1
            assert not any(o.gap.overlaps(pocket, by=1e-6) for o in plan.openings.values())
            count += 1
        assert not any(o.hardware == "slider" for o in doors(plan) if o.kind == "entrance")
    assert count > 150


@EVERY
def test_doors_have_the_width_hardware_and_threshold_of_their_level(level: int) -> None:
    rules = Rules(level)
    for plan in plans(level):
        for opening in doors(plan):
            uses = {plan.rooms[name].use for name in opening.rooms if name != OUTSIDE}
            if opening.kind == "passage":
                assert opening.clear_width >= max(rules.figure("passage_width"), 0.9) - 1e-6
                continue
            what = "bathroom_door" if "bathroom" in uses else "door"
            what = "entrance" if opening.kind == "entrance" else what
            assert opening.clear_width == pytest.approx(rules.figure(f"{what}_clear_width"))
            threshold = what.removesuffix("_door") + "_threshold"
            assert opening.threshold == rules.figure(threshold.replace("door_door", "door"))
            if opening.kind == "door":
                assert opening.hardware == rules.choice("door_hardware")


@EVERY
def test_windows_are_in_outer_walls_and_light_every_room_to_live_in(level: int) -> None:
    for plan in plans(level):
        lit = {o.rooms[0] for o in plan.openings.values() if o.kind == "window"}
        for window in (o for o in plan.openings.values() if o.kind == "window"):
            assert window.rooms[1] == OUTSIDE and 0 < window.sill < window.head
        for room in plan.rooms.values():
            if room.kind not in ("bathroom", "other"):
                assert room.name in lit, f"{room.name} of {plan.name} is dark"


@EVERY
def test_all_rooms_are_reached_and_none_through_somebody_elses_bedroom_or_bath(level: int) -> None:
    for plan in plans(level):
        assert reachable(plan) == set(plan.rooms)
        private = {r.name for r in plan.rooms.values() if r.kind in ("bedroom", "bathroom")}
        found = {o.rooms[0] for o in doors(plan) if o.kind == "entrance"}
        assert not found & private
        for _ in plan.rooms:
            found |= {
                name
                for o in doors(plan)
                if OUTSIDE not in o.rooms and (set(o.rooms) & found) - private
                for name in o.rooms
            }
        left = set(plan.rooms) - found  # baths of bedrooms only
        assert all(plan.rooms[name].kind == "bathroom" for name in left)
        for name in left:
            (door,) = [o for o in doors(plan) if name in o.rooms]
            other = next(room for room in door.rooms if room != name)
            assert plan.rooms[other].kind == "bedroom"


def test_level_3_is_reached_through_wide_ways_and_level_1_is_not() -> None:
    for name in HOUSES:
        wide = plan_of(name, 3)
        assert set(wide.required_rooms()) <= reachable(wide, clear_width=0.915)
        usual = plan_of(name, 1)
        assert len(reachable(usual, clear_width=0.815)) < len(usual.rooms)


@EVERY
def test_rooms_have_the_proportions_of_a_home(level: int) -> None:
    bounds = {  # usual areas [m²]; a barrier-free house is larger
        "bedroom": (9, 20),
        "bathroom": (3, 12.5),  # the assisted bathroom of house_04 is the largest
        "kitchen": (9, 20),
        "living": (18, 38),
        "dining": (10, 20),
        "lounge": (11, 21),
    }
    rules = Rules(level)
    more = (1.0, 1.2, 1.4)[level - 1]
    for plan in plans(level):
        for room in plan.rooms.values():
            short, long = sorted((room.inside.width, room.inside.depth))
            if room.use == "hall":
                assert short >= rules.figure("hallway_width") - 1e-6
                continue
            assert long <= 2.2 * short, f"{room.name} of {plan.name} is {short:.1f} x {long:.1f}"
            if room.kind in bounds:
                low, high = bounds[room.kind]
                assert low <= room.inside.area <= more * high, f"{plan.name} {room.name}"
                if level > 1:
                    assert short >= rules.figure("turning_diameter")


def test_a_house_grows_with_its_level_and_keeps_its_rooms() -> None:
    for name in HOUSES:
        one, two, three = (plan_of(name, level) for level in (1, 2, 3))
        areas = [sum(part.area for part in plan.outline) for plan in (one, two, three)]
        assert areas[0] < areas[1] < areas[2]
        assert list(one.rooms) == list(two.rooms) == list(three.rooms)


def test_required_rooms_are_all_but_the_others() -> None:
    plan = plan_of("house_01", 1)
    required = plan.required_rooms()
    assert "bedroom_4" in required and "hall_1" not in required
    assert len(required) == sum(room.kind != "other" for room in plan.rooms.values())


def test_the_same_house_is_drawn_the_same_every_time() -> None:
    assert lay_out(load_house("house_08"), 3) == lay_out(load_house("house_08"), 3)


def test_houses_differ_in_title_story_and_colours() -> None:
    houses = [load_house(name) for name in HOUSES]
    assert len({house.title for house in houses}) == len({h.story for h in houses}) == 16
    assert len({repr(house.colours()) for house in houses}) == 16
    assert load_house("house_01").finish("bathroom_1", 3) == "tile"


def small_house(**changes: Any) -> dict[str, Any]:
    house: dict[str, Any] = {
        "title": "Hut",
        "story": "Nobody lives here.",
        "plan": {
            "row": [
                {"room": "living_1", "size": [5, 4]},
                {"room": "bedroom_1", "size": [3, 4]},
                {"room": "bathroom_1", "size": [2, 4]},
            ]
        },
        "doors": [["living_1", "bedroom_1"], ["bedroom_1", "bathroom_1"]],
        "entrances": [["living_1", "south"]],
    }
    return {**house, **changes}


def test_a_small_house_is_laid_out() -> None:
    plan = lay_out(load(HouseConfig, small_house()), 2)
    assert [room.use for room in plan.rooms.values()] == ["living", "bedroom", "bathroom"]
    assert plan.openings["door_2"].rooms == ("bathroom_1", "bedroom_1")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"doors": [["living_1", "bedrom_1"]]}, "Did you mean 'bedroom_1'"),
        ({"passages": [["living_1", "attic_1"]]}, "no room of the house named 'attic_1'"),
        ({"entrances": [["living_1", "up"]]}, "no side of a room named 'up'"),
        ({"entrances": []}, "at least one entrance"),
        ({"palette": {"sky": [0, 0, 1, 1]}}, "no colour named 'sky'"),
        ({"palette": {"wall": [0, 0, 2, 1]}}, "within 0 and 1"),
        ({"floors": {"bedroom": "lava"}}, "no floor named 'lava'"),
        ({"windows": {"cellar_1": ["north"]}}, "no room of the house named 'cellar_1'"),
        ({"plan": {"room": "living_1"}}, "a room has a size"),
        ({"plan": {"row": [{"room": "living_1", "size": [5, 4]}]}}, "at least two parts"),
        ({"plan": {"room": "living_1", "size": [5, 400]}}, "within 0.5 and 30 m"),
        ({"roof": "flat"}, "no field of HouseConfig"),
    ],
)
def test_a_wrong_description_is_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError)) as caught:
        load(HouseConfig, small_house(**changes))
    assert message in str(caught.value)


@pytest.mark.parametrize("name", ["living_1", "cave_1", "kitchen"])
def test_rooms_have_names_of_their_own_and_of_a_known_use(name: str) -> None:
    parts = [{"room": "living_1", "size": [5, 4]}, {"room": name, "size": [3, 4]}]
    with pytest.raises((ConfigError, UnknownNameError)):
        load(HouseConfig, small_house(plan={"row": parts}, doors=[]))
    assert use_of("hall_12") == "hall"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"doors": [["living_1", "bathroom_1"]]}, "living_1 and bathroom_1 do not touch"),
        ({"doors": [["living_1", "bedroom_1"]]}, "no way from the entrance to bathroom_1"),
        ({"entrances": [["bedroom_1", "east"]]}, "bedroom_1 has no outer wall in the east"),
        ({"windows": {"bedroom_1": []}}, "bedroom_1 has no outer wall for a window"),
    ],
)
def test_a_house_that_cannot_be_built_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        lay_out(load(HouseConfig, small_house(**changes)), 1)


def test_a_door_that_finds_no_room_is_named() -> None:
    rooms = [{"room": "kitchen_1", "size": [3, 0.6]}, {"room": "bathroom_1", "size": [2, 4]}]
    parts = {"row": [{"room": "living_1", "size": [5, 5]}, {"column": rooms}]}
    many = [["living_1", "bathroom_1"]] * 4
    with pytest.raises(
        ConfigError, match="in each other's way at level 3.*living_1 and bathroom_1"
    ):
        lay_out(load(HouseConfig, small_house(plan=parts, doors=many)), 3)


def test_a_room_has_the_floor_that_its_house_says() -> None:
    usual, level = load_house("house_02"), 1
    assert not usual.floors
    house = load_house("house_05")
    for name, room in lay_out(house, level).rooms.items():
        if room.use in house.floors:
            assert room.finish == house.floors[room.use], name
    assert {room.use: room.finish for room in lay_out(usual, 1).rooms.values()}[
        "bedroom"
    ] == "carpet"
    assert {room.finish for room in lay_out(usual, 3).rooms.values()} <= {"wood", "tile"}
