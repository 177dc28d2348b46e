"""Tooth brushing: gentle strokes on the outer side of every quadrant, felt by springs inside the mouth."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from episode import play

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.people.behaviour.avatar_tree import AvatarBehaviour
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.scenes.dental_arch import QUADRANTS, arches_of
from rcare_marl.envs.scenes.refusal import GENTLE, LAST_NO
from rcare_marl.envs.tasks.tooth_brushing import BRUSHED, ToothBrushing


def made(recipient: str = "jose", partner: str = "cooperative", **arguments: Any) -> CareEnv:
    policies = {"robot": "scripted", "recipient": partner}
    return rcare_marl.make("tooth_brushing", recipient=recipient, policies=policies, **arguments)


def test_the_scripted_robot_brushes_every_quadrant_gently() -> None:
    env = made()
    task = cast(ToothBrushing, env.task)
    play(env, 0)
    assert task.succeeded() and task.state.refusal.count == 0
    assert (task.state.brushed >= BRUSHED - 1e-9).all()
    assert 0.5 < task.state.peak_force < 5.0
    env.close()


def test_who_is_bent_looks_at_the_brush_and_not_under_it() -> None:
    env = made("population:train:55")  # bent forward by 25 degrees
    env.reset(seed=55)
    for _ in range(4):  # before it is too near to be looked at
        env.step({})
    state = cast(ToothBrushing, env.task).state
    way = state.bristles - state.mouth
    off = np.degrees(np.arccos(state.face @ way / np.linalg.norm(way)))
    assert off < 12.0, off
    env.close()


# Looked aside and up at the brush, so that the arm did not reach the far side; 404 to the other side.
@pytest.mark.slow
@pytest.mark.parametrize("who", [401, 430, 404])
def test_the_far_side_is_reached_of_who_looks_aside_and_up(who: int) -> None:
    env = made(f"population:train:{who}")
    play(env, 71000 + who - 400)
    assert env.task.succeeded() and env.task.state.peak_force < 5.0
    env.close()


@pytest.mark.slow
# Heavy, heavy, bent: legs and trunk were in the way.
@pytest.mark.parametrize(
    "who",
    [
        pytest.param(53, marks=pytest.mark.xfail(strict=True, reason="docs/tooth_brushing.md")),
        54,
        55,
    ],
)
def test_who_is_heavy_or_bent_has_all_teeth_brushed(who: int) -> None:
    env = made(f"population:train:{who}")
    play(env, who)
    assert env.task.succeeded() and env.task.state.peak_force < 5.0
    env.close()


@pytest.mark.slow
def test_who_only_lets_it_happen_opens_a_little_and_has_all_teeth_brushed() -> None:
    env = made("daniel", "passive")
    play(env, 1)
    assert env.task.succeeded() and env.task.state.peak_force < 5.0
    env.close()


def test_a_mouth_that_stays_closed_is_not_entered() -> None:
    env = made(partner="still")
    env.reset(seed=0)
    for _ in range(60):
        env.step({})
        state = cast(ToothBrushing, env.task).state
        assert not state.is_inside and state.force == 0.0
    assert not env.task.succeeded() and state.brushed.sum() == 0.0
    env.close()


def test_who_refuses_before_the_brush_comes_is_left_alone() -> None:
    env = made("kim", "refusing")
    for seed in range(2):
        play(env, seed)
        report = env.task.report()
        assert env.task.succeeded() and report["refusals"] in (0, LAST_NO)
        assert report["pressed_after_no_n"] <= GENTLE
    env.close()


def test_who_says_no_with_the_brush_in_the_mouth_is_not_pressed() -> None:
    env = made(partner="behaviour")
    env.reset(seed=0)
    person, was_inside = env.policies["recipient"], False
    assert isinstance(person, AvatarBehaviour)
    while not env.is_over:
        state = cast(ToothBrushing, env.task).state
        if state.brushed[0] > 1.0 and not person.cues.refuses:
            person.cues.refuses, was_inside = True, state.is_inside
        env.step({})
    report = env.task.report()
    assert was_inside and env.task.succeeded() and report["refusals"] == LAST_NO
    assert report["pressed_after_no_n"] <= GENTLE
    env.close()


def test_arches_have_the_published_sizes_and_lie_behind_the_lips() -> None:
    env = rcare_marl.make("tooth_brushing", recipient="karan")
    person = cast(ToothBrushing, env.task).recipient
    for arch in arches_of(person):
        width, _, depth = np.ptp(arch.nodes, axis=0)
        assert 0.042 < width < 0.062 and 0.026 < depth < 0.042
        assert np.allclose(np.linalg.norm(arch.outward, axis=1), 1.0)
        for side in (1.0, -1.0):
            node, outward = arch.beside(side, 0.4)
            assert node[0] * side > 0.01 and outward[0] * side > 0.3
    assert len(QUADRANTS) == 4
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("avatar", [n for n in assets.names("avatars") if n != "caregiver"])
@pytest.mark.parametrize("partner", ["cooperative", "behaviour", "refusing"])
def test_everybodys_teeth_are_brushed_or_they_are_left_alone(avatar: str, partner: str) -> None:
    env = made(avatar, partner)
    for seed in range(5):
        play(env, seed)
        assert env.task.succeeded(), seed
        assert env.task.report()["pressed_after_no_n"] <= GENTLE
    env.close()
