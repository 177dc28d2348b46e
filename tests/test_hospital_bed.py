"""The hospital bed, and people who lie in it while it bends."""

from __future__ import annotations

import math

import numpy as np
import pybullet as bullet
import pytest
from device_scene import AVATARS, FAST, LEGS, depth, place, run
from variants import few

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.envs.devices import HospitalBed, ManualWheelchair, TransferBench
from rcare_marl.pose import Pose
from rcare_marl.world import World


def test_the_bed_rises_as_far_as_its_source_says() -> None:
    world, bed = World(), HospitalBed()
    bed.spawn(world)
    for travel, height in ((0.0, 0.38), (0.45, 0.83)):
        bed.set_position("height", travel)
        hit = bullet.rayTest((1.0, 0, 2.0), (1.0, 0, 0.0), physicsClientId=world.client)[0]
        assert hit[3][2] == pytest.approx(height, abs=1e-3)
        assert bed.mattress_height() == pytest.approx(height, abs=1e-3)
        assert bed.frame_in_world("mattress").position[2] == pytest.approx(height, abs=1e-3)


def test_the_bed_lifts_a_heavy_person_and_holds_them() -> None:
    world, bed = World(), HospitalBed()
    bed.spawn(world)
    load = world.add_box((0.5, 0.4, 0.2), Pose((0.5, 0, 0.481)), mass=60.0)
    more = world.add_box((0.4, 0.4, 0.2), Pose((1.3, 0, 0.481)), mass=60.0)
    bed.command("height", 0.1)
    run(world, 4.0)
    assert bed.position("height") == pytest.approx(0.1, abs=1e-3)
    bed.command("backrest", 0.3)
    run(world, 7.0)
    assert bed.position("backrest") == pytest.approx(0.3, abs=5e-3)
    assert place(load)[2] > place(more)[2] + 0.05


def test_calves_of_the_bed_arrive_with_the_thighs() -> None:
    world, bed = World(), HospitalBed()
    bed.spawn(world)
    bed.command("knee", math.radians(35))
    end = Pose((bed.model.figure("calf"), 0.0, 0.0))
    for _ in range(5):
        run(world, 2.5)
        foot = bed.body.link_pose(bed.body.link_index("calf")) @ end
        assert foot.position[2] == pytest.approx(bed.model.figure("low"), abs=0.01)


@pytest.mark.parametrize(
    "avatar", [pytest.param(a, marks=() if a in FAST else pytest.mark.slow) for a in AVATARS]
)
def test_everybody_fits_chair_bench_and_bed(avatar: str) -> None:
    """Rigid shapes lie at most 100 mm inside cushions: they are plumper than the skin, which sinks 30."""
    person = Human("person", load_avatar(avatar), posture=load_posture("wheelchair"))
    world, chair = World(), ManualWheelchair()
    soles = person.soles(chair.frame("seat_back"))
    chair.fit_footplates(soles["left"], soles["right"])
    chair.spawn(world)
    pads = (chair.frame_in_world(f"armrest_{side}") for side in ("left", "right"))
    person.use_arm_rests(*pads)
    person.spawn(world, chair.frame_in_world("seat_back"))
    assert 0.0 < depth(world, person, chair) < 0.1

    person = Human("person", load_avatar(avatar), posture=load_posture("bench"))
    world, bench = World(), TransferBench()
    soles = person.soles(bench.frame("seat_back"))
    bench.fit_legs(soles["left"], soles["right"])
    bench.spawn(world)
    person.spawn(world, bench.frame_in_world("seat_back"))
    assert 0.0 < depth(world, person, bench) < 0.08
    assert 0.0 <= person.body.bounds()[0][2] < 0.05  # feet at the floor

    world, bed = World(), HospitalBed()
    bed.spawn(world)
    bed.set_position("backrest", math.radians(45))
    bed.set_position("knee", math.radians(20))
    who = load_avatar(avatar)
    person = Human("person", who, posture=bed.posture(who))
    person.spawn(world, bed.support(person))
    assert 0.0 < depth(world, person, bed) < 0.015
    low, high = person.body.bounds()
    assert low[0] > 0.1 and high[0] < 2.1 and abs(low[1]) < 0.5 and high[1] < 0.5


def test_a_person_rises_with_the_bed() -> None:
    world, bed = World(), HospitalBed()
    bed.spawn(world)
    who = load_avatar("natalia")
    person = Human("person", who, posture=bed.posture(who), movable=LEGS)
    person.spawn(world, bed.support(person))
    person.ignore(bed.body)
    bed.command("backrest", math.radians(60))
    bed.command("knee", math.radians(20))
    last = np.array(person.joint_pose("head").position)
    for _ in range(48):
        run(world, 0.5)
        bed.raise_with(person)
        now = np.array(person.joint_pose("head").position)
        assert np.linalg.norm(now - last) < 0.05  # no leaps
        last = now
    trunk = last - np.array(person.joint_pose("pelvis").position)
    assert math.degrees(math.atan2(trunk[2], -trunk[0])) == pytest.approx(60, abs=6)
    assert depth(world, person, bed) < 0.015
    feet = [person.joint_pose(f"{side}_ankle").position[2] for side in ("left", "right")]
    assert min(feet) > bed.mattress_height() - 0.02


@pytest.mark.parametrize("knee", few([0.0, 20.0], 20.0))
@pytest.mark.parametrize(
    "avatar", [pytest.param(a, marks=() if a in FAST else pytest.mark.slow) for a in AVATARS]
)
def test_nobody_sinks_into_the_bed_while_it_bends(avatar: str, knee: float) -> None:
    """From flat to 60 degrees nobody lies deeper than 15 mm in the bed, nor above it, nor leaps."""
    world, bed, who = World(), HospitalBed(), load_avatar(avatar)
    bed.spawn(world)
    bed.set_position("knee", math.radians(knee))
    person = Human("person", who, posture=bed.posture(who), movable=LEGS)
    person.spawn(world, bed.support(person))
    last = place(person.body)
    for angle in range(0, 61, 3):
        bed.set_position("backrest", math.radians(angle))
        bed.raise_with(person)
        assert 0.01 < depth(world, person, bed) < 0.015, angle
        assert np.linalg.norm(place(person.body) - last) < 0.03, angle
        last = place(person.body)
