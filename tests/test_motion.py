"""Motion: trajectories, clips that come back as they were written, a walk, and a caregiver's hands."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from py_trees.common import Status

from rcare_marl.agents.avatar import body_model, load_avatar, load_posture
from rcare_marl.agents.body.posture import UPRIGHT
from rcare_marl.agents.body.skeleton import (
    DOF_INDEX,
    DOFS,
    DOFS_OF,
    JOINT_INDEX,
    JOINTS,
    SIDES,
    axis_rotation,
    forward_kinematics,
    joint_rotations,
)
from rcare_marl.agents.body.skin import BodyModel
from rcare_marl.agents.human import Human
from rcare_marl.agents.motion.amass import load_amass, save_amass
from rcare_marl.agents.motion.bvh import Bvh, read_bvh, write_bvh
from rcare_marl.agents.motion.caregiving import Caregiving, Do
from rcare_marl.agents.motion.clip import Clip, Motion, heading_of, leg_length, sole_points
from rcare_marl.agents.motion.decomposition import decompose
from rcare_marl.agents.motion.playback import Puppet, fitted, play
from rcare_marl.agents.motion.retarget import load_bvh, map_joints, save_bvh
from rcare_marl.agents.motion.trajectory import (
    Follow,
    Trajectory,
    TrajectoryPolicy,
    minimum_jerk,
    minimum_jerk_speed,
)
from rcare_marl.agents.motion.walk import LEGS, STEP_LENGTH, Station, Walk, stations
from rcare_marl.agents.policy import Policy
from rcare_marl.envs.devices.wheelchair import Wheelchair
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import (
    Pose,
    matrix_from_quaternion,
    quaternion_from_matrix,
    quaternion_from_rpy,
)
from rcare_marl.world import World

Array = npt.NDArray[np.float64]
CONTROL_STEPS = 24
CONTROL_DT = CONTROL_STEPS / 240
ARM = ("right_collar", "right_shoulder", "right_elbow", "right_wrist")


def person_in(
    world: World,
    pose: Pose,
    movable: tuple[str, ...],
    *,
    avatar: str = "caregiver",
    name: str = "caregiver",
) -> Human:
    person = Human(name, load_avatar(avatar), posture=load_posture("standing"), movable=movable)
    person.spawn(world, pose)
    person.reset(np.random.default_rng(0))
    return person


def run_policy(world: World, person: Human, policy: Policy, seconds: float) -> None:
    for _ in range(round(seconds / CONTROL_DT)):
        person.command(policy.act(), CONTROL_DT)
        for _ in range(CONTROL_STEPS):
            person.actuate()
            world.step()
        person.sense()


# Trajectories.


def test_minimum_jerk_starts_and_ends_at_rest() -> None:
    assert [minimum_jerk(s) for s in (-1, 0, 0.5, 1, 2)] == [0, 0, 0.5, 1, 1]
    assert minimum_jerk_speed(0) == minimum_jerk_speed(1) == 0
    h = 1e-4
    for s in (0.0, 1.0):  # neither speed nor acceleration at the ends
        inside = s + h if s == 0 else s - h
        assert abs(minimum_jerk(inside) - s) < 20 * h**3
    for s in (0.2, 0.5, 0.7):
        numeric = (minimum_jerk(s + h) - minimum_jerk(s - h)) / (2 * h)
        assert minimum_jerk_speed(s) == pytest.approx(numeric, abs=1e-6)


def test_a_trajectory_goes_through_its_postures_no_faster_than_allowed() -> None:
    way = Trajectory.through(
        {"a": 0.0, "b": 1.0}, [{"a": 1.2}, {"a": 0.4, "b": 0.0}, {"b": 0.0}], speed=0.5
    )
    for time, wanted in zip(way.times, ((0, 1), (1.2, 1), (0.4, 0), (0.4, 0)), strict=True):
        assert way.sample(float(time)) == pytest.approx({"a": wanted[0], "b": wanted[1]})
        assert way.speed(float(time)) == pytest.approx({"a": 0, "b": 0}, abs=1e-9)
    fastest = max(
        abs(rate)
        for time in np.linspace(0, way.duration, 500)
        for rate in way.speed(float(time)).values()
    )
    assert 0.49 < fastest <= 0.5 + 1e-9
    assert way.sample(1e9) == way.sample(way.duration)


def test_a_person_follows_a_trajectory_to_its_end_and_rests_there() -> None:
    world = World()
    person = person_in(world, Pose(), ("right_shoulder_flexion", "right_elbow_flexion"))
    goal = {"right_shoulder_flexion": 0.6, "right_elbow_flexion": 1.2}
    policy = TrajectoryPolicy(
        person, lambda: Trajectory.to(person, goal), lambda: world.time, CONTROL_DT
    )
    policy.reset(np.random.default_rng(0))
    run_policy(world, person, policy, 4.0)
    for dof, angle in goal.items():
        assert person.angle(dof) == pytest.approx(angle, abs=0.03)
    assert max(map(abs, person.velocities)) < 0.02


def test_the_leaf_runs_until_the_person_has_arrived() -> None:
    world = World()
    person = person_in(world, Pose(), ("right_elbow_flexion",))
    intent: dict[str, float] = {}
    way = Trajectory.to(person, {"right_elbow_flexion": 1.0})
    leaf = Follow("bend", person, intent, lambda: way, lambda: world.time, CONTROL_DT)
    seen = []
    for _ in range(40):
        leaf.tick_once()
        seen.append(leaf.status)
        if leaf.status == Status.SUCCESS:
            break
        person.command(person.action_towards(intent, CONTROL_DT), CONTROL_DT)
        for _ in range(CONTROL_STEPS):
            person.actuate()
            world.step()
    assert seen[0] == Status.RUNNING and seen[-1] == Status.SUCCESS
    assert world.time >= way.duration


def test_impossible_trajectories_are_named_errors() -> None:
    with pytest.raises(ConfigError, match="takes 1.88 s"):
        Trajectory.through({"a": 0.0}, [{"a": 1.0}], speed=1.0, duration=1.0)
    with pytest.raises(ConfigError, match="positive"):
        Trajectory.through({"a": 0.0}, [{"a": 1.0}], speed=0.0)
    with pytest.raises(UnknownNameError, match="'b'"):
        Trajectory.through({"a": 0.0}, [{"b": 1.0}])
    with pytest.raises(ConfigError, match="begin at zero and grow"):
        Trajectory(("a",), np.zeros((2, 1)), (0.0, 0.0))
    with pytest.raises(ConfigError, match="finite"):
        Trajectory.through({"a": 0.0}, [{"a": math.nan}])


# Decomposition.


def test_every_joint_is_decomposed_into_the_angles_that_made_its_rotation() -> None:
    limits = load_avatar("morgan").profile.limits("passive")
    rng = np.random.default_rng(0)
    for joint in JOINTS[1:]:
        dofs = DOFS_OF[joint]
        bounds = np.array([limits[dof.name] for dof in dofs])
        ends = bounds[:, 0] + rng.random((2, len(dofs))) * (bounds[:, 1] - bounds[:, 0])
        angles = np.linspace(np.clip(0, *bounds.T), ends[0], 20)  # from the T-pose, in small steps
        turns = np.tile(np.eye(3), (20, 1, 1))
        for k, dof in enumerate(dofs):
            turns = turns @ np.array([axis_rotation(dof.axis, a) for a in angles[:, k]])
        np.testing.assert_allclose(decompose(joint, turns, bounds), angles, atol=1e-6)


def test_aligned_axes_still_give_the_same_rotation() -> None:
    joint = "left_shoulder"  # flexed by 90 degrees, its first and third axis align
    for flexion in (math.pi / 2, -math.pi / 2):
        turn = np.eye(3)
        for dof, angle in zip(DOFS_OF[joint], (-0.3, flexion, 0.4), strict=True):
            turn = turn @ axis_rotation(dof.axis, angle)
        found = decompose(joint, turn[None])[0]
        again = np.eye(3)
        for dof, angle in zip(DOFS_OF[joint], found, strict=True):
            again = again @ axis_rotation(dof.axis, float(angle))
        np.testing.assert_allclose(again, turn, atol=1e-7)


def test_a_finger_with_one_axis_gets_the_nearest_turn() -> None:
    dof = DOFS_OF["left_index2"][0]
    turn = axis_rotation(dof.axis, 0.7) @ axis_rotation((1.0, 0.0, 0.0), 0.2)

    def gap(angle: float) -> float:
        return float(np.linalg.norm(axis_rotation(dof.axis, angle) - turn))

    found = float(decompose("left_index2", turn[None])[0, 0])
    assert gap(found) <= min(gap(found - 1e-4), gap(found + 1e-4))
    with pytest.raises(ConfigError, match="no rotations"):
        decompose("left_index2", 2 * turn[None])
    with pytest.raises(UnknownNameError, match="pelvis"):
        decompose("pelvis", turn[None])


# Clips.


def body(name: str) -> BodyModel:
    avatar = load_avatar(name)
    return body_model(avatar.body_path(), avatar.height_m)


def waving(name: str = "karan", frames: int = 40) -> Motion:
    """Return a smooth motion of all DoFs inside the passive range, walking a curve."""
    limits = load_avatar(name).profile.limits("passive")
    low, high = np.array([limits[dof.name] for dof in DOFS]).T
    rng = np.random.default_rng(2)
    share = np.linspace(0, 1, frames)[:, None]
    start = np.clip(np.zeros(len(DOFS)), low, high)
    angles = start + share * (low + rng.random(len(DOFS)) * (high - low) - start)
    turns = [
        UPRIGHT @ axis_rotation((0.0, 1.0, 0.0), 0.03 * k) @ axis_rotation((1.0, 0.0, 0.0), 0.1)
        for k in range(frames)
    ]
    pelvis = np.column_stack((0.02 * np.arange(frames), np.zeros(frames), 0.9 + 0.05 * share[:, 0]))
    return Motion(30.0, angles, pelvis, np.array([quaternion_from_matrix(t) for t in turns]))


def assert_same_motion(found: Motion, wanted: Motion, tolerance: float) -> None:
    assert found.rate == pytest.approx(wanted.rate)
    for a, b in zip(found.angles, wanted.angles, strict=True):
        np.testing.assert_allclose(joint_rotations(a), joint_rotations(b), atol=tolerance)
    np.testing.assert_allclose(found.angles, wanted.angles, atol=100 * tolerance)
    np.testing.assert_allclose(found.pelvis, wanted.pelvis, atol=tolerance)
    same = np.abs((found.quaternions * wanted.quaternions).sum(axis=1))
    np.testing.assert_allclose(same, 1.0, atol=tolerance)


def test_a_motion_written_as_bvh_comes_back_as_it_was(tmp_path: Path) -> None:
    motion, model = waving(), body("karan")
    save_bvh(tmp_path / "wave.bvh", motion, model.joints)
    clip = load_bvh(tmp_path / "wave.bvh")
    found = clip.fit(model, load_avatar("karan").profile, on_floor=False)
    assert_same_motion(found, motion, 1e-5)
    assert found.excess < 1e-4


def test_a_motion_written_like_amass_comes_back_as_it_was(tmp_path: Path) -> None:
    motion, model = waving(), body("karan")
    save_amass(tmp_path / "wave.npz", motion, gender="male")
    with np.load(tmp_path / "wave.npz") as data:
        assert data["poses"].shape == (40, 165) and str(data["gender"]) == "male"
    clip = load_amass(tmp_path / "wave.npz", leg=leg_length(model.joints))
    found = clip.fit(model, load_avatar("karan").profile, on_floor=False)
    assert_same_motion(found, motion, 1e-9)


@pytest.mark.parametrize("layout", [72, 156])
def test_smpl_and_smplh_layouts_keep_the_joints_that_they_have(tmp_path: Path, layout: int) -> None:
    motion, model = waving(), body("karan")
    save_amass(tmp_path / "x.npz", motion, gender="male")
    with np.load(tmp_path / "x.npz") as data:
        poses, trans = data["poses"], data["trans"]
    body_part = poses[:, :66]
    hands = poses[:, 75:] if layout == 156 else np.zeros((40, 6))
    np.savez(
        tmp_path / "h.npz", poses=np.hstack((body_part, hands)), trans=trans, mocap_framerate=30.0
    )
    clip = load_amass(tmp_path / "h.npz", leg=leg_length(model.joints))
    found = clip.fit(model, load_avatar("karan").profile, on_floor=False)
    kept = JOINTS[1:22] + (JOINTS[25:] if layout == 156 else ())
    for dof in DOFS:
        wanted = motion.angles[:, DOF_INDEX[dof.name]]
        if dof.joint in kept:
            np.testing.assert_allclose(found.angles[:, DOF_INDEX[dof.name]], wanted, atol=1e-7)


def mixamo_like(tmp_path: Path) -> Path:
    """Write a file with other names, in centimetres, its arms 45 degrees down, that raises one."""
    names = ["mixamorig:Hips", "mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2",
             "mixamorig:Neck", "mixamorig:Head"]  # fmt: skip
    parents, offsets = [-1, 0, 1, 2, 3, 4], [(0, 100, 0), *[(0, 12, 0)] * 5]
    for side, x in (("Left", 1), ("Right", -1)):
        for name, parent, offset in (
            ("UpLeg", 0, (9 * x, -5, 0)), ("Leg", None, (0, -45, 0)), ("Foot", None, (0, -45, 0)),
            ("ToeBase", None, (0, -6, 14)), ("Shoulder", 3, (4 * x, 8, 0)),
            ("Arm", None, (12 * x, 0, 0)), ("ForeArm", None, (20 * x, -20, 0)),
            ("Hand", None, (18 * x, -18, 0)),
        ):  # fmt: skip
            parents.append(len(names) - 1 if parent is None else parent)
            names.append(f"mixamorig:{side}{name}")
            offsets.append(offset)
    turning = ("Zrotation", "Yrotation", "Xrotation")
    channels = [
        ("Xposition", "Yposition", "Zposition", *turning) if j == 0 else turning
        for j in range(len(names))
    ]
    values = np.zeros((3, sum(map(len, channels))))
    values[:, 1] = 100
    starts = np.cumsum([0, *map(len, channels)])
    values[2, starts[names.index("mixamorig:LeftArm")]] = 45  # degrees about z: level
    path = tmp_path / "other.bvh"
    write_bvh(
        path,
        Bvh(tuple(names), tuple(parents), np.array(offsets, np.float64), tuple(channels), 0.1, values),
    )  # fmt: skip
    return path


def test_other_skeletons_keep_the_directions_of_their_limbs(tmp_path: Path) -> None:
    path = mixamo_like(tmp_path)
    found = map_joints(read_bvh(path))
    by_name = {ours: read_bvh(path).names[j] for ours, j in found.items()}
    assert by_name["left_collar"] == "mixamorig:LeftShoulder"
    assert by_name["left_shoulder"] == "mixamorig:LeftArm"
    assert by_name["left_ankle"] == "mixamorig:LeftFoot"
    assert by_name["spine3"] == "mixamorig:Spine2"
    model = body("morgan")
    motion = load_bvh(path).fit(model, load_avatar("morgan").profile)
    ways = []
    for angles in motion.angles:
        _, positions = forward_kinematics(model.joints, angles)
        way = positions[JOINT_INDEX["left_elbow"]] - positions[JOINT_INDEX["left_shoulder"]]
        ways.append(way / np.linalg.norm(way))
    down = math.sqrt(0.5)
    np.testing.assert_allclose(ways[0], (down, -down, 0), atol=1e-6)
    np.testing.assert_allclose(ways[2], (1, 0, 0), atol=1e-6)
    stature_ratio = leg_length(model.joints) / 90
    assert np.ptp(motion.pelvis[:, 2]) == pytest.approx(0, abs=1e-9)
    assert 0.9 * 100 * stature_ratio < motion.pelvis[0, 2] < 1.2 * 100 * stature_ratio


def test_joints_with_foreign_names_are_mapped_by_the_user(tmp_path: Path) -> None:
    path = mixamo_like(tmp_path)
    text = path.read_text().replace("mixamorig:LeftArm", "Oberarm_l")
    path.write_text(text)
    with pytest.raises(ConfigError, match="left_shoulder"):
        load_bvh(path, names={"mixamorig:LeftShoulder": "left_collar"})
    names = {"mixamorig:LeftShoulder": "left_collar", "Oberarm_l": "left_shoulder"}
    assert len(load_bvh(path, names=names).rotations) == 3
    with pytest.raises(UnknownNameError, match="Oberarm"):
        load_bvh(path, names={"Oberarm": "left_shoulder"})
    with pytest.raises(UnknownNameError, match="left_shoulder"):
        load_bvh(path, names={"Oberarm_l": "left_schoulder"})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("HIERARCHY", "HIRARCHY", "line 1: expected 'HIERARCHY'"),
        (
            "OFFSET 0.000000 100.000000 0.000000",
            "OFFSET 0 a 0",
            "line 4: expected 3 finite numbers",
        ),
        ("OFFSET 0.000000 100.000000 0.000000", "OFFSET 0 100", "'OFFSET' and 3 values"),
        ("CHANNELS 6 Xposition", "CHANNELS 6 Wposition", "line 5: expected 'CHANNELS'"),
        ("CHANNELS 6 Xposition", "CHANNELS 5 Xposition", "line 5: expected 5 channels"),
        ("CHANNELS 6 Xposition Yposition", "CHANNELS 6 Xposition Xposition", "each channel once"),
        ("Frames: 3", "Frames: 4", "frame 4 of 4, got the end"),
        ("Frames: 3", "Frames: 2", "the end after 2 frames"),
        ("Frames: 3", "Frames: 0", "whole number of frames"),
        ("Frame Time: 0.1", "Frame Time: 0", "positive frame time"),
        ("JOINT mixamorig:Spine1", "JOINT mixamorig:Spine", "a new name"),
        ("End Site", "End", "'End Site' or '}'"),
        ("MOTION", "}\nMOTION", "'MOTION'"),
    ],
)
def test_a_malformed_bvh_names_the_line_and_what_was_expected(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = mixamo_like(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError) as caught:
        read_bvh(path)
    assert message in str(caught.value) and "other.bvh" in str(caught.value)


def test_malformed_motion_files_are_named_errors(tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    good: dict[str, Any] = {
        "poses": np.zeros((4, 165)),
        "trans": np.zeros((4, 3)),
        "mocap_frame_rate": 30.0,
    }
    for change, message in (
        ({"poses": np.zeros((4, 100))}, "72, 156, 165"),
        ({"poses": np.full((4, 165), np.nan)}, "finite"),
        ({"trans": np.zeros((3, 3))}, r"\(4, 3\)"),
        ({"mocap_frame_rate": 0.0}, "frame rate"),
    ):
        np.savez(path, **(good | change))
        with pytest.raises(ConfigError, match=message):
            load_amass(path)
    np.savez(path, poses=good["poses"])
    with pytest.raises(ConfigError, match="lacks trans, mocap_framerate or mocap_frame_rate"):
        load_amass(path)
    path.write_text("no archive")
    with pytest.raises(ConfigError, match="cannot read"):
        load_amass(path)
    with pytest.raises(ConfigError, match="cannot read"):
        read_bvh(tmp_path / "nowhere.bvh")
    with pytest.raises(ConfigError, match="at least one frame"):
        Clip(30.0, np.zeros((0, 55, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)), 0.8)


def test_a_clip_is_cut_to_the_range_of_the_person_and_says_by_how_much() -> None:
    motion = waving("caregiver")
    turns = np.array([joint_rotations(angles) for angles in motion.angles])
    world = np.array([matrix_from_quaternion(q) for q in motion.quaternions])
    clip = Clip(30.0, turns, motion.pelvis, world, leg_length(body("caregiver").joints))
    karan = load_avatar("karan")
    found = clip.fit(body("karan"), karan.profile)
    limits = karan.profile.limits("passive")
    low, high = np.array([limits[dof.name] for dof in DOFS]).T
    assert (found.angles >= low).all() and (found.angles <= high).all()
    assert found.excess > 0.1
    ratio = leg_length(body("karan").joints) / leg_length(body("caregiver").joints)
    np.testing.assert_allclose(np.diff(found.pelvis[:, 0]), 0.02 * ratio, atol=1e-12)
    lowest = min(
        float(((points @ r[JOINT_INDEX[j]].T + p[JOINT_INDEX[j]]) @ up + z).min())
        for angles, q, z in zip(found.angles, found.quaternions, found.pelvis[:, 2], strict=True)
        for up in [matrix_from_quaternion(q)[2]]
        for r, p in [forward_kinematics(body("karan").joints, angles)]
        for j, points in sole_points(body("karan")).items()
    )
    assert lowest == pytest.approx(0, abs=1e-9)


def test_resampling_keeps_the_ends_and_the_way_between() -> None:
    motion = waving()
    again = motion.resampled(0.01)
    assert again.rate == pytest.approx(100) and again.duration == pytest.approx(motion.duration)
    np.testing.assert_allclose(again.angles[-1], motion.angles[-1], atol=1e-12)
    np.testing.assert_allclose(again.at(0.5)[0], motion.at(0.5)[0], atol=1e-12)
    moved = motion.placed(2.0, -1.0, 0.7)
    assert moved.pelvis[0, :2] == pytest.approx((2, -1))
    assert heading_of(moved.at(0.0)[1]) == pytest.approx(0.7)
    assert moved.pelvis[0, 2] == pytest.approx(motion.pelvis[0, 2])


def test_a_clip_plays_by_the_persons_own_strength_and_as_a_puppet() -> None:
    world = World()
    person = person_in(world, Pose(), ("right_shoulder", "right_elbow"))
    frames = 61
    start = np.array([person.angle(dof) for dof in DOF_INDEX])
    angles = np.tile(start, (frames, 1))
    angles[:, DOF_INDEX["right_elbow_flexion"]] += np.linspace(0, 0.9, frames)
    bent = angles[-1, DOF_INDEX["right_elbow_flexion"]]
    base = person.body.base_pose()
    pelvis = np.tile(base.position, (frames, 1))
    pelvis[:, 0] += np.linspace(0, 0.5, frames)
    motion = Motion(30.0, angles, pelvis, np.tile(base.quaternion, (frames, 1)))
    assert fitted(motion, person) is motion
    policy = play(motion, person, lambda: world.time, CONTROL_DT)
    policy.reset(np.random.default_rng(0))
    run_policy(world, person, policy, 2.5)
    assert person.angle("right_elbow_flexion") == pytest.approx(bent, abs=0.03)
    assert person.body.base_pose().position == pytest.approx(base.position)  # not the pelvis
    person.reset(np.random.default_rng(0))
    person.course = Puppet(person, motion, lambda: world.time)
    steps = 0
    while person.course is not None:
        person.actuate()
        world.step()
        steps += 1
    assert steps == pytest.approx(2.0 * 240, abs=2)
    assert person.body.base_pose().position == pytest.approx(pelvis[-1], abs=1e-6)
    assert person.angle("right_elbow_flexion") == pytest.approx(bent, abs=1e-3)
    person.reset(np.random.default_rng(0))
    assert person.body.base_pose().position == pytest.approx(base.position, abs=1e-9)


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
