"""People driven by muscles: the torques are right, the movement is stable, and it makes physical sense."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
import pytest
from variants import few

import rcare_marl
from rcare_marl.agents.agent import Array
from rcare_marl.agents.people.actuation.drive import ActuationConfig
from rcare_marl.agents.people.actuation.muscle_model import Tendon
from rcare_marl.agents.people.actuation.muscular import MuscleDrive
from rcare_marl.agents.people.avatar import AvatarConfig, load_avatar, load_posture
from rcare_marl.agents.people.behaviour.behaviour_tree import Reach
from rcare_marl.agents.people.body.ik import grip_point
from rcare_marl.agents.people.body.person_tree import person_tree
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS, JOINT_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.profile import ClinicalProfile, SideProfile
from rcare_marl.errors import ActionError, ConfigError, UnknownNameError
from rcare_marl.pose import Pose
from rcare_marl.world import World

AVATARS = ("caregiver", "daniel", "jose", "karan", "kim", "morgan", "natalia")
CONTROL_DT = 0.1


def spawned(
    avatar: AvatarConfig | str,
    posture: str = "standing",
    *,
    movable: Sequence[str] | None = None,
    seed: int = 0,
    **actuation: Any,
) -> tuple[World, Human]:
    world = World()
    person = Human(
        "person",
        load_avatar(avatar) if isinstance(avatar, str) else avatar,
        posture=load_posture(posture),
        movable=movable,
        actuation=ActuationConfig(kind="muscle", **actuation),
    )
    person.spawn(world, Pose((0, 0, 0.5)))
    world.mark_start()
    world.rewind()
    person.reset(np.random.default_rng(seed))
    return world, person


def drive_of(person: Human) -> MuscleDrive:
    """Return the muscular drive of a person."""
    assert isinstance(person.drive, MuscleDrive)
    return person.drive


def go_on(
    world: World,
    person: Human,
    action: Array | Callable[[], Array],
    seconds: float,
    *,
    before_step: Callable[[], None] | None = None,
) -> Array:
    """Hold an action, or ask for one in each control step, for some time; return the angles."""
    angles = []
    for _ in range(round(seconds / CONTROL_DT)):
        person.command(action() if callable(action) else action, CONTROL_DT)
        for _ in range(24):
            person.actuate()
            if before_step is not None:
                before_step()
            world.step()
        person.sense()
        angles.append(np.array(person.positions))
    return np.array(angles)


def excitation_of(person: Human, prefix: str, value: float = 1.0) -> Array:
    """Return an action that excites the muscles of a clinical group on the right."""
    units = drive_of(person).model.units
    chosen = [u.side == "right" and u.clinical_group == prefix for u in units]
    assert any(chosen)
    return np.where(chosen, value, 0.0)


def healthy(**right: Any) -> AvatarConfig:
    """Return the caregiver with another profile of the right side."""
    profile = ClinicalProfile(right=SideProfile(**right))
    return dataclasses.replace(load_avatar("caregiver"), profile=profile)


# --- stability -----------------------------------------------------------------------------------


def check_stable(
    name: str, posture: str, seconds: float, tendon: Tendon, *, seed: int = 11
) -> None:
    world, person = spawned(name, posture, tendon=tendon)
    rng = np.random.default_rng(seed)
    angles = go_on(world, person, lambda: rng.uniform(0, 1, person.action_size), seconds)
    assert np.isfinite(angles).all()
    assert np.abs(person.velocities).max() < 25
    low, high = person.passive.T
    assert (angles > low - 0.02).all() and (angles < high + 0.02).all()
    world.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "posture", "tendon"),
    [
        ("caregiver", "standing", "quasi_static"),
        ("karan", "wheelchair", "rigid"),
        ("kim", "bed_supine", "implicit"),
    ],
)
def test_random_excitations_of_the_whole_body_stay_stable(
    name: str, posture: str, tendon: Tendon
) -> None:
    check_stable(name, posture, 2.0, tendon)


def test_a_hand_that_hits_the_thigh_flings_no_finger_past_its_end() -> None:
    check_stable("caregiver", "bed_supine", 0.2, "rigid", seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", AVATARS)
def test_random_excitations_stay_stable_for_a_minute(name: str) -> None:
    check_stable(name, "wheelchair", 60.0, "quasi_static")


# --- physical sense ------------------------------------------------------------------------------


def energy(person: Human) -> float:
    """Return kinetic and potential energy of a person whose pelvis is held [J]."""
    body, total = person.body, 0.0
    positions, velocities = body.joint_states(person._joints)
    chain = person_tree(person.segments, person.model.joints, person.angles, person.movable)
    matrix = chain.mass_matrix(np.array(positions))
    total += 0.5 * np.array(velocities) @ matrix @ np.array(velocities)
    for joint, segment in person.segments.items():
        matrix = person.joint_pose(joint).matrix()
        total += segment.mass * 9.81 * (matrix[:3, :3] @ segment.centre + matrix[:3, 3])[2]
    return total


def test_energy_does_not_grow_in_a_free_swing() -> None:
    world, person = spawned("caregiver", movable=["right_shoulder_flexion", "right_elbow_flexion"])
    person.set_angles({"right_shoulder_flexion": 1.3, "right_elbow_flexion": 0.3})
    relaxed, energies = np.zeros(person.action_size), [energy(person)]
    for _ in range(80):
        go_on(world, person, relaxed, CONTROL_DT)
        energies.append(energy(person))
    fallen = energies[0] - energies[-1]
    assert fallen > 1.0  # the arm did fall
    assert max(energies[1:]) < energies[0] + 0.1 * fallen  # stretched fibres held a little
    # Stretched fibres take and give back what is not counted here; the limb comes to rest all the same.
    assert np.ptp(energies[-10:]) < 0.1 * np.ptp(energies[:10])


def test_a_relaxed_arm_falls() -> None:
    world, person = spawned("caregiver", movable=["right_elbow_flexion", "right_shoulder_flexion"])
    person.set_angles({"right_elbow_flexion": 1.57})
    angles = go_on(world, person, np.zeros(person.action_size), 2.0)
    assert angles[-1][person.movable.index("right_elbow_flexion")] < 0.5


def test_daniel_bends_the_elbow_but_cannot_strongly_extend_it() -> None:
    def turned(avatar: AvatarConfig | str, group: str, load: float) -> float:
        """Return by how much an excited group bends the elbow against a load at the wrist [rad]."""
        world, person = spawned(avatar, "wheelchair", movable=["right_elbow_flexion"])
        person.set_angles({"right_elbow_flexion": np.pi / 2})
        link = person.frames[JOINT_INDEX["right_wrist"]].link

        def press() -> None:
            shoulder, elbow, wrist = (
                np.array(person.joint_pose(f"right_{name}").position)
                for name in ("shoulder", "elbow", "wrist")
            )
            bending = np.cross(np.cross(wrist - elbow, shoulder - elbow), wrist - elbow)
            person.body.apply_force(link, load * bending / np.linalg.norm(bending), wrist)

        action = excitation_of(person, group)
        return float(go_on(world, person, action, 1.5, before_step=press)[-1][0] - np.pi / 2)

    assert turned("daniel", "elbow_flexors", -30.0) > 0.3  # he bends against 30 N
    assert (
        turned("daniel", "elbow_extensors", 30.0) > 0.1
    )  # and is bent by them, however he extends
    assert turned(healthy(), "elbow_extensors", 30.0) < -0.3  # which a healthy person resists


@pytest.mark.slow
def test_jose_moves_nothing_below_the_neck() -> None:
    world, person = spawned("jose", "wheelchair")
    units = drive_of(person).model.units
    below = np.array([u.side != "axial" or u.region == "trunk" for u in units])
    assert below.sum() > 200
    told = go_on(world, person, np.where(below, 1.0, 0.0), 1.0)
    world_b, relaxed = spawned("jose", "wheelchair")
    untold = go_on(world_b, relaxed, np.zeros(person.action_size), 1.0)
    moved = np.abs(told - untold).max(axis=0)
    for dof, angle in zip(person.movable, moved, strict=True):
        if dof.startswith(("left", "right", "spine")) and "eye" not in dof and "collar" not in dof:
            assert angle < 0.02, dof


@pytest.mark.slow
def test_karans_right_arm_lifts_and_his_left_does_not() -> None:
    risen = {}
    for side in ("left", "right"):
        world, person = spawned("karan", "wheelchair", excitation="posture")
        goal = {f"{side}_shoulder_flexion": 1.2, f"{side}_elbow_flexion": 0.6}
        before = person.joint_pose(f"{side}_wrist").position[2]
        go_on(world, person, partial(person.action_towards, goal, CONTROL_DT), 3.0)
        risen[side] = person.joint_pose(f"{side}_wrist").position[2] - before
    assert risen["right"] > 0.12
    assert risen["left"] < 0.05


def test_a_grade_3_muscle_holds_the_limb_and_no_more() -> None:
    avatar = healthy(mmt={"elbow_flexors": 3})
    elbow = ["right_elbow_flexion"]

    def final(load: float) -> float:
        world, person = spawned(avatar, movable=elbow)
        person.set_angles({"right_elbow_flexion": np.pi / 2})
        link = person.frames[JOINT_INDEX["right_wrist"]].link

        def press() -> None:
            wrist = person.joint_pose("right_wrist").position
            person.body.apply_force(link, (0.0, 0.0, -load), wrist)

        flexors = excitation_of(person, "elbow_flexors")
        return go_on(world, person, flexors, 2.0, before_step=press)[-1][0]

    assert final(0.0) > np.radians(70)  # it holds
    assert final(8.0) < np.radians(40)  # but not another 0.8 kg at the wrist


def test_active_movement_ends_at_the_active_range_and_passive_movement_at_the_passive_one() -> None:
    avatar = healthy(arom_deg={"elbow_flexion": 60}, prom_deg={"elbow_flexion": 120})
    world, person = spawned(avatar, movable=["right_elbow_flexion"])
    angles = go_on(world, person, excitation_of(person, "elbow_flexors"), 2.0)[:, 0]
    assert np.radians(50) < angles[-1] < np.radians(62)
    link = person.frames[JOINT_INDEX["right_wrist"]].link

    def bend() -> None:
        at = person.joint_pose("right_wrist").position
        up = person.joint_pose("right_shoulder").position
        pull = np.subtract(up, at)
        person.body.apply_force(link, tuple(60.0 * pull / np.linalg.norm(pull)), at)

    bent = go_on(world, person, np.zeros(person.action_size), 2.0, before_step=bend)[:, 0]
    assert np.radians(105) < bent[-1] < np.radians(122)


def test_spastic_muscles_resist_fast_stretch_more_than_slow_and_by_their_grade() -> None:
    def resistance(grade: str, speed: float) -> Array:
        """Return the torque of a relaxed elbow that is straightened at a speed [N·m], by step."""
        avatar = healthy(spasticity={"elbow_flexors": grade})
        _, person = spawned(avatar, movable=["right_elbow_flexion"])
        drive, still = person.drive, person._gravity
        drive.relax()
        way = np.linspace(2.3, 0.1, round(2.2 / speed * 240))
        return np.array([drive.torques([float(at)], [-speed], still)[0] for at in way])

    def extra(grade: str, speed: float) -> float:
        return float((resistance(grade, speed) - resistance("0", speed)).max())

    assert extra("1+", 3.0) > 0.5
    assert extra("3", 3.0) > extra("1+", 3.0) + 2.0
    for grade in ("1+", "3"):
        assert extra(grade, 0.3) < 0.5 * extra(grade, 3.0)


@pytest.mark.parametrize("kind", ["muscle", "skeletal"])
def test_a_tremor_shakes_at_its_frequency_and_only_where_it_is(
    kind: Literal["skeletal", "muscle"],
) -> None:
    avatar = healthy(tremor={"wrist_flexors": 0.3, "wrist_extensors": 0.3})
    world = World()
    person = Human(
        "p",
        avatar,
        posture=load_posture("standing"),
        actuation=ActuationConfig(kind=kind),
        movable=["left_wrist_flexion", "right_wrist_flexion"],
    )
    person.spawn(world, Pose((0, 0, 0.5)))
    person.reset(np.random.default_rng(2))
    angles = []
    person.command(np.zeros(person.action_size), CONTROL_DT)
    for _ in range(960):
        person.actuate()
        world.step()
        angles.append(person.body.joint_states(person._joints)[0])
    left, right = np.array(angles)[240:].T - np.mean(angles[240:], axis=0)[:, None]
    assert np.ptp(left) < 0.01 < np.ptp(right)
    peak = np.fft.rfftfreq(len(right), 1 / 240)[np.abs(np.fft.rfft(right)).argmax()]
    assert 3.9 < peak < 6.1


# --- as an agent ---------------------------------------------------------------------------------


def test_a_person_told_to_reach_does_it_with_muscles_only() -> None:
    world, person = spawned("caregiver", excitation="posture")
    goal = {"right_shoulder_flexion": 1.0, "right_elbow_flexion": 1.2}
    go_on(world, person, lambda: person.action_towards(goal, CONTROL_DT), 3.0)
    for dof, angle in goal.items():
        assert person.angle(dof) == pytest.approx(angle, abs=0.15)
    assert ((drive_of(person).excitation >= 0) & (drive_of(person).excitation <= 1)).all()
    assert np.abs(person.velocities).max() < 1.0


@pytest.mark.parametrize("excitation", ["unit", "group"])
def test_any_avatar_can_be_cast_with_muscles(excitation: str) -> None:
    cast = {"model": "kim", "actuation": "muscle", "excitation": excitation}
    env = rcare_marl.make("feeding", recipient=cast, policies={"robot": "still"})
    try:
        space = env.action_space("recipient")
        assert (space.low == 0).all() and (space.high == 1).all()
        env.reset(seed=1)
        space.seed(1)
        for _ in range(5):
            env.step({"recipient": space.sample()})
        with pytest.raises(ActionError, match=r"excitations lie in \[0, 1\]"):
            env.step({"recipient": np.full(space.shape, -0.5)})
        env.step({"recipient": space.sample()})  # nothing is lost
        names = env.cast["recipient"].action_names
        assert len(names) == len(set(names)) == space.shape[0]
    finally:
        env.close()


@pytest.mark.parametrize(
    ("task", "name", "excitation"),
    [("feeding", "karan", "unit"), ("handing_over", "kim", "posture")],
)
def test_episodes_with_muscles_are_bit_equal(task: str, name: str, excitation: str) -> None:
    cast = {"model": name, "actuation": "muscle", "excitation": excitation}
    env = rcare_marl.make(task, recipient=cast, policies={"robot": "random"})
    try:
        runs = []
        for _ in range(2):
            env.reset(seed=7)
            rng = np.random.default_rng(0)
            size = env.action_space("recipient").shape
            seen = []
            for _ in range(15):
                action = rng.uniform(0, 1, size).astype(np.float32)
                seen.append(env.step({"recipient": action})[0]["recipient"])
            runs.append(np.array(seen))
        assert np.array_equal(runs[0], runs[1])
    finally:
        env.close()


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"actuation": "muscles"}, UnknownNameError, "muscle"),
        ({"actuation": "muscle", "tendon": "stiff"}, UnknownNameError, "quasi_static"),
        ({"actuation": "muscle", "musculature": "nowhere.csv"}, ConfigError, "nowhere.csv"),
        ({"actuation": "muscle", "movable": ("left_eye_smplhf",)}, ConfigError, "no muscle"),
        ({"strength": "linaer"}, UnknownNameError, "linear"),
    ],
)
def test_a_cast_that_cannot_be_is_refused_by_name(
    options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        rcare_marl.make("feeding", recipient={"model": "karan", **options})


def palm(person: Human, side: str) -> Array:
    matrix = person.joint_pose(f"{side}_wrist").matrix()
    return matrix[:3, :3] @ grip_point(person, side) + matrix[:3, 3]


@pytest.mark.parametrize(
    ("name", "side", "arrives"), [("karan", "right", True), ("karan", "left", False)]
)
def test_reaching_with_muscles_goes_as_far_as_the_profile_lets(
    name: str, side: str, arrives: bool
) -> None:
    world, person = spawned(name, "wheelchair", excitation="posture")
    goal = palm(person, side) + np.array([0.10, 0.05, 0.18])
    policy = Reach(person, side, lambda: goal, control_dt=CONTROL_DT)
    policy.reset(np.random.default_rng(0))
    go_on(world, person, policy.act, 4.0)
    assert (np.linalg.norm(palm(person, side) - goal) < 0.07) == arrives


@pytest.mark.parametrize("kind", ["muscle", "skeletal"])
def test_tired_regions_lose_strength_and_a_new_episode_gives_it_back(
    kind: Literal["skeletal", "muscle"],
) -> None:
    def fallen(tired: float) -> list[float]:
        world = World()
        person = Human(
            "p",
            load_avatar("caregiver"),
            posture=load_posture("standing"),
            movable=["right_elbow_flexion"],
            actuation=ActuationConfig(kind=kind, excitation="posture"),
        )
        person.spawn(world, Pose((0, 0, 0.5)))
        world.mark_start()
        angles = []
        for fatigue in (tired, 0.0):
            world.rewind()
            person.reset(np.random.default_rng(0))
            person.physiology.set_fatigue("right_arm", fatigue)
            goal = {"right_elbow_flexion": 1.5}
            act = partial(person.action_towards, goal, CONTROL_DT)
            angles.append(go_on(world, person, act, 3.0)[-1][0])
        return angles

    weak, rested = fallen(0.99)  # nearly all: what is left carries a bent forearm soon
    assert rested == pytest.approx(1.5, abs=0.2)
    assert weak < rested - 0.3


@pytest.mark.parametrize("name", few(["caregiver", "jose", "kim"], "caregiver"))
def test_people_at_rest_stay_in_their_chair_and_hardly_work(name: str) -> None:
    world, person = spawned(name, "wheelchair", excitation="posture")
    joints = ("right_ankle", "left_ankle", "head", "right_wrist")
    before = [person.joint_pose(joint).position for joint in joints]
    go_on(world, person, lambda: person.action_towards({}, CONTROL_DT), 2.0)
    for joint, place in zip(joints, before, strict=True):
        assert np.linalg.norm(np.subtract(person.joint_pose(joint).position, place)) < 0.05, joint
    assert drive_of(person).excitation.mean() < 0.12


def test_people_hold_the_start_posture_until_they_are_told_otherwise() -> None:
    world, person = spawned("caregiver", "wheelchair", movable=["spine1", "neck", "head", "jaw"])
    before = np.array(person.positions)
    for _ in range(240):
        person.actuate()
        world.step()
    person.sense()
    assert np.abs(np.array(person.positions) - before).max() < 0.1


def test_a_relaxed_arm_hangs_straight_down_and_is_turned_in_a_little() -> None:
    motions = ("shoulder_abduction", "shoulder_flexion", "shoulder_external_rotation")
    arm = [f"left_{motion}" for motion in (*motions, "elbow_flexion")]
    world, person = spawned("caregiver", movable=arm, excitation="group")
    end = go_on(world, person, np.zeros(len(person.action_names)), 6.0)[-1]
    zero = np.array([DOFS[DOF_INDEX[name]].clinical_zero for name in arm])
    abduction, flexion, rotation, elbow = np.degrees(end + zero)
    assert 0.0 < abduction < 15.0
    assert abs(flexion) < 8.0
    assert -25.0 < rotation < 0.0
    assert 8.0 < elbow < 28.0
