"""A caregiver who walks, reaches, grasps a limb or a thing, and moves it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
import pytest
from py_trees.common import Status
from scipy.optimize import brentq  # type: ignore[import-untyped]
from standing_person import CONTROL_DT, CONTROL_STEPS, person_in
from variants import few

from rcare_marl.agents.people.actuation.drive import ActuationConfig
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, JOINT_INDEX, JOINTS
from rcare_marl.agents.people.hand import GRIP_GAP
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.motion.caregiving import Caregiving, Do
from rcare_marl.agents.people.motion.clip import heading_of
from rcare_marl.agents.people.motion.gait import LEGS, STEP_LENGTH
from rcare_marl.envs.devices import Wheelchair
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import (
    Pose,
    quaternion_from_rpy,
)
from rcare_marl.world import World

Array = npt.NDArray[np.float64]
ARM = ("right_collar", "right_shoulder", "right_elbow", "right_wrist")


# Walking and kneeling, by actions alone.


def walker(*moves: str) -> tuple[World, Human]:
    world = World()
    joints = (*LEGS, "left_shoulder", "right_shoulder")
    person = person_in(world, Pose((-0.8, 0.1, 0.0)), joints, moves=moves or ("walk",))
    world.mark_start()
    return world, person


def ball(person: Human, side: str) -> Array:
    """Where the ball of a foot is in the world [m]."""
    joints, ankle = person.model.joints, person.joint_pose(f"{side}_ankle").matrix()
    way = joints[JOINT_INDEX[f"{side}_foot"]] - joints[JOINT_INDEX[f"{side}_ankle"]]
    return np.asarray((ankle @ np.append(way, 1.0))[:3])


def do_action(world: World, person: Human, **moves: tuple[float, ...]) -> list[tuple[Array, Array]]:
    """Send an action for a control step; return where the balls of both feet were [m]."""
    action = np.zeros(person.action_size)
    for move, values in moves.items():
        action[person.entries[move]] = values
    person.command(action, CONTROL_DT)
    rows = []
    for _ in range(CONTROL_STEPS):
        person.actuate()
        world.step()
        rows.append((ball(person, "left"), ball(person, "right")))
    person.sense()
    return rows


def walked(
    world: World, person: Human, shares: tuple[float, float, float], steps: int
) -> tuple[Array, Array]:
    """Walk so many control steps, and on until both feet stand; return the balls of the feet [m]."""
    rows = []
    for k in range(100):
        if k >= steps and person.legs is not None and person.legs.stands:
            break
        rows += do_action(world, person, walk=shares if k < steps else (0.0, 0.0, 0.0))
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


SLID = 0.005  # [m] that a foot may slide while it stands


def assert_feet_stand(*feet: Array) -> None:
    """Assert that at each time one foot is where it stands, and that none sinks into the floor."""
    still = []
    for rows in feet:
        low = rows[:, 2] < rows[0, 2] + 0.006
        assert rows[:, 2].min() > rows[0, 2] - 0.005
        edges = np.flatnonzero(np.diff(low.astype(int))) + 1
        for span in np.split(np.arange(len(rows)), edges):
            if low[span[0]] and len(span) > 48:  # a stance: else it lifts off or comes down
                middle = span[24:-24]
                moved = np.linalg.norm(rows[middle] - rows[middle[0]], axis=1).max()
                assert moved < SLID
                still.append(moved)
        assert rows[:, 2].max() > rows[0, 2] + 0.03  # and it is lifted between
    assert len(still) > 1


@pytest.mark.parametrize(
    ("shares", "steps", "way"),
    [
        ((1.0, 0.0, 0.0), 18, (1.35, 0.0, 0.0)),
        pytest.param((-0.5, 0.0, 0.0), 12, (-0.45, 0.0, 0.0), marks=pytest.mark.slow),
        ((0.0, 1.0, 0.0), 12, (0.0, 0.2, 0.0)),
        pytest.param((0.0, -1.0, 0.0), 24, (0.0, -0.4, 0.0), marks=pytest.mark.slow),
        pytest.param((0.0, 0.0, 1.0), 24, (0.0, 0.0, 120.0), marks=pytest.mark.slow),
        ((0.0, 0.0, -0.5), 12, (0.0, 0.0, -30.0)),
    ],
)
def test_walking_by_actions_goes_where_told_and_standing_feet_do_not_slide(
    shares: tuple[float, float, float], steps: int, way: tuple[float, float, float]
) -> None:
    world, person = walker()
    x, y, standing = person.pelvis.position
    feet = walked(world, person, shares, steps)
    assert person.pelvis.position == pytest.approx((x + way[0], y + way[1], standing), abs=1e-6)
    turned = math.remainder(heading_of(person.pelvis) - math.radians(way[2]), 2 * math.pi)
    assert turned == pytest.approx(0, abs=1e-6)
    assert_feet_stand(*feet)
    start = {dof: person.angles[DOF_INDEX[dof]] for dof in person.movable if "knee" in dof}
    assert {dof: person.angle(dof) for dof in start} == pytest.approx(start, abs=0.02)


def test_a_curve_is_walked_smoothly_and_within_the_range_of_the_legs() -> None:
    world, person = walker()
    places, postures = [], []
    for _ in range(24):
        do_action(world, person, walk=(0.7, 0.0, 0.5))
        places.append([*person.pelvis.position, heading_of(person.pelvis)])
        postures.append(person.positions)
    speeds = np.abs(np.diff(np.array(places), axis=0)) / CONTROL_DT
    assert speeds[:, :2].max() < 1.2 and speeds[:, 2].max() < 0.6  # [m/s]
    assert speeds[:, 3].max() < 2.0  # [rad/s]
    assert (np.abs(np.diff(np.array(postures), axis=0)) / CONTROL_DT).max() < 12  # [rad/s]
    low, high = person.passive.T
    assert (np.array(postures) > low - 0.02).all() and (np.array(postures) < high + 0.02).all()


def test_a_step_that_has_begun_is_finished_and_nothing_asked_moves_nothing() -> None:
    world, person = walker()
    here = person.pelvis.position
    for _ in range(6):
        do_action(world, person, walk=(0.04, -0.04, 0.04))
    assert person.pelvis.position == here
    do_action(world, person, walk=(1.0, 0.0, 0.0))
    walked(world, person, (0.0, 0.0, 0.0), 0)
    assert person.pelvis.position[0] == pytest.approx(here[0] + STEP_LENGTH, abs=1e-6)
    seen = {o.name: np.asarray(o.read()) for o in person.observables()}
    assert seen["step"] == pytest.approx((0.0, 0.0))
    assert seen["pelvis_position"] == pytest.approx(person.pelvis.position)


def test_kneeling_by_actions_goes_down_to_the_knee_and_up_again() -> None:
    world, person = walker("walk", "kneel")
    start, foot = person.pelvis, np.array(person.joint_pose("right_ankle").position)
    for _ in range(19):
        do_action(world, person, kneel=(1.0, 0.0))
    radius = person.segments["left_knee"].shapes[0].size[1]
    assert person.joint_pose("left_knee").position[2] == pytest.approx(radius, abs=0.03)
    assert person.joint_pose("right_ankle").position == pytest.approx(foot, abs=0.02)
    assert person.joint_pose("right_knee").position[2] > 0.3
    assert person.legs is not None and person.legs.kneeling == {"left": 1.0, "right": 0.0}
    low = person.pelvis
    for _ in range(6):  # who kneels does not walk, nor go down on the other knee
        do_action(world, person, walk=(1.0, 0.0, 0.0), kneel=(0.0, 1.0))
    assert person.pelvis == low
    for _ in range(19):
        do_action(world, person, kneel=(-1.0, 0.0))
    assert person.legs.stands and person.pelvis.position == pytest.approx(start.position, abs=1e-9)
    walked(world, person, (1.0, 0.0, 0.0), 6)
    assert person.pelvis.position[0] == pytest.approx(start.position[0] + STEP_LENGTH, abs=1e-6)


def test_who_cannot_walk_is_a_named_error() -> None:
    with pytest.raises(ConfigError, match="left_hip_flexion"):
        person_in(World(), Pose(), ("right_elbow",), moves=("walk",))
    seated = Human(
        "seated",
        load_avatar("karan"),
        posture=load_posture("wheelchair"),
        movable=LEGS,
        moves=("kneel",),
    )
    with pytest.raises(ConfigError, match="does not stand"):
        seated.spawn(World(), Pose((0, 0, 0.5)))
    with pytest.raises(UnknownNameError, match="grasp, kneel, speak, walk"):
        person_in(World(), Pose(), LEGS, moves=("fly",))
    with pytest.raises(ConfigError, match="'posture'"):
        Human(
            "excited",
            load_avatar("caregiver"),
            posture=load_posture("standing"),
            actuation=ActuationConfig(kind="muscle"),
            moves=("grasp",),
        )
    world, person = walker("kneel")
    still = Caregiving(person, world, CONTROL_DT)
    with pytest.raises(ConfigError, match="cannot walk: its moves are kneel"):
        still.walk_to(1.0, 0.0, 0.0)
    with pytest.raises(ConfigError, match="cannot grasp"):
        still.grasp(person, "left_knee")
    with pytest.raises(UnknownNameError, match="side"):
        still.kneel("middle")
    world, person = walker()
    with pytest.raises(ConfigError, match="all finite"):
        Caregiving(person, world, CONTROL_DT).walk_to(math.nan, 0.0, 0.0)


# A caregiver's hands.


# The arm was laid on the armrest by somebody, whatever his own bearing.
LAID = ("spine1", "spine2", "spine3", "left_shoulder", "left_elbow", "left_wrist")


class Room:
    """Somebody in a wheelchair, the left forearm free, and a caregiver two steps away."""

    def __init__(self, avatar: str = "karan") -> None:
        self.world = World()
        floor = self.world.add_box((6, 6, 0.1), Pose((0, 0, -0.05)), name="floor")
        chair = Wheelchair(mounts="none")
        posture = load_posture("wheelchair")
        held = tuple(joint for joint in JOINTS[1:] if not joint.startswith("left_"))
        self.karan = Human(
            "recipient",
            load_avatar(avatar),
            posture=dataclasses.replace(posture, supported=held, posed=LAID),
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
        joints = (*LEGS, "spine1", "spine2", "spine3", *ARM)
        self.helper = person_in(self.world, pose, joints, moves=("walk", "grasp"))
        forearm = self.karan.frames[JOINT_INDEX["left_elbow"]].link
        rest = [link for link in range(-1, self.karan.body.link_count) if link != forearm]
        self.world.set_collision(self.karan.body, chair.body, False, links_a=rest)
        self.world.set_collision(self.helper.body, floor, False)
        self.caregiving = Caregiving(self.helper, self.world, CONTROL_DT, script=self.lift)
        self.helper.may_take(self.karan, "left_elbow", hand="right")
        self.world.mark_start()

    def forearm(self) -> Array:
        """Return a point 1 cm above the upper side of the forearm, near the wrist [m]."""
        here = self.karan.joint_pose("left_elbow")
        end = self.karan.joint_pose("left_wrist").position
        bone, up = np.subtract(end, here.position), np.array((0.0, 0.0, 1.0))
        out = up - (up @ bone) / (bone @ bone) * bone
        start, out = here.position + 0.88 * bone, out / np.linalg.norm(out)
        shapes, back = self.karan.segments["left_elbow"].shapes, here.inverse()

        def gap(away: float) -> float:
            point = np.asarray((back @ Pose(tuple((start + away * out).tolist()))).position)
            return min(shape.distance(point) for shape in shapes)

        return np.asarray(start + (float(brentq(gap, 0.0, 0.3)) + 0.01) * out)

    def lift(self, do: Caregiving) -> None:
        do.walk_to(0.5, 0.68, math.radians(-140))
        palm, fingers = (0, 0, -1), (-0.3, -1, 0)
        do.reach(self.forearm, palm=palm, fingers=fingers, near=GRIP_GAP, follow=True)
        do.grasp(self.karan, "left_elbow")
        # A heavy limb sags, and what it lies on comes first: some centimetres do.
        do.move_by((0.0, 0.0, 0.15), speed=0.25, near=GRIP_GAP)
        do.move_by((0.0, 0.0, -0.15), speed=0.25, near=GRIP_GAP)
        do.release()
        do.lower_arm()

    def episode(self, seconds: float = 25.0, replayed: list[Array] | None = None) -> Array:
        """Return joints, pelvis and hand after each control step, until all is done.

        What the helper does is kept in `sent`; `replayed` does that again with no policy.
        """
        self.world.rewind()
        for person in (self.karan, self.helper):
            person.reset(np.random.default_rng(0))
        rows = []
        if replayed is None:
            self.sent: list[Array] = []
            self.caregiving.reset(np.random.default_rng(0))
        for k in range(round(seconds / CONTROL_DT) if replayed is None else len(replayed)):
            if replayed is None:
                if k and self.caregiving.is_idle:
                    break
                self.sent.append(self.caregiving.act().copy())
            action = self.sent[k] if replayed is None else replayed[k]
            self.helper.command(action, CONTROL_DT)
            self.karan.command(self.karan.slack_action(CONTROL_DT), CONTROL_DT)  # goes along
            for _ in range(CONTROL_STEPS):
                self.karan.actuate()
                self.helper.actuate()
                self.world.step()
            self.karan.sense()
            self.helper.sense()
            rows.append(
                [
                    *self.karan.positions,
                    *self.helper.positions,
                    *self.helper.pelvis.position,
                    *self.caregiving.hand(),
                    self.karan.joint_pose("left_wrist").position[2],
                    float(self.caregiving.is_holding),
                ]
            )
        return np.array(rows)


@pytest.mark.slow
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
    other = Room()
    np.testing.assert_array_equal(other.episode(replayed=room.sent), rows)  # actions are all


@pytest.mark.parametrize("avatar", few(("kim", "daniel", "morgan", "jose", "natalia"), "kim"))
def test_an_arm_of_any_body_is_found_and_lifted(avatar: str) -> None:
    room = Room(avatar)
    rows = room.episode()
    assert room.caregiving.trouble == "" and room.caregiving.is_idle
    wrist, holding = rows[:, -2], rows[:, -1]
    assert wrist.max() > wrist[holding == 1][0] + 0.10


def test_an_episode_cut_short_in_the_middle_of_a_lift_leaves_no_trace() -> None:
    room = Room()
    first = room.episode(8.0)
    assert first[-1, -1] == 1  # still holding
    np.testing.assert_array_equal(room.episode(8.0), first)


def helper_alone() -> tuple[World, Human]:
    world = World()
    joints = ("spine1", "spine2", "spine3", *ARM)
    return world, person_in(world, Pose(), joints, moves=("grasp",))


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
    person.may_take(box, hand="right")
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
    person.may_take(rail, hand="right")
    caregiving.reach((0.4, -0.25, 1.0), palm=(0, 0, -1))
    caregiving.grasp(rail, force=20.0)
    caregiving.move_by((0.0, 0.0, 0.3))
    do_all(world, caregiving)
    assert "slipped" in caregiving.trouble and not caregiving.is_holding
    assert caregiving.is_idle


def tick(leaf: Do, world: World, person: Human, intent: dict[str, float], most: int) -> None:
    """Let a person do what a leaf of their tree wishes, until it has ended."""
    for _ in range(most):
        leaf.tick_once()
        if leaf.status != Status.RUNNING:
            break
        person.command(person.action_towards(intent, CONTROL_DT), CONTROL_DT)
        for _ in range(CONTROL_STEPS):
            person.actuate()
            world.step()


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
    tick(leaf, world, person, intent, 150)
    assert leaf.status == Status.FAILURE and "does not reach" in leaf.feedback_message


def test_the_leaf_succeeds_when_the_skills_are_done() -> None:
    world, person = helper_alone()
    caregiving = Caregiving(person, world, CONTROL_DT)
    caregiving.reset(np.random.default_rng(0))
    intent: dict[str, float] = {}
    leaf = Do("reach", caregiving, intent, lambda do: do.reach((0.45, -0.2, 1.1)))
    tick(leaf, world, person, intent, 80)
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
