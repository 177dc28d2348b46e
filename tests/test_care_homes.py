"""Furnished houses: what stands where, who gets where, and houses in worlds."""

from __future__ import annotations

import math
from collections import Counter

import pytest
from house_levels import ALL, EACH, built
from test_home_plans import COUNTS

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.envs.homes.care_home import CareHome, home_names
from rcare_marl.envs.homes.doorway import doorway
from rcare_marl.envs.homes.recipe import recipe_for
from rcare_marl.envs.rectangle import Rectangle
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose
from rcare_marl.world import World

PUSHED_UNDER = {("chair", "dining_table"), ("chair", "round_table"), ("office_chair", "desk")}

SHOULDERS = 0.5  # [m] wide, with arms; from memory
STRIDE = 0.6  # [m] before and behind a door


@pytest.mark.slow  # builds all; their plans are counted in test_home_plans.py
@pytest.mark.parametrize("level", [1, 2, 3])
def test_the_houses_have_the_rooms_of_the_paper(level: int) -> None:
    assert len(home_names()) == 16
    kinds = Counter(room.kind for name in home_names() for room in built(name, level).rooms())
    assert kinds == COUNTS


@pytest.mark.parametrize(("name", "level"), ALL)
def test_furniture_stands_in_its_room_and_in_nothing_else(name: str, level: int) -> None:
    home = built(name, level)
    for room in home.rooms():
        standing = [p for p in home.furniture(room.name) if p.piece.blocks]
        for i, placed in enumerate(standing):
            assert room.inside.contains(placed.footprint, by=1e-4), placed.name
            for other in standing[:i]:
                if (placed.piece.kind, other.piece.kind) in PUSHED_UNDER:
                    continue
                assert not placed.footprint.overlaps(other.footprint, by=1e-4), (
                    placed.name,
                    other.name,
                )


@pytest.mark.parametrize(("name", "level"), ALL)
def test_every_door_is_walked_through(name: str, level: int) -> None:
    home = built(name, level)
    way = home.way(SHOULDERS)
    openings = [o for o in home.plan.openings.values() if o.kind != "window"]
    entrance = next(o for o in openings if o.kind == "entrance")
    walked = way.regions_in(home.room(entrance.rooms[0]).inside) & way.regions_in(entrance.gap)
    assert len(walked) == 1
    for opening in openings:
        half, deep = 0.5 * opening.width, 0.5 * opening.thickness
        for low, high in ((-deep - STRIDE, -deep), (-deep, deep), (deep, deep + STRIDE)):
            step = Rectangle(-half, low, half, high).moved(opening.pose)
            assert walked <= way.regions_in(step), (opening.name, low)


@pytest.mark.parametrize(("name", "level"), ALL)
def test_doors_open_without_striking_furniture(name: str, level: int) -> None:
    home = built(name, level)
    for opening in home.plan.openings.values():
        if opening.kind == "window":
            continue
        for room in opening.rooms:
            if room not in home.plan.rooms:
                continue
            for area in doorway(opening, room, home.rules):
                for placed in home.furniture(room):
                    is_there = placed.footprint.overlaps(area, by=1e-4)
                    assert not (placed.piece.blocks and is_there), (opening.name, placed.name)


@pytest.mark.parametrize(("name", "level"), ALL)
def test_rooms_have_what_they_are_for(name: str, level: int) -> None:
    home = built(name, level)
    for room in home.rooms():
        kinds = {placed.piece.kind for placed in home.furniture(room.name)}
        for entry, _ in recipe_for(room.use).wanted(room, level):
            assert not entry.required or entry.piece in kinds, (room.name, entry.piece)


@EACH
def test_a_wheelchair_reaches_every_required_room_at_level_3_and_fewer_at_level_1(
    name: str,
) -> None:
    usual, free = built(name, 1), built(name, 3)
    assert set(free.required_rooms()) <= set(free.reached())
    assert len(set(usual.required_rooms()) & set(usual.reached())) < len(usual.required_rooms())


def test_a_home_is_the_same_each_time() -> None:
    again = CareHome.load("house_01", level=2)
    assert repr(again.placed) == repr(built("house_01", 2).placed)


def test_unknown_houses_rooms_and_places_are_named() -> None:
    home = built("house_01", 1)
    with pytest.raises(UnknownNameError, match="house_01"):
        CareHome.load("house_1")
    with pytest.raises(ConfigError, match="level must be 1"):
        CareHome.load("house_01", level=4)
    with pytest.raises(UnknownNameError, match="kitchen"):
        home.rooms("kitchn")
    with pytest.raises(UnknownNameError, match="bedroom_1"):
        home.route("bedrom_1", "kitchen_1")
    with pytest.raises(UnknownNameError, match="beside_bed"):
        home.spot("bedroom_1", "beside_bd")


def test_a_person_is_placed_beside_the_bed_on_free_floor() -> None:
    home = built("house_01", 3)
    world = World()
    person = Human("caregiver", load_avatar("caregiver"), posture=load_posture("standing"))
    person.spawn(world, Pose())
    height = person.body.base_pose().position[2]
    pose = home.place(person, "bedroom_1", "beside_bed")
    x, y, z = person.body.base_pose().position
    assert (x, y) == pytest.approx(pose.position[:2], abs=0.02)
    assert z == pytest.approx(height, abs=0.01)
    assert home.clearance.clearance(x, y) > 0.2
    world.close()


def test_people_look_where_their_place_says_and_lie_with_the_head_at_the_headboard() -> None:
    home = built("house_01", 3)
    world = World()
    for posture, spot, axis, along in (
        ("standing", "beside_bed", 2, 1.0),  # the z axis of a pelvis points ahead
        ("bed_supine", "bed_mattress", 1, -1.0),  # and y to the head; x of a bed to its foot
    ):
        person = Human(posture, load_avatar("caregiver"), posture=load_posture(posture), movable=())
        person.spawn(world, Pose((0, 0, 0), (0, 0, 0.6, 0.8)))
        pose = home.place(person, "bedroom_1", spot)
        pelvis = person.body.base_pose().matrix()[:3, axis]
        assert pelvis @ pose.matrix()[:3, 0] == pytest.approx(along, abs=0.02)
    world.close()


@EACH
def test_a_barrier_free_house_has_a_hospital_bed_that_tasks_find_as_a_bed(name: str) -> None:
    home = built(name, 3)
    (bed,) = [p for p in home.placed if p.piece.kind == "hospital_bed"]
    assert not any(p.piece.kind == "bed" for p in home.furniture(bed.room))
    spots = home.spots(bed.room)
    assert {"beside_bed", "beside_bed_2", "bed_mattress", "bed_pillow"} <= set(spots)
    for side in ("beside_bed", "beside_bed_2"):
        x, y, _ = spots[side].pose.position
        assert home.clearance.clearance(x, y) > 0.4
    assert not any(p.piece.kind == "hospital_bed" for p in built(name, 1).placed)


@pytest.mark.parametrize(("name", "level"), ALL)
def test_each_room_has_a_light_switch_at_a_door_with_nothing_before_it(
    name: str, level: int
) -> None:
    home = built(name, level)
    for room in home.rooms():
        (switch,) = [p for p in home.furniture(room.name) if p.piece.kind == "light_switch"]
        x, y, z = switch.frame("rocker").position
        assert z == pytest.approx(home.rules.figure("switch_height"))
        assert room.inside.has(x, y)
        ways = [o for o in home.plan.openings_of(room.name) if o.kind != "window"]
        assert min(math.dist((x, y), o.centre) - 0.5 * o.width for o in ways) < 1.0
        for placed in home.furniture(room.name):
            is_before = placed.footprint.overlaps(switch.footprint)
            assert placed is switch or not is_before or placed.piece.height < z, placed.name


@pytest.mark.parametrize(("name", "level"), ALL)
def test_toilets_stand_at_the_wall_that_their_bars_hang_on(name: str, level: int) -> None:
    home = built(name, level)
    for placed in (p for p in home.placed if p.piece.kind == "toilet"):
        inside = home.plan.room(placed.room).inside.moved(placed.pose.inverse())
        own = placed.piece.footprint
        gap = inside.y1 - own.y1 if own.y1 > -own.y0 else own.y0 - inside.y0
        assert gap == pytest.approx(0.005, abs=1e-6), placed.name
