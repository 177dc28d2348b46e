"""Body landmarks become the angles of an upper body."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from rcare_marl.agents.coaching.exercise import exercise_names, load_exercise
from rcare_marl.agents.coaching.recognition.recogniser import Frame
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.sources.landmark_source import (
    LandmarkReading,
    LandmarkSource,
)
from rcare_marl.agents.coaching.sources.one_euro import OneEuro
from rcare_marl.agents.coaching.upper_body import (
    ARM,
    MOTION_INDEX,
    MOTIONS,
    SIDES,
    UpperBody,
    directions,
)
from rcare_marl.baselines.coaching.landmark_sensor import landmarks_of
from rcare_marl.errors import ConfigError

Array = npt.NDArray[np.float64]
BODY = UpperBody.of_height(1.7)


def landmarks(angles: Array, *, facing: float = 0.0, tilt: float = 0.0) -> LandmarkReading:
    """Return what a camera with a tilt [rad] before somebody would give, who looks past it by `facing`."""
    cosine, sine = math.cos(facing), math.sin(facing)
    seen = landmarks_of(BODY, angles[None])[0]
    seen = seen @ np.array(((cosine, 0, sine), (0, 1, 0), (-sine, 0, cosine))).T
    lean = np.array(
        ((1, 0, 0), (0, math.cos(tilt), math.sin(tilt)), (0, -math.sin(tilt), math.cos(tilt)))
    )
    return LandmarkReading(seen @ lean.T, np.ones(33))


def settled(**where: float) -> LandmarkSource:
    source = LandmarkSource(tilt=where.get("tilt", 0.0))
    for k in range(16):
        frame = source.update(landmarks(np.zeros(16), **where), k / 15)
    assert frame is not None  # the second is over
    return source


def held(source: LandmarkSource, reading: LandmarkReading) -> Frame:
    """Return the last frame of a second of holding still: what smoothing lags behind is over."""
    for k in range(30):
        frame = source.update(reading, 2.0 + k / 15)
    assert frame is not None
    return frame


@pytest.mark.parametrize("name", exercise_names())
def test_landmarks_of_every_key_pose_give_its_angles(name: str) -> None:
    for key in load_exercise(name).keys[1:-1]:
        frame = held(settled(), landmarks(key))
        found, wanted = directions(frame.angles), directions(key)
        for part, direction in wanted.items():
            assert np.allclose(found[part], direction, atol=0.01), part
        for side in SIDES:
            elbow = MOTION_INDEX[f"{side}_elbow_flexion"]
            assert frame.angles[elbow] == pytest.approx(key[elbow], abs=0.01)


def test_bent_arms_show_rotation_and_pronation() -> None:
    angles = np.zeros(16)
    for side in SIDES:
        angles[ARM[side]] = np.radians((40, 30, 25, 80, 35))
    angles[3:6] = np.radians((10, -8, 30))
    angles[:3] = np.radians((12, 7, -15))
    frame = held(settled(), landmarks(angles))
    assert np.degrees(frame.angles) == pytest.approx(np.degrees(angles), abs=0.5)


def test_neither_where_somebody_faces_nor_a_known_tilt_of_the_camera_matters() -> None:
    key = load_exercise("chest_expansion").keys[1]
    straight = held(settled(), landmarks(key)).angles
    where = {"facing": 0.4, "tilt": -0.2}
    assert held(settled(**where), landmarks(key, **where)).angles == pytest.approx(
        straight, abs=1e-6
    )


def test_what_is_not_seen_is_not_known() -> None:
    source, reading = settled(), landmarks(load_exercise("lateral_raise").keys[1])
    hidden = reading.visibility.copy()
    hidden[[15, 23]] = 0.1  # left wrist, left hip
    angles = held(source, LandmarkReading(reading.points, hidden)).angles
    unknown = {motion for motion, angle in zip(MOTIONS, angles, strict=True) if np.isnan(angle)}
    assert unknown == {
        "trunk_flexion",
        "trunk_lateral_flexion_left",
        "left_shoulder_rotation",
        "left_elbow_flexion",
        "left_forearm_pronation",
    }


def test_nothing_is_told_before_somebody_sat_still_or_when_nobody_is_there() -> None:
    source = LandmarkSource()
    assert source.update(landmarks(np.zeros(16)), 0.0) is None
    assert source.update(landmarks(np.zeros(16)), 0.5) is None
    assert settled().update(None, 3.0) is None


def test_landmarks_of_another_shape_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"\[33, 3\]"):
        LandmarkReading(np.zeros((17, 3)), np.zeros(17))
    with pytest.raises(ConfigError, match="tilt"):
        LandmarkSource(tilt=1.5)


def test_the_filter_is_smooth_at_rest_quick_in_motion_and_knows_gaps() -> None:
    rng = np.random.default_rng(0)
    smooth = OneEuro(cutoff=2.0, beta=5.0)
    noisy = [smooth.update(rng.normal(0, 0.01, size=1), i / 30)[0] for i in range(300)]
    assert np.std(noisy[30:]) < 0.006
    ramp = OneEuro(cutoff=2.0, beta=5.0)
    lag = [i / 30 - ramp.update(np.array((i / 30,)), i / 30)[0] for i in range(60)]
    assert lag[-1] < 0.05  # [s] at 1 m/s
    assert np.isnan(ramp.update(np.array((np.nan,)), 2.0)).all()
    assert np.isfinite(ramp.update(np.array((2.1,)), 2.1)).all()


@pytest.mark.parametrize("person", ("daniel", "natalia"))
def test_what_mediapipe_made_of_a_film_is_right_where_it_was_and_wrong_for_half_the_way(
    person: str,
) -> None:
    with np.load(Path(__file__).parent / "data" / "webcam_landmarks.npz") as recorded:
        for share, verdict in (("right", "right"), ("half", "wrong")):
            source, recogniser = LandmarkSource(monocular=True), RuleRecogniser()
            recogniser.begin(load_exercise("lateral_raise"))
            found = []
            for i, seen in enumerate(recorded[f"{person}_{share}"].astype(np.float64)):
                frame = source.update(LandmarkReading(seen[:, :3], seen[:, 3]), i / 7.5)
                if frame is not None and (done := recogniser.update(frame).finished) is not None:
                    found.append(done)
            assert [each.verdict for each in found] == [verdict]
            assert share == "right" or "range" in found[0].errors
