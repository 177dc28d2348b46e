"""What there is, as rows: for tables and for JSON."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec

from rcare_marl import assets
from rcare_marl.agents.coaching.exercise import load_exercises
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.sampling.population import (
    PREFIX,
    SIX,
    population_hash,
    population_names,
    population_size,
)
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.agents.sensing.suite import SENSORS
from rcare_marl.config import read_yaml
from rcare_marl.console import console, table
from rcare_marl.envs.devices.device_model import load_device
from rcare_marl.envs.homes import home_names, load_house
from rcare_marl.envs.randomise import ABOUT, FOLDER, randomisation_names
from rcare_marl.envs.registry import policy_factory, policy_names, task_class, task_names

Row = dict[str, str]


def rows(kind: str) -> list[Row]:
    """Return one row for each thing of a kind that `list` lists; all have the same keys."""
    return {
        "tasks": _tasks,
        "robots": _robots,
        "avatars": _avatars,
        "populations": _populations,
        "postures": _postures,
        "policies": _policies,
        "devices": _devices,
        "homes": _homes,
        "sensors": _sensors,
        "exercises": _exercises,
        "algorithms": _algorithms,
        "randomisations": _randomisations,
        "licences": _licences,
    }[kind]()


def show(kinds: Mapping[str, Sequence[Row]]) -> None:
    """Print a table for each kind."""
    screen = console()
    for kind, found in kinds.items():
        columns = list(found[0]) if found else ["name"]
        screen.print(table(kind, columns, (list(row.values()) for row in found)))


def _tasks() -> list[Row]:
    out = []
    for name in task_names():
        cls = task_class(name)
        roles = (
            f"{role} ({part.default})" if part.default else f"{role} (optional)"
            for role, part in cls.roles().items()
        )
        out.append({"name": name, "roles": ", ".join(roles), "about": first_line(cls)})
    return out


def _robots() -> list[Row]:
    return [
        {
            "name": name,
            "arm joints": " + ".join(str(len(arm.joints)) for arm in config.arms.values()),
            "moves": ", ".join(config.parts),
            "base": config.base.kind if config.base is not None else "bolted down",
            "mounts": ", ".join(config.mounts),
        }
        for name, config in ((name, load_robot(name)) for name in assets.names("robots"))
    ]


def _avatars() -> list[Row]:
    return [
        {
            "name": name,
            "condition": avatar.condition,
            "age": f"{avatar.age_years:g}",
            "height": f"{avatar.height_m:.2f} m",
            "mass": f"{avatar.mass_kg:g} kg",
        }
        for name, avatar in ((name, load_avatar(name)) for name in assets.names("avatars"))
    ]


def _populations() -> list[Row]:
    return [
        {
            "name": name if name == SIX else f"{PREFIX}{name}",
            "people": str(population_size(name)),
            "version": population_hash(name),
        }
        for name in population_names()
    ]


def _postures() -> list[Row]:
    return [
        {"name": name, "about": load_posture(name).description} for name in assets.names("postures")
    ]


def _policies() -> list[Row]:
    out = []
    for task in task_names():
        for role, part in task_class(task).roles().items():
            for name in policy_names(task, role):
                out.append(
                    {
                        "task": task,
                        "role": role,
                        "name": name,
                        "default": "yes" if name == part.partner else "",
                        "about": first_line(policy_factory(task, role, name)),
                    }
                )
    return out


def _devices() -> list[Row]:
    files = ((name, assets.find("devices", name)) for name in assets.names("devices"))
    models = ((name, load_device(file)) for name, file in files if "links" in read_yaml(file))
    return [
        {
            "name": name,
            "mass": f"{model.mass:.1f} kg",
            "controls": ", ".join(model.controls),
            "carries": ", ".join(model.postures),
        }
        for name, model in models
    ]


def _homes() -> list[Row]:
    houses = ((name, load_house(name)) for name in home_names())
    return [
        {"name": name, "about": house.title, "rooms": str(len(house.rooms))}
        for name, house in houses
    ]


def _sensors() -> list[Row]:
    return [{"name": name, "about": first_line(made)} for name, made in sorted(SENSORS.items())]


def _exercises() -> list[Row]:
    return [{"name": each.name, "about": each.about} for each in load_exercises()]


def _algorithms() -> list[Row]:
    if find_spec("torch") is None:
        return [{"name": "none", "about": "they need torch, which is not installed"}]
    from rcare_marl.baselines.algorithms import algorithm_class, algorithm_names  # it needs torch

    return [
        {"name": name, "about": first_line(algorithm_class(name))} for name in algorithm_names()
    ]


def _randomisations() -> list[Row]:
    return [
        {
            "name": name,
            "about": str(about["description"]),
            "perturbs": ", ".join(key for key in about if key not in ABOUT),
        }
        for name in randomisation_names()
        for about in (read_yaml(assets.find(FOLDER, name)),)
    ]


def first_line(thing: object) -> str:
    """Return the first sentence of what documents a class or function, as a description."""
    text = (inspect.getdoc(thing) or "").split("\n\n")[0].replace("\n", " ").strip()
    if text.startswith("Return "):
        text = text.removeprefix("Return ").capitalize()
    return text.rstrip(".")


def _licences() -> list[Row]:
    """Return what is installed of all that this package needs, directly or not, and its licence."""
    found: dict[str, Row] = {}
    waiting = ["rcare-marl"]
    while waiting:
        name = waiting.pop()
        key = re.sub(r"[-_.]+", "-", name).lower()
        if key in found:
            continue
        try:
            package = distribution(name)
        except PackageNotFoundError:  # of an extra that was not asked for
            continue
        about = package.metadata.json
        kinds = (kind for kind in about.get("classifier", ()) if kind.startswith("License ::"))
        said = (
            str(about.get("license_expression", "")),
            ", ".join(k.split(" :: ")[-1] for k in kinds),
        )
        licence = next(filter(None, (*said, str(about.get("license", "")).strip())), "not said")
        found[key] = {
            "name": package.name,
            "version": package.version,
            "licence": licence.partition("\n")[0],
        }
        needed = (re.match(r"[\w.-]+", line) for line in package.requires or ())
        waiting += [match[0] for match in needed if match]
    return [found[key] for key in sorted(found)]
