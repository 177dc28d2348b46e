"""A caregiver who walks, reaches, grasps a limb or a thing, and moves it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
import pytest
from py_trees.common import Status
from standing_person import CONTROL_DT, CONTROL_STEPS, person_in

from rcare_marl.agents.avatar import load_avatar, load_posture
from rcare_marl.agents.body.skeleton import (
    DOF_INDEX,
    JOINT_INDEX,
    JOINTS,
    SIDES,
)
from rcare_marl.agents.human import Human
from rcare_marl.agents.motion.caregiving import Caregiving, Do
from rcare_marl.agents.motion.clip import heading_of
from rcare_marl.agents.motion.playback import Puppet
from rcare_marl.agents.motion.walk import LEGS, STEP_LENGTH, Station, Walk, stations
from rcare_marl.envs.devices.wheelchair import Wheelchair
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import (
    Pose,
    quaternion_from_rpy,
)
from rcare_marl.world import World

Array = npt.NDArray[np.float64]
ARM = ("right_collar", "right_shoulder", "right_elbow", "right_wrist")


# Walking.


def walker() -> tuple[World, Human]:
    world = World()
    person = person_in(world, Pose((-0.8, 0.1, 0.0)), (*LEGS, "left_shoulder", "right_shoulder"))
    world.mark_start()
    return world, person


def walk_through(world: World, person: Human, walk: Walk) -> tuple[Array, dict[str, Array]]:
    """Walk; return the time of each physics step and the balls of both feet then [m]."""
    person.course = Puppet(person, walk.motion, lambda: world.time)
    joints, times = person.model.joints, []
    places: dict[str, list[Array]] = {side: [] for side in SIDES}
    while person.course is not None:
        person.actuate()
        times.append(world.time)
        world.step()
        for side in SIDES:
            ankle = person.joint_pose(f"{side}_ankle").matrix()
            ball = joints[JOINT_INDEX[f"{side}_foot"]] - joints[JOINT_INDEX[f"{side}_ankle"]]
            places[side].append((ankle @ np.append(ball, 1.0))[:3])
    return np.array(times), {side: np.array(rows) for side, rows in places.items()}


def test_a_walk_arrives_and_standing_feet_neither_slide_nor_sink() -> None:
    world, person = walker()
    walk = Walk(person, [(0.4, 0.1), (0.5, -0.7)], math.radians(-170))
    standing = person.body.base_pose().position[2]
    times, places = walk_through(world, person, walk)
    assert person.pelvis.position == pytest.approx((0.5, -0.7, standing), abs=1e-6)
    turn = math.remainder(heading_of(person.pelvis) - math.radians(-170), 2 * math.pi)
    assert turn == pytest.approx(0, abs=1e-6)
    for side, rows in places.items():
        stands = np.array([walk.stance(side, time) for time in times])
        edges = np.flatnonzero(np.diff(stands.astype(int))) + 1
        spans = np.split(np.arange(len(times)), edges)
        stances = [rows[span] for span in spans if stands[span[0]]]
        assert len(stances) > 3
        for stance in stances:
            assert np.linalg.norm(stance - stance[0], axis=1).max() < 0.01
        height = rows[0, 2]
        assert rows[:, 2].min() > height - 0.005  # never through the floor
        assert rows[:, 2].max() > height + 0.03  # and lifted between


def test_a_walk_ends_in_the_posture_that_it_began_with_and_moves_smoothly() -> None:
    _, person = walker()
    walk = Walk(person, [(0.6, 0.1)], 0.0)
    motion = walk.motion
    np.testing.assert_allclose(motion.angles[-1], motion.angles[0], atol=0.02)
    legs = [DOF_INDEX[dof] for dof in person.movable if "hip" in dof or "knee" in dof]
    speeds = np.abs(np.diff(motion.angles[:, legs], axis=0)) * motion.rate
    assert speeds.max() < 12  # [rad/s]: nothing jumps
    assert (np.abs(np.diff(motion.pelvis, axis=0)) * motion.rate).max() < 1.5  # [m/s]
    low, high = person.passive.T
    chosen = motion.angles[:, [DOF_INDEX[dof] for dof in person.movable]]
    assert (chosen > low - 0.02).all() and (chosen < high + 0.02).all()


def test_stations_are_no_more_than_a_step_apart() -> None:
    ways = stations(Station(0, 0, 0), [(1.0, 0.0), (1.0, 2.0)], math.pi)
    assert ways[-1].at(0, 0) == pytest.approx((1, 2)) and ways[-1].heading == pytest.approx(math.pi)
    for a, b in zip(ways, ways[1:], strict=False):
        assert math.hypot(b.x - a.x, b.y - a.y) <= STEP_LENGTH + 1e-9
        assert abs(b.heading - a.heading) <= math.radians(30) + 1e-9
    aside = stations(Station(0, 0, 0), [(0.0, 0.15)], 0.0)
    assert all(station.heading == 0 for station in aside)  # a short way needs no turn


def test_who_cannot_walk_is_a_named_error() -> None:
    world = World()
    stiff = person_in(world, Pose(), ("right_elbow",))
    with pytest.raises(ConfigError, match="left_hip_flexion"):
        Walk(stiff, [(1, 0)], 0.0)
    seated = Human("seated", load_avatar("karan"), posture=load_posture("wheelchair"), movable=LEGS)
    seated.spawn(World(), Pose((0, 0, 0.5)))
    with pytest.raises(ConfigError, match="does not stand"):
        Walk(seated, [(1, 0)], 0.0)
    _, person = walker()
    for points, heading in (([], 0.0), ([(math.nan, 0.0)], 0.0), ([(1.0, 0.0)], math.inf)):
        with pytest.raises(ConfigError, match="all finite"):
            Walk(person, points, heading)


# A caregiver's hands.


class Room:
    """Karan in his wheelchair, his left forearm free, and a caregiver two steps away."""

    def __init__(self) -> None:
        self.world = World()
        floor = self.world.add_box((6, 6, 0.1), Pose((0, 0, -0.05)), name="floor")
        chair = Wheelchair(mounts="none")
        posture = load_posture("wheelchair")
        held = tuple(joint for joint in JOINTS[1:] if not joint.startswith("left_"))
        self.karan = Human(
            "recipient",
            load_avatar("karan"),
            posture=dataclasses.replace(posture, supported=held),
            movable=("left_shoulder", "left_elbow"),
        )
        soles = self.karan.soles(chair.frame("seat_back"))
        chair.fit_footplates(soles["left"], soles["right"])
        chair.spawn(self.world)
        self.karan.use_arm_rests(
            chair.frame_in_world("armrest_left"), chair.frame_in_world("armrest_right")
        )
        self.karan.spawn(self.world, chair.frame_in_world("seat_back"))
        pose = Pose((1.0, 1.1, 0.0), tuple(quaternion_from_rpy(0, 0, math.radians(-140)).tolist()))
        self.helper = person_in(self.world, pose, (*LEGS, "spine1", "spine2", "spine3", *ARM))
        forearm = self.karan.frames[JOINT_INDEX["left_elbow"]].link
        rest = [link for link in range(-1, self.karan.body.link_count) if link != forearm]
        self.world.set_collision(self.karan.body, chair.body, False, links_a=rest)
        self.world.set_collision(self.helper.body, floor, False)
        self.caregiving = Caregiving(self.helper, self.world, CONTROL_DT, script=self.lift)
        self.caregiving.pass_through(self.karan, "left_elbow")
        self.world.mark_start()

    def forearm(self) -> Array:
        elbow, wrist = (
            np.array(self.karan.joint_pose(f"left_{joint}").position)
            for joint in ("elbow", "wrist")
        )
        return np.asarray(wrist + 0.12 * (elbow - wrist) + (0.0, 0.0, 0.045))

    def lift(self, do: Caregiving) -> None:
        do.walk_to(0.5, 0.68, math.radians(-140))
        do.reach(self.forearm, palm=(0, 0, -1), fingers=(-0.3, -1, 0))
        do.grasp(self.karan, "left_elbow")
        do.move_by((0.0, 0.0, 0.15), speed=0.25)
        do.move_by((0.0, 0.0, -0.15), speed=0.25)
        do.release()
        do.lower_arm()

    def episode(self, seconds: float = 25.0) -> Array:
        """Return joints, pelvis and hand after each control step, until all is done."""
        self.world.rewind()
        for person in (self.karan, self.helper):
            person.reset(np.random.default_rng(0))
        self.caregiving.reset(np.random.default_rng(0))
        rows = []
        for k in range(round(seconds / CONTROL_DT)):
            if k and self.caregiving.is_idle:
                break
            self.helper.command(self.caregiving.act(), CONTROL_DT)
            present = {dof: self.karan.angle(dof) for dof in self.karan.movable}
            self.karan.command(self.karan.action_towards(present, CONTROL_DT), CONTROL_DT)
            for _ in range(CONTROL_STEPS):
                self.karan.actuate()
                self.helper.actuate()
                self.world.step()
            self.karan.sense()
            self.helper.sense()
            rows.append(
                [*self.karan.positions, *self.helper.positions, *self.helper.pelvis.position,
                 *self.caregiving.hand(), self.karan.joint_pose("left_wrist").position[2],
                 float(self.caregiving.is_holding)]
            )  # fmt: skip
        return np.array(rows)


def test_a_caregiver_walks_up_lifts_an_arm_and_lays_it_back_bit_for_bit_the_same() -> None:
    room = Room()
    rows = room.episode()
    assert room.caregiving.trouble == "" and room.caregiving.is_idle
    wrist, holding = rows[:, -2], rows[:, -1]
    lies = wrist[holding == 1][0]
    assert wrist.max() > lies + 0.10  # the limb rises
    assert wrist[-1] == pytest.approx(lies, abs=0.02)  # and lies where it lay
    assert holding.any() and not room.caregiving.is_holding  # let go after
    assert 3 < room.caregiving.greatest_grip < 80  # [N], far below what a grasp can bear
    assert room.helper.pelvis.position[:2] == pytest.approx((0.5, 0.68), abs=1e-6)
    np.testing.assert_array_equal(room.episode(), rows)
    np.testing.assert_array_equal(Room().episode(), rows)


def test_an_episode_cut_short_in_the_middle_of_a_lift_leaves_no_trace() -> None:
    room = Room()
    first = room.episode(8.0)
    assert first[-1, -1] == 1  # still holding
    np.testing.assert_array_equal(room.episode(8.0), first)


def helper_alone() -> tuple[World, Human]:
    world = World()
    return world, person_in(world, Pose(), ("spine1", "spine2", "spine3", *ARM))


def do_all(world: World, caregiving: Caregiving, seconds: float = 8.0) -> None:
    person = caregiving.person
    for _ in range(round(seconds / CONTROL_DT)):
        person.command(caregiving.act(), CONTROL_DT)
        if caregiving.is_idle:
            break
        for _ in range(CONTROL_STEPS):
            person.actuate()
            world.step()


def test_a_thing_is_carried_to_a_place_and_let_go_there() -> None:
    world, person = helper_alone()
    caregiving = Caregiving(person, world, CONTROL_DT)
    caregiving.reset(np.random.default_rng(0))
    box = world.add_box((0.05, 0.05, 0.05), Pose((0.4, -0.25, 0.95)), mass=0.4, name="cup")
    table = world.add_box((0.3, 0.3, 0.02), Pose((0.4, -0.25, 0.915)), name="table")
    caregiving.pass_through(box)
    world.set_collision(person.body, table, False)
    caregiving.reach((0.4, -0.25, 1.0), palm=(0, 0, -1))
    caregiving.grasp(box)
    caregiving.move_to((0.35, 0.05, 1.15))
    do_all(world, caregiving)
    assert caregiving.trouble == "" and caregiving.is_holding
    assert math.dist(box.base_pose().position, caregiving.hand()) < 0.08
    assert caregiving.hand() == pytest.approx((0.35, 0.05, 1.15), abs=0.03)
    caregiving.release()
    caregiving.lower_arm()
    do_all(world, caregiving, 0.5)
    assert not caregiving.is_holding and box.base_pose().position[2] < 1.0  # it falls


def test_a_grasp_slips_where_more_is_asked_than_it_can_hold() -> None:
    world, person = helper_alone()
    caregiving = Caregiving(person, world, CONTROL_DT)
    caregiving.reset(np.random.default_rng(0))
    rail = world.add_box((0.05, 0.05, 0.05), Pose((0.4, -0.25, 0.95)), name="rail")
    caregiving.pass_through(rail)
    caregiving.reach((0.4, -0.25, 1.0), palm=(0, 0, -1))
    caregiving.grasp(rail, force=5.0)
    caregiving.move_by((0.0, 0.0, 0.3))
    do_all(world, caregiving)
    assert "slipped" in caregiving.trouble and not caregiving.is_holding
    assert caregiving.is_idle


def test_what_cannot_be_done_is_said_and_the_rest_is_dropped() -> None:
    world, person = helper_alone()
    far = world.add_box((0.05, 0.05, 0.05), Pose((2, 0, 1)), name="cup")
    caregiving = Caregiving(person, world, CONTROL_DT)
    caregiving.reset(np.random.default_rng(0))
    caregiving.grasp(far)
    caregiving.move_by((0, 0, 0.1))
    do_all(world, caregiving)
    assert "too far to grasp" in caregiving.trouble and caregiving.is_idle
    caregiving.reset(np.random.default_rng(0))
    intent: dict[str, float] = {}
    leaf = Do("reach", caregiving, intent, lambda do: do.reach((3.0, 0.0, 1.0)))
    for _ in range(150):
        leaf.tick_once()
        if leaf.status != Status.RUNNING:
            break
        person.command(person.action_towards(intent, CONTROL_DT), CONTROL_DT)
        for _ in range(CONTROL_STEPS):
            person.actuate()
            world.step()
    assert leaf.status == Status.FAILURE and "does not reach" in leaf.feedback_message


def test_the_leaf_succeeds_when_the_deeds_are_done() -> None:
    world, person = helper_alone()
    caregiving = Caregiving(person, world, CONTROL_DT)
    caregiving.reset(np.random.default_rng(0))
    intent: dict[str, float] = {}
    leaf = Do("reach", caregiving, intent, lambda do: do.reach((0.45, -0.2, 1.1)))
    for _ in range(80):
        leaf.tick_once()
        if leaf.status != Status.RUNNING:
            break
        person.command(person.action_towards(intent, CONTROL_DT), CONTROL_DT)
        for _ in range(CONTROL_STEPS):
            person.actuate()
            world.step()
    assert leaf.status == Status.SUCCESS
    assert caregiving.hand() == pytest.approx((0.45, -0.2, 1.1), abs=0.02)


def test_impossible_orders_are_named_errors() -> None:
    world, person = helper_alone()
    with pytest.raises(UnknownNameError, match="left, right"):
        Caregiving(person, world, CONTROL_DT, side="both")
    with pytest.raises(ConfigError, match="left arm"):
        Caregiving(person_in(World(), Pose(), ARM), world, CONTROL_DT, side="left")
    caregiving = Caregiving(person, world, CONTROL_DT)
    with pytest.raises(UnknownNameError, match="left_elbow"):
        caregiving.grasp(person, "left_elbo")
    with pytest.raises(ConfigError, match="force of a grasp"):
        caregiving.grasp(person, "left_elbow", force=0.0)
    with pytest.raises(ConfigError, match="3 finite numbers"):
        caregiving.reach((0.0, math.nan, 0.0))
    with pytest.raises(ConfigError, match="speed of a hand"):
        caregiving.reach((0.0, 0.0, 1.0), speed=0.0)


# What was built for all this in the world.


def test_a_bond_holds_a_limb_by_one_point_and_tells_its_load() -> None:
    world = World()
    hook = world.add_box((0.1, 0.1, 0.1), Pose((1, 0, 1.5)), name="hook")
    weight = world.add_box((0.1, 0.1, 0.1), Pose((1.1, 0, 1.2)), mass=2.0, name="weight")
    bond = world.attach(hook, "base", weight, pivot=(0.0, 0.0, -0.2))
    for _ in range(2000):
        world.step()
    assert math.dist(weight.base_pose().position, (1, 0, 1.3)) == pytest.approx(
        math.dist((1.1, 0, 1.2), (1, 0, 1.3)), abs=0.005
    )  # it swings about the pivot
    assert 0 < bond.load() < 60
    person = person_in(world, Pose(), ("left_shoulder", "left_elbow"))
    link = person.body.link_names[person.frames[JOINT_INDEX["left_elbow"]].link]
    held = world.add_box((0.02,) * 3, person.joint_pose("left_elbow"), name="hand", collides=False)
    tie = world.attach(held, "base", person.body, child_link=link, pivot=(0, 0, 0), force=60)
    x, y, z = held.base_pose().position
    for k in range(240):
        held.set_base(Pose((x + 0.0005 * k, y, z)))
        person.actuate()
        world.step()
    elbow = person.joint_pose("left_elbow").position
    assert elbow[0] > x + 0.03
    world.detach(tie)
    assert tie.load() == 0.0 and not tie.is_active
    with pytest.raises(UnknownNameError, match="link"):
        world.attach(held, "base", person.body, child_link="tentacle")
