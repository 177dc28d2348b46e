"""Manual muscle testing of our people finds the grades that they were given."""

import numpy as np
import pytest
from variants import few

from rcare_marl.agents.people.actuation.drive import ActuationConfig
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.validation import grades
from rcare_marl.agents.people.validation.grades import (
    GROUPS,
    KINDS,
    TUNED,
    Kind,
    bodies,
    checks,
    graded_group,
    group_cases,
    moved,
    resisted_cases,
    side_cases,
)
from rcare_marl.agents.people.validation.single_joint import SingleJoint
from rcare_marl.pose import Pose
from rcare_marl.world import World


def wrong(cases: list[grades.Case]) -> list[grades.Case]:
    return [case for case in cases if not case.is_right]


@pytest.mark.parametrize("kind", few(KINDS, "skeletal"))
@pytest.mark.parametrize("name", few(["karan", "kim", "caregiver, 1.48 m and 42 kg"], "kim"))
def test_all_forty_whole_side_cases_are_right(name: str, kind: Kind) -> None:
    cases = side_cases(bodies()[name], kind)
    assert len(cases) == 40
    assert not wrong(cases)


def test_whole_side_cases_of_an_elbow_are_right_by_muscles_too() -> None:
    cases = side_cases(bodies()["kim"], "muscle", ["elbow_flexors"])
    assert len(cases) == 8
    assert not wrong(cases)


@pytest.mark.parametrize("kind", few(KINDS, "skeletal"))
def test_strong_muscles_of_other_groups_do_not_lift_for_a_graded_one(kind: Kind) -> None:
    assert not wrong(group_cases(load_avatar("jose"), kind))


@pytest.mark.parametrize("kind", few(KINDS, "skeletal"))
def test_an_examiner_finds_3_plus_and_4_by_hand(kind: Kind) -> None:
    assert not wrong(resisted_cases(load_avatar("caregiver"), kind))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", list(bodies()))
def test_all_cases_are_right_on_every_body(name: str, kind: Kind) -> None:
    person = bodies()[name]
    assert not wrong(side_cases(person, kind))
    assert not wrong(group_cases(person, kind))


@pytest.mark.parametrize("kind", KINDS)
def test_the_higher_the_grade_the_further_the_limb_goes(kind: Kind) -> None:
    person = load_avatar("morgan")
    gone = [
        moved(
            graded_group(person, "elbow_flexors", grade), kind, "elbow_flexors", "against gravity"
        )
        for grade in (1.0, 1.5, 2.0, 2.33, 2.67, 3.0)
    ]
    assert (np.diff(gone) > -0.02).all()
    assert gone[0] < 0.5 < gone[-1]


@pytest.mark.parametrize("kind", KINDS)
def test_a_joint_alone_moves_as_in_the_physics_engine(kind: Kind) -> None:
    person = graded_group(load_avatar("karan"), "elbow_flexors", 3.0)
    dof, posture = "right_elbow_flexion", load_posture("standing")
    config = ActuationConfig(kind=kind, excitation="posture")
    world = World()
    human = Human("p", person, posture=posture, movable=[dof], actuation=config)
    human.spawn(world, Pose((0, 0, 0.5)))
    human.reset(np.random.default_rng(0))
    angles = human.angles.copy()  # with the person's bearing
    joint = SingleJoint(person, dof, config, angles=angles, gravity=np.array((0, -1.0, 0)))
    found = joint.move(2.0, towards=2.0).angles
    there = []
    for step in range(len(found)):
        if step % 24 == 0:
            human.command(human.action_towards({dof: 2.0}, 0.1), 0.1)
        human.actuate()
        world.step()
        there.append(human.angle(dof))
    assert np.abs(found - np.array(there)).max() < 0.02
    assert angles[DOF_INDEX[dof]] == pytest.approx(joint.start)
    assert found[-1] > 1.0


@pytest.mark.slow
def test_the_checks_say_what_is_fitted_and_what_is_held_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(grades, "GROUPS", GROUPS[:1])
    monkeypatch.setattr(
        grades, "bodies", lambda: {name: load_avatar(name) for name in (TUNED[0], "kim")}
    )
    monkeypatch.setattr(grades, "KINDS", ("skeletal",))
    found = checks()
    assert {check.split for check in found} == {"fitted", "held out"}
    assert {check.family for check in found} == {"grade"}
    assert all(("karan" in c.case) == c.is_fitted for c in found if "cases right" in c.case)
    assert len({check.case + check.source for check in found}) == len(found)
    assert len(DOFS) == 112
