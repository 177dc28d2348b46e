"""The camera source tells an upper body from the corners of its bands, and from pictures alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from variants import every

from rcare_marl.agents.coaching.exercise import Exercise, exercise_names, load_exercise
from rcare_marl.agents.coaching.imitation import Imitation
from rcare_marl.agents.coaching.recognition.recogniser import Frame, Repetition
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.sources.band_pose import BandPose, Layout
from rcare_marl.agents.coaching.sources.camera_source import (
    CameraReading,
    CameraSource,
    CardFinder,
    resting,
)
from rcare_marl.agents.coaching.sources.marker_band import Band, band_set
from rcare_marl.agents.coaching.sources.worn_band import wear
from rcare_marl.agents.coaching.upper_body import (
    ARM,
    MOTION_INDEX,
    SIDES,
    UpperBody,
    directions,
)
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.body.skeleton import DOFS
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.sensing.marker_print import cells
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose
from rcare_marl.rendering import Camera, Renderer, make_renderer
from rcare_marl.world import World

Array = npt.NDArray[np.float64]
SEAT = np.array((0.0, 0.0, 0.5))  # the hips of whoever is drawn here [m]
CAMERA = Camera((1.6, 0.1, 1.3), (0.0, 0.0, 1.05), fov_deg=47.6)


class Wearer:
    """Somebody who is nothing but bands: what a camera sees of them, with noise [pixel]."""

    def __init__(self, *, height: float = 1.7, careless: float = 0.0, noise: float = 0.3) -> None:
        self.bands = band_set()
        self._noise, self._rng = noise, np.random.default_rng(4)
        layout = Layout(self.bands)
        self.pose = BandPose.of(layout, UpperBody.of_height(height), height)
        worn = np.zeros(layout.size)
        worn[layout.first :] = careless * self._rng.standard_normal(layout.size - layout.first)
        worn[layout.first :].reshape(-1, 6)[:, 3:] *= 0.1  # radians and tenths of metres
        self.pose = self.pose.plus(worn)

    def seen(self, angles: Array, camera: Camera = CAMERA) -> dict[int, Array]:
        """Return corners [pixel] of the cards that face the camera by 65 degrees at most."""
        self.pose.set_angles(angles)
        out = {}
        for i, band in enumerate(self.bands):
            for face in band.faces:
                points = SEAT + self.pose.place(np.full(4, i), face.corners())
                across, up = points[1] - points[0], points[0] - points[3]
                normal = np.cross(across, up)
                sight = np.subtract(camera.eye, points.mean(axis=0))
                if normal @ sight > 0.42 * np.linalg.norm(normal) * np.linalg.norm(sight):
                    pixels = camera.project(points)[:, :2]
                    out[face.id] = pixels + self._rng.normal(0, self._noise, (4, 2))
        return out


def calibrated(wearer: Wearer, *, height: float | None = None) -> CameraSource:
    source = CameraSource(height=height)
    for k in range(31):
        assert source.follow(wearer.seen(resting()), CAMERA, k / 30) is None
    assert source.tracker is not None
    return source


def followed(source: CameraSource, wearer: Wearer, path: Array) -> list[Frame]:
    frames = []
    for k, angles in enumerate(path):
        frame = source.follow(wearer.seen(angles), CAMERA, 1.1 + k / 30)
        assert frame is not None
        frames.append(frame)
    return frames


def off_deg(found: Array, wanted: Array) -> dict[str, float]:
    a, b = directions(found), directions(wanted)
    return {part: float(np.degrees(np.arccos(np.clip(a[part] @ b[part], -1, 1)))) for part in b}


@pytest.mark.slow
@pytest.mark.parametrize("name", every(2, exercise_names()))
def test_arms_head_and_trunk_are_within_6_degrees_on_the_way(name: str) -> None:
    wearer, path = Wearer(careless=0.03), load_exercise(name).path()
    frames = followed(calibrated(wearer), wearer, path)
    for frame, angles in list(zip(frames, path, strict=True))[::10]:
        for part, off in off_deg(frame.angles, angles).items():
            assert off < 6.0, part
        for side in SIDES:
            elbow = MOTION_INDEX[f"{side}_elbow_flexion"]
            assert frame.angles[elbow] == pytest.approx(angles[elbow], abs=math.radians(9))


@pytest.mark.parametrize("height", (1.5, 1.85))
def test_the_stature_is_told_from_how_far_bands_hang_apart(height: float) -> None:
    source = calibrated(Wearer(height=height))
    assert source.height == pytest.approx(height, abs=0.06)


def judged(exercise: Exercise, path: Array) -> Repetition:
    wearer, rules = Wearer(careless=0.02), RuleRecogniser()
    rules.begin(exercise)
    still = np.tile(path[0], (15, 1))
    frames = followed(calibrated(wearer), wearer, np.concatenate((still, path, *4 * [still])))
    found = [done for frame in frames if (done := rules.update(frame).finished) is not None]
    assert len(found) == 1
    return found[0]


@pytest.mark.slow
def test_the_rules_take_its_frames_and_tell_a_right_repetition_from_half_of_one() -> None:
    exercise = load_exercise("lateral_raise")
    path = exercise.path()
    assert judged(exercise, path).right
    half = judged(exercise, path[0] + 0.5 * (path - path[0]))
    assert not half.right and "range" in half.errors


def test_a_hidden_arm_is_held_for_a_moment_and_then_unknown_and_found_again() -> None:
    wearer = Wearer()
    source, angles = calibrated(wearer), load_exercise("lateral_raise").keys[1]
    followed(source, wearer, resting() + np.linspace(0, 1, 30)[:, None] * (angles - resting()))
    arm, numbers = ARM["left"], range(10, 18)

    def look(time: float, *, hidden: bool) -> Array:
        seen = wearer.seen(angles)
        seen = {n: c for n, c in seen.items() if not (hidden and n in numbers)}
        frame = source.follow(seen, CAMERA, time)
        assert frame is not None
        return frame.angles

    for k in range(30):
        found = look(2.1 + k / 30, hidden=True)
        if k < 5:
            assert np.isfinite(found).all()
    assert np.isnan(found[arm]).all()
    assert np.isfinite(np.delete(found, np.arange(16)[arm])).all()
    for k in range(5):
        found = look(4.0 + k / 30, hidden=False)
    assert off_deg(found, angles)["left_arm"] < 4


def test_a_hidden_upper_arm_is_told_from_the_forearm() -> None:
    wearer = Wearer()
    source = calibrated(wearer, height=1.7)
    path = load_exercise("lateral_raise").path()[:50]
    for k, angles in enumerate(path):
        seen = {n: c for n, c in wearer.seen(angles).items() if n not in range(10, 14)}
        frame = source.follow(seen, CAMERA, 1.1 + k / 30)
    assert frame is not None
    assert off_deg(frame.angles, path[-1])["left_arm"] < 6


def test_a_robot_that_moves_its_head_sees_the_same() -> None:
    wearer, angles = Wearer(), resting()
    source = calibrated(wearer)
    moved = replace(CAMERA, eye=(1.5, -0.2, 1.2), target=(0.0, 0.1, 0.95))
    for k in range(10):
        frame = source.follow(wearer.seen(angles, moved), moved, 1.2 + k / 30)
    assert frame is not None
    assert max(off_deg(frame.angles, angles).values()) < 4


def test_nothing_is_told_without_a_calibration_or_for_a_frame_out_of_order() -> None:
    source = CameraSource()
    assert [source.follow({}, CAMERA, k / 10) for k in range(30)] == [None] * 30
    assert source.tracker is None
    wearer = Wearer()
    source = calibrated(wearer)
    assert source.follow(wearer.seen(resting()), CAMERA, 2.0) is not None
    assert source.follow(wearer.seen(resting()), CAMERA, 1.5) is None


def test_shoulders_move_with_the_arms_as_those_of_the_upper_body_do() -> None:
    body, rng = UpperBody.of_height(1.7), np.random.default_rng(2)
    pose = BandPose.of(Layout(band_set()), body, 1.7)
    for angles in rng.uniform(-0.3, 1.6, (20, 16)):
        pose.set_angles(angles)
        origins, points = pose.frames()[1], body.points(angles)
        ends = [points[f"{side}_{part}"] for part in ("shoulder", "elbow") for side in SIDES]
        assert origins[2:] == pytest.approx(np.array(ends), abs=1e-9)


def test_derivatives_are_those_of_the_places() -> None:
    layout, rng = Layout(band_set()), np.random.default_rng(0)
    pose = BandPose.of(layout, UpperBody.of_height(1.6), 1.6)
    pose = pose.plus(rng.normal(0, 0.3, layout.size))
    bands, local = rng.integers(0, len(layout.bands), 20), rng.normal(0, 0.1, (20, 3))
    _, slopes = pose.look(bands, local)
    step = 1e-6 * np.eye(layout.size)
    for k in range(layout.size):
        after, before = (pose.plus(s * step[k]).place(bands, local) for s in (1, -1))
        assert slopes[:, :, k] == pytest.approx((after - before) / 2e-6, abs=1e-6)
    vector = rng.normal(0, 0.2, layout.size)
    assert pose.plus(vector).minus(pose) == pytest.approx(vector)


def card_picture(number: int, *, smudged: bool) -> tuple[npt.NDArray[np.uint8], Array]:
    """Return a grey picture of a card, and the corners of its black square, 20 pixels apart."""
    cell = cells("4x4_50", number)
    if smudged:
        cell[2:4, 3] = 1 - cell[2:4, 3]
        cell[5, 5] = 1 - cell[5, 5]
    large = cv2.resize(cell * 200 + 20, (160, 160), interpolation=cv2.INTER_NEAREST)
    corners = 50 + 10 * np.array(((-1.0, -0.9), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)))
    rim = np.array(((20, 20), (140, 20), (140, 140), (20, 140)), np.float32) - 0.5
    turn = cv2.getPerspectiveTransform(rim, (8 * corners + 3.5).astype(np.float32))
    drawn = cv2.warpPerspective(large, turn, (800, 800), borderValue=120)
    image = cv2.resize(drawn, (100, 100), interpolation=cv2.INTER_AREA)
    return np.asarray(np.clip(image, 0, 255), np.uint8), corners


def test_a_card_that_cannot_be_read_is_found_where_it_is_expected_and_nowhere_else() -> None:
    finder = CardFinder()
    image, corners = card_picture(11, smudged=False)
    assert np.abs(finder.find(image)[11] - corners).max() < 1.0
    image, corners = card_picture(11, smudged=True)
    assert not finder.find(image)
    found = finder.find(image, {11: corners + 1.0})
    assert list(found) == [11]
    assert np.abs(found[11] - corners).max() < 1.0
    assert not finder.find(image, {11: corners + 20.0})
    assert not finder.find(image, {11: 50 + 1.5 * (corners - 50)})  # of another size
    assert not finder.find(image, {22: corners})  # another print


def test_bad_input_is_refused() -> None:
    with pytest.raises(ConfigError, match="stature"):
        CameraSource(height=3.0)
    with pytest.raises(ConfigError, match="recline"):
        CameraSource(recline=2.0)
    with pytest.raises(ConfigError, match="uint8"):
        CardFinder().find(np.zeros((4, 4)))  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="sizes"):
        band_set(size=0.0)
    with pytest.raises(ConfigError, match="flare"):
        band_set(flare_deg=90.0)
    face = band_set()[0].faces
    with pytest.raises(UnknownNameError, match="trunk"):
        Band("belt", "trunc", face, np.zeros(3), np.zeros(3))


@pytest.fixture(scope="module")
def sitter() -> Iterator[tuple[World, Human, Renderer]]:
    world = World()
    person = Human("person", load_avatar("kim"), posture=load_posture("wheelchair"))
    person.spawn(world, Pose((0.0, 0.0, 0.5)))
    wear(world, person, band_set())
    renderer = make_renderer(world)
    yield world, person, renderer
    renderer.close()
    world.close()


@pytest.mark.needs_gl
def test_pictures_alone_tell_the_posture_of_a_simulated_person(
    sitter: tuple[World, Human, Renderer],
) -> None:
    _, person, renderer = sitter
    imitation = Imitation({dof.name: (-4.0, 4.0) for dof in DOFS})
    camera = Camera((1.5, 0.0, 1.4), (-0.1, 0.0, 1.0), fov_deg=47.6)
    source = CameraSource(recline=math.radians(person.posture.recline_deg))

    def look(angles: Array, time: float) -> Frame | None:
        for dof, angle in imitation(angles).items():
            person.body.set_joints(person.body.indices([dof]), [angle])
        return source.update(CameraReading(renderer.render(camera), camera), time)

    for k in range(4):
        assert look(resting(), 0.4 * k) is None
    goal = load_exercise("lateral_raise").keys[1]
    for k in range(1, 9):
        frame = look(resting() + k / 8 * (goal - resting()), 1.2 + 0.2 * k)
    assert frame is not None
    assert max(off_deg(frame.angles, goal).values()) < 10


def test_bands_touch_nothing(sitter: tuple[World, Human, Renderer]) -> None:
    world, person, _ = sitter
    plates = [body for body in world.bodies if body.name.startswith("marker_")]
    assert len(plates) == sum(len(band.faces) for band in band_set())
    world.step()
    assert not any(world.contacts(plate) for plate in plates)
    assert all(not plate.collision_shapes(link) for plate in plates for link in (-1, 0))
