"""The command `bench learning`: steps and updates per second, see `baselines.training.throughput`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rcare_marl.baselines.evaluate import versions

from .console import console, table

TASK = "feeding"
PROCESSES = "1,2"
SECONDS = 10.0
MEASURED_WITH = ("pybullet", "numpy", "torch", "torchrl", "tensordict")


def bench(task: str = TASK, processes: str = PROCESSES, seconds: float = SECONDS) -> dict[str, Any]:
    """Return what was measured, as plain values for JSON.

    Args:
        task: Name of the task.
        processes: Counts of worker processes, such as `1,4,16`.
        seconds: Time of each measurement [s].

    Raises:
        ConfigError: If `processes` is no such list, or a number is impossible.
        UnknownNameError: If there is no such task.
    """
    from rcare_marl.baselines.training import throughput  # TorchRL takes seconds to import

    counts = throughput.process_counts(processes)
    result = throughput.measure(task, processes=counts, seconds=seconds)
    return result | {"versions": versions(MEASURED_WITH)}


def show(result: Mapping[str, Any]) -> None:
    """Print what `bench` returned as a table."""
    from rcare_marl.baselines.training import throughput

    envs = result["envs_per_process"]
    title = f"{result['task']}, {envs} environments a process, load {result['load']:.1f}"
    console().print(table(title, ("what", "figure"), throughput.lines(result)))
