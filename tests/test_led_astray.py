"""Scripts go by what is so: a hand that was led astray begins anew, and the task is done all the same."""

from __future__ import annotations

import numpy as np
import pytest

import rcare_marl
from rcare_marl.envs.cast import make_policy

SPANS = ((15, 25), (50, 60))  # control steps in which chance moves the hand


@pytest.mark.parametrize(
    ("task", "place", "most"),
    [
        pytest.param("ambulating", {"level": 1}, 1.0, id="knob"),
        pytest.param("ambulating", {"level": 2}, 1.0, id="lever", marks=pytest.mark.slow),
        pytest.param("ambulating", {"level": 3}, 1.0, id="panel", marks=pytest.mark.slow),
        pytest.param("scratching", {}, 0.3, id="itch", marks=pytest.mark.slow),
        pytest.param("limb_repositioning", {}, 0.3, id="arm"),
        pytest.param("tooth_brushing", {}, 0.3, id="teeth", marks=pytest.mark.slow),
    ],
)
def test_a_script_whose_hand_was_led_astray_begins_anew(
    task: str, place: dict[str, int], most: float
) -> None:
    person = "still" if task in ("ambulating", "scratching") else "cooperative"
    env = rcare_marl.make(task, policies={"recipient": person}, **place)  # type: ignore[arg-type]
    script = make_policy(env, task, "robot", "scripted")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    script.reset(rng)
    for k in range(1000):
        action = np.array(script.act(), np.float32)
        if any(begin <= k < end for begin, end in SPANS):
            action = rng.uniform(-most, most, action.shape).astype(np.float32)
        _, _, ended, late, infos = env.step({"robot": action})
        if any(ended.values()) or any(late.values()):
            break
    assert infos["robot"]["success"] == 1.0
    env.close()
