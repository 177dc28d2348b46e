"""What a headset streams to the coach's page: its clock, its rate, and the poses of head and hands."""

from __future__ import annotations

import numpy as np
import pytest
from webxr_pose import webxr_pose

from rcare_marl.agents.coaching.upper_body import UpperBody
from rcare_marl.baselines.coaching.page.message import Hands, MessageError, Place
from rcare_marl.baselines.coaching.page.sight import ANEW, Limiter, PageClock, reading
from rcare_marl.pose import matrix_from_quaternion


def test_a_clock_that_runs_backwards_or_ahead_is_refused_and_later_taken_anew() -> None:
    clock = PageClock()
    assert clock.take(100.0, now=5.0) == 0.0
    assert clock.take(100.5, now=5.5) == pytest.approx(0.5)
    with pytest.raises(MessageError, match="grow"):
        clock.take(100.5, now=5.6)
    with pytest.raises(MessageError, match="grow"):
        clock.take(90.0, now=5.7)
    with pytest.raises(MessageError, match="ahead"):
        clock.take(1e6, now=5.8)
    assert clock.take(101.0, now=6.0) == pytest.approx(1.0)  # the honest one goes on
    for k in range(10):  # a device that began its clock anew
        with pytest.raises(MessageError):
            clock.take(3.0 + 0.1 * k, now=6.1 + 0.1 * k)
    assert clock.take(6.0, now=6.1 + ANEW) == pytest.approx(1.1 + ANEW)
    assert clock.take(6.1, now=6.2 + ANEW) == pytest.approx(1.2 + ANEW)


def test_more_messages_than_a_headset_sends_are_dropped() -> None:
    limiter = Limiter(rate=100, burst=10)
    assert sum(limiter.lets(1.0) for _ in range(1000)) == 10
    assert limiter.dropped == 990
    assert sum(limiter.lets(1.0 + k / 1000) for k in range(1001)) == pytest.approx(100, abs=2)


@pytest.mark.parametrize("side", ("left", "right"))
def test_joints_and_grips_of_webxr_give_the_palm_they_were_made_of(side: str) -> None:
    angles = np.random.default_rng(3).uniform(-0.8, 0.8, 16)
    joints, grip, head, poses = webxr_pose(side, angles)
    for hand in (joints, grip):
        hands = Hands(
            0.0, head, hand if side == "left" else None, hand if side == "right" else None
        )
        out = reading(hands, UpperBody.of_height(1.7))
        palm = out.left if side == "left" else out.right
        assert palm is not None and out.head is not None
        for found, wanted in ((palm, poses[f"{side}_hand"]), (out.head, poses["head"])):
            assert found.position == pytest.approx(wanted[0], abs=1e-6)
            assert abs(np.dot(found.quaternion, wanted[1])) == pytest.approx(1.0, abs=1e-6)


def test_a_right_hand_with_its_palm_down_has_its_back_up_in_a_controller() -> None:
    # Fist around a controller held forward, palm to the left: the grip has no turn at all.
    out = reading(
        Hands(0.0, None, None, Place((0.2, 1.0, -0.4), (0.0, 0.0, 0.0, 1.0))),
        UpperBody.of_height(1.7),
    )
    assert out.right is not None
    axes = matrix_from_quaternion(out.right.quaternion)
    assert out.right.position == pytest.approx((0.4, -0.2, 1.0))
    assert axes[:, 2] == pytest.approx((0.0, -1.0, 0.0))  # the back of the hand to the right
    assert axes[:, 0] == pytest.approx((0.0, 0.0, -1.0))  # flat fingers would point down
