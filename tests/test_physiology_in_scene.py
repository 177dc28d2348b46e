"""Physiology of people in a scene: effort, weight on them, postures, episodes."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
import pytest

import rcare_marl
from rcare_marl.agents.agent import Array
from rcare_marl.agents.people.actuation.drive import ActuationConfig
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.physiology import Physiology, vital_signs
from rcare_marl.observable import Observation
from rcare_marl.pose import Pose
from rcare_marl.world import World


def person(
    avatar: str = "caregiver",
    *,
    movable: tuple[str, ...] = ("right_shoulder",),
    kind: Literal["skeletal", "muscle"] = "skeletal",
    eased: tuple[str, ...] = (),
) -> Human:
    world = World()
    posture = dataclasses.replace(load_posture("wheelchair"), eased=eased)
    human = Human("recipient", load_avatar(avatar), posture=posture,
                  movable=movable, physiology_observed=True,
                  actuation=ActuationConfig(kind=kind, excitation="posture"))  # fmt: skip
    human.use_arm_rests(Pose((0.25, 0.26, 0.77)), Pose((0.25, -0.26, 0.77)))
    human.spawn(world, Pose((0, 0, 0.5)))
    human.reset(np.random.default_rng(0))
    return human


def step(human: Human, seconds: float, action: Array | None = None) -> None:
    for _ in range(round(seconds * 10)):
        if action is not None:
            human.command(action, 0.1)
        for _ in range(24):
            human.actuate()
            human.world.step()
        human.sense()


def test_who_sits_still_in_a_chair_makes_no_effort_and_a_raised_arm_does() -> None:
    human = person(movable=("right_shoulder", "right_elbow_flexion"))
    step(human, 2)
    assert human.physiology.values() == pytest.approx(Physiology(human.avatar).values(), abs=0.05)
    goal = {"right_shoulder_flexion": 1.4, "right_elbow_flexion": 0.2}
    step(human, 3, human.action_towards(goal, 0.1))
    step(human, 20)
    assert human.angle("right_shoulder_flexion") > 0.6
    assert human.physiology.heart_rate > 72.5
    assert human.physiology.fatigue == human.physiology.fatigue_of("right_arm") > 0
    assert human.physiology.fatigue_of("left_arm") == 0


def test_an_arm_that_lies_on_something_rests_however_it_has_rolled_and_not_once_it_is_raised() -> (
    None
):
    left = {}
    for raised in (0.0, 0.6):
        human = person(eased=("right_shoulder",))
        up = human.angle("right_shoulder_flexion") + raised
        human.set_angles({"right_shoulder_external_rotation": -0.6, "right_shoulder_flexion": up})
        human.physiology.set_fatigue("right_arm", 0.4)
        step(human, 5, human.action_towards({}, 0.1))
        left[raised] = human.physiology.fatigue_of("right_arm")
    assert left[0.0] < 0.37 < left[0.6]


def under_a_weight(avatar: str) -> Human:
    """Return a person on whose left thigh 42 kg fell and lie, two seconds later."""
    world = World()
    human = Human("recipient", load_avatar(avatar), posture=load_posture("bed_supine"),
                  movable=())  # fmt: skip
    human.spawn(world, Pose((0, 0, 0.5)))
    hip, knee = (np.array(human.joint_pose(f"left_{j}").position) for j in ("hip", "knee"))
    above = hip + 0.2 * (knee - hip) + (0, 0, 0.2)
    world.add_box((0.15, 0.15, 0.1), Pose(tuple(above.tolist())), mass=42.0)
    human.reset(np.random.default_rng(0))
    step(human, 2)
    return human


def test_a_weight_on_the_thigh_hurts_who_feels_it() -> None:
    physiology = under_a_weight("caregiver").physiology
    assert physiology.pain > 1 and physiology.comfort < 0.8
    assert physiology.pain_segment in ("left_hip", "pelvis")
    assert physiology.systolic > 120 and not physiology.is_dysreflexic


def test_a_weight_on_the_thigh_raises_the_pressure_of_who_cannot_feel_it() -> None:
    physiology = under_a_weight("jose").physiology
    assert physiology.pain == 0
    assert physiology.systolic > 88 + 2 and physiology.heart_rate < 52


def test_lying_and_sitting_are_told_apart() -> None:
    lying = Human("r", load_avatar("jose"), posture=load_posture("bed_supine"), movable=())
    lying.spawn(World(), Pose((0, 0, 0.5)))
    assert lying._meter.upright() < 0.3 < 0.9 < person("jose", movable=())._meter.upright()


def test_an_episode_begins_at_rest_again() -> None:
    human = person()
    fresh = human.physiology.values()
    human.physiology.set({"heart_rate": 120, "fatigue": 0.5, "ambient": 35})
    human.reset(np.random.default_rng(0))
    assert human.physiology.values() == fresh and human.physiology.ambient == 22


def test_what_is_set_before_the_first_reset_is_lost_and_after_it_is_kept() -> None:
    env = rcare_marl.make("feeding", policies={"robot": "still", "recipient": "still"})
    recipient = env.cast["recipient"]
    assert isinstance(recipient, Human)
    for is_kept in (False, True):
        recipient.physiology.ambient = 35.0
        if not is_kept:
            env.reset(seed=0)
        env.step({})
        assert recipient.physiology.ambient == (35.0 if is_kept else 22.0)
    env.close()


@pytest.mark.parametrize("kind", ["skeletal", "muscle"])
def test_fatigue_takes_its_share_of_strength(kind: Literal["skeletal", "muscle"]) -> None:
    """A straight arm is lifted level by who is rested and sinks with who is spent."""

    def reached(fatigue: float) -> float:
        human = person(movable=("right_shoulder",), kind=kind)
        for _ in range(30):
            human.physiology.fatigue = fatigue
            step(human, 0.1, human.action_towards({"right_shoulder_flexion": 1.2}, 0.1))
        return human.angle("right_shoulder_flexion")

    assert reached(0.0) > 1.0
    assert reached(0.97) < 0.5


def test_physiology_is_observed_by_whom_it_is_shown_to() -> None:
    human = person()
    own = Observation(human.observables())
    human.physiology.heart_rate = 101
    table = {name: part for part, name, _ in own.table()}
    assert own.read()[table["heart_rate"]] == 101
    monitor = Observation(vital_signs(human))
    assert [name for _, name, _ in monitor.table()][0] == "recipient_heart_rate"
    assert monitor.read()[0] == 101
    hidden = Human("r", human.avatar, posture=human.posture, movable=("right_shoulder",))
    hidden.spawn(World(), Pose((0, 0, 0.5)))
    assert "heart_rate" not in {o.name for o in hidden.observables()}
