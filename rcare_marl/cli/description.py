"""A task in full: who plays, what each role does and sees, settings, constants."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import sys
import typing
from collections.abc import Iterator, Mapping
from contextlib import closing
from typing import Any

from rich.text import Text

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.console import console, table
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.reach import describe_reach
from rcare_marl.envs.registry import policy_names, task_class
from rcare_marl.envs.task import Task, part_name

SECTION = re.compile(r"\n\s*(?:Attributes|Args|Raises|Returns|Example)s?:\s*\n")
TRAILING = re.compile(r"\s#\s(?!type:|fmt:|noqa)(.*)$")


def describe(task: str, cast: Mapping[str, Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """Return everything about a task under a cast and settings, as plain values for JSON."""
    cls = task_class(task)
    with closing(make(task, options=options, **cast)) as env:
        env.reset(seed=0)
        roles = {role: _role(env, task, role) for role in env.cast}
        return {
            "task": task,
            "about": inspect.getdoc(cls) or "",
            "roles": roles,
            "unplayed_roles": [role for role in cls.roles() if role not in env.cast],
            "control_dt_s": env.task.control_dt,
            "physics_dt_s": env.world.physics_dt,
            "time_limit_s": env.task.time_limit,
            "options": _options(cls, env.task.options),
            "metrics": list(env.task.report()),
            "constants": list(_constants(cls)),
        }


def _role(env: CareEnv, task: str, role: str) -> dict[str, Any]:
    agent = env.cast[role]
    people = [each for each in env.cast.values() if isinstance(each, Human)]
    reach = None
    if isinstance(agent, Robot) and any(name in agent.config.arms for name in agent.moves):
        reach = describe_reach(env.world, agent, people)
    return {
        "kind": type(agent).__name__.lower(),
        "facts": agent.describe(),
        "reach": reach,
        "policies": list(policy_names(task, part_name(role))),
        "partner": env.task.roles()[part_name(role)].partner,
        "actions": [{"index": i, "name": name} for i, name in enumerate(agent.action_names)],
        "observations": [
            {"slice": [part.start, part.stop], "name": name, "unit": unit}
            for part, name, unit in env.describe(role)
        ],
        "arrays": [
            {"name": name, "shape": list(shape), "unit": unit}
            for shape, name, unit in env.describe_arrays(role)
        ],
        "rewards": list(env.task.paid(role, env.task.state)),
    }


def _options(cls: type[Task], chosen: Any) -> list[dict[str, Any]]:
    hints, about = typing.get_type_hints(cls.Options), dict[str, str]()
    for base in reversed(cls.Options.__mro__[:-1]):  # without `object`
        about |= _attributes(base)
    return [
        {
            "name": field.name,
            "type": _shown(hints[field.name]),
            "default": _default(field),
            "value": getattr(chosen, field.name),
            "about": about.get(field.name, ""),
        }
        for field in dataclasses.fields(cls.Options)
    ]


def _shown(hint: Any) -> str:
    if typing.get_origin(hint) is typing.Literal:
        return " or ".join(str(value) for value in typing.get_args(hint))
    return hint.__name__ if isinstance(hint, type) else str(hint)


def _attributes(cls: type) -> dict[str, str]:
    """Return what a class's docstring says of each attribute."""
    _, _, rest = (inspect.getdoc(cls) or "").partition("Attributes:\n")
    text = SECTION.split(rest)[0]
    found = re.findall(r"^\s{4}(\w+): (.*(?:\n\s{5,}.*)*)", text, re.MULTILINE)
    return {name: " ".join(words.split()).rstrip(".") for name, words in found}


def _constants(cls: type[Task]) -> Iterator[dict[str, Any]]:
    """Yield the numbers that a task's module names, with the comments that say what they are."""
    module = sys.modules[cls.__module__]
    source = inspect.getsource(module)
    lines = source.splitlines()
    for node in ast.parse(source).body:
        if not isinstance(node, ast.Assign):
            continue
        target = node.targets[0]
        names = target.elts if isinstance(target, ast.Tuple) else [target]
        comment = TRAILING.search(lines[(node.end_lineno or node.lineno) - 1])
        for name in names:
            if not isinstance(name, ast.Name) or not name.id.isupper():
                continue
            value = getattr(module, name.id)
            if isinstance(value, int | float | str | tuple | dict):
                yield {
                    "name": name.id,
                    "value": list(value) if isinstance(value, tuple) else value,
                    "about": comment.group(1) if comment else "",
                }


def show(facts: Mapping[str, Any]) -> None:
    """Print what `describe` returned."""
    screen = console()
    screen.print(Text(facts["task"], style="bold"))
    screen.print(Text(facts["about"]))
    screen.print(
        Text(
            f"\nA control step lasts {facts['control_dt_s']:g} s, a physics step "
            f"1/{1 / facts['physics_dt_s']:.0f} s, an episode {facts['time_limit_s']:g} s."
        )
    )
    for role in facts["unplayed_roles"]:
        screen.print(Text(f"Nobody plays {role}: --{role} MODEL adds someone."))
    for role, part in facts["roles"].items():
        _show_role(role, part)
    options = [
        (o["name"], o["type"], _value(o["value"]), _value(o["default"]), o["about"])
        for o in facts["options"]
    ]
    screen.print(
        table(
            "settings (--option NAME=VALUE)", ("name", "type", "now", "default", "about"), options
        )
    )
    constants = [(c["name"], _value(c["value"]), c["about"]) for c in facts["constants"]]
    screen.print(table("constants", ("name", "value", "about"), constants))
    screen.print(Text(f"metrics: {', '.join(facts['metrics'])}"))


def _show_role(role: str, part: Mapping[str, Any]) -> None:
    screen = console()
    screen.print()
    screen.rule(Text(f"{role}, a {part['kind']}", style="bold cyan"), align="left")
    for name, fact in part["facts"].items():
        screen.print(Text(f"{name}: {fact}"))
    if part["reach"] is not None:
        told = (f"{name.replace('_', ' ')} {fact}" for name, fact in part["reach"].items())
        screen.print(Text(f"reaches from: {', '.join(told)}"))
    screen.print(
        Text(f"policies: {', '.join(part['policies'])} (default partner {part['partner']})")
    )
    screen.print(Text(f"reward terms: {', '.join(part['rewards'])}"))
    actions = [(str(action["index"]), action["name"]) for action in part["actions"]]
    screen.print(table("actions, each in -1 to 1", ("index", "what 1 means"), actions, index=True))
    seen = [(_slice(*o["slice"]), o["name"], o["unit"]) for o in part["observations"]]
    size = part["observations"][-1]["slice"][1] if seen else 0
    screen.print(table(f"observation, {size} values", ("slice", "name", "unit"), seen, slice=True))
    if part["arrays"]:
        arrays = [(a["name"], " x ".join(map(str, a["shape"])), a["unit"]) for a in part["arrays"]]
        screen.print(table("arrays beside them", ("name", "shape", "unit"), arrays))


def _slice(start: int, stop: int) -> str:
    return str(start) if stop == start + 1 else f"{start}:{stop}"


def _default(field: dataclasses.Field[Any]) -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return field.default


def _value(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_value(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_value(item) for item in value)
    return str(value)
