"""Motion: trajectories, clips that come back as they were written, a walk, and a caregiver's hands."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from standing_person import CONTROL_DT, person_in, run_policy

from rcare_marl.agents.people.avatar import body_model, load_avatar
from rcare_marl.agents.people.body.posture import UPRIGHT
from rcare_marl.agents.people.body.skeleton import (
    DOF_INDEX,
    DOFS,
    DOFS_OF,
    JOINT_INDEX,
    JOINTS,
    forward_kinematics,
    joint_rotations,
)
from rcare_marl.agents.people.body.skin import BodyModel
from rcare_marl.agents.people.motion.amass import load_amass, save_amass
from rcare_marl.agents.people.motion.bvh import Bvh, read_bvh, write_bvh
from rcare_marl.agents.people.motion.clip import Clip, Motion, heading_of, leg_length, sole_points
from rcare_marl.agents.people.motion.decomposition import decompose
from rcare_marl.agents.people.motion.playback import Puppet, fitted, play
from rcare_marl.agents.people.motion.retarget import load_bvh, map_joints, save_bvh
from rcare_marl.agents.people.motion.trajectory import Trajectory, minimum_jerk
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import (
    Pose,
    axis_rotation,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from rcare_marl.world import World

Array = npt.NDArray[np.float64]


# Trajectories.


def test_minimum_jerk_starts_and_ends_at_rest() -> None:
    assert [minimum_jerk(s) for s in (-1, 0, 0.5, 1, 2)] == [0, 0, 0.5, 1, 1]
    h = 1e-4
    for s in (0.0, 1.0):  # neither speed nor acceleration at the ends
        inside = s + h if s == 0 else s - h
        assert abs(minimum_jerk(inside) - s) < 20 * h**3


def test_a_trajectory_goes_through_its_postures_no_faster_than_allowed() -> None:
    way = Trajectory.through(
        {"a": 0.0, "b": 1.0}, [{"a": 1.2}, {"a": 0.4, "b": 0.0}, {"b": 0.0}], speed=0.5
    )
    for time, wanted in zip(way.times, ((0, 1), (1.2, 1), (0.4, 0), (0.4, 0)), strict=True):
        assert way.sample(float(time)) == pytest.approx({"a": wanted[0], "b": wanted[1]})
    times = np.linspace(0, way.duration, 2000)
    angles = np.array([list(way.sample(float(time)).values()) for time in times])
    fastest = np.abs(np.diff(angles, axis=0) / np.diff(times)[:, None]).max()
    assert 0.49 < fastest <= 0.5 + 1e-9
    assert way.sample(1e9) == way.sample(way.duration)


def test_a_person_follows_a_trajectory_to_its_end_and_rests_there() -> None:
    world = World()
    person = person_in(world, Pose(), ("right_shoulder_flexion", "right_elbow_flexion"))
    goal = {"right_shoulder_flexion": 0.6, "right_elbow_flexion": 1.2}
    way = Trajectory.to(person, goal)

    class Following:
        def reset(self, rng: np.random.Generator) -> None: ...

        def act(self) -> Array:
            return person.action_towards(way.sample(world.time + CONTROL_DT), CONTROL_DT)

    run_policy(world, person, Following(), 4.0)
    for dof, angle in goal.items():
        assert person.angle(dof) == pytest.approx(angle, abs=0.03)
    assert max(map(abs, person.velocities)) < 0.02


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
    names = [
        "mixamorig:Hips",
        "mixamorig:Spine",
        "mixamorig:Spine1",
        "mixamorig:Spine2",
        "mixamorig:Neck",
        "mixamorig:Head",
    ]
    parents, offsets = [-1, 0, 1, 2, 3, 4], [(0, 100, 0), *[(0, 12, 0)] * 5]
    for side, x in (("Left", 1), ("Right", -1)):
        for name, parent, offset in (
            ("UpLeg", 0, (9 * x, -5, 0)),
            ("Leg", None, (0, -45, 0)),
            ("Foot", None, (0, -45, 0)),
            ("ToeBase", None, (0, -6, 14)),
            ("Shoulder", 3, (4 * x, 8, 0)),
            ("Arm", None, (12 * x, 0, 0)),
            ("ForeArm", None, (20 * x, -20, 0)),
            ("Hand", None, (18 * x, -18, 0)),
        ):
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
        Bvh(
            tuple(names),
            tuple(parents),
            np.array(offsets, np.float64),
            tuple(channels),
            0.1,
            values,
        ),
    )
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
    with pytest.raises(ConfigError, match="no file of a motion"):
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
    puppet = Puppet(person, motion, lambda: world.time)
    steps = 0
    while not puppet.is_over:
        puppet.advance()
        world.step()
        steps += 1
    assert steps == pytest.approx(2.0 * 240, abs=2)
    assert person.body.base_pose().position == pytest.approx(pelvis[-1], abs=1e-6)
    assert person.angle("right_elbow_flexion") == pytest.approx(bent, abs=1e-3)
    person.reset(np.random.default_rng(0))
    assert person.body.base_pose().position == pytest.approx(base.position, abs=1e-9)
