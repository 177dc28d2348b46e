"""Populations on the command line: choose among people, export and draw them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import yaml

from rcare_marl.agents.people.avatar import AvatarConfig
from rcare_marl.agents.people.sampling.condition import condition_names
from rcare_marl.agents.people.sampling.population import (
    PREFIX,
    avatar_fields,
    find_avatar,
    people_of,
    population_hash,
    population_names,
    population_size,
)
from rcare_marl.agents.people.sampling.sampler import sample_person
from rcare_marl.atomic_file import write_whole
from rcare_marl.console import console, print_line, table
from rcare_marl.envs.people_sheet import draw_people
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.rendering.portrait import encoded


@dataclass(frozen=True)
class Wanted:
    """Which people are chosen: words of their condition, sex, ages as LOW:HIGH, and at most how many."""

    condition: str | None = None
    sex: str | None = None
    age: str | None = None
    limit: int | None = None


def show_people(
    who: str,
    severity: str | None,
    seed: int,
    wanted: Wanted,
    out: Path | None,
    sheet: Path | None,
) -> None:
    """Print people as a table, or write them to a file, or draw them.

    Args:
        who: A population, one of its people, or a condition.
        severity: Of a condition.
        seed: Of the first person of a condition.
        wanted: Which of them.
        out: A .json or .yaml file or a folder for them.
        sheet: A picture for them.

    Raises:
        ConfigError: If nobody is as wanted, or the file is of no kind that is written.
        UnknownNameError: If there is no such population, condition or severity.
    """
    named, about = _who(who, severity, seed, wanted.limit)
    low, high = _ages(wanted.age)
    chosen = {
        name: person
        for name, person in named.items()
        if (wanted.condition is None or _plain(wanted.condition) in _plain(person.condition))
        and (wanted.sex is None or person.sex == wanted.sex)
        and low <= person.age_years <= high
    }
    chosen = dict(list(chosen.items())[: wanted.limit])
    if not chosen:
        raise ConfigError(f"nobody of {who!r} is as wanted; there are {len(named)} people")
    if out is not None:
        _export(chosen, out)
        print_line(f"{len(chosen)} people in {out}")
    if sheet is not None:
        kind = "JPEG" if sheet.suffix.lower() in (".jpg", ".jpeg") else "PNG"
        write_whole(sheet, encoded(draw_people(list(chosen.values())), kind))
        print_line(f"{len(chosen)} people drawn in {sheet}")
    if out is None and sheet is None:
        rows = (
            (
                name,
                p.name,
                p.sex,
                f"{p.age_years:g}",
                f"{p.height_m:.2f} m",
                f"{p.mass_kg:g} kg",
                p.condition,
            )
            for name, p in chosen.items()
        )
        columns = ("person", "name", "sex", "age", "stature", "mass", "condition")
        console().print(table(about, columns, rows))


def _who(
    who: str, severity: str | None, seed: int, limit: int | None
) -> tuple[dict[str, AvatarConfig], str]:
    """Return people by name, and the title of their table."""
    who = who.removeprefix(PREFIX)
    population, _, number = who.partition(":")
    if population in population_names():
        if number:
            return {f"{PREFIX}{who}": find_avatar(f"{PREFIX}{who}")}, who
        found = {f"{PREFIX}{who}:{i}": person for i, person in enumerate(people_of(who))}
        return found, f"{who}: {population_size(who)} people, version {population_hash(who)}"
    check_name("population or condition", who, [*population_names(), *condition_names()])
    wanted: str | float | None = severity
    if severity is not None and severity.replace(".", "", 1).isdecimal():
        wanted = float(severity)
    seeds = range(seed, seed + (limit or 1))
    return {f"{who} seed {s}": sample_person(who, wanted, s) for s in seeds}, who


def _plain(text: str) -> str:
    return text.lower().replace("_", " ")


def _ages(text: str | None) -> tuple[float, float]:
    if text is None:
        return 0.0, 200.0
    low, found, high = text.partition(":")
    try:
        return float(low or 0), float(high or 200) if found else float(low)
    except ValueError:
        raise ConfigError(f"--age is LOW:HIGH in years, such as 20:40, got {text!r}") from None


def _export(chosen: dict[str, AvatarConfig], out: Path) -> None:
    """Write people to one JSON, to one YAML, or each to a YAML of their own in a folder."""
    if out.suffix == ".json":
        people = {name: avatar_fields(person) for name, person in chosen.items()}
        write_whole(out, (json.dumps(people, indent=1) + "\n").encode())
        return
    if out.suffix not in ("", ".yaml", ".yml"):
        raise ConfigError(f"--out ends with .json or .yaml or is a folder, got {out.name!r}")
    if out.suffix and len(chosen) > 1:
        raise ConfigError(f"{len(chosen)} people need a .json file or a folder, got {out.name!r}")
    for name, person in chosen.items():
        file = out if out.suffix else out / f"{name.replace(':', '_').replace(' ', '_')}.yaml"
        file.parent.mkdir(parents=True, exist_ok=True)
        text = f"# SYNTHETIC: {name}\n" + yaml.safe_dump(avatar_fields(person), sort_keys=False)
        write_whole(file, text.encode())
