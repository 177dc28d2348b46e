"""The command `evaluate`: a bar while it runs, a table in the end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rcare_marl.baselines import evaluate as baseline

from .console import console, progress, table


def run(
    task: str,
    policy: str,
    role_policies: Mapping[str, str],
    *,
    episodes: int,
    seed: int,
    options: Mapping[str, Any],
    cast: Mapping[str, Any],
) -> baseline.Evaluation:
    """Return the evaluation of a policy; arguments as for the command."""
    policies = baseline.lead_policies(task, policy, role_policies)
    with progress(f"{task}, {policy}") as bar:
        job = bar.add_task("", total=episodes)
        return baseline.evaluate(
            task,
            policies,
            episodes=episodes,
            seed=seed,
            options=options,
            cast=cast,
            on_episode=lambda _: bar.advance(job),
        )


def show(result: baseline.Evaluation) -> None:
    """Print an evaluation as a table."""
    numbers = result.to_dict()
    low, high = result.success_interval
    rows = [
        (
            "success",
            f"{numbers['successes']} of {numbers['episodes']}, {percent(result.success_rate)}",
        ),
        ("95 % interval", f"{percent(low)} to {percent(high)}"),
    ]
    for name in result.episodes[0].metrics:
        mean, most = numbers[f"{name}_mean"], numbers[f"{name}_max"]
        text = "never" if mean is None else f"mean {mean:.3g}, max {most:.3g}"
        rows.append((name, text))
    rows += [(f"return of {role}", f"mean {v:.4g}") for role, v in numbers["mean_return"].items()]
    rows.append(("steps", f"mean {numbers['steps_mean']:.4g}, total {numbers['steps']}"))
    who = ", ".join(
        f"{role} {result.cast[role]} ({name})" for role, name in result.policies.items()
    )
    last = result.seed + len(result.episodes) - 1
    title = f"{result.task}: {who}; seeds {result.seed} to {last}"
    console().print(table(title, ("metric", "value"), rows))


def successes(result: baseline.Evaluation) -> str:
    """Return how many episodes ended in success, as a text."""
    count = sum(episode.success for episode in result.episodes)
    return f"{count} of {len(result.episodes)}, {percent(result.success_rate)}"


def percent(share: float) -> str:
    """Return a share as a text in percent."""
    return f"{100 * share:.1f} %"
