"""Relaxed limbs drop as people's do, and spastic ones catch by their grade."""

from typing import Any

import numpy as np
import pytest
from variants import few

from rcare_marl.agents.people.actuation.drive import ActuationConfig
from rcare_marl.agents.people.actuation.joint_tissue import (
    PassiveJoint,
    end_tissue,
    joint_damping,
    passive_joints,
)
from rcare_marl.agents.people.actuation.stretch_reflex import (
    Spasticity,
    StretchReflex,
    spasticity,
)
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.profile import ASHWORTH
from rcare_marl.agents.people.validation.swing import (
    KINDS,
    LIMBS,
    SPASTIC,
    Kind,
    beats,
    catch,
    checks,
    drop,
    examined,
)
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.world import World

DT = 1 / 240


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["karan", "natalia", "kim"])
def test_a_healthy_leg_swings_as_published(name: str, kind: Kind) -> None:
    found = drop(examined(load_avatar(name)), kind, "knee")
    assert 1.5 < found.relaxation < 2.1
    assert 5 <= found.swings <= 9
    arm = drop(examined(load_avatar(name)), kind, "elbow")
    assert arm.swings >= 3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", few(["caregiver", "daniel"], "daniel"))
def test_the_drop_is_ordered_by_ashworth_grade(name: str, kind: Kind) -> None:
    person = load_avatar(name)
    drops = [
        drop(examined(person, spasticity={SPASTIC["knee"]: g}), kind, "knee") for g in ASHWORTH
    ]
    still = 1.05  # relaxation index of a leg that sinks without a swing: grades 2 to 4
    assert (np.diff([max(each.relaxation, still) for each in drops]) <= 0).all()
    assert (np.diff([each.first for each in drops]) < 0.1).all()  # [deg]
    assert drops[0].relaxation - drops[1].relaxation > 0.25


@pytest.mark.parametrize("kind", KINDS)
def test_the_catch_comes_earlier_and_stronger_with_every_grade(kind: Kind) -> None:
    for limb in LIMBS:
        found = [catch(load_avatar("karan"), kind, limb, grade) for grade in ASHWORTH]
        assert (np.diff([place for place, _ in found]) < 0).all()
        assert (np.diff([torque for _, torque in found]) > 0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_ankles_beat_at_grades_3_and_4_only(kind: Kind) -> None:
    person = load_avatar("karan")
    assert all(beats(person, kind, grade)[0] < 3 for grade in ("0", "1", "1+", "2"))
    for grade in ("3", "4"):
        count, rate = beats(person, kind, grade)
        assert count >= 3
        assert 4 < rate < 9


def reflex(grade: str = "3", **change: Any) -> StretchReflex:
    """Return the reflex of one joint whose muscles along the axis are spastic."""
    options: dict[str, Any] = {
        "passive": np.array([[0.0, 2.0]]),
        "strength": np.full((1, 2), 50.0),
        "inertia": np.ones(1),
        "physics_dt": DT,
        "by_muscle": True,
    }
    return StretchReflex([("0", grade)], **(options | change))


def test_a_reflex_answers_its_stretch_30_ms_late_and_only_its_own() -> None:
    felt, steps = reflex(), round(spasticity().delay / DT)
    shares = []
    for step in range(3 * steps):
        felt.feel(np.array([1.0]), np.array([-3.0 if step < 2 else 0.0]))
        shares.append(felt.share[0].copy())
    along = np.array(shares)[:, 1]
    assert np.flatnonzero(along > 0).tolist() == [steps, steps + 1]
    assert (np.array(shares)[:, 0] == 0).all()  # the other muscles are not spastic
    assert felt.torques().shape == (1,)
    felt.reset()
    assert felt.share.max() == 0


def test_a_longer_muscle_answers_a_slower_stretch() -> None:
    def least_speed(angle: float) -> float:
        for speed in np.linspace(0.05, 8.0, 160):
            felt = reflex("2")
            for _ in range(20):
                felt.feel(np.array([angle]), np.array([-speed]))
            if felt.share[0, 1] > 0.005:
                return float(speed)
        return np.inf

    assert least_speed(0.6) < least_speed(1.2) < least_speed(1.6)


def test_no_spasticity_costs_nothing() -> None:
    assert reflex("0").is_silent
    assert not reflex("1").is_silent


def test_passive_tissue_scales_with_the_limb() -> None:
    dofs, strength = ["right_knee_flexion", "right_index1_flexion"], np.array([220.0, 4.0])
    light, heavy = (joint_damping(dofs, strength, inertia * np.ones(2)) for inertia in (0.2, 0.4))
    assert heavy[0] == pytest.approx(2 * light[0])
    assert heavy[1] == light[1] == pytest.approx(passive_joints().other_damping * 4.0)
    assert end_tissue(dofs, np.ones(2))[1, ::2].max() == 0.0


def test_wrong_data_of_joints_and_reflexes_are_refused() -> None:
    with pytest.raises(ConfigError, match="below 0"):
        PassiveJoint(-1.0, (1, 1), (1, 1))
    with pytest.raises(ConfigError, match="grades of the reflex"):
        Spasticity(0.03, 0.04, 4.0, 600.0, 1650.0, {})


@pytest.mark.parametrize("kind", KINDS)
def test_who_was_relaxed_begins_to_move_where_the_limb_is(kind: Kind) -> None:
    world = World()
    config = ActuationConfig(kind=kind, excitation="posture")
    person = Human(
        "p",
        examined(load_avatar("karan")),
        posture=load_posture("standing"),
        movable=["right_elbow_flexion"],
        actuation=config,
    )
    person.spawn(world, Pose((0, 0, 0.5)))
    person.reset(np.random.default_rng(0))
    person.set_angles({"right_elbow_flexion": 1.6})
    person.drive.relax()
    for _ in range(240):
        person.actuate()
        world.step()
    fallen = person.angle("right_elbow_flexion")
    assert fallen < 1.3
    person.command(np.zeros(1), 0.1)
    for _ in range(24):
        person.actuate()
        world.step()
    assert abs(person.angle("right_elbow_flexion") - fallen) < 0.5
    assert abs(person.drive.target[0] - fallen) < 0.1


@pytest.mark.parametrize(("seconds"), [2.0, pytest.param(60.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["karan", "kim"])
def test_random_actions_without_muscles_stay_stable(name: str, seconds: float) -> None:
    world = World()
    person = Human("p", load_avatar(name), posture=load_posture("wheelchair"))
    person.spawn(world, Pose((0, 0, 0.5)))
    person.reset(np.random.default_rng(0))
    rng, fastest = np.random.default_rng(5), 0.0
    for _ in range(round(seconds / 0.1)):
        person.command(rng.uniform(-1, 1, person.action_size), 0.1)
        for _ in range(24):
            person.actuate()
            world.step()
        person.sense()
        fastest = max(fastest, max(map(abs, person.velocities)))
    assert np.isfinite(person.positions).all()
    assert fastest < 25


@pytest.mark.slow
def test_nearly_all_checks_of_swings_are_in_band() -> None:
    found = checks()
    for split, least in (("fitted", 1.0), ("held out", 0.9)):
        mine = [check.is_in_band for check in found if check.split == split]
        assert len(mine) > 20
        assert np.mean(mine) >= least
