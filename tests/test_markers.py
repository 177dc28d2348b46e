"""Markers lie where they should, follow what carries them, and are found in pictures."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
import pytest
from variants import every, few

from rcare_marl import assets
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.sensing.marker import Marker, MarkerConfig, fasten
from rcare_marl.agents.sensing.marker_detector import Detection, detect, two_poses
from rcare_marl.agents.sensing.marker_print import DICTIONARIES, cells, plate_edge
from rcare_marl.agents.sensing.marker_sensor import photograph
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, UnknownNameError, WorldError
from rcare_marl.pose import Pose, quaternion_from_rpy, rotation_vector
from rcare_marl.rendering import Camera, Renderer, make_renderer
from rcare_marl.world import World


@pytest.fixture
def world() -> Iterator[World]:
    world = World()
    yield world
    world.close()


@pytest.fixture(scope="module")
def bench() -> Iterator[tuple[World, Marker, Renderer]]:
    """Return a marker of 50 mm that lies on its back 1 m above the floor, and a renderer."""
    world = World()
    marker = fasten(world, None, MarkerConfig(7, on="world", at=(0.0, 0.0, 1.0)))
    renderer = make_renderer(world)
    yield world, marker, renderer
    renderer.close()
    world.close()


def off(found: Detection, marker: Marker, camera: Camera) -> tuple[float, float]:
    """Return the errors of a detection in position [m] and orientation [deg]."""
    wrong = (camera.pose.inverse() @ marker.pose()).inverse() @ found.pose
    return (
        float(np.linalg.norm(wrong.position)),
        float(np.degrees(np.linalg.norm(rotation_vector(wrong.quaternion)))),
    )


def looking_down(tilt: float, azimuth: float, beside: tuple[float, float], turn: float) -> Camera:
    """Return a camera 0.6 m from the bench's marker, the angles in degrees, `beside` in metres."""
    t, a = np.radians(tilt), np.radians(azimuth)
    back = np.array((np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)))
    up = np.array((np.cos(np.radians(turn)), np.sin(np.radians(turn)), 0.0))
    up -= up @ back * back
    right = np.cross(up, back) / np.linalg.norm(up)
    target = np.array((0.0, 0.0, 1.0)) + beside[0] * right + beside[1] * up / np.linalg.norm(up)
    eye = target + 0.6 * back
    return Camera(tuple(eye.tolist()), tuple(target.tolist()), tuple(up.tolist()), fov_deg=45.0)


@pytest.mark.needs_gl
@pytest.mark.parametrize("tilt", few((0, 2, 5, 10, 20, 35, 50, 60), 0, 60))
def test_a_pose_is_within_5_mm_and_2_degrees_at_60_cm(
    bench: tuple[World, Marker, Renderer], tilt: float
) -> None:
    _, marker, renderer = bench
    places = ((20, (0.0, 0.0), 77), (200, (0.14, 0.09), 10), (95, (-0.1, 0.05), 45), (0, (0, 0), 0))
    for azimuth, beside, turn in places:
        camera = looking_down(tilt, azimuth, beside, turn)
        image, seen_by = photograph(renderer, camera)
        (found,) = detect(image, seen_by, {7: 0.05})
        distance, angle = off(found, marker, camera)
        assert distance < 0.005
        assert angle < 2.0


def test_without_opengl_a_pose_is_within_5_mm_and_2_degrees_too(world: World) -> None:
    marker = fasten(world, None, MarkerConfig(7, on="world", at=(0.0, 0.0, 1.0)))
    renderer = make_renderer(world, "software")
    for tilt, azimuth, beside, turn in (
        (20, 200, (0.14, 0.09), 10),
        (35, 95, (-0.1, 0.05), 45),
        (50, 20, (0, 0), 77),
    ):
        camera = looking_down(tilt, azimuth, beside, turn)
        image, seen_by = photograph(renderer, camera, look="plain", count=4)
        (found,) = detect(image, seen_by, {7: 0.05})
        distance, angle = off(found, marker, camera)
        assert distance < 0.005
        assert angle < 2.0
    renderer.close()


def test_of_two_poses_that_look_alike_the_true_one_is_taken(
    bench: tuple[World, Marker, Renderer],
) -> None:
    _, marker, renderer = bench
    camera = looking_down(30, 140, (0.02, -0.03), 15)
    image, seen_by = photograph(renderer, camera)
    (found,) = detect(image, seen_by, {7: 0.05})
    both = two_poses(found.corners, 0.05, seen_by.K)
    tilts = [
        np.degrees(np.arccos(-rotation[:, 2] @ place / np.linalg.norm(place)))
        for rotation, place in both
    ]
    assert len(both) == 2
    assert np.allclose(tilts, 30, atol=3)  # they lean alike, to different sides
    turned = both[0][0].T @ both[1][0]
    assert np.degrees(np.arccos((np.trace(turned) - 1) / 2)) > 30
    assert off(found, marker, camera)[1] < 2
    assert found.ambiguity < 0.9


@pytest.mark.parametrize("backend", [pytest.param("gl", marks=pytest.mark.needs_gl), "software"])
def test_pixels_are_counted_as_opencv_counts_them(world: World, backend: Any) -> None:
    """A shift by half a pixel, 0.7 mm here, would show in every place alike."""
    marker = fasten(world, None, MarkerConfig(7, on="world", size=0.1, at=(0.0, 0.0, 1.0)))
    renderer = make_renderer(world, backend)
    shifts = []
    for turn in (12, 103, 197, 288):  # against what the renderer's samples do to each edge
        camera = looking_down(20, 3 * turn, (0.05, 0.03), turn)
        image, seen_by = photograph(renderer, camera, look="plain", count=4)
        (found,) = detect(image, seen_by, {7: 0.1})
        true = seen_by.project(marker.corners())[:, :2]
        shifts.append((found.corners - true).mean(axis=0))
    renderer.close()
    assert np.abs(np.mean(shifts, axis=0)).max() < 0.05


@pytest.mark.parametrize("dictionary", every(3, DICTIONARIES))
def test_every_dictionary_can_be_printed_and_read(world: World, dictionary: str) -> None:
    config = MarkerConfig(3, on="world", size=0.2, dictionary=dictionary, at=(0.0, 0.0, 1.0))
    marker = fasten(world, None, config)
    renderer = make_renderer(world)
    camera = looking_down(25, 60, (0.0, 0.0), 30)
    found = detect(renderer.render(camera), camera, {3: 0.2}, dictionary=dictionary)
    renderer.close()
    assert [f.id for f in found] == [3]
    distance, angle = off(found[0], marker, camera)
    assert distance < 0.005 and angle < 2


@pytest.mark.needs_gl  # in software a detector misses one of so small ones
def test_only_the_markers_asked_for_are_reported_by_rising_number(world: World) -> None:
    for i, number in enumerate((9, 2, 5)):
        fasten(world, None, MarkerConfig(number, on="world", at=(0.1 * (i - 1), 0.0, 1.0)))
    renderer = make_renderer(world)
    camera = looking_down(15, 0, (0.0, 0.0), 90)
    image = renderer.render(camera)
    renderer.close()
    assert [f.id for f in detect(image, camera, {5: 0.05, 2: 0.05, 9: 0.05})] == [2, 5, 9]
    assert [f.id for f in detect(image, camera, {9: 0.05, 4: 0.05})] == [9]
    assert detect(image, camera, {9: 0.05}, dictionary="7x7_50") == []


def test_a_picture_gives_the_same_poses_each_time(bench: tuple[World, Marker, Renderer]) -> None:
    _, _, renderer = bench
    camera = looking_down(35, 10, (0.0, 0.05), 3)
    twice = [detect(renderer.render(camera), camera, {7: 0.05})[0] for _ in range(2)]
    assert twice[0].pose == twice[1].pose
    assert (twice[0].corners == twice[1].corners).all()


def test_a_hidden_marker_is_not_seen(world: World) -> None:
    fasten(world, None, MarkerConfig(7, on="world", at=(0.0, 0.0, 1.0)))
    cover = world.add_box((0.1, 0.1, 0.01), Pose((0.0, 0.0, 0.5)), name="cover")
    renderer = make_renderer(world)
    camera = looking_down(15, 0, (0.0, 0.0), 0)
    assert len(detect(renderer.render(camera), camera, {7: 0.05})) == 1
    cover.set_base(Pose((0.0, 0.0, 1.03)))
    assert detect(renderer.render(camera), camera, {7: 0.05}) == []
    renderer.close()


def test_from_behind_a_marker_is_a_blank_card(world: World) -> None:
    fasten(world, None, MarkerConfig(7, on="world", at=(0.0, 0.0, 1.0), rpy_deg=(180.0, 0.0, 0.0)))
    renderer = make_renderer(world)
    camera = looking_down(15, 0, (0.0, 0.0), 0)
    assert detect(renderer.render(camera), camera, {7: 0.05}) == []
    renderer.close()


def test_a_marker_goes_where_its_carrier_goes_and_back_with_the_world(world: World) -> None:
    box = world.add_box((0.2, 0.2, 0.2), Pose((0.0, 0.0, 2.0)), mass=1.0)
    marker = fasten(world, box, MarkerConfig(7, on="base", at=(0.0, 0.0, 0.101)))
    world.mark_start()
    start = marker.pose()
    for _ in range(60):
        world.step()
    fallen = marker.pose()
    assert start.position[2] - fallen.position[2] > 0.25
    assert fallen == box.base_pose() @ Pose((0.0, 0.0, 0.101))
    world.rewind()
    assert marker.pose() == start
    for _ in range(60):
        world.step()
    assert marker.pose() == fallen


def test_a_marker_touches_nothing_and_weighs_nothing(world: World) -> None:
    def fall(with_marker: bool) -> tuple[Any, int]:
        here = World()
        here.add_box((1.0, 1.0, 0.1))
        box = here.add_box(
            (0.2, 0.2, 0.2),
            Pose((0.0, 0.0, 0.5), tuple(quaternion_from_rpy(0.3, 0.2, 0))),
            mass=1.0,
        )
        touching = 0
        if with_marker:  # below the box, where it lands first
            marker = fasten(here, box, MarkerConfig(7, on="base", at=(0.0, 0.0, -0.15)))
        for _ in range(200):
            here.step()
            touching += len(here.contacts(marker.body)) if with_marker else 0
        pose = box.base_pose()
        here.close()
        return pose, touching

    assert fall(True) == (fall(False)[0], 0)


def test_a_marker_cannot_be_moved_by_hand(world: World) -> None:
    marker = fasten(world, None, MarkerConfig(7, on="world"))
    with pytest.raises(WorldError, match="fastened"):
        marker.body.set_base(Pose())


def test_the_print_has_the_size_that_was_asked_for(world: World) -> None:
    marker = fasten(world, None, MarkerConfig(7, on="world", size=0.06, at=(1.0, 2.0, 3.0)))
    corners = marker.corners()
    assert np.allclose(np.linalg.norm(np.diff(corners, axis=0), axis=1), 0.06)
    assert np.allclose(corners.mean(axis=0), (1, 2, 3))
    assert plate_edge("4x4_50", 0.06) == pytest.approx(0.08)
    assert cells("4x4_50", 7).shape == (8, 8)
    shapes = marker.body.visual_shapes()
    assert len(shapes) == 2  # white and black


@pytest.fixture(scope="module")
def seated() -> Iterator[tuple[World, Human, list[Marker]]]:
    """Return Karan in a wheelchair posture, with a marker on every limb."""
    world = World()
    person = Human("person", load_avatar("karan"), posture=load_posture("wheelchair"))
    person.spawn(world, Pose((0.0, 0.0, 0.5)))
    limbs = [f"{s}_{j}" for s in ("left", "right") for j in ("shoulder", "elbow", "hip", "knee")]
    markers = [fasten(world, person, MarkerConfig(i, on=on)) for i, on in enumerate(limbs)]
    markers.append(fasten(world, person, MarkerConfig(20, on="spine3")))
    world.mark_start()
    yield world, person, markers
    world.close()


def depth_below(person: Human, world: World, marker: Marker) -> float:
    """Return how far the skin rises through the plate of a marker [m]; negative for a gap."""
    surface = world.skins[0].vertices().astype(np.float64)
    local = (
        marker.pose().inverse().matrix() @ np.column_stack((surface, np.ones(len(surface)))).T
    )[:3]
    half = plate_edge("4x4_50", marker.config.size) / 2
    under = (np.abs(local[:2]) < half).all(axis=0) & (np.abs(local[2]) < 0.03)
    return float(local[2][under].max())


def test_markers_lie_on_the_skin_and_not_in_it(seated: tuple[World, Human, list[Marker]]) -> None:
    world, person, markers = seated
    world.rewind()
    for marker in markers:
        assert -0.004 < depth_below(person, world, marker) < 0.0, marker.config.on


@pytest.mark.slow
@pytest.mark.parametrize("posture", ["wheelchair", "standing"])
def test_nobodys_skin_lies_over_a_marker_that_found_its_own_place(posture: str) -> None:
    for name in assets.names("avatars"):
        world = World()
        person = Human("person", load_avatar(name), posture=load_posture(posture))
        person.spawn(world, Pose((0.0, 0.0, 0.5)))
        surface = world.skins[0].vertices().astype(np.float64)
        for i, on in enumerate(
            (*product(("left", "right"), ("shoulder", "elbow", "hip", "knee")),)
        ):
            marker = fasten(world, person, MarkerConfig(i, on="_".join(on)))
            pose = marker.pose().matrix()
            local = (surface - pose[:3, 3]) @ pose[:3, :3]
            over = (np.abs(local[:, :2]) < plate_edge("4x4_50", 0.05) / 2).all(axis=1)
            assert not (over & (local[:, 2] > 0.0) & (local[:, 2] < 0.07)).any(), (name, on)
        world.close()


def test_a_persons_marker_faces_outwards_and_stands_along_the_bone(
    seated: tuple[World, Human, list[Marker]],
) -> None:
    world, person, markers = seated
    world.rewind()
    by_segment = {marker.config.on: marker.pose().matrix() for marker in markers}
    for side, sign in (("left", 1.0), ("right", -1.0)):  # the person looks along x
        assert sign * by_segment[f"{side}_shoulder"][1, 2] > 0.8
        for joint, child in (("shoulder", "elbow"), ("hip", "knee")):
            start, end = (person.joint_pose(f"{side}_{j}").position for j in (joint, child))
            bone = np.subtract(start, end) / np.linalg.norm(np.subtract(start, end))
            assert by_segment[f"{side}_{joint}"][:3, 1] @ bone > 0.8
    assert by_segment["spine3"][0, 2] > 0.8


def test_a_persons_marker_follows_the_limb(seated: tuple[World, Human, list[Marker]]) -> None:
    world, person, markers = seated
    world.rewind()
    (marker,) = (m for m in markers if m.config.on == "left_elbow")
    before = person.joint_pose("left_elbow").inverse() @ marker.pose()
    start = marker.pose()
    person.set_angles({"left_elbow_flexion": 1.6, "left_shoulder_abduction": 0.5})
    after = person.joint_pose("left_elbow").inverse() @ marker.pose()
    assert np.linalg.norm(np.subtract(marker.pose().position, start.position)) > 0.03
    assert np.allclose(after.position, before.position, atol=1e-9)
    assert np.allclose(after.quaternion, before.quaternion, atol=1e-9)
    world.rewind()
    assert marker.pose() == start


def test_a_bent_elbow_does_not_swallow_its_marker(
    seated: tuple[World, Human, list[Marker]],
) -> None:
    world, person, markers = seated
    world.rewind()
    (marker,) = (m for m in markers if m.config.on == "left_elbow")
    for flexion in (0.1, 0.6, 1.2):
        person.set_angles({"left_elbow_flexion": flexion})
        assert depth_below(person, world, marker) < 0.005
    world.rewind()


def test_a_spot_on_the_skin_can_be_chosen(world: World) -> None:
    person = Human("person", load_avatar("karan"), posture=load_posture("wheelchair"))
    person.spawn(world, Pose((0.0, 0.0, 0.5)))
    front = fasten(world, person, MarkerConfig(1, on="left_elbow", at=(0.1, 0.0, 0.1)))
    turned = fasten(
        world,
        person,
        MarkerConfig(2, on="left_elbow", at=(0.1, 0.0, 0.1), rpy_deg=(0.0, 0.0, 30.0)),
    )
    local = person.joint_pose("left_elbow").inverse() @ front.pose()
    assert local.position[0] == pytest.approx(0.1, abs=0.02)
    assert 0.02 < local.position[2] < 0.07
    assert local.matrix()[2, 2] > 0.8
    assert turned.pose().position == pytest.approx(front.pose().position)
    between = front.pose().inverse() @ turned.pose()
    assert rotation_vector(between.quaternion) == pytest.approx((0, 0, np.radians(30)), abs=1e-6)
    with pytest.raises(ConfigError, match="bone"):
        fasten(world, person, MarkerConfig(3, on="left_elbow", at=(0.0, 0.0, 0.0)))
    with pytest.raises(
        ConfigError, match="marker 3 on 'person': segment 'left_eye_smplhf' has no skin"
    ):
        fasten(world, person, MarkerConfig(3, on="left_eye_smplhf"))
    with pytest.raises(UnknownNameError, match="left_elbow"):
        fasten(world, person, MarkerConfig(3, on="left_elbo"))


@pytest.mark.parametrize(
    ("options", "message"),
    (
        ({"id": 50, "on": "tool"}, "0 to 49"),
        ({"id": -1, "on": "tool"}, "0 to 49"),
        ({"id": 7, "on": "tool", "size": 0.0}, "size"),
        ({"id": 7, "on": "tool", "dictionary": "4x4"}, "4x4_50"),
        ({"id": 7, "on": "tool", "rpy_deg": [0.0, float("nan"), 0.0]}, "finite"),
        ({"id": 7, "onn": "tool"}, "'on'"),
        ({"on": "tool"}, "missing id"),
        ({"id": 7}, "missing on"),
    ),
)
def test_an_impossible_marker_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        load(MarkerConfig, options)


def test_impossible_requests_to_the_detector_are_refused() -> None:
    camera = Camera((0.0, 0.0, 1.0), (0.0, 0.1, 0.0), width=40, height=30)
    image = np.zeros((30, 40, 3), np.uint8)
    assert detect(image, camera, {1: 0.05}) == []
    with pytest.raises(ConfigError, match="30 rows and 40 columns"):
        detect(np.zeros((40, 30, 3), np.uint8), camera, {1: 0.05})
    with pytest.raises(ConfigError, match="positive"):
        detect(image, camera, {1: 0.0})
    with pytest.raises(UnknownNameError, match="4x4_50"):
        detect(image, camera, {1: 0.05}, dictionary="4x4_5")


def test_what_carries_a_marker_must_exist(world: World) -> None:
    box: Body = world.add_box((0.1, 0.1, 0.1))
    with pytest.raises(UnknownNameError, match="lid"):
        fasten(world, box, MarkerConfig(1, on="lid"))
    with pytest.raises(ConfigError, match="of whom"):
        fasten(world, None, MarkerConfig(1, on="lid"))
