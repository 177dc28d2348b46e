"""Episodes of shipped policies on both engines: how often they succeed, and how hard they touch.

- `success_X`: by how much the 95 % intervals (Wilson) of the success of policy X miss each other, 0 where
  they overlap;
- `force_X`: the two-sample statistic of Kolmogorov and Smirnov, the greatest difference of the two
  distributions of the greatest force of an episode, beside its critical value at 5 %. An engine is no
  different from the other by that where it stays below.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import ks_2samp, kstwobign  # type: ignore[import-untyped]

from rcare_marl.engines import ENGINES
from rcare_marl.envs.registry import lead_roles, policy_names
from rcare_marl.errors import check_name

from ..evaluation.evaluate import Episode, Job, run_jobs, wilson_interval

SHIPPED = ("scripted", "learned", "specialist")
FORCE = "peak_force_n"  # the metric [N]
ALIKE = 0.05  # share of equal engines that the bound of the force tells apart
QUANTILES = (0.25, 0.5, 0.75, 0.95)
BLOCK = 25  # episodes that a process plays in one scene


def compare(
    task: str,
    episodes: int,
    seed: int,
    processes: int,
    policy: str | None = None,
    level: int | None = None,
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """Return what each policy came to on either engine, and figures with their bounds.

    Args:
        task: The task.
        episodes: Of each policy on each engine, with the same seeds.
        seed: The first of them.
        processes: How many work side by side.
        policy: The policy; all that ship if None.
        level: Of the furniture or door, see `rcare_marl.make`.

    Raises:
        UnknownNameError: If there is no such policy.
    """
    lead = lead_roles(task)[0]
    known = policy_names(task, lead)
    if policy is not None:
        check_name(f"policy for {lead!r} of task {task!r}", policy, known)
    policies = [policy] if policy is not None else [name for name in known if name in SHIPPED]
    blocks = [(first, min(BLOCK, episodes - first)) for first in range(0, episodes, BLOCK)]
    played = [(policy, engine) for policy in policies for engine in ENGINES]
    jobs = [
        Job(task, {lead: policy}, count, seed + first, {}, {"engine": engine, "level": level})
        for policy, engine in played
        for first, count in blocks
    ]
    done = iter(run_jobs(jobs, processes))
    found = {key: [e for _ in blocks for e in next(done).episodes] for key in played}
    told: dict[str, dict[str, Any]] = {}
    figures: dict[str, dict[str, Any]] = {}
    for policy in policies:
        pair = [found[policy, engine] for engine in ENGINES]
        told[policy] = dict(zip(ENGINES, (_summary(each) for each in pair), strict=True))
        (low, high), (below, above) = (told[policy][e]["success_interval_95"] for e in ENGINES)
        forces = [[e.metrics[FORCE] for e in each] for each in pair]
        apart = float(ks_2samp(*forces, method="exact").statistic)
        rest = {
            f"success_{policy}": (max(low - above, below - high, 0.0), 0.0),
            f"force_{policy}": (apart, critical(*map(len, forces))),
        }
        for name, (value, bound) in rest.items():
            figures[name] = {"value": value, "bound": bound, "met": bool(value <= bound)}
    return told, figures


def critical(one: int, other: int) -> float:
    """Return the statistic of Kolmogorov and Smirnov that equal distributions exceed in 5 % of samples.

    Its limit for large samples. Source: Smirnov (1948), Ann. Math. Stat. 19, 279-281.
    """
    return float(kstwobign.isf(ALIKE) * np.sqrt((one + other) / (one * other)))


def _summary(episodes: Sequence[Episode]) -> dict[str, Any]:
    succeeded = sum(e.success for e in episodes)
    forces = np.array([e.metrics[FORCE] for e in episodes])
    return {
        "episodes": len(episodes),
        "successes": succeeded,
        "success_interval_95": list(wilson_interval(succeeded, len(episodes))),
        "peak_force_mean": float(forces.mean()),
        "peak_force_max": float(forces.max()),
        "peak_force_quantiles": dict(
            zip(map(str, QUANTILES), np.quantile(forces, QUANTILES).tolist(), strict=True)
        ),
    }
