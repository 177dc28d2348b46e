"""An episode begins with everybody apart: who does nothing presses nobody."""

from __future__ import annotations

import pytest

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.envs.registry import task_class
from rcare_marl.errors import ConfigError

PRESSED = 5.0  # [N] that a robot which does nothing presses with, in the first control step
PEOPLE = tuple(name for name in assets.names("avatars") if name != "caregiver")
TASKS = ("feeding", "drinking", "bathing", "limb_repositioning", "ambulating", "handing_over")
# Robots whose other hand or body began in the person.
KNOWN = (
    ("bathing", "pr2", "morgan"),
    ("bathing", "pr2", "daniel"),
    ("bathing", "pepper", "natalia"),
)


def first_force(task: str, robot: str, person: str, seeds: int = 1) -> float:
    """Return the greatest force of a robot on a person in the first 0.1 s, where nobody acts [N]."""
    roles = task_class(task).roles()
    still = {name: "still" for name, role in roles.items() if role.default is not None}
    env = rcare_marl.make(task, robot=robot, recipient=person, policies=still)
    forces = [0.0]
    try:
        people = [a for a in env.cast.values() if isinstance(a, Human)]
        robots = [a for a in env.cast.values() if isinstance(a, Robot)]
        look = env.task.after_substep

        def measure() -> None:
            look()
            forces.extend(env.world.contact_force(p.body, r.body) for p in people for r in robots)

        env.task.after_substep = measure  # type: ignore[method-assign]
        for seed in range(seeds):
            env.reset(seed=seed)
            env.step({})
        return max(forces)
    finally:
        env.close()


@pytest.mark.parametrize(
    ("task", "robot", "person"),
    [KNOWN[0], *(pytest.param(*case, marks=pytest.mark.slow) for case in KNOWN[1:])],
)
def test_a_robot_that_does_nothing_presses_nobody_at_the_start(
    task: str, robot: str, person: str
) -> None:
    assert first_force(task, robot, person, seeds=3) <= PRESSED


def test_a_robot_that_drives_does_not_begin_bathing_within_the_bed() -> None:
    env = rcare_marl.make("bathing", robot="pepper", recipient="natalia")
    bed = next(b for b in env.world.bodies if b.name == "hospital_bed")
    for seed in (21503, 93101, 93102):  # up to 10 cm within it before, and thrown out by it later
        env.reset(seed=seed)
        robot = env.cast["robot"].body
        assert env.world.separation(robot, bed, within=0.1) > 0
    env.close()


def test_an_elbow_that_lies_otherwise_does_not_begin_against_a_robot_beside_the_bed() -> None:
    both = {"robot": "still", "recipient": "still"}
    env = rcare_marl.make("bathing", robot="pepper", recipient="natalia", policies=both)
    for seed in (90953, 93101, 93134):  # 19 to 42 N before
        env.reset(seed=seed)
        env.step({})
        assert env.task.report()["peak_force_n"] == 0
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("robot", assets.names("robots"))
@pytest.mark.parametrize("task", TASKS)
def test_every_robot_begins_clear_of_everybody_or_is_refused(task: str, robot: str) -> None:
    for person in PEOPLE:
        try:
            force = first_force(task, robot, person)
        except ConfigError as refusal:
            assert robot in str(refusal) or person in str(refusal) or "mount" in str(refusal)
            continue
        assert force <= PRESSED, person
