"""Every fault that the safety layer is fed without ROS stops the robot in 0.1 s, and it says why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rcare_marl.baselines.ros.safety import Guard, SafetyLimits
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

JOINTS = ("shoulder", "elbow")
RATE = 0.1  # [s] between messages, as `ros serve` tells them
JOINT_RATE = 0.01  # [s] the same of joints
CHECK = 0.01  # [s] between looks at the clock
STOP_WITHIN = 0.1  # [s]
WORKSPACE = (np.full(3, -1.0), np.full(3, 1.0))
FAULT_AT = 1.0  # [s]


class Bench:
    """A robot that moves evenly, whose messages a fault may change; time is counted, not waited for."""

    def __init__(self) -> None:
        self.said: list[tuple[float, str]] = []
        self.now = 0.0
        limits = SafetyLimits(workspace=WORKSPACE)
        self.guard = Guard(
            limits, JOINTS, np.ones(2), lambda why: self.said.append((self.now, why))
        )
        self.told: list[tuple[float, Array]] = []
        # What a fault changes:
        self.drop, self.lateness, self.ahead, self.thought = set[str](), 0.0, 0.0, 0.0
        self.edit: Callable[[Array], Array] = lambda positions: positions
        self.names: tuple[str, ...] = JOINTS
        self.force, self.tool, self.twist = 1.0, np.zeros(3), np.array([0.1, 0, 0, 0, 0, 0])
        self.stamped: Callable[[float], float] = lambda stamp: stamp

    def run(self, until: float) -> None:
        """Go on to a time: messages when they are due, a look at the clock every `CHECK`."""
        while self.now < until - 1e-9:
            self.now = round(self.now + CHECK, 6)
            self.guard.check(self.now)
            self._tell(is_scene_due=abs(self.now / RATE - round(self.now / RATE)) < 1e-6)

    def _tell(self, *, is_scene_due: bool) -> None:
        guard, now = self.guard, self.now
        stamp = self.stamped(now - self.lateness + self.ahead)
        positions = self.edit(0.1 * now * np.ones(2))
        if "joints" not in self.drop:
            guard.joints(stamp, now, self.names, positions, np.zeros_like(positions))
        if not is_scene_due:
            return
        if "wrench" not in self.drop:
            guard.wrench(stamp, now, np.array([self.force, 0, 0, 0, 0, 0]))
        if "scene" not in self.drop:
            guard.scene(stamp, now, np.zeros(3), self.tool)
            self.told.append((now, guard.permit(self.twist, now, gap=0.5, took=self.thought)))


def _late(bench: Bench) -> None:
    bench.lateness = 0.4


def _missing(bench: Bench) -> None:
    bench.drop = {"joints", "wrench", "scene"}


def _one_source_missing(bench: Bench) -> None:
    bench.drop = {"wrench"}


def _nan(bench: Bench) -> None:
    bench.edit = lambda positions: positions * np.array([1.0, np.nan])


def _infinite(bench: Bench) -> None:
    bench.force = np.inf


def _frozen(bench: Bench) -> None:
    bench.edit = lambda _: 0.1 * FAULT_AT * np.ones(2)


def _swapped(bench: Bench) -> None:
    bench.stamped = lambda stamp: stamp - 0.12


def _twice(bench: Bench) -> None:
    bench.stamped = lambda _: FAULT_AT


def _future(bench: Bench) -> None:
    bench.ahead = 5.0


def _jump(bench: Bench) -> None:
    bench.edit = lambda positions: positions + 0.7


def _exchanged_values(bench: Bench) -> None:
    bench.edit = lambda positions: np.array([positions[0], -positions[1] - 0.5])


def _truncated(bench: Bench) -> None:
    bench.edit = lambda positions: positions[:1]


def _other_joints(bench: Bench) -> None:
    bench.names = ("shoulder", "wrist")


def _hard(bench: Bench) -> None:
    bench.force = 80.0


def _outside(bench: Bench) -> None:
    bench.tool = np.array([0.0, 0.0, 3.0])


def _policy_nan(bench: Bench) -> None:
    bench.twist = np.full(6, np.nan)


def _policy_slow(bench: Bench) -> None:
    bench.thought = 0.5


FAULTS = {
    "late": (_late, "late"),
    "missing": (_missing, "nothing for"),
    "one source missing": (_one_source_missing, "wrench: nothing"),
    "not a number": (_nan, "not a number"),
    "infinite": (_infinite, "infinite"),
    "frozen": (_frozen, "frozen"),
    "swapped": (_swapped, "swapped"),
    "twice": (_twice, "twice"),
    "from the future": (_future, "future"),
    "jump": (_jump, "jumped"),
    "exchanged values": (_exchanged_values, "jumped"),
    "truncated": (_truncated, "positions for"),
    "other joints": (_other_joints, "elbow missing"),
    "too hard": (_hard, "80 N"),
    "out of the workspace": (_outside, "workspace"),
    "policy not a number": (_policy_nan, "no twist"),
    "policy too slow": (_policy_slow, "took 500 ms"),
}
SLOW = (  # of wrench, scene and policy
    *("one source missing", "infinite", "too hard", "out of the workspace"),
    *("policy not a number", "policy too slow"),
)


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_stops_the_robot_in_time_and_says_why(name: str) -> None:
    fault, said = FAULTS[name]
    bench = Bench()
    bench.run(FAULT_AT)
    assert not bench.said and bench.told[-1][1][0] == pytest.approx(0.1)
    fault(bench)
    bench.run(FAULT_AT + 1.0)
    (stop,) = bench.said
    due = FAULT_AT + (
        RATE if name in SLOW else JOINT_RATE
    )  # when the first message was due that the fault could spoil
    assert stop[0] - due <= STOP_WITHIN, stop
    assert said in stop[1]
    assert all((twist == 0).all() for when, twist in bench.told if when >= stop[0])


def test_nothing_moves_before_all_have_spoken_or_before_release() -> None:
    bench = Bench()
    bench.drop = {"wrench"}
    bench.run(0.1)
    assert (bench.told[-1][1] == 0).all()
    bench.guard.stop("somebody pressed the button")
    bench.drop = set()
    bench.run(1.0)
    assert (bench.told[-1][1] == 0).all()
    bench.guard.release()
    bench.run(1.2)
    assert bench.told[-1][1][0] == pytest.approx(0.1)


def test_a_robot_that_says_that_it_pauses_may_be_silent_and_jump() -> None:
    bench = Bench()
    bench.run(1.0)
    bench.guard.pause(bench.now)
    bench.drop = {"joints", "wrench", "scene"}
    bench.run(2.0)
    bench.drop, bench.edit = set(), lambda positions: positions + 1.0
    bench.guard.release(bench.now)
    bench.run(3.0)
    assert not bench.said and bench.told[-1][1][0] == pytest.approx(0.1)
    bench.drop = {"joints"}
    bench.run(4.0)
    ((when, _),) = bench.said
    assert when - 3.0 <= JOINT_RATE + STOP_WITHIN


def test_nothing_is_told_in_a_pause_and_one_without_end_is_a_fault() -> None:
    bench = Bench()
    bench.run(1.0)
    bench.guard.pause(bench.now)
    bench.run(9.0)
    assert not bench.said and all((twist == 0).all() for when, twist in bench.told if when > 1.0)
    bench.run(12.0)
    assert "paused" in bench.said[0][1]


def test_what_was_told_before_an_episode_began_is_not_heeded() -> None:
    bench = Bench()
    bench.guard.release(1.0)
    bench.edit = lambda positions: positions + (3.0 if bench.now < 1.0 else 0.0)
    bench.run(2.0)
    assert not bench.said and bench.told[-1][1][0] == pytest.approx(0.1)


def test_joints_that_stand_are_not_frozen_until_they_were_told_to_move_for_a_while() -> None:
    bench = Bench()
    stands = np.ones(2)
    bench.edit, bench.twist = lambda _: stands, np.zeros(6)
    bench.run(2.0)
    assert not bench.said
    bench.twist = np.array([0.1, 0, 0, 0, 0, 0])
    bench.run(2.16)  # told at 2.1 to move
    bench.edit = lambda _: stands + 0.1 * (bench.now - 2.16)
    bench.run(3.0)
    assert not bench.said


def test_names_in_another_order_are_no_fault() -> None:
    bench = Bench()
    bench.names = ("elbow", "shoulder")
    bench.run(2.0)
    assert not bench.said


def test_the_nearer_a_person_the_slower_the_tool() -> None:
    bench = Bench()
    bench.run(1.0)
    fast = np.array([1.0, 0, 0, 0.5, 0, 0])
    limits = bench.guard.limits
    speeds = []
    for gap in (0.5, 0.1, 0.05, 0.0, -0.01):
        told = bench.guard.permit(fast, bench.now, gap=gap)
        speeds.append(float(np.linalg.norm(told[:3])))
        assert told[3] / told[0] == pytest.approx(0.5)
    assert speeds[0] == pytest.approx(limits.speed)
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] == pytest.approx(limits.near_speed)


def test_limits_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ConfigError, match="patience"):
        replace(SafetyLimits(), patience=0.0)
