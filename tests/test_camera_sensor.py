"""Cameras as sensors: what they give, when anything is drawn, and what it costs."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from camera_scene import Room, robot_with

import rcare_marl
from rcare_marl import rendering
from rcare_marl.agents.sensing.camera import CameraConfig, CameraSensor
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, UnknownNameError, WorldError
from rcare_marl.observable import Observation
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.rendering import Camera, GLRenderer, Picture, Renderer, Shot
from rcare_marl.rendering.gl_target import free_context
from rcare_marl.world import World


@pytest.fixture
def room() -> Iterator[Room]:
    room = Room()
    yield room
    room.close()


class Watch:
    """Counts renderers, and the pictures of each reading."""

    def __init__(self, make: Callable[..., Renderer]) -> None:
        self._make = make
        self.made = self.closed = 0
        self.readings: list[int] = []

    def __call__(self, world: World, **options: Any) -> Watch:
        self.made += 1
        self._renderer = self._make(world, **options)
        return self

    def read(self, shots: Sequence[Shot]) -> list[Picture]:
        self.readings.append(len(shots))
        return self._renderer.read(shots)

    def close(self) -> None:
        self.closed += 1
        self._renderer.close()


@pytest.fixture
def watch(monkeypatch: pytest.MonkeyPatch) -> Watch:
    watch = Watch(rendering.make_renderer)
    monkeypatch.setattr(rendering, "make_renderer", watch)
    return watch


def test_each_output_is_an_array_of_its_own_kind(room: Room) -> None:
    outputs = ("rgb", "depth", "normals", "segmentation", "points")
    suite = room.add({"outputs": outputs, "width": 40, "height": 30})
    room.begin()
    observation = Observation(suite.observables())
    seen = observation.read()
    assert observation.space.contains(seen)
    shapes = {name: (a.shape, str(a.dtype)) for name, a in seen.items() if name != "vector"}
    assert shapes == {
        "eye_0_rgb": ((30, 40, 3), "uint8"),
        "eye_0_depth": ((30, 40), "float32"),
        "eye_0_normals": ((30, 40, 3), "float32"),
        "eye_0_segmentation": ((30, 40), "int32"),
        "eye_0_points": ((1200, 3), "float32"),
        "eye_0_valid": ((1200,), "uint8"),
    }
    sensor = suite.sensors["eye_0"]
    assert isinstance(sensor, CameraSensor)
    assert sensor.labels[seen["eye_0_segmentation"][15, 20]][0] == "wall"
    assert np.allclose(seen["eye_0_normals"][15, 20], (0, 0, -1), atol=1e-5)
    assert seen["eye_0_depth"][15, 20] == pytest.approx(1.0, abs=1e-4)


def test_points_are_in_the_frame_of_the_base_and_never_nan(room: Room) -> None:
    turn = tuple(quaternion_from_rpy(0, 0, 0.2).tolist())
    camera = {"outputs": ("points", "segmentation"), "at": (0.05, 0.0, 0.03), "far": 3.0}
    suite = room.add(camera, pose=Pose((0.1, -0.1, 0.5), turn))
    room.begin()
    points, valid = (suite.reading("eye_0", channel) for channel in ("points", "valid"))
    assert np.isfinite(points).all()
    assert not points[valid == 0].any() and 0 < valid.mean() < 1
    wall = suite.reading("eye_0", "segmentation").ravel() == 0
    world = points[wall] @ Pose((0, 0, 0), turn).matrix()[:3, :3].T + (0.1, -0.1, 0.5)
    assert wall.sum() > 300
    # All on the wall: on its front, or on the bevel and side of its edge.
    assert world[:, 0].min() > 0.9995 and np.median(abs(world[:, 0] - 1.0)) < 0.0005
    assert world[:, 1].max() < 0.401 and abs(world[:, 1]).max() > 0.35


def test_beyond_its_range_a_camera_sees_nothing(room: Room) -> None:
    near, far = (
        room.add({"outputs": ("depth",), "near": 1.1}),
        room.add({"outputs": ("depth", "segmentation"), "far": 0.9}),
    )
    room.begin()
    assert not (near.reading("eye_0", "depth") == 1.0).any()
    assert not far.reading("eye_0", "depth").any()
    assert (far.reading("eye_0", "segmentation") == -1).all()


@pytest.mark.parametrize("growth", ["constant", "quadratic"])
def test_noise_is_of_the_depth_alone(room: Room, growth: str) -> None:
    room.wall.set_base(Pose((2.01, 0, 0.5)))
    camera = {"outputs": ("depth", "points", "rgb"), "width": 160, "height": 120}
    clean = room.add(camera)
    noisy = room.add({**camera, "noise": 0.003, "noise_growth": growth})
    room.begin()
    truth, measured = (suite.reading("eye_0", "depth") for suite in (clean, noisy))
    wall = np.abs(truth - 2.0) < 1e-3
    spread = 0.003 * (4 if growth == "quadratic" else 1)
    assert wall.sum() > 800
    assert np.std((measured - truth)[wall]) == pytest.approx(spread, rel=0.1)
    assert abs(np.mean((measured - truth)[wall])) < 0.2 * spread
    assert (measured[truth == 0] == 0).all() and (truth == 0).any()
    assert np.array_equal(clean.reading("eye_0", "rgb"), noisy.reading("eye_0", "rgb"))
    along = noisy.reading("eye_0", "points")[:, 0].reshape(measured.shape)
    assert np.allclose(along, measured, atol=1e-5)  # points move along their rays


def test_equal_seeds_give_equal_pictures(room: Room) -> None:
    room.world.add_box((4, 4, 0.1), Pose((0, 0, 0.3)))
    suite = room.add({"outputs": ("rgb", "depth", "points"), "noise": 0.01, "look": "full"})
    room.world.mark_start()

    def episode(seed: int) -> list[npt.NDArray[Any]]:
        room.world.rewind()
        room.begin(seed)
        out = []
        for _ in range(3):
            for _ in range(20):
                room.world.step()
            room.sense()
            out += [suite.reading("eye_0", c).copy() for c in ("rgb", "depth", "points")]
        return out

    first, other, again = episode(1), episode(2), episode(1)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[1], other[1])
    assert not np.array_equal(first[0], first[3])  # the block falls


def test_nothing_is_drawn_unless_a_camera_is_read(room: Room, watch: Watch) -> None:
    world, robot, blind = robot_with("imu", "joint_torque")
    blind.sense()
    blind.close()
    world.close()
    assert watch.made == 0
    suite = room.add({"outputs": ("depth",)})
    assert suite.observables() and watch.made == 0
    suite.close()
    assert watch.made == 0
    suite = room.add({"outputs": ("depth",)})
    room.suites[:] = [suite]
    room.begin()
    suite.close()
    assert watch.made == watch.closed == 1


def test_all_cameras_share_a_renderer_and_are_read_at_once(room: Room, watch: Watch) -> None:
    first = room.add({"outputs": ("rgb",)}, {"outputs": ("depth",), "rpy_deg": (-90.0, 0.0, 0.0)})
    second = room.add({"outputs": ("segmentation",)}, pose=Pose((0, 0.3, 0.5)))
    room.begin()
    assert watch.made == 1 and watch.readings == [3]
    for _ in range(4):
        room.world.step()
    room.sense()
    assert watch.readings == [3, 3]
    first.close()
    first.close()
    assert watch.closed == 0
    room.world.step()
    second.sense()
    assert watch.readings == [3, 3, 1]
    second.close()
    assert watch.closed == 1


def test_cameras_of_one_rate_are_read_together(room: Room, watch: Watch) -> None:
    every = 1 / room.world.physics_dt
    for rate in (every / 4, every / 6):
        room.add({"rate": rate}, {"rate": rate, "outputs": ("depth",)})
    room.begin()
    for _ in range(12):
        room.world.step()
        for suite in room.suites:
            suite.after_substep()
    # At the start each rate for itself or all at once; then at steps 4, 8, 12 and at 6, 12.
    assert sum(watch.readings) == 4 + 3 * 2 + 2 * 2
    assert all(count >= 2 for count in watch.readings)


def test_a_fast_camera_does_not_make_those_without_a_rate_look(room: Room, watch: Watch) -> None:
    room.add({"rate": 60.0}, {})
    room.begin()
    watch.readings.clear()
    for _ in range(24):
        room.world.step()
        room.suites[0].after_substep()
    room.sense()
    assert watch.readings == [1] * 7


def test_a_camera_in_the_room_may_look_straight_down(room: Room) -> None:
    above: dict[str, Any] = {"link": "", "rpy_deg": (0.0, 0.0, 0.0), "outputs": ("segmentation",)}
    room.world.add_box((0.1, 0.1, 0.1), Pose((0.0, 0.3, 0.2)), name="crate")
    suite = room.add({**above, "eye": (0.0, 0.0, 2.0), "target": (0.0, 0.0, 0.0)})
    room.begin()
    sensor = suite.sensors["eye_0"]
    assert isinstance(sensor, CameraSensor)
    crates = [number for number, (body, _) in sensor.labels.items() if body == "crate"]
    rows, columns = np.nonzero(np.isin(suite.reading("eye_0", "segmentation"), crates))
    assert rows.mean() < 20 and columns.mean() == pytest.approx(31.5, abs=1.0)  # y is up


def test_a_camera_may_stand_in_the_room(room: Room) -> None:
    fixed = {
        "eye": (-1.0, 0.0, 0.5),
        "target": (1.0, 0.0, 0.5),
        "link": "",
        "rpy_deg": (0.0, 0.0, 0.0),
    }
    suite = room.add({**fixed, "outputs": ("segmentation",)}, pose=Pose((0.0, 0.0, 0.7)))
    room.begin()
    before = suite.reading("eye_0", "segmentation").copy()
    for _ in range(30):
        room.world.step()  # the block falls through the picture
    room.sense()
    after = suite.reading("eye_0", "segmentation")
    assert (before == 1).any() and not np.array_equal(before, after)
    assert np.array_equal(before == 0, after == 0) or (before != after).sum() < 40
    sensor = suite.sensors["eye_0"]
    assert isinstance(sensor, CameraSensor) and sensor.view.eye == (-1.0, 0.0, 0.5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"eye": (0, 0, 1)}, "eye and target belong together"),
        ({"camera": "wrist", "link": "base"}, "only one of"),
        ({"at": (0.1, 0, 0)}, "need a link"),
        ({"outputs": ()}, "outputs must name some"),
        ({"outputs": ("rgb", "rgb")}, "each once"),
        ({"noise": 0.1}, "noise is for depth"),
        ({"width": 0}, "width"),
        ({"near": 2.0, "far": 1.0}, "near < far"),
        ({"fov_deg": 0.5}, "sensor 'eye': camera fov_deg"),
        ({"fov_deg": 0}, "sensor 'eye': camera fov_deg"),
        ({"outputs": ("dept",)}, "Did you mean 'depth'"),
        ({"look": "nice"}, "look"),
        ({"eye": (0, 0, 1), "target": (0, 0, 1)}, "sensor 'eye': eye and target must differ"),
    ],
)
def test_impossible_options_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        load(CameraConfig, {"name": "eye", **options})


def test_a_closed_camera_says_so(room: Room) -> None:
    suite = room.add({})
    room.begin()
    suite.close()
    with pytest.raises(WorldError, match="closed"):
        suite.sensors["eye_0"].measure()


def test_cameras_of_all_agents_of_an_environment_are_read_at_once(watch: Watch) -> None:
    eyes = {
        "kind": "camera",
        "name": "eyes",
        "link": "head",
        "at": [0, 0.07, 0.1],
        "rpy_deg": [0, 0, 180],
        "outputs": ["rgb", "depth"],
    }
    env = rcare_marl.make("feeding", robot={"sensors": ["camera"]}, recipient={"sensors": [eyes]})
    seen, _ = env.reset(seed=0)
    assert watch.made == 1 and watch.readings == [2]
    stay = {role: np.zeros(env.action_space(role).shape, np.float32) for role in env.agents}
    after, *_ = env.step(stay)
    assert watch.readings == [2, 2]
    for role, keys in (("robot", ["camera_rgb"]), ("recipient", ["eyes_rgb", "eyes_depth"])):
        assert set(seen[role]) == {"vector", *keys}
        assert env.observation_space(role).contains(after[role])
    again, _ = env.reset(seed=0)
    assert np.array_equal(seen["recipient"]["eyes_depth"], again["recipient"]["eyes_depth"])
    assert np.array_equal(seen["robot"]["camera_rgb"], again["robot"]["camera_rgb"])
    env.close()
    assert watch.closed == 1


FORKED = """
import gymnasium, multiprocessing, rcare_marl
from rcare_marl.rendering import Camera, make_renderer

def draw():
    try:
        make_renderer(world)
    except rcare_marl.errors.RenderingError as error:
        print("forked:", error, flush=True)

camera = {"kind": "camera", "width": 16, "height": 12}
envs = gymnasium.make_vec(
    "rcare_marl/Feeding-v0", 1, "async", {"context": "fork"}, robot={"sensors": [camera]}
)
seen, _ = envs.reset(seed=1)
print("worker:", seen["camera_rgb"].shape, seen["camera_rgb"].std() > 5, flush=True)
envs.close()
world = rcare_marl.world.World()
renderer, view = make_renderer(world), Camera((0, -1, 1), (0, 0, 0), width=16, height=12)
renderer.render(view)
process = multiprocessing.get_context("fork").Process(target=draw)
process.start()
process.join()
renderer.render(view)
print("parent:", process.exitcode)
"""


@pytest.mark.slow
@pytest.mark.needs_gl
def test_forked_workers_draw_and_those_that_cannot_say_what_to_do() -> None:
    """In a process of its own, which OpenGL has not touched; what goes wrong would hang."""
    done = subprocess.run(
        [sys.executable, "-c", FORKED],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
        env={**os.environ, rendering.VARIABLE: "auto"},
    )
    lines = [line for line in done.stdout.splitlines() if ":" in line and "build" not in line]
    assert lines[0] == "worker: (1, 12, 16, 3) True"
    assert lines[1].startswith("forked: OpenGL was used before") and "context='spawn'" in lines[1]
    assert lines[2] == "parent: 0"


@pytest.mark.needs_gl
def test_what_is_dropped_without_close_frees_its_context(monkeypatch: pytest.MonkeyPatch) -> None:
    freed = []

    def counted(context: Any, opened_by: int) -> None:
        freed.append(context)
        free_context(context, opened_by)

    monkeypatch.setattr("rcare_marl.rendering.gl_renderer.free_context", counted)
    monkeypatch.setenv(rendering.VARIABLE, "gl")
    world = World()
    other = GLRenderer(world)
    camera = Camera((0.0, -1.0, 0.5), (0.0, 0.0, 0.0), width=16, height=12)
    before = other.render(camera)
    env = rcare_marl.make("feeding", robot={"sensors": ["camera"]})
    env.reset(seed=0)
    assert not freed
    del env
    gc.collect()
    assert len(freed) == 1
    assert np.array_equal(other.render(camera), before)
    other.close()
    assert len(freed) == 2
    world.close()
