"""What numbers depend on beside seeds: versions of packages, and the machine."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import rcare_marl

MEASURED_WITH = ("pybullet", "numpy", "numba", "gymnasium", "pettingzoo")


def versions(packages: Iterable[str] = MEASURED_WITH) -> dict[str, str]:
    """Return the versions of this package, of Python, and of `packages`."""
    found = {name: importlib.metadata.version(name) for name in packages}
    return {"rcare_marl": rcare_marl.__version__, "python": platform.python_version(), **found}


def machine() -> dict[str, Any]:
    """Return what a machine is, without its name."""
    return {"system": platform.platform(), "processor": _processor(), "cores": os.cpu_count()}


def _processor() -> str:
    """Return the model of the processor; what Python knows of it where Linux does not tell."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or platform.machine()
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return found[1].strip() if found is not None else platform.machine()


def changes(then: Mapping[str, Any], now: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what is another now than it was, as texts."""
    names = sorted({*now, *then})
    return tuple(
        f"{n} is {now.get(n)}, was {then.get(n)}" for n in names if now.get(n) != then.get(n)
    )
