"""The coach's page in a browser, with an emulated headset; `make test-browser` installs what it needs."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

pytest.importorskip("aiohttp", reason="the coach's page needs the extra 'coach'")

from aiohttp import web

from rcare_marl.agents.coaching.exercise import Exercise, load_exercise
from rcare_marl.agents.coaching.upper_body import MOTION_INDEX, UpperBody
from rcare_marl.cli.coaching.server import Server, Service
from rcare_marl.cli.coaching.three import WEB
from rcare_marl.cli.coaching.webxr import FROM_WEBXR, grip_place, head_place
from rcare_marl.pose import matrix_from_quaternion, quaternion_from_matrix

Array = npt.NDArray[np.float64]

HEIGHT = 1.7  # [m]
SEAT = np.array((0.0, 0.0, 0.5))  # of the hips above the floor [m]
RATE = 60.0  # of the poses that are played [1/s]
BEFORE, AFTER = 1.0, 1.8  # rest before and after a repetition [s]
MODULES = WEB / "node_modules"
CHROMIUM = next(
    (
        found
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (found := shutil.which(name))
    ),
    None,
)
MISSING = [
    what
    for what, there in {
        "Chromium": CHROMIUM,
        "Node": shutil.which("node"),
        "the packages of make test-browser": (MODULES / "iwer").is_dir()
        and (MODULES / "playwright-core").is_dir(),
    }.items()
    if not there
]
pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)}")


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """A server on a free port of this computer."""
    loop, ready, ports = asyncio.new_event_loop(), threading.Event(), list[int]()

    async def start() -> web.AppRunner:
        service = Service(three=MODULES / "three" / "build")
        runner = web.AppRunner(Server(service).app, handle_signals=False)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0, shutdown_timeout=1.0)
        await site.start()
        ports.append(runner.addresses[0][1])
        ready.set()
        return runner

    def work() -> None:
        runner = loop.run_until_complete(start())
        loop.run_forever()
        loop.run_until_complete(runner.cleanup())

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    assert ready.wait(60)
    yield f"http://127.0.0.1:{ports[0]}/"
    loop.call_soon_threadsafe(loop.stop)
    thread.join(30)


def drive(folder: Path, **job: Any) -> dict[str, Any]:
    """Run the driver; return what it saw. Pictures go where COACH_PICTURES says, or into `folder`."""
    pictures = os.environ.get("COACH_PICTURES", str(folder))
    job = {"web": str(WEB), "chromium": CHROMIUM, "flags": [], "pictures": pictures,
           "viewport": {"width": 900, "height": 600}, "height_cm": round(100 * HEIGHT),
           "patience": 120_000, **job}  # fmt: skip
    file = folder / "job.json"
    file.write_text(json.dumps(job))
    driver = Path(__file__).with_name("coach_page.mjs")
    done = subprocess.run(
        ["node", str(driver), str(file)], capture_output=True, text=True, timeout=400
    )
    assert done.returncode == 0, done.stderr
    seen: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    assert not seen["errors"], seen["errors"]
    assert not seen["outside"], "the page asked for something outside this computer"
    return seen


def performance(exercise: Exercise, share: float) -> list[dict[str, Any]]:
    """Return poses of head and hands in WebXR's frame through one repetition, `share` of the way."""
    times = np.arange(int((BEFORE + exercise.duration + AFTER) * RATE)) / RATE
    rest = exercise.angles(0.0)
    angles = rest + share * (exercise.angles(times - BEFORE) - rest)
    angles[:, MOTION_INDEX["neck_flexion"]] += 0.05  # nobody looks quite ahead
    body = UpperBody.of_height(HEIGHT)
    poses = body.poses(angles)
    out = []
    for i, time in enumerate(times.tolist()):
        frame: dict[str, Any] = {"time": time}
        position, quaternion = (each[i] for each in poses["head"])
        frame["head"] = head_place(position + SEAT, quaternion)
        for side in ("left", "right"):
            position, quaternion = (each[i] for each in poses[f"{side}_hand"])
            turn = matrix_from_quaternion(quaternion)
            wrist = FROM_WEBXR.T @ (position + SEAT - body.palm * turn[:, 0])
            palm = (*wrist.tolist(), *quaternion_from_matrix(FROM_WEBXR.T @ turn).tolist())
            frame[side] = {"palm": palm, "grip": grip_place(side, position + SEAT, quaternion)}
        out.append(frame)
    return out


@pytest.mark.slow
def test_a_right_performance_in_a_headset_turns_green_and_a_wrong_one_does_not(
    url: str, tmp_path: Path
) -> None:
    exercise = load_exercise("lateral_raise").faster(0.6)  # for machines that draw slowly
    seen = drive(
        tmp_path, url=url, kind="headset", exercise=exercise.name,
        right=performance(exercise, 1.0), wrong=performance(exercise, 0.5),
        viewport={"width": 480, "height": 320}, gap=0.3,
    )  # fmt: skip
    assert seen["hands"] == ["joints"]
    assert seen["right"]["green"], seen
    assert seen["right"]["counted"] == 1
    assert not seen["wrong"]["green"]
    assert seen["wrong"]["counted"] == 0
    assert "Please go a little further." in seen["wrong"]["hints"]
    assert seen["controllers"]["green"], seen
    assert seen["controllers"]["counted"] == 1


@pytest.mark.slow
def test_a_simulated_person_is_coached_by_keyboard_alone(url: str, tmp_path: Path) -> None:
    seen = drive(tmp_path, url=url, kind="simulated", exercise="lateral_raise")
    assert seen["words"].startswith("That is it")
    assert seen["kind"] == "solid"
    assert seen["title"] == "The session is over."
    assert seen["focus"] == "over"


@pytest.mark.slow
def test_without_webgl_both_figures_are_drawn_as_lines(url: str, tmp_path: Path) -> None:
    seen = drive(
        tmp_path, url=url, kind="simulated", exercise="front_raise", flags=["--disable-3d-apis"]
    )
    assert seen["kind"] == "flat"
