"""The command `coach evaluate`: synthetic people before a recogniser, tables and a figure of what came."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from rcare_marl.agents.coaching.exercise import load_exercises
from rcare_marl.atomic_file import write_whole
from rcare_marl.baselines.coaching.evaluation import (
    UNSEEN,
    CoachEvaluation,
    evaluate_coach,
    noise_levels,
)
from rcare_marl.baselines.coaching.noise import TROUBLES, NoiseModel
from rcare_marl.baselines.coaching.performance import WRONG
from rcare_marl.baselines.evaluation.episode_figure import style
from rcare_marl.console import console, print_line, progress, table
from rcare_marl.errors import ConfigError, check_name

from .parameter import print_json

SHARES = ("right recognised", "95 % interval", "of", "wrong detected", "95 %", "of ")
SHOWN = 3  # verdicts on each kind of performance in the table of confusions
# Of the palette of Okabe & Ito, which people with a colour vision deficiency tell apart; and marks besides.
STYLES = {"right": ("#0072B2", "o"), "wrong": ("#D55E00", "s")}
NAMES = {"right": "right recognised", "wrong": "wrong detected"}
UNITS = {
    "hands": "{cm:g} cm, {deg:g} degrees and {lost:g} % drop-outs",
    "joints": "{deg:g} degrees and {lost:g} % drop-outs",
    "camera": "{pixel:g} pixels and {lost:g} % of the markers missed",
}


def run(*, exercises: Sequence[str], noise: NoiseModel | None, **given: Any) -> CoachEvaluation:
    """Return the evaluation of a recogniser, with a bar; arguments as for `evaluate_coach`."""
    with progress(f"by {given['source']}") as bar:
        job = bar.add_task("", total=given["users"])
        return evaluate_coach(
            **given,
            noise=noise,
            exercises=load_exercises(tuple(exercises)) if exercises else None,
            progress=lambda done: bar.update(job, completed=done),
        )


def evaluate(
    *,
    levels: Sequence[float],
    trouble: str | None,
    plot: Path | None,
    output: Path | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Evaluate at usual noise, and at each level of it if there are any; print and write what came of it.

    Raises:
        ConfigError: If a trouble of hands is asked for with another source, or with levels.
    """
    begun, noise = time.monotonic(), None
    if trouble is not None:
        check_name("trouble", trouble, TROUBLES)
        if given["source"] != "hands" or levels:
            raise ConfigError("--trouble is of --source hands, and goes without --level and --plot")
        noise = TROUBLES[trouble]
    noises = noise_levels(given["source"], levels)
    usual = run(**given, noise=noise)
    found = {
        level: usual if level == 1 else run(**given, noise=noise) for level, noise in noises.items()
    }
    out = usual.to_dict()
    if found:
        out["levels"] = {f"{level:g}": _brief(each) for level, each in sorted(found.items())}
    if output is not None:
        write_whole(output, (json.dumps(out, indent=2) + "\n").encode())
    if plot is not None:
        write_whole(plot, draw(found))
    if as_json:
        print_json(out)
    else:
        show(usual, found)
    for file in (output, plot):
        if file is not None:
            print_line(f"wrote {file}")
    if not as_json:
        print_line(f"took {time.monotonic() - begun:.0f} s")


def _brief(found: CoachEvaluation) -> dict[str, Any]:
    """Return what a level of the noise is summed up in."""
    told = found.to_dict()
    names = ("noise", "right_recognised", "right", "wrong_detected", "wrong", "latency")
    return {name: told[name] for name in (*names, "false_alarms")}


def _share(told: Mapping[str, Any]) -> tuple[str, str, str]:
    low, high = told["interval"]
    return f"{100 * told['share']:.1f} %", f"{100 * low:.1f} to {100 * high:.1f}", str(told["of"])


def show(found: CoachEvaluation, levels: Mapping[float, CoachEvaluation]) -> None:
    """Print an evaluation: shares, what was said of what, and how soon."""
    told, screen = found.to_dict(), console()
    title = f"by {found.source}: {found.users} people of seed {found.seed}, {found.split}"
    columns: tuple[str, ...] = ("", *SHARES)
    rows: list[tuple[str, ...]] = [("all", *_share(told["right"]), *_share(told["wrong"])), ()]
    for name, each in told["exercises"].items():
        shares = (*_share(each["right_recognised"]), *_share(each["wrong_detected"]))
        rows.append((name.replace("_", " "), *shares))
    screen.print(table(title, columns, rows, **dict.fromkeys(columns[1:], True)))
    columns = ("done", "detected", "95 % interval", "of", "said first, how often")
    kinds: list[tuple[str, ...]] = [
        ("right", "", "", "", _said(told["confusion"].get("right", {})))
    ]
    for kind in (kind for kind in WRONG if kind in told["kinds"]):
        said = _said(told["confusion"].get(kind, {}))
        kinds.append((kind.replace("_", " "), *_share(told["kinds"][kind]), said))
    screen.print(table("what was made of it", columns, kinds, **dict.fromkeys(columns[1:4], True)))
    columns = ("share of a limit that was used", "called right", "95 % interval", "of")
    near = [(f"{row['used']:g}", *_share(row)) for row in told["distance"]]
    screen.print(table("near a limit", columns, near, **dict.fromkeys(columns[1:], True)))
    screen.print(table("on line", ("measure", "value"), _line_rows(told), value=True))
    if levels:
        columns = ("noise", *SHARES)
        grown = ((level, one.to_dict()) for level, one in sorted(levels.items()))
        rows = [
            (f"x {level:g}", *_share(each["right"]), *_share(each["wrong"]))
            for level, each in grown
        ]
        screen.print(table("as noise grows", columns, rows, **dict.fromkeys(columns[1:], True)))


def _said(counts: Mapping[str, int]) -> str:
    """Return the commonest verdicts as a text."""
    names = {UNSEEN: "nothing"}
    common = sorted(counts.items(), key=lambda item: -item[1])
    out = [f"{names.get(name, name).replace('_', ' ')} {count}" for name, count in common[:SHOWN]]
    left = sum(count for _, count in common[SHOWN:])
    return ", ".join([*out, *([f"others {left}"] if left else [])])


def _line_rows(told: Mapping[str, Any]) -> list[tuple[str, str]]:
    latency, alarms, frame = told["latency"], told["false_alarms"], told["frame_ms"]
    right = told["latency_of_right"]
    rows = []
    if latency:
        rows += [
            ("verdict after the end of a repetition, median", f"{latency['median_s']:.2f} s"),
            ("95th percentile", f"{latency['p95_s']:.2f} s"),
            ("longest", f"{latency['greatest_s']:.2f} s"),
            ("within half a second", f"{100 * latency['within_half_a_second']:.1f} %"),
            ("of right ones", f"{100 * right['within_half_a_second']:.1f} %" if right else ""),
        ]
    return [
        *rows,
        ("wrong verdicts a minute of right exercise", f"{alarms['while_right_per_minute']:.3f}"),
        (
            "right verdicts a minute of doing nothing of it",
            f"{alarms['while_idle_per_minute']:.3f}",
        ),
        ("a frame, mean", f"{frame['mean']:.2f} ms"),
        ("a frame, 99th percentile", f"{frame['p99']:.2f} ms"),
    ]


def draw(evaluations: Mapping[float, CoachEvaluation]) -> bytes:
    """Return a PNG of both shares, with their 95 % intervals, over the level of the noise.

    Args:
        evaluations: By level of the noise, as of `evaluation.sweep_noise`; one at least.
    """
    figure = Figure(figsize=(7.0, 4.2), dpi=140, layout="constrained")
    axes = figure.subplots()
    levels = sorted(evaluations)
    first = evaluations[levels[0]]
    lowest = 100.0
    for key, (color, marker) in STYLES.items():
        told = [evaluations[level].to_dict()[key] for level in levels]
        shares = [100 * each["share"] for each in told]
        low = [100 * max(each["share"] - each["interval"][0], 0.0) for each in told]
        high = [100 * max(each["interval"][1] - each["share"], 0.0) for each in told]
        axes.errorbar(
            levels,
            shares,
            yerr=(low, high),
            color=color,
            marker=marker,
            capsize=3,
            label=NAMES[key],
        )
        lowest = min(lowest, *(s - down for s, down in zip(shares, low, strict=True)))
    goal = 95 if first.source == "camera" else 99
    axes.axhline(goal, color="0.5", linestyle=":", linewidth=1)
    axes.annotate(
        f"{goal} %",
        (levels[-1], goal),
        (0, 3),
        textcoords="offset points",
        ha="right",
        color="0.35",
        fontsize=8,
    )
    usual = NoiseModel()
    unit = UNITS[first.source].format(
        cm=100 * usual.position, deg=usual.angle_deg, lost=100 * usual.dropout, pixel=usual.pixel
    )
    axes.set_xlabel(f"noise, times {unit}")
    axes.set_ylabel("share [%]")
    axes.set_ylim(max(0.0, lowest - 2), 101)
    style(axes)
    axes.set_title(f"{first.source}, {first.users} people", loc="left", fontsize=10)
    axes.legend(loc="lower left", frameon=False)
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()
