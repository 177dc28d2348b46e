"""A person: skeleton, masses, ranges, strength, and a drive that never drifts or blows up."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt
import pytest
from variants import every

from rcare_marl import assets
from rcare_marl.agents.people.actuation.skeletal import SkeletalDrive
from rcare_marl.agents.people.avatar import (
    AvatarConfig,
    load_avatar,
    load_posture,
    person_urdf,
)
from rcare_marl.agents.people.body.posture import Bearing
from rcare_marl.agents.people.body.skeleton import (
    DOF_INDEX,
    DOFS,
    EYES,
    JOINT_INDEX,
    JOINTS,
    PARENTS,
    SIDES,
    forward_kinematics,
)
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.profile import clinical_norms
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose
from rcare_marl.world import GRAVITY, World

AVATARS = assets.names("avatars")
# In the others something hangs, and goes where gravity lets it.
POSTURES = [n for n in assets.names("postures") if load_posture(n).supported == "all"]
Array = npt.NDArray[np.float64]


def spawned(
    avatar: str = "karan",
    posture: str = "wheelchair",
    movable: tuple[str, ...] | None = None,
    *,
    fixed: bool = True,
) -> tuple[World, Human]:
    world = World()
    human = Human(
        "recipient",
        load_avatar(avatar),
        posture=load_posture(posture),
        movable=movable,
        fixed_base=fixed,
    )
    human.use_arm_rests(Pose((0.25, 0.26, 0.77)), Pose((0.25, -0.26, 0.77)))
    human.spawn(world, Pose((0, 0, 0.5)))
    human.reset(np.random.default_rng(0))
    return world, human


def run(world: World, human: Human, seconds: float) -> Array:
    """Return the greatest joint speed seen once a tenth of a second [rad/s]."""
    speeds = []
    for step in range(round(seconds / world.physics_dt)):
        human.actuate()
        world.step()
        if step % 24 == 23:
            human.sense()
            speeds.append(max(map(abs, human.velocities)))
    human.sense()
    return np.array(speeds)


# The skeleton.


def test_the_skeleton_is_that_of_smplx_with_112_degrees_of_freedom() -> None:
    assert len(JOINTS) == len(PARENTS) == 55
    assert JOINTS[:3] == ("pelvis", "left_hip", "right_hip") and JOINTS[22] == "jaw"
    assert len(DOFS) == 112 == 24 * 3 + 40
    assert all(parent < child for child, parent in enumerate(PARENTS))


@cache
def joints_of_karan() -> Array:
    """Return the joint centres in the T-pose [m], shape [55, 3]."""
    world, human = spawned(movable=())
    world.close()
    return human.model.joints


def posed(**degrees: float) -> Array:
    """Return joint positions of Karan's body in the anatomical position but for some DoFs [deg]."""
    angles = np.array([-dof.clinical_zero for dof in DOFS])
    for name, value in degrees.items():
        angles[DOF_INDEX[name]] += np.radians(value)
    return forward_kinematics(joints_of_karan(), angles)[1]


UP, FORWARD, OUT_LEFT = np.array((0, 1, 0)), np.array((0, 0, 1)), np.array((1, 0, 0))


@pytest.mark.parametrize(
    ("dof", "degrees", "end", "direction"),
    [
        ("elbow_flexion", 60, "wrist", FORWARD),
        ("shoulder_flexion", 60, "elbow", FORWARD),
        ("shoulder_abduction", 60, "elbow", OUT_LEFT),
        ("hip_flexion", 60, "knee", FORWARD),
        ("hip_abduction", 30, "knee", OUT_LEFT),
        ("knee_flexion", 60, "ankle", -FORWARD),
        ("ankle_dorsiflexion", 20, "foot", UP),
        ("collar_elevation", 20, "shoulder", UP),
    ],
)
def test_a_positive_angle_is_the_motion_that_the_dof_is_named_by(
    dof: str, degrees: float, end: str, direction: Array
) -> None:
    rest = posed()
    for side, mirror in (("left", 1.0), ("right", -1.0)):
        moved = posed(**{f"{side}_{dof}": degrees}) - rest
        shift = moved[JOINT_INDEX[f"{side}_{end}"]] * (mirror, 1.0, 1.0)
        assert shift @ direction > 0.02
        assert abs(moved[JOINT_INDEX[f"{'right' if side == 'left' else 'left'}_{end}"]]).max() == 0


def test_the_trunk_and_head_bend_the_way_they_say() -> None:
    rest, head = posed(), JOINT_INDEX["head"]
    assert (posed(spine1_flexion=30) - rest)[head] @ FORWARD > 0.1
    assert (posed(spine1_lateral_flexion_left=20) - rest)[head] @ OUT_LEFT > 0.1
    assert (posed(spine1_rotation_left=30) - rest)[JOINT_INDEX["left_shoulder"]] @ FORWARD < -0.05
    eye = JOINT_INDEX["left_eye_smplhf"]
    assert (posed(head_flexion=20) - rest)[eye] @ UP < -0.01


# The URDFs.


@pytest.mark.parametrize("avatar", AVATARS)
def test_segment_masses_sum_to_the_weight(avatar: str) -> None:
    config = load_avatar(avatar)
    for movable in (None, ("head", "jaw_opening"), ()):
        root = ElementTree.fromstring(person_urdf(config, "passive", movable=_names(movable)).text)
        masses = [float(mass.get("value", "nan")) for mass in root.iter("mass")]
        assert sum(masses) == pytest.approx(config.mass_kg, rel=1e-4)


def _names(movable: tuple[str, ...] | None) -> list[str] | None:
    if movable is None:
        return None
    return [d.name for d in DOFS if d.joint in movable or d.name in movable]


@pytest.mark.parametrize("avatar", AVATARS)
def test_arom_lies_inside_prom_for_52_joints(avatar: str) -> None:
    config = load_avatar(avatar)
    active, passive = (
        {
            joint.get("name"): tuple(
                float(joint.find("limit").get(end, "nan"))  # type: ignore[union-attr]
                for end in ("lower", "upper")
            )
            for joint in ElementTree.fromstring(person_urdf(config, kind).text).iter("joint")
        }
        for kind in ("active", "passive")
    )
    assert active.keys() == passive.keys() and len(active) == 112
    joints = {dof.joint for dof in DOFS if dof.joint not in EYES}
    assert len(joints) == 52
    for name, (low, high) in active.items():
        assert passive[name][0] - 1e-6 <= low <= high <= passive[name][1] + 1e-6


def test_inertias_are_physical() -> None:
    for avatar in AVATARS:
        root = ElementTree.fromstring(person_urdf(load_avatar(avatar), "passive").text)
        for tensor in root.iter("inertia"):
            i = {k: float(v) for k, v in tensor.items()}
            matrix = [
                [i["ixx"], i["ixy"], i["ixz"]],
                [i["ixy"], i["iyy"], i["iyz"]],
                [i["ixz"], i["iyz"], i["izz"]],
            ]
            a, b, c = np.linalg.eigvalsh(matrix)
            assert a > 0 and c <= (a + b) * 1.001  # the triangle inequality


def test_limb_shapes_follow_the_skin() -> None:
    _, human = spawned(movable=())
    owner = human.model.owner
    for joint in ("left_shoulder", "right_elbow", "left_hip", "right_knee", "head", "spine3"):
        index = JOINT_INDEX[joint]
        points = human.model.vertices[owner == index] - human.model.joints[index]
        shapes = human.segments[joint].shapes
        gaps = [min(abs(s.distance(p)) for s in shapes) for p in points[::10].astype(float)]
        assert np.median(gaps) < 0.04  # clothes and hair lie off the body


# Range and strength.


def test_a_deficit_of_extension_is_a_range_that_starts_flexed() -> None:
    low, high = load_avatar("karan").profile.limits("passive")["left_elbow_flexion"]
    assert np.degrees((low, high)) == pytest.approx((15, 140))


def test_each_side_has_its_own_ability() -> None:
    profile = load_avatar("karan").profile
    limits, (_, strength) = profile.limits("active"), profile.strength("male")
    left, right = (DOF_INDEX[f"{side}_elbow_flexion"] for side in SIDES)
    assert limits["left_shoulder_flexion"][1] < limits["right_shoulder_flexion"][1]
    assert strength[left] == pytest.approx(0.6 * strength[right])  # of the norms: grade 3 of 5


def test_the_muscle_never_exceeds_its_strength_nor_moves_beyond_the_active_range() -> None:
    world, human = spawned(movable=("right_elbow_flexion",))
    action = np.ones(1)
    most = clinical_norms().motions["elbow_flexion"].torque
    for _ in range(60):
        human.command(action, 0.1)
        for _ in range(24):
            position, velocity = human.body.joint_states(human._joints)
            torque = human.drive.torques(position, velocity, human._gravity)
            assert abs(torque[0]) <= most * 1.01 + 2.0 * abs(velocity[0])
            human.actuate()
            world.step()
    human.sense()
    assert human.positions[0] == pytest.approx(human.active[0, 1], abs=0.02)


def test_a_paralysed_limb_does_not_follow_its_target() -> None:
    movable = ("left_elbow_flexion",)
    moved = {}
    for avatar in ("jose", "caregiver"):
        world, human = spawned(avatar, movable=movable)
        start = human.angle("left_elbow_flexion")
        for _ in range(10):
            human.command(np.ones(1), 0.1)
            run(world, human, 0.1)
        moved[avatar] = abs(human.angle("left_elbow_flexion") - start)
    assert moved["jose"] < 0.02 < 0.3 < moved["caregiver"]


def test_furniture_does_not_move_a_paralysed_person() -> None:
    """Held by the chair or not: without strength no action moves a limb, whatever its range."""
    avatar = load_avatar("karan")
    axial = dataclasses.replace(
        avatar.profile.axial, mmt={"trunk": 0, "neck_flexors": 0, "neck_extensors": 0}, arom_deg={}
    )
    profile = dataclasses.replace(avatar.profile, axial=axial)
    world = World()
    human = Human(
        "recipient",
        dataclasses.replace(avatar, profile=profile),
        posture=load_posture("wheelchair"),
        movable=("spine1", "neck", "head"),
    )
    human.spawn(world, Pose((0, 0, 0.5)))
    human.reset(np.random.default_rng(0))
    for _ in range(10):
        human.command(np.ones(human.action_size), 0.1)
        run(world, human, 0.1)
    assert np.abs(np.array(human.positions) - human._start).max() < 0.01


def test_a_weak_muscle_moves_a_held_limb_a_little() -> None:
    world, human = spawned("kim", movable=("left_elbow_flexion",))
    assert isinstance(human.drive, SkeletalDrive)
    assert human.drive._table[0, 33] == 1.0  # extensors of grade 2: furniture holds the forearm
    start = human.angle("left_elbow_flexion")
    for _ in range(10):
        human.command(np.ones(1), 0.1)
        run(world, human, 0.1)
    strength = human.drive._table[0, 32]
    limit = strength / human.drive._table[0, 28]
    assert 0.02 < human.angle("left_elbow_flexion") - start < limit + 0.02


def test_pushed_hard_a_joint_stops_at_its_passive_range() -> None:
    world, human = spawned("karan", movable=("left_elbow_flexion",))
    hand = human.body.link_index("left_elbow")
    for _ in range(480):
        human.actuate()
        pose = human.body.link_pose(hand)
        tip = np.add(pose.position, 0.2 * pose.matrix()[:3, 0])
        human.body.apply_force(hand, (0, 0, 80), tip.tolist())
        world.step()
    assert human.angle("left_elbow_flexion") <= human.passive[0, 1] + np.radians(2)


# The drive.


def test_the_drive_knows_the_weight_of_every_limb() -> None:
    """The torque against gravity is the gradient of the potential energy."""
    _, human = spawned(movable=("spine1", "left_shoulder", "left_elbow", "neck"))
    chain_angles = np.array(human.body.joint_states(human._joints)[0])
    human.drive.target[:] = chain_angles
    free = human.drive
    assert isinstance(free, SkeletalDrive)
    free._table[:, 31:33] = 1e9  # no limit of strength

    def energy(angles: Array) -> float:
        human.body.set_joints(human._joints, angles)
        total = 0.0
        for joint in JOINTS:
            segment, frame = human.segments[joint], human.frames[JOINT_INDEX[joint]]
            here = human.body.link_pose(frame.link).matrix()
            centre = frame.rotation @ segment.centre + frame.offset
            total += segment.mass * GRAVITY * (here @ np.append(centre, 1.0))[2]
        return total

    slope = [
        (energy(chain_angles + 0.01 * e) - energy(chain_angles - 0.01 * e)) / 0.02
        for e in np.eye(len(chain_angles))
    ]
    still = [0.0] * len(chain_angles)
    torque = free.torques(chain_angles.tolist(), still, human._gravity)
    np.testing.assert_allclose(torque, slope, atol=0.01, rtol=1e-3)


@pytest.mark.parametrize(
    ("posture", "avatar"),
    [
        pytest.param(posture, avatar, marks=() if (i - j) % 3 == 0 else pytest.mark.slow)
        for i, posture in enumerate(POSTURES)
        for j, avatar in enumerate(("karan", "jose", "kim"))
    ],
)
def test_a_person_stays_as_they_were_put(avatar: str, posture: str) -> None:
    world, human = spawned(avatar, posture)
    speeds = run(world, human, 2.0)
    assert np.abs(np.array(human.positions) - human._start).max() < 0.02
    assert speeds.max() < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("avatar", AVATARS)
@pytest.mark.parametrize("posture", POSTURES)
def test_sixty_seconds_bring_no_drift_no_nan_and_no_energy(avatar: str, posture: str) -> None:
    world, human = spawned(avatar, posture)
    speeds = run(world, human, 60.0)
    assert np.isfinite(speeds).all()
    assert np.abs(np.array(human.positions) - human._start).max() < 0.02
    assert speeds[-10:].max() <= speeds[:10].max() + 1e-6
    assert speeds.max() < 0.1  # the reflex of Morgan's calves lowers the feet by half a degree


def test_a_hit_person_comes_to_rest_again() -> None:
    world, human = spawned("karan", "wheelchair")
    rng = np.random.default_rng(0)
    for _ in range(24):
        human.actuate()
        for link in range(0, human.body.link_count, 7):
            place = human.body.link_pose(link).position
            human.body.apply_force(link, rng.normal(0, 3, 3).tolist(), place)
        world.step()
    speeds = run(world, human, 6.0)
    assert np.isfinite(speeds).all()
    assert speeds[-1] < 0.02 < speeds[0]


def test_only_what_moves_costs_joints() -> None:
    _, human = spawned(movable=("head", "jaw_opening"))
    assert human.movable == (
        "head_flexion",
        "head_lateral_flexion_left",
        "head_rotation_left",
        "jaw_opening",
    )
    assert len(human.body.joints) == 4 == human.action_size == len(human.action_names)


def test_a_misspelt_joint_is_named() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'left_elbow'"):
        spawned(movable=("left_elbw",))
    _, human = spawned(movable=())
    with pytest.raises(UnknownNameError, match="jaw_opening"):
        human.angle("jaw_openin")


# Contacts and skin.


def test_contact_forces_are_told_by_segment_in_newtons() -> None:
    world, human = spawned("caregiver", "bed_supine", movable=())
    thigh = human.joint_pose("left_hip").matrix() @ np.append(0.5 * _thigh(human), 1.0)
    box = world.add_box((0.1, 0.1, 0.1), Pose((thigh[0], thigh[1], thigh[2] + 0.2)), mass=2.0)
    forces: dict[str, float] = {}
    while not forces and world.time < 2:
        world.step()
        forces = human.contact_forces(box)
    assert list(forces) == ["left_hip"]
    assert world.contact_force(human.body, box) == pytest.approx(sum(forces.values()))
    assert human.contact_forces(world.add_sphere(0.1, Pose((5, 5, 5)))) == {}


def _thigh(human: Human) -> Array:
    joints = human.model.joints
    return np.asarray(joints[JOINT_INDEX["left_knee"]] - joints[JOINT_INDEX["left_hip"]])


def test_the_skin_follows_the_joints_of_the_body() -> None:
    world, human = spawned(movable=("left_elbow_flexion", "head"))
    skin = world.skins[0]
    before = skin.vertices().copy()
    human.set_angles({"left_elbow_flexion": human.angle("left_elbow_flexion") + 0.4})
    moved = np.linalg.norm(skin.vertices() - before, axis=1)
    owner = human.model.owner
    assert moved[owner == JOINT_INDEX["left_middle3"]].min() > 0.05
    assert moved[owner == JOINT_INDEX["right_wrist"]].max() == 0.0


def test_the_mouth_follows_head_and_jaw() -> None:
    _, human = spawned(movable=("neck", "head", "jaw_opening"))
    mouth, face = human.mouth_and_face()
    assert face @ (1, 0, 0) > 0.9
    human.set_angles({"head_rotation_left": 0.4})
    turned, face_turned = human.mouth_and_face()
    assert turned[1] > mouth[1] + 0.02 and face_turned[1] > 0.3
    human.set_angles({"head_rotation_left": 0.0, "jaw_opening": 0.4})
    assert human.mouth_position()[2] < mouth[2] - 0.01


@pytest.mark.parametrize("avatar", every(3, AVATARS))
def test_forearms_lie_on_the_armrests_and_not_in_them(avatar: str) -> None:
    _, human = spawned(avatar)
    for side in set(SIDES) - set(human.posture.own_arms):
        elbow, wrist = (
            np.array(human.joint_pose(f"{side}_{j}").position) for j in ("elbow", "wrist")
        )
        radius = human.segments[f"{side}_elbow"].shapes[0].size[1]
        for point in (elbow, wrist):
            assert 0.77 + 0.5 * radius < point[2] < 0.77 + radius + 0.04


def test_karan_holds_a_fist_before_his_belly_and_leans_to_the_weak_side() -> None:
    _, human = spawned("karan")
    at = {j: np.array(human.joint_pose(j).position) for j in ("pelvis", "spine3", "left_wrist")}
    assert at["spine3"][1] > at["pelvis"][1] + 0.01  # to his left
    assert abs(at["left_wrist"][1] - at["pelvis"][1]) < 0.15 < at["left_wrist"][0] - at["pelvis"][0]
    assert human.angle("left_middle2_flexion") > 1.2 > human.angle("right_middle2_flexion")
    assert human.posture.own_arms == ("left",)


def test_a_bearing_is_cut_to_the_passive_range_and_leaves_out_what_the_posture_is_about() -> None:
    karan = load_avatar("karan")
    own = Bearing("a trial", {"elbow_flexion": 170, "left_wrist_flexion": 30}, ("sitting",))
    avatar = dataclasses.replace(karan, bearing=(own,))
    sits, hangs, stands = (
        Human("p", avatar, posture=load_posture(name))
        for name in ("wheelchair", "wheelchair_arm_out", "standing")
    )
    angles = sits.posture.angles(avatar.profile.limits("passive"))
    assert angles[DOF_INDEX["right_elbow_flexion"]] == pytest.approx(np.radians(145))
    assert angles[DOF_INDEX["left_elbow_flexion"]] == pytest.approx(np.radians(140))
    assert sits.posture.own_arms == ("left", "right") and hangs.posture.own_arms == ("right",)
    assert hangs.posture.angles_deg["left_elbow_flexion"] == 25
    assert stands.posture.own_arms == () and "left_wrist_flexion" not in stands.posture.angles_deg


@pytest.mark.parametrize(
    ("bearing", "message"),
    [
        ({"reason": "so", "angles_deg": {"left_elbow_flexon": 3}}, "left_elbow_flexion"),
        ({"reason": "so", "angles_deg": {"elbow_flexion": 200}}, "must lie in -180..180 deg"),
        ({"reason": "so", "angles_deg": {}}, "needs an angle"),
        ({"reason": " ", "angles_deg": {"elbow_flexion": 3}}, "needs its reason"),
        ({"reason": "so", "angles_deg": {"elbow_flexion": 3}, "postures": ["sittin"]}, "sitting"),
        ({"angles_deg": {"elbow_flexion": 3}}, "missing reason"),
    ],
)
def test_a_bearing_that_makes_no_sense_is_refused(bearing: dict[str, Any], message: str) -> None:
    own = {
        "name": "A",
        "condition": "none",
        "sex": "male",
        "height_m": 1.7,
        "mass_kg": 70,
        "body": "b",
    }
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        load(AvatarConfig, {**own, "bearing": [bearing]})
