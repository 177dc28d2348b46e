"""Assistive devices: joints, brakes, ramps and thresholds, and people who rest in them."""

from __future__ import annotations

import math

import numpy as np
import pybullet as bullet
import pytest
from device_scene import HAND, SECOND, floor, heading, place, push, run, seated

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.envs.devices import (
    HospitalBed,
    ManualWheelchair,
    PlatformLift,
    TransferBench,
    make_device,
)
from rcare_marl.envs.devices.wheelchair import LOWEST_PLATE, PLATE_STEP, plates_under
from rcare_marl.errors import ActionError, ConfigError, UnknownNameError, WorldError
from rcare_marl.pose import Pose
from rcare_marl.world import SOLVER_ITERATIONS, World

DEVICES = ("manual_wheelchair", "hospital_bed", "transfer_bench", "slide_board", "platform_lift")


# ---- what all have in common


@pytest.mark.parametrize("kind", DEVICES)
def test_each_control_moves_its_joint_through_its_range(kind: str) -> None:
    world, device = World(), make_device(kind)
    floor(world)
    body = device.spawn(world)
    for end in ("upper", "lower"):
        goals, longest = {}, 0.0
        for name, control in device.controls.items():
            joint = body.joint(control.joint)
            longest = max(longest, (joint.upper - joint.lower) / control.speed + 1.5)
            goals[name] = getattr(joint, end)
            device.command(name, goals[name])
        run(world, longest)
        for name, goal in goals.items():
            assert device.position(name) == pytest.approx(goal, abs=2e-3), (name, end)


def test_nothing_drifts_by_a_millimetre_in_ten_seconds() -> None:
    world = World()
    floor(world)
    bodies = []
    for k, kind in enumerate(DEVICES):
        at = Pose((0.0, 1.3 * (k - 2), 0.0))
        if kind == "slide_board":
            at = Pose((1.0, 0.0, 0.017))
        bodies.append(make_device(kind).spawn(world, at))
    run(world, 0.5)
    before = [body.link_poses()[0] for body in bodies]
    run(world, 10.0)
    for body, old in zip(bodies, before, strict=True):
        moved = np.linalg.norm(body.link_poses()[0] - old, axis=1).max()
        assert moved < 1e-3, (body.name, moved)


@pytest.mark.parametrize("kind", DEVICES)
def test_people_rest_where_postures_say(kind: str) -> None:
    device = make_device(kind)
    assert device.postures
    for posture, frame in device.postures.values():
        assert load_posture(posture).description
        assert device.frame(frame).position[2] >= 0.0


def test_devices_refuse_what_they_cannot_be() -> None:
    world, bed, chair = World(), HospitalBed(), ManualWheelchair()
    bed.spawn(world)
    chair.spawn(world)
    with pytest.raises(UnknownNameError, match="backrest"):
        bed.command("backrst", 0.3)
    with pytest.raises(ActionError, match="finite"):
        chair.push(math.nan, 0.0)
    with pytest.raises(ConfigError, match="rises by 0 to"):
        PlatformLift(rise=2.0)
    with pytest.raises(ConfigError, match="legs reach"):
        TransferBench(seat_height=0.9)
    held = Human("held", load_avatar("kim"), posture=load_posture("wheelchair"), movable=())
    held.spawn(world, chair.frame_in_world("seat_back"))
    with pytest.raises(ConfigError, match="fixed_base=False"):
        chair.carry(held)
    with pytest.raises(ConfigError, match="must be movable"):
        bed.raise_with(held)


def test_a_chair_carries_one_person_and_lets_go() -> None:
    world, chair = World(), ManualWheelchair()
    floor(world)
    person = seated(world, chair)
    with pytest.raises(WorldError, match="release them first"):
        chair.carry(person)
    chair.release()
    chair.release()  # does no harm
    low = place(person.body)[2]
    run(world, 0.2)
    assert place(person.body)[2] < low - 0.1  # nothing bears them
    chair.carry(person)


def test_the_bench_asks_for_the_iterations_that_a_person_needs() -> None:
    world, bench = World(), TransferBench()
    person = Human(
        "person", load_avatar("kim"), posture=load_posture("bench"), movable=(), fixed_base=False
    )
    bench.spawn(world)
    person.spawn(world, bench.frame_in_world("seat_back"))
    with pytest.raises(WorldError, match=r"set_solver_iterations\(150\)"):
        bench.carry(person)
    assert world.solver_iterations == SOLVER_ITERATIONS


# ---- wheelchair


def test_the_wheelchair_has_the_width_and_weight_of_its_source() -> None:
    world, chair = World(), ManualWheelchair()
    body = chair.spawn(world)
    low, high = body.bounds()
    assert high[1] - low[1] == pytest.approx(0.66, abs=0.01)
    assert low[2] == pytest.approx(0.0, abs=5e-3)
    assert 16.0 <= body.mass() <= 18.0


@pytest.mark.parametrize("occupied", [False, True])
def test_the_wheelchair_rolls_straight(occupied: bool) -> None:
    world, chair = World(), ManualWheelchair()
    floor(world)
    if occupied:
        seated(world, chair)
    else:
        chair.spawn(world)
    run(world, 0.2)
    for speed in np.linspace(0.2, 3.0, 40):  # [rad/s]: nobody starts at once
        chair.roll(speed, speed)
        run(world, 0.025)
    run(world, 3.0)
    x, y, z = place(chair.body)
    assert x > 3.0
    assert abs(y) < 0.1 and abs(z) < 2e-3
    assert chair.travelled() == pytest.approx((x, x), rel=0.03)


def test_the_wheelchair_turns_on_the_spot() -> None:
    world, chair = World(), ManualWheelchair()
    floor(world)
    seated(world, chair)
    run(world, 0.2)
    axle = Pose((chair.model.joints["wheel_left"].at[0], 0.0, 0.0))
    before, last, turned = (chair.pose @ axle).position, heading(chair.body), 0.0
    chair.roll(-2.0, 2.0)
    while turned < 2 * math.pi and world.time < 6.0:
        world.step()
        now = heading(chair.body)
        turned += (now - last + math.pi) % (2 * math.pi) - math.pi
        last = now
    assert turned >= 2 * math.pi
    assert np.linalg.norm(np.subtract((chair.pose @ axle).position, before)) < 0.05


def test_an_occupied_wheelchair_stays_where_it_is_left_on_a_level_floor() -> None:
    world, chair = World(), ManualWheelchair()
    floor(world)
    seated(world, chair)
    run(world, 0.5)
    before = place(chair.body)
    run(world, 10.0)
    assert np.linalg.norm(place(chair.body) - before) < 1e-3


def test_the_wheelchair_loses_speed_as_rubber_on_a_hard_floor() -> None:
    world, chair = World(), ManualWheelchair()
    floor(world)
    seated(world, chair)
    chair.roll(3.0, 3.0)
    run(world, 2.5)
    chair.coast()
    before = chair.body.link_motion(-1)[1][0]
    run(world, 1.0)
    loss = before - chair.body.link_motion(-1)[1][0]
    assert 0.1 < loss < 0.25  # [m/s²]; 1 to 2.5 % of the weight


@pytest.mark.parametrize("way", [1, -1])
def test_brakes_hold_an_occupied_wheelchair_on_a_ramp(way: int) -> None:
    world, chair = World(), ManualWheelchair()
    on_ramp = floor(world, way * math.atan(1 / 12))
    seated(world, chair, on_ramp)
    chair.brake(True)
    run(world, 0.5)
    before = place(chair.body)
    run(world, 5.0)
    assert np.linalg.norm(place(chair.body) - before) < 1e-3
    chair.brake(False)
    run(world, 2.0)
    assert way * (place(chair.body)[0] - before[0]) > 0.5


@pytest.mark.parametrize(
    ("height", "force", "down", "crosses"),
    [(0.013, 80.0, 260.0, True), (0.05, 150.0, 300.0, False)],
)
def test_an_attendant_takes_the_wheelchair_over_a_low_threshold(
    height: float, force: float, down: float, crosses: bool
) -> None:
    """At walking speed, leaning on the handles at the threshold to take weight off the casters."""
    world, chair, ahead = World(), ManualWheelchair(), 0.9
    floor(world)
    seated(world, chair)
    sill = world.add_box((0.1, 3.0, height), Pose((ahead, 0.0, 0.5 * height)))
    sill.set_friction([-1], lateral=0.8)
    while place(chair.body)[0] < ahead + 0.8 and world.time < 5.0:
        at = place(chair.body)[0]
        lean = down if ahead - 0.4 < at < ahead - 0.15 else 0.0
        push(chair, force if chair.body.link_motion(-1)[1][0] < 0.8 else 0.0, lean)
        world.step()
    assert (place(chair.body)[0] > ahead + 0.7) == crosses


@pytest.mark.parametrize(
    ("rest", "ahead", "axis"), [("footrest", 0.0, (0, 0, 1)), ("armrest", 0.15, (0, -1, 0))]
)
def test_a_hand_swings_rests_of_the_wheelchair_away(
    rest: str, ahead: float, axis: tuple[int, int, int]
) -> None:
    world, chair = World(), ManualWheelchair()
    chair.spawn(world)
    floor(world)
    chair.brake(True)
    control, joint = f"{rest}_left", chair.body.joint(f"{rest}_left").index
    held = "footplate_left" if rest == "footrest" else control
    while chair.position(control) < 1.2 and world.time < 3.0:
        at = np.array((chair.frame_in_world(held) @ Pose((ahead, 0.0, 0.0))).position)
        pivot = chair.body.link_pose(joint)
        way = np.cross(pivot.matrix()[:3, :3] @ axis, at - pivot.position)
        chair.body.apply_force(joint, HAND * way / np.linalg.norm(way), at)
        world.step()
    assert chair.position(control) >= 1.2
    run(world, 0.5)
    stays = chair.position(control)
    assert stays >= 1.2
    run(world, 1.0)
    assert chair.position(control) == pytest.approx(stays, abs=1e-4)


def test_rests_of_the_wheelchair_carry_their_frames_away() -> None:
    world, chair = World(), ManualWheelchair()
    chair.spawn(world)
    for name in ("footrest_left", "footrest_right", "armrest_left", "armrest_right"):
        chair.set_position(name, chair.limits(name)[1])
    for side, sign in (("left", 1), ("right", -1)):
        plate = chair.frame_in_world(f"footplate_{side}").position
        assert sign * plate[1] > 0.35 and plate[0] < 0.3  # beside the seat
        assert chair.frame_in_world(f"armrest_{side}").position[0] < -0.2  # behind it


def test_a_foot_that_is_steps_higher_has_its_plate_so_much_higher() -> None:
    def plates(left: float, right: float) -> dict[str, tuple[float, ...]]:
        found = plates_under((0.5, 0.2, left), (0.6, -0.2, right))
        return {side: tuple(round(x, 6) for x in place) for side, place in found.items()}

    level = plates(0.20, 0.22)  # less than a step apart: both where the lower foot is
    assert level == {"left": (0.5, 0.2, 0.2), "right": (0.5, -0.2, 0.2)}
    assert plates(0.13, 0.22) == {"left": (0.5, 0.2, 0.13), "right": (0.6, -0.2, 0.205)}
    assert plates(0.12, 0.01)["right"] == (0.6, -0.2, LOWEST_PLATE)  # not on the floor
    assert plates(0.12, 0.01)["left"] == (0.5, 0.2, LOWEST_PLATE + 2 * PLATE_STEP)


# ---- bench, board, lift


def slide_seat(world: World, bench: TransferBench, end: float) -> None:
    """Push the handle of the seat by hand, at 0.3 m/s at most, until it has come to `end` [m]."""
    slide = bench.body.joint("slide").index
    position, started = bench.body.joint_states([slide])[0][0], world.time
    way = math.copysign(1.0, end - position)
    while way * (end - position) > 5e-3 and world.time < started + 5.0:
        handle = bench.frame_in_world("handle_slide").position
        if way * bench.body.joint_states([slide])[1][0] < 0.3:
            bench.body.apply_force(slide, (0.0, way * HAND, 0.0), handle)
        world.step()
        position = bench.body.joint_states([slide])[0][0]
    assert position == pytest.approx(end, abs=6e-3)


def test_a_hand_slides_the_seat_of_the_bench() -> None:
    world, bench = World(), TransferBench()
    floor(world)
    body = bench.spawn(world)
    for end in (0.4, 0.0):
        slide_seat(world, bench, end)
    run(world, 0.5)
    assert np.linalg.norm(place(body)[:2]) < 2e-3


def test_the_bench_stands_level_with_two_legs_in_the_tub() -> None:
    world, bench = World(solver_iterations=150), TransferBench(seat_height=0.52)
    floor(world)
    world.add_box((1.5, 0.6, 0.08), Pose((0.0, 0.4, 0.04)), name="tub")
    body = bench.spawn(world, Pose((0.0, 0.0, 0.0)))
    bench.stand(0.52, tub_floor=0.08)
    run(world, 0.5)
    load = world.add_box((0.3, 0.3, 0.2), Pose((0.0, -0.2, 0.621)), mass=90.0)
    run(world, 3.0)
    assert bench.frame_in_world("seat").position[2] == pytest.approx(0.52, abs=2e-3)
    assert body.base_pose().matrix()[2, 2] > 0.9999
    assert place(load)[2] == pytest.approx(0.62, abs=5e-3)


def test_the_bench_carries_a_person_to_the_tub() -> None:
    world, bench = World(solver_iterations=150), TransferBench()
    floor(world)
    person = Human(
        "person", load_avatar("daniel"), posture=load_posture("bench"), movable=(), fixed_base=False
    )
    soles = person.soles(bench.frame("seat_back"))
    bench.fit_legs(soles["left"], soles["right"])
    body = bench.spawn(world)
    person.spawn(world, bench.frame_in_world("seat_back"))
    bench.carry(person)
    run(world, 0.5)
    before, start = place(body), place(person.body)
    run(world, 5.0)
    assert np.linalg.norm(place(body) - before) < 1e-3
    slide_seat(world, bench, 0.4)
    assert place(person.body)[1] - start[1] > 0.38
    assert np.linalg.norm(place(body) - before) < 2e-3


def test_the_board_bridges_two_seats_and_somebody_slides_along_it() -> None:
    world, board, mass = World(), make_device("slide_board"), 75.0
    floor(world)
    for x in (-0.35, 0.35):
        world.add_box((0.4, 0.4, 0.5), Pose((x, 0.0, 0.25))).set_friction([-1], lateral=0.6)
    body = board.spawn(world, Pose((0.0, 0.0, 0.5165)))
    rider = world.add_box((0.25, 0.18, 0.2), Pose((-0.15, 0.0, 0.618)), mass=mass)
    rider.set_friction([-1], lateral=0.6)  # clothes
    run(world, 0.5)
    before, start = place(body), place(rider)
    run(world, 2.0)
    assert np.linalg.norm(place(rider) - start) < 1e-4
    for share, slides in ((0.08, False), (0.2, True)):  # of the weight
        for _ in range(SECOND):
            rider.apply_force(-1, (share * mass * 9.81, 0.0, 0.0), place(rider))
            world.step()
        assert (place(rider)[0] - start[0] > 0.2) == slides
    assert np.linalg.norm(place(body) - before) < 0.02
    assert place(body)[2] > 0.5


@pytest.mark.parametrize("rise", [0.3, pytest.param(1.2, marks=pytest.mark.slow)])
def test_the_lift_takes_an_occupied_wheelchair_up(rise: float) -> None:
    world, chair, lift = World(), ManualWheelchair(), PlatformLift(rise=rise)
    floor(world)
    lift.spawn(world)
    seated(world, chair, Pose((-1.7, 0.0, 0.0)))
    run(world, 0.2)
    while place(chair.body)[0] < -0.25 and world.time < 6.0:
        push(chair, 110.0 if chair.body.link_motion(-1)[1][0] < 0.6 else 0.0)
        world.step()
    chair.brake(True)
    run(world, 0.5)
    assert place(chair.body)[2] == pytest.approx(lift.model.figure("thickness"), abs=2e-3)
    lift.command("ramp", lift.limits("ramp")[1])
    run(world, 5.0)
    before = place(chair.body)
    lift.command("height", rise)
    run(world, rise / lift.controls["height"].speed + 1.0)
    assert lift.position("height") == pytest.approx(rise, abs=1e-3)
    assert np.linalg.norm(place(chair.body) - before - (0.0, 0.0, rise)) < 2e-3


def test_the_lift_is_wide_enough_for_a_wheelchair() -> None:
    world, lift = World(), PlatformLift(rise=0.3)
    lift.spawn(world)
    walls = [
        bullet.rayTest((0, 0, 0.5), (0, side, 0.5), physicsClientId=world.client)[0][3][1]
        for side in (1.0, -1.0)
    ]
    assert walls[0] - walls[1] >= 0.915  # ADA 410 and 305.3
