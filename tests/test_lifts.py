"""Lifts: their joints reach, they roll and brake, and they carry everybody in a sling."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.envs.devices import CeilingLift, DryFriction, FloorLift
from rcare_marl.envs.devices.device import SLIP
from rcare_marl.errors import ActionError, ConfigError, UnknownNameError, WorldError
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.world import GRAVITY, World

Array = npt.NDArray[np.float64]
Lift = FloorLift | CeilingLift
FAST = ("kim", "morgan")  # light and heavy
AVATARS = ("caregiver", "daniel", "jose", "karan", "kim", "morgan", "natalia")
FLOOR_LIFTS = ("hoyer_lift_sling", "hoyer_lift_transfer")
LIFTS = (*FLOOR_LIFTS, "ceiling")
MOVABLE = (
    "left_hip",
    "right_hip",
    "left_knee",
    "right_knee",
    "neck",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
)


def floor_lift(name: str = FLOOR_LIFTS[0], pose: Pose = Pose()) -> tuple[World, FloorLift]:
    world, lift = World(), FloorLift(name)
    lift.spawn(world, pose)
    return world, lift


def ceiling_lift(*, span: float = 0.0, down: float = 0.0) -> tuple[World, CeilingLift]:
    world, lift = World(), CeilingLift(span=span)
    lift.spawn(world, Pose((0.0, 0.0, 2.5)))
    lift.set_position("lift", -down)
    return world, lift


def hung(
    world: World, lift: Lift, avatar: str = "kim", *, movable: tuple[str, ...] = MOVABLE
) -> Human:
    posture, frame = lift.postures["slung"]
    person = Human(
        avatar,
        load_avatar(avatar),
        posture=load_posture(posture),
        movable=movable,
        fixed_base=False,
    )
    person.spawn(world, lift.frame_in_world(frame))
    person.reset(np.random.default_rng(0))
    lift.carry(person)
    return person


def run(world: World, person: Human | None, seconds: float) -> Array:
    """Step, and return where the pelvis was after each step [m], shape [n, 3]."""
    track = []
    for _ in range(round(seconds / world.physics_dt)):
        if person is not None:
            person.actuate()
        world.step()
        if person is not None:
            track.append(person.body.base_pose().position)
    return np.array(track)


def place_in_sling(lift: Lift, person: Human) -> Array:
    inside = lift.frame_in_world("sling").inverse() @ person.body.base_pose()
    return np.array(inside.position)


@pytest.mark.parametrize("name", FLOOR_LIFTS)
def test_boom_and_legs_reach_their_limits(name: str) -> None:
    world, lift = floor_lift(name)
    for control, joint in (("boom", "boom"), ("legs", "leg_left")):
        limits = lift.body.joint(joint)
        for end in (limits.upper, limits.lower):
            lift.command(control, end)
            run(world, None, (limits.upper - limits.lower) / lift.controls[control].speed + 1)
            assert lift.position(control) == pytest.approx(end, abs=1e-3)


def test_bar_of_the_floor_lift_goes_from_bed_rails_to_overhead() -> None:
    _, lift = floor_lift()
    heights = []
    for end in (lift.body.joint("boom").lower, lift.body.joint("boom").upper):
        lift.set_position("boom", end)
        heights.append(lift.frame_in_world("bar").position[2])
    assert heights[0] < 0.62 and heights[1] > 1.75


@pytest.mark.parametrize("name", FLOOR_LIFTS)
def test_legs_spread_both_ways_to_the_widths_of_the_data(name: str) -> None:
    _, lift = floor_lift(name)
    legs = [lift.body.link_index(f"leg_{side}") for side in ("left", "right")]
    caster = lift.model.links["leg_left"].visual[1]
    tip, figure = caster.points[0][0], lift.model.figure
    for spread, width in ((0.0, figure("width_closed")), (1.0, figure("width_open"))):
        angle = spread * lift.body.joint("leg_left").upper
        lift.body.set_joints(lift.body.indices(("leg_left", "leg_right")), (angle, angle))
        left, right = (lift.body.link_pose(leg) @ Pose((tip, 0.0, 0.0)) for leg in legs)
        assert left.position[1] - right.position[1] + 0.05 == pytest.approx(width, abs=0.03)


def test_one_control_spreads_both_legs_alike() -> None:
    world, lift = floor_lift()
    lift.command("legs", 0.15)
    run(world, None, 4.0)
    angles = lift.body.joint_states(lift.body.indices(("leg_left", "leg_right")))[0]
    assert angles == pytest.approx([0.15, 0.15], abs=2e-3)


@pytest.mark.parametrize("name", FLOOR_LIFTS)
def test_floor_lift_weighs_what_its_data_say_and_clears_a_bed(name: str) -> None:
    world, lift = floor_lift(name)
    mass = {"hoyer_lift_sling": 40.0, "hoyer_lift_transfer": 29.0}[name]  # without the sling
    assert lift.body.mass() == pytest.approx(mass + lift.model.links["sling"].mass, abs=1e-3)
    tall = lift.model.figure("leg_height")
    assert tall <= 0.115
    bed = world.add_box((1.0, 2.0, 0.1), Pose((0.6, 0.0, tall + 0.055)))
    world.step()
    touched = {c.link_a for c in world.contacts(lift.body, bed) if c.distance < 0}
    assert not touched & {lift.body.link_index(f"leg_{s}") for s in ("left", "right")}


def test_pushed_lift_rolls_along_its_own_axes_and_stands_when_let_go() -> None:
    turn = tuple(quaternion_from_rpy(0, 0, math.pi / 2).tolist())
    world, lift = floor_lift(pose=Pose((1.0, 0.0, 0.0), turn))
    lift.push(0.4)
    run(world, None, 1.0)
    x, y, _ = lift.pose.position
    assert (x, y) == pytest.approx((1.0, 0.4), abs=0.03)
    lift.push(0.0)
    run(world, None, 1.5)
    at = lift.pose.position
    run(world, None, 2.0)
    assert lift.pose.position == pytest.approx(at, abs=1e-3)
    lift.push(0.0, 0.0, 0.5)
    run(world, None, 1.0)
    heading = lift.body.joint_states(lift.body.indices(("roll_turn",)))[0][0]
    assert heading == pytest.approx(0.5, abs=0.05)


def test_brakes_hold_against_a_shove_that_moves_a_free_lift() -> None:
    moved = []
    for braked in (True, False):
        world, lift = floor_lift()
        lift.brake(braked)
        assert lift.is_braked is braked
        lift.push(0.0)
        chassis = lift.body.link_index("chassis")
        for _ in range(240):
            lift.body.apply_force(chassis, (120.0, 0.0, 0.0), (0.0, 0.0, 0.2))
            world.step()
        moved.append(lift.pose.position[0])
    assert moved[0] < 1e-3 and moved[1] > 0.3


def test_braked_lift_is_not_pushed() -> None:
    world, lift = floor_lift()
    lift.brake(True)
    lift.push(0.5)
    run(world, None, 1.0)
    assert lift.pose.position[0] == pytest.approx(0.0, abs=1e-3)


def test_ceiling_lift_reaches_the_ends_of_strap_track_and_rails() -> None:
    world, lift = ceiling_lift(span=2.0)
    for control in ("traverse", "cross", "lift"):
        limits = lift.body.joint(lift.controls[control].joint)
        for end in (limits.upper, limits.lower):
            lift.command(control, end)
            reach = limits.upper - limits.lower
            run(world, None, reach / lift.controls[control].speed + 1)
            assert lift.position(control) == pytest.approx(end, abs=1e-3), control
    x, y, z = lift.frame_in_world("bar").position
    assert z == pytest.approx(2.5 - 0.445 - 1.75, abs=0.01)
    assert x < -1.2 and y < -0.9


def test_track_is_as_long_as_asked_for_and_solid() -> None:
    world, lift = World(), CeilingLift(track_length=4.0)
    lift.spawn(world, Pose((0.0, 0.0, 2.5)))
    ends = [lift.frame_in_world(f"track_{end}").position[0] for end in ("start", "end")]
    assert ends == pytest.approx([-2.0, 2.0])
    low, high = lift.body.bounds()
    assert high[0] - low[0] == pytest.approx(4.0, abs=0.05)
    assert "cross" not in lift.controls
    for name, sign in (("track_start", -1), ("track_end", 1)):
        short = CeilingLift(track_length=2.2)
        stops = [s.at[0] for s in short.model.links["track"].visual if s.at[0] * sign > 0]
        assert short.frame(name).position[0] == sign * 1.1
        assert stops == pytest.approx([sign * 1.085])


@pytest.mark.parametrize("make", LIFTS)
def test_empty_lift_stays_as_it_is_left(make: str) -> None:
    world, lift = ceiling_lift(down=0.5) if make == "ceiling" else floor_lift(make)
    run(world, None, 1.0)
    before = lift.body.link_poses()[0]
    run(world, None, 10.0)
    assert np.abs(lift.body.link_poses()[0] - before).max() < 1e-3


@pytest.mark.parametrize(
    ("make", "avatar"),
    [
        pytest.param(
            make, who, marks=() if who == FAST[k % 2] else pytest.mark.slow, id=f"{make}-{who}"
        )
        for k, make in enumerate(LIFTS)
        for who in AVATARS
    ],
)
def test_everybody_rises_with_the_bar_and_clear_of_the_lift(make: str, avatar: str) -> None:
    world, lift = ceiling_lift(down=1.0) if make == "ceiling" else floor_lift(make)
    person = hung(world, lift, avatar)
    world.step()
    assert not [c for c in world.contacts(person.body, lift.body) if c.distance < 0]
    inside, low = place_in_sling(lift, person), person.body.base_pose().position[2]
    control, target = ("lift", -0.58) if make == "ceiling" else ("boom", 0.45)
    lift.command(control, target)
    weight = GRAVITY * person.avatar.mass_kg
    for _ in range(20):
        run(world, person, 0.5)
        assert np.linalg.norm(place_in_sling(lift, person) - inside) < 0.02
        assert 0.5 * weight < lift.load() < 2 * weight
    assert person.body.base_pose().position[2] - low > 0.4
    assert world.contact_force(person.body, lift.body) == 0.0


@pytest.mark.parametrize(
    ("make", "avatar"),
    [
        pytest.param(make, who, marks=() if k % 2 == i else pytest.mark.slow)
        for k, make in enumerate(LIFTS)
        for i, who in enumerate(FAST)
    ],
)
def test_hanging_person_comes_to_rest(make: str, avatar: str) -> None:
    """After 5 s somebody hangs so still that they drift by less than half a millimetre in 10 s."""
    world, lift = ceiling_lift(down=1.0) if make == "ceiling" else floor_lift(make)
    if isinstance(lift, FloorLift):
        lift.brake(True)
    person = hung(world, lift, avatar, movable=())
    run(world, person, 5.0)
    track = run(world, person, 10.0)
    assert np.linalg.norm(np.ptp(track, axis=0)) < 0.5e-3
    assert lift.load() == pytest.approx(GRAVITY * person.avatar.mass_kg, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("make", LIFTS)
def test_hanging_person_with_limbs_that_move_comes_to_rest(make: str) -> None:
    world, lift = ceiling_lift(down=1.0) if make == "ceiling" else floor_lift(make)
    person = hung(world, lift, "morgan")
    run(world, person, 5.0)
    track = run(world, person, 10.0)
    assert np.linalg.norm(np.ptp(track, axis=0)) < 0.5e-3


def test_dry_friction_holds_up_to_its_force_and_where_it_slipped_to() -> None:
    world, lift = floor_lift()
    joint, chassis = lift.body.joint("roll_x").index, lift.body.link_index("chassis")
    friction = lift.model.figure("rolling_resistance") * GRAVITY * lift.model.mass

    def pushed(force: float) -> float:
        for _ in range(240):
            lift.body.apply_force(chassis, (force, 0.0, 0.0), (0.0, 0.0, 0.2))
            world.step()
        return lift.body.joint_states([joint])[0][0]

    assert abs(pushed(0.9 * friction)) < SLIP
    slipped = pushed(1.5 * friction)
    assert slipped > 0.02
    run(world, None, 2.0)
    rested = lift.body.joint_states([joint])[0][0]
    assert rested >= slipped  # it ran out, and was not pulled back
    run(world, None, 2.0)
    assert lift.body.joint_states([joint])[0][0] == pytest.approx(rested, abs=1e-6)


def test_dry_friction_is_rewound_with_its_world() -> None:
    world, lift = floor_lift()
    friction = next(matter for matter in world.matter if isinstance(matter, DryFriction))
    world.mark_start()
    friction.let_go(list(friction._places))
    world.rewind()
    run(world, None, 0.5)
    assert friction._places
    ways = []
    for _ in range(2):
        world.rewind()
        lift.reset()
        lift.push(0.3)
        run(world, None, 0.5)
        lift.push(0.0)
        run(world, None, 0.5)
        ways.append(lift.pose.position)
    assert ways[0] == ways[1] and ways[0][0] > 0.1


def test_person_is_lowered_onto_a_bed_and_left_there() -> None:
    world, lift = floor_lift()
    lift.set_position("boom", 0.4)
    person = hung(world, lift, "daniel")
    x, y, z = lift.frame_in_world("sling").position
    bed = world.add_box((2.2, 1.0, 0.2), Pose((x + 0.4, y, z - 0.45)), name="bed")
    lift.command("boom", lift.body.joint("boom").lower)
    run(world, person, 12.0)
    held = lift.position("boom")
    assert held > lift.body.joint("boom").lower + 0.1  # it stopped by itself
    weight = GRAVITY * person.avatar.mass_kg
    assert world.contact_force(person.body, bed) < 1.5 * weight
    lift.release()
    assert lift.person is None and lift.load() == 0.0
    lift.command("boom", 0.6)
    run(world, person, 4.0)
    assert z - 0.35 < person.body.base_pose().position[2] < z
    assert world.contact_force(person.body, bed) == pytest.approx(weight, rel=0.2)


def test_person_is_carried_across_a_room() -> None:
    world, lift = floor_lift()
    person = hung(world, lift)
    start, inside = person.body.base_pose().position[0], place_in_sling(lift, person)
    lift.push(-0.3)
    run(world, person, 3.0)
    lift.brake(True)
    run(world, person, 3.0)
    assert person.body.base_pose().position[0] - start == pytest.approx(-0.9, abs=0.15)
    assert np.linalg.norm(place_in_sling(lift, person) - inside) < 0.02


def test_fabric_lies_on_the_person_and_follows_them() -> None:
    world, lift = floor_lift()
    empty = lift.sling.vertices()
    person = hung(world, lift, "natalia", movable=())
    skin = next(s for s in world.skins if s.body is person.body).vertices()
    fabric = lift.sling.vertices()
    assert len(fabric) != len(empty) and lift.sling.faces.max() == len(fabric) - 1
    middle = fabric[:750].reshape(30, 25, 3)[3:-3, 10:15].reshape(-1, 3)
    gaps = [float(np.linalg.norm(skin - point, axis=1).min()) for point in middle]
    assert max(gaps) < 0.09 and np.median(gaps) < 0.04
    before = fabric - np.array(person.body.base_pose().position, np.float32)
    lift.command("boom", 0.2)
    run(world, person, 1.0)
    after = lift.sling.vertices() - np.array(person.body.base_pose().position, np.float32)
    assert np.abs(after - before)[:750].max() < 0.03
    lift.release()
    assert len(lift.sling.vertices()) == len(empty)


def test_hooks_carry_the_straps() -> None:
    _, lift = floor_lift()
    fabric = lift.sling.vertices()
    for name in lift.hooks:
        hook = np.array(lift.frame_in_world(name).position)
        assert np.linalg.norm(fabric - hook, axis=1).min() < 0.03


def test_frames_of_the_bar_move_with_it() -> None:
    _, lift = floor_lift()
    for name in lift.frames:
        assert lift.frame_in_world(name).position == pytest.approx(
            lift.frame(name).position, abs=1e-6
        )
    lift.set_position("boom", 0.3)
    assert lift.frame_in_world("sling").position[2] > lift.frame("sling").position[2] + 0.2
    assert lift.frame_in_world("mast").position == pytest.approx(lift.frame("mast").position)


def test_rewound_lift_hangs_empty_or_laden_as_it_was() -> None:
    world, lift = floor_lift()
    person = Human(
        "kim", load_avatar("kim"), posture=load_posture("sling"), movable=(), fixed_base=False
    )
    person.spawn(world, lift.frame_in_world("sling"))
    world.mark_start()
    lift.carry(person)
    run(world, person, 0.5)
    world.rewind()
    lift.reset()
    assert lift.person is None and lift.load() == 0.0
    lift.carry(person)
    run(world, person, 0.5)
    assert lift.load() > 0.5 * GRAVITY * 46


def test_lifts_refuse_what_they_cannot_do() -> None:
    world, lift = floor_lift()
    with pytest.raises(UnknownNameError, match="control"):
        lift.command("bom", 0.1)
    with pytest.raises(UnknownNameError, match="frame"):
        lift.frame_in_world("seat")
    with pytest.raises(ActionError, match="finite"):
        lift.push(math.nan)
    with pytest.raises(UnknownNameError, match="hoyer"):
        FloorLift("hoyer_lift")
    with pytest.raises(ConfigError, match="too short"):
        CeilingLift(track_length=0.3)
    with pytest.raises(ConfigError, match="span"):
        CeilingLift(span=0.2)
    held = Human("held", load_avatar("kim"), posture=load_posture("sling"), movable=())
    held.spawn(world, lift.frame_in_world("sling"))
    with pytest.raises(ConfigError, match="fixed_base=False"):
        lift.carry(held)


def test_lift_bears_one_person_within_its_load() -> None:
    world, lift = floor_lift()
    person = hung(world, lift)
    with pytest.raises(WorldError, match="hangs in the sling already"):
        lift.carry(person)
    lift.release()
    lift.release()  # does no harm
    lift.model = replace(lift.model, figures=lift.model.figures | {"load": 40.0})
    with pytest.raises(ConfigError, match="bears 40"):
        lift.carry(person)
