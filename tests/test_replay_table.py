"""The replay table: every task x actuation x policy gives the same episode by its actions alone.

The rows come from the registries, so that a new task, a new way to drive muscles or a new policy of people
is in the table by itself. Every row is played for a few steps, and the usual ones to their end.
"""

from __future__ import annotations

import typing
from typing import Any

import pytest

import rcare_marl
from rcare_marl.agents.people.actuation.muscular import Excitation
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.episode import EpisodeRecorder, replay
from rcare_marl.envs.registry import task_class
from rcare_marl.errors import ConfigError

PERSON, HELPER = "recipient", "caregiver"
DRIVES = ("skeletal", *typing.get_args(Excitation))
MOODS = ("cooperative", "behaviour", "passive", "resisting")
BRIEF = 12  # control steps of a row that is not whole
QUICK = (  # the core; every other row is slow
    "ambulating-skeletal-default",
    "drinking-skeletal-resisting",
    "feeding-skeletal-cooperative",
    "feeding-unit-random",
)


def rows() -> list[Any]:
    """Return all rows: task, how the person is driven, who plays, and whether to the end."""
    out = []
    for task in rcare_marl.task_names():
        known = rcare_marl.policy_names(task, PERSON)
        moods = ["default", "random", *(mood for mood in MOODS if mood in known)]
        with_helper = [HELPER] if HELPER in task_class(task).roles() else []
        learned = ["learned"] if "learned" in rcare_marl.policy_names(task, "robot") else []
        found = [(drive, mood, False) for drive in DRIVES for mood in moods]
        found += [(drive, "default", True) for drive in DRIVES]
        found += [("skeletal", m, w) for m in with_helper + learned for w in (False, True)]
        found += [("skeletal", mood, True) for mood in moods[1:]]
        for drive, mood, whole in found:
            name = f"{task}-{drive}-{mood}"
            marks = [] if name in QUICK and not whole else [pytest.mark.slow]
            identifier = f"{name}-whole" if whole else name
            out.append(pytest.param(task, drive, mood, whole, id=identifier, marks=marks))
    return out


def cast(task: str, drive: str, mood: str) -> CareEnv:
    """Return an environment in which policies play all roles.

    Args:
        task: The task.
        drive: `skeletal`, or what the muscles of the person are commanded by.
        mood: A policy of the person; `default` for everybody's usual one, `random` for everybody,
            `learned` for the robot, `caregiver` for a helper who is there beside.

    Raises:
        ConfigError: If a policy cannot act through such a drive.
    """
    roles = task_class(task).roles()
    # Not everybody can move what a task lets move at will, and those who cannot have no behaviour.
    model = roles[PERSON].default if mood != "behaviour" else None
    entries: dict[str, Any] = {PERSON: {"model": model or "karan"}}
    if drive != "skeletal":
        entries[PERSON] |= {"actuation": "muscle", "excitation": drive}
    if mood == HELPER:
        entries[HELPER] = "caregiver"
    policies: dict[str, str] = {}
    for name, role in roles.items():
        if role.default is None and name not in entries:
            continue
        policies[name] = "scripted" if role.kind is Robot else role.partner or "still"
        if mood == "random":
            policies[name] = mood
    if mood in MOODS:
        policies[PERSON] = mood
    if mood == HELPER and roles[HELPER].default is None:
        policies[HELPER] = "behaviour"
    if mood == "learned":
        policies["robot"] = mood
    return rcare_marl.make(task, policies=policies, **entries)


@pytest.mark.parametrize(("task", "drive", "mood", "whole"), rows())
def test_the_actions_alone_give_the_same_episode(
    task: str, drive: str, mood: str, whole: bool
) -> None:
    try:
        env = cast(task, drive, mood)
    except (
        ConfigError
    ) as refusal:  # a script may refuse excitations, but must say what it acts through
        assert drive in ("unit", "group") and "posture" in str(refusal)
        return
    try:
        recorder = EpisodeRecorder(env)
        env.reset(seed=3)
        while not env.is_over and (whole or len(recorder) < BRIEF):
            env.step({})
        episode = recorder.episode()
    finally:
        env.close()
    found = replay(episode)
    assert found.difference == ""
    assert found.steps == episode.steps > 0
