"""Assistive devices: joints, brakes, ramps and thresholds, and people who rest in them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pybullet as bullet
import pytest

from rcare_marl.agents.avatar import load_avatar, load_posture
from rcare_marl.agents.human import Human
from rcare_marl.body import Body
from rcare_marl.envs.devices import (
    Device,
    HospitalBed,
    ManualWheelchair,
    PlatformLift,
    SlideBoard,
    TransferBench,
    device_kinds,
    make_device,
)
from rcare_marl.errors import ActionError, ConfigError, UnknownNameError, WorldError
from rcare_marl.pose import Array, Pose, quaternion_from_rpy
from rcare_marl.world import SOLVER_ITERATIONS, World

FAST = ("morgan", "kim")  # the heaviest and the lightest
AVATARS = ("morgan", "jose", "natalia", "daniel", "kim", "karan")
DEVICES: tuple[Callable[[], Device], ...] = (
    ManualWheelchair,
    HospitalBed,
    TransferBench,
    SlideBoard,
    PlatformLift,
)
HAND = 22.2  # [N], ADA 309.4
SECOND = 240  # physics steps
LEGS = ("left_hip_flexion", "right_hip_flexion", "left_knee_flexion", "right_knee_flexion")
DOCS = Path(__file__).resolve().parents[1] / "docs"


def floor(world: World, slope: float = 0.0) -> Pose:
    """Add a floor that rises against x by `slope` [rad], and return its frame at the origin."""
    turn = tuple(quaternion_from_rpy(0.0, slope, 0.0).tolist())
    at = (-0.05 * math.sin(slope), 0.0, -0.05 * math.cos(slope))
    world.add_box((16, 6, 0.1), Pose(at, turn), name="floor").set_friction([-1], lateral=0.8)
    return Pose((0.0, 0.0, 0.0), turn)


def place(body: Body) -> Array:
    return np.array(body.base_pose().position)


def heading(body: Body) -> float:
    forward = body.base_pose().matrix()[:3, 0]
    return math.atan2(forward[1], forward[0])


def run(world: World, seconds: float) -> None:
    for _ in range(round(seconds * SECOND)):
        world.step()


def seated(
    world: World, chair: ManualWheelchair, at: Pose = Pose(), avatar: str = "karan"
) -> Human:
    """Spawn a chair and, as one rigid body, somebody who sits in it."""
    person = Human(
        "person", load_avatar(avatar), posture=load_posture("wheelchair"), movable=(),
        fixed_base=False,
    )  # fmt: skip
    soles = person.soles(chair.frame("seat_back"))
    chair.fit_footplates(soles["left"], soles["right"])
    chair.spawn(world, at)
    person.spawn(world, chair.frame_in_world("seat_back"))
    chair.carry(person)
    return person


def push(chair: ManualWheelchair, force: float, down: float = 0.0) -> None:
    """Push the handles for one step as somebody who walks behind does, who leans on them with `down`."""
    ahead = chair.pose.matrix()[:3, 0]
    for side in ("left", "right"):
        both = 0.5 * force * ahead - (0.0, 0.0, 0.5 * down)
        chair.body.apply_force(-1, both, chair.frame_in_world(f"grip_{side}").position)


def depth(world: World, person: Human, device: Device) -> float:
    """Return how far a person's rigid shapes lie inside a device [m]."""
    return -world.separation(person.body, device.body, within=0.1)


# ---- what all have in common


@pytest.mark.parametrize("make", DEVICES)
def test_each_control_moves_its_joint_through_its_range(make: Callable[[], Device]) -> None:
    world, device = World(), make()
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
    for k, make in enumerate(DEVICES):
        at = Pose((0.0, 1.3 * (k - 2), 0.0))
        if make is SlideBoard:
            at = Pose((1.0, 0.0, 0.017))
        bodies.append(make().spawn(world, at))
    run(world, 0.5)
    before = [body.link_poses()[0] for body in bodies]
    run(world, 10.0)
    for body, old in zip(bodies, before, strict=True):
        moved = np.linalg.norm(body.link_poses()[0] - old, axis=1).max()
        assert moved < 1e-3, (body.name, moved)


@pytest.mark.parametrize("make", DEVICES)
def test_people_rest_where_postures_say(make: Callable[[], Device]) -> None:
    device = make()
    assert device.postures
    for posture, frame in device.postures.values():
        assert load_posture(posture).description
        assert device.frame(frame).position[2] >= 0.0


def test_the_eight_kinds_can_be_made_by_name_and_have_data_files() -> None:
    kinds = device_kinds()
    assert len(kinds) == len(set(kinds)) == 8
    for kind in kinds:
        device = make_device(kind)
        assert device.model().name == kind and device.model().source
        assert device.postures or kind == "platform_lift"
    with pytest.raises(UnknownNameError, match="Did you mean 'hospital_bed'"):
        make_device("hospitalbed")


@pytest.mark.parametrize("kind", device_kinds())
def test_devices_tell_newcomers_what_is_wrong(kind: str) -> None:
    device = make_device(kind)
    uses: list[Callable[[], object]] = [lambda: device.body, lambda: device.pose]
    uses += [partial(device.frame_in_world, name) for name in device.frames]
    for name in device.controls:
        uses += [partial(use, name) for use in (device.position, device.stop, device.limits)]
        uses.append(partial(device.command, name, 0.0))
    for use in uses:
        with pytest.raises(WorldError, match="spawn it first"):
            use()
    world = World()
    device.spawn(world)
    with pytest.raises(WorldError, match="spawned already"):
        device.spawn(world)
    with pytest.raises(UnknownNameError, match="no control named 'hight'"):
        device.command("hight", 0.1)
    for name in device.controls:
        low, high = device.limits(name)
        assert low < high
        for beyond in (low - 0.01, high + 0.01):
            for put in (device.command, device.set_position):
                with pytest.raises(ActionError, match=f"{name!r} of .* goes from"):
                    put(name, beyond)
        for wrong in (math.nan, math.inf, "up"):
            with pytest.raises(ActionError, match="finite number"):
                device.command(name, wrong)  # type: ignore[arg-type]
        device.set_position(name, high)
        device.stop(name)
        assert device.position(name) == pytest.approx(high, abs=1e-6)


def test_the_number_of_solver_iterations_is_the_worlds_own() -> None:
    def of_bullet(world: World) -> int:
        found = bullet.getPhysicsEngineParameters(physicsClientId=world.client)
        count: int = found["numSolverIterations"]
        return count

    world, chair = World(), ManualWheelchair()
    seated(world, chair)
    SlideBoard().spawn(world)
    assert (
        of_bullet(world) == world.solver_iterations == SOLVER_ITERATIONS
    )  # devices leave it alone
    world.set_solver_iterations(80)
    world.mark_start()
    world.set_solver_iterations(50)
    assert of_bullet(world) == world.solver_iterations == 50
    world.rewind()
    assert of_bullet(world) == world.solver_iterations == 80
    assert of_bullet(World(solver_iterations=150)) == 150
    for wrong in (0, -3, 1001, 2.5, True):
        with pytest.raises(ConfigError, match="whole number, 1 to 1000"):
            World(solver_iterations=wrong)  # type: ignore[arg-type]


def test_the_page_about_devices_runs_and_names_every_control() -> None:
    page = (DOCS / "devices.md").read_text(encoding="utf-8")
    assert "(devices.md)" in (DOCS / "index.md").read_text(encoding="utf-8")
    for kind in device_kinds():
        device = make_device(kind)
        for name in (kind, type(device).__name__, *device.controls):
            assert f"`{name}`" in page, name
    for image in re.findall(r"!\[.*?\]\((.*?)\)", page):
        assert (DOCS / image).stat().st_size < 500_000
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "devices.md", "exec"), names)


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
    axle = Pose((chair.config.wheel_axle, 0.0, 0.0))
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
    [(0.013, 80.0, 200.0, True), (0.05, 150.0, 300.0, False)],
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


def test_rests_of_the_wheelchair_carry_their_frames_away() -> None:
    world, chair = World(), ManualWheelchair()
    chair.spawn(world)
    for name in ("footrest_left", "footrest_right", "armrest_left", "armrest_right"):
        chair.set_position(name, chair.limits(name)[1])
    for side, sign in (("left", 1), ("right", -1)):
        plate = chair.frame_in_world(f"footplate_{side}").position
        assert sign * plate[1] > 0.35 and plate[0] < 0.3  # beside the seat
        assert chair.frame_in_world(f"armrest_{side}").position[0] < -0.2  # behind it


# ---- bed


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
    end = Pose((bed.config.sections[3], 0.0, 0.0))
    for _ in range(5):
        run(world, 2.5)
        foot = bed.body.link_pose(bed.body.link_index("calf")) @ end
        assert foot.position[2] == pytest.approx(bed.config.low, abs=0.01)


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


@pytest.mark.parametrize("knee", [0.0, 20.0])
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
    world, board, mass = World(), SlideBoard(), 75.0
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
    assert place(chair.body)[2] == pytest.approx(lift.config.thickness, abs=2e-3)
    lift.command("ramp", lift.limits("ramp")[1])
    run(world, 5.0)
    before = place(chair.body)
    lift.command("height", rise)
    run(world, rise / lift.config.speed + 1.0)
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
