"""Over ROS 2, in processes of their own; skipped where `make ros` has made no environment for it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
PYTHON = Path(os.environ.get("RCARE_MARL_ROS_PYTHON", ROOT / ".venv-ros" / "bin" / "python"))
IS_WANTED = bool(os.environ.get("RCARE_MARL_REQUIRE_ROS"))
MAIN = "from rcare_marl.cli import main; main()"
SPACE = "/left"
ROBOT = (
    "{model: kinova_gen3, moves: [arm, gripper], "
    "sensors: [{kind: camera, name: wrist, width: 32, height: 24}]}"
)
OPENED = 0.0  # [rad] of the joint of the Gen3's gripper

pytestmark = pytest.mark.skipif(
    not (PYTHON.exists() or IS_WANTED), reason=f"no ROS 2 at {PYTHON}: make ros"
)


def environment() -> dict[str, str]:
    domain = str(os.getpid() % 100)  # so that nobody else is heard
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return {
        **os.environ,
        "ROS_DOMAIN_ID": domain,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PYTHONPATH": path,
        "PYTHONUNBUFFERED": "1",
    }


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [str(PYTHON), "-c", MAIN, "ros", *arguments],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def run(script: str, *arguments: str) -> str:
    done = subprocess.run(
        [str(PYTHON), str(ROOT / "tests" / script), *arguments],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=90,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def end(process: subprocess.Popen[str]) -> str:
    process.send_signal(signal.SIGCONT)
    process.send_signal(signal.SIGINT)
    try:
        return process.communicate(timeout=20)[0]
    except subprocess.TimeoutExpired:
        process.kill()
        return process.communicate()[0]


@pytest.fixture(scope="module")
def robot() -> Iterator[None]:
    process = start("serve", "feeding", "--namespace", SPACE, "--prefix", "left_", "--robot", ROBOT)
    yield
    said = end(process)
    assert "Traceback" not in said, said


@pytest.mark.slow
@pytest.mark.usefixtures("robot")
def test_a_robot_tells_all_that_it_senses() -> None:
    got: dict[str, Any] = json.loads(run("ros_probe.py", SPACE).splitlines()[-1])
    assert len(got["topics"]) == 10
    assert got["answers"] == ["stopped", "released"]
    assert {f"joint_{k}" for k in range(1, 8)} <= set(got["joints"])
    assert "<robot" in got["urdf"]
    assert {"left_tool", "left_recipient/head", "left_base_link"} <= set(got["frames"])
    assert got["picture"][0] == 24 and got["picture"][1] > 5
    assert got["focus"] == pytest.approx(12 / 0.3839, rel=0.01)  # 42 degrees over 24 rows
    assert got["bones"] > 10


@pytest.mark.usefixtures("robot")
def test_a_client_that_is_not_ours_moves_the_arm_by_a_trajectory() -> None:
    action = f"{SPACE}/arm_controller/follow_joint_trajectory"
    changes = [f"joint_{k}={0.1 * (-1) ** k}" for k in range(1, 8)]
    said = run("ros_client.py", f"{SPACE}/joint_states", action, *changes)
    assert "code 0" in said, said
    assert float(said.split("off ")[1]) < 0.03


@pytest.mark.slow
@pytest.mark.usefixtures("robot")
def test_what_is_told_is_recorded_for_tools_that_are_not_ours(tmp_path: Path) -> None:
    file = tmp_path / "robot.mcap"
    recorder = start("record", str(file), "--namespace", SPACE, "--seconds", "3")
    assert recorder.wait(timeout=60) == 0, end(recorder)
    got: dict[str, Any] = json.loads(run("ros_bag.py", str(file)).splitlines()[-1])
    counts = got["counts"]
    assert {"/tf", "/clock", f"{SPACE}/scene", f"{SPACE}/robot_description"} <= counts.keys()
    assert "joint_1" in got["joints"]
    assert counts[f"{SPACE}/joint_states"] > 5 * counts[f"{SPACE}/scene"] > 75


@pytest.mark.slow
@pytest.mark.usefixtures("robot")
def test_a_client_that_is_not_ours_opens_the_gripper() -> None:
    said = run("ros_gripper.py", f"{SPACE}/gripper_controller/gripper_cmd", str(OPENED))
    assert "reached True stalled False" in said, said
    assert float(said.split("at ")[1]) == pytest.approx(OPENED, abs=0.05)


@pytest.mark.slow
def test_a_policy_in_another_process_feeds_the_person_in_real_time() -> None:
    server = start("serve", "feeding", "--episodes", "1")
    player = start("play", "feeding", "--policy", "learned", "--episodes", "1")
    try:
        said = player.communicate(timeout=120)[0]
    finally:
        served = end(server)
        player.kill()
    assert "1 of 1 ended well" in said, said + served
    assert "1 of 1 ended well" in served


@pytest.mark.slow
def test_a_robot_that_falls_silent_ends_in_a_stop_and_a_message() -> None:
    server = start("serve", "feeding")
    player = start("play", "feeding", "--policy", "scripted")
    try:
        said = ""
        assert player.stdout is not None
        while "plays" not in said:
            line = player.stdout.readline()
            assert line, said
            said += line
        time.sleep(2)
        server.send_signal(signal.SIGSTOP)
        said += player.communicate(timeout=30)[0]
    finally:
        end(server)
        player.kill()
    assert player.returncode == 1, said
    assert "nothing for" in said
    silence = float(said.split("nothing for ")[1].split(" ms")[0])
    assert silence - 100 < 100  # [ms] after the message was due
