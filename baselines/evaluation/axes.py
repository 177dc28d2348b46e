"""What a matrix is made over: people, robots, partners and homes, each a list of names as text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rcare_marl import assets
from rcare_marl.agents.people.sampling.population import (
    PREFIX,
    SIX,
    find_avatar,
    names_several,
    people_named,
)
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.envs.homes import LEVELS, home_names
from rcare_marl.envs.registry import is_policy_file, policy_names, task_class
from rcare_marl.errors import ConfigError, check_name

AXES = ("people", "robots", "partners", "homes")
ALL, REACHABLE, BARE = "all", "reachable", "bare"
RECIPIENT, CAREGIVER = "recipient", "caregiver"
TREMOR, MUSCLE = "tremor", "muscle"  # partners that differ in their body
USUAL = ("behaviour", "still", "passive", "resisting", "refusing")  # of `all`, where they are known


def parse_over(text: str) -> dict[str, tuple[str, ...]]:
    """Return the values of each axis of a text such as `people=six,robots=all,homes=2`.

    Raises:
        UnknownNameError: If there is no such axis.
        ConfigError: If it is no list of axes, or one stands there twice or without a value.
    """
    out: dict[str, tuple[str, ...]] = {}
    for part in text.split(","):
        axis, _, rest = part.partition("=")
        axis, values = axis.strip(), tuple(value.strip() for value in rest.split("+"))
        check_name("axis of a matrix", axis, AXES)
        if axis in out or not all(values):
            what = "stands there twice" if axis in out else "needs values, joined by +"
            raise ConfigError(
                f"{axis} {what}; write for example people=six,robots=pr2+ur5, got {text!r}"
            )
        out[axis] = values
    return out


def axis_values(task: str, axis: str, values: Sequence[str]) -> tuple[str, ...]:
    """Return the single values that those of an axis stand for, each once.

    Raises:
        UnknownNameError: If a name does not exist.
        ConfigError: If a value is impossible.
    """
    expand = {"people": _people, "robots": _robots, "partners": _partners, "homes": _homes}[axis]
    found = [name for value in values for name in expand(task, value)]
    return tuple(dict.fromkeys(found))


def _people(task: str, value: str) -> tuple[str, ...]:
    if RECIPIENT not in task_class(task).roles():
        raise ConfigError(f"task {task!r} has no {RECIPIENT!r}: leave out people and partners")
    if not Path(value).suffix and not value.startswith(PREFIX):
        check_name("avatar or population", value, [*assets.names("avatars"), SIX])
    if not names_several(value):
        find_avatar(value)  # so that a file that is missing is told before anything runs
    return people_named(value)


def _robots(task: str, value: str) -> tuple[str, ...]:
    known, reach = assets.names("robots"), task_class(task).reachable_by
    if value == REACHABLE:
        return tuple(sorted(known if reach is None else reach))
    if not Path(value).suffix:
        check_name("robot", value, [*known, ALL, REACHABLE])
    if value != ALL:
        load_robot(value)
    return tuple(known) if value == ALL else (value,)


def partner_names(task: str) -> tuple[str, ...]:
    """Return the partners that `all` stands for: how the recipient is played, and then the caregiver.

    The recipient's default policy comes first, then others that it knows (see `USUAL`), then the default
    one with a body that trembles and with one driven by muscles. Policies of a caregiver whom the task
    cannot do without are called `caregiver:NAME`.
    """
    roles = task_class(task).roles()
    if RECIPIENT not in roles:
        raise ConfigError(f"task {task!r} has no {RECIPIENT!r}: leave out people and partners")
    known = policy_names(task, RECIPIENT)
    usual = roles[RECIPIENT].partner
    own = [name for name in (usual, *USUAL) if name in known]
    helper = roles.get(CAREGIVER)
    beside = policy_names(task, CAREGIVER) if helper is not None and helper.default else ()
    others = [f"{CAREGIVER}:{n}" for n in beside if helper and n not in (helper.partner, "random")]
    return tuple(dict.fromkeys([*own, TREMOR, MUSCLE, *others]))


def _partners(task: str, value: str) -> tuple[str, ...]:
    known = partner_names(task)
    if value == ALL:
        return known
    role, _, name = value.rpartition(":")
    if not is_policy_file(name):
        helpers = policy_names(task, CAREGIVER) if CAREGIVER in task_class(task).roles() else ()
        more = [*policy_names(task, RECIPIENT), *(f"{CAREGIVER}:{each}" for each in helpers)]
        check_name(f"partner in task {task!r}", value, {ALL, *known, *more})
    elif role not in ("", CAREGIVER):
        raise ConfigError(
            f"a partner plays the {RECIPIENT} or, as in caregiver:FILE, helps: got {value!r}"
        )
    return (value,)


def _homes(task: str, value: str) -> tuple[str, ...]:
    known = home_names()
    if value.isdecimal():
        if not 1 <= int(value) <= len(known):
            raise ConfigError(f"homes are a number from 1 to {len(known)}, or names, got {value}")
        return tuple(known[: int(value)])
    name, colon, level = value.partition(":")
    check_name("house", name, [*known, ALL, BARE])
    if colon and (name == BARE or level not in map(str, LEVELS)):
        raise ConfigError(
            f"the level of a house is one of {LEVELS}, as in house_07:2, got {value!r}"
        )
    return tuple(f"{each}{colon}{level}" for each in known) if name == ALL else (value,)
