"""Files of the package: robots, avatars, postures, devices."""

from __future__ import annotations

from pathlib import Path

from rcare_marl.errors import check_name

ROOT = Path(__file__).resolve().parent


def names(kind: str) -> tuple[str, ...]:
    """Return the names of all YAML files of a `kind`, a folder here, sorted."""
    return tuple(sorted(path.stem for path in (ROOT / kind).glob("*.yaml")))


def find(kind: str, name: str | Path) -> Path:
    """Return the YAML file of the `kind` (a folder here) called `name`, or the YAML file that it names.

    Raises:
        UnknownNameError: If there is none; the message lists those there are.
    """
    if Path(name).suffix in (".yaml", ".yml"):
        return Path(name)
    check_name(kind.rstrip("s"), str(name), names(kind))
    return ROOT / kind / f"{name}.yaml"
