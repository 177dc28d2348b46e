"""The figure of recognition as the noise of its sensors grows."""

from __future__ import annotations

import io
from collections.abc import Mapping

from matplotlib.figure import Figure

from rcare_marl.baselines.coaching.evaluation import CoachEvaluation
from rcare_marl.baselines.coaching.noise import NoiseModel
from rcare_marl.baselines.evaluation.episode_figure import style

# Of the palette of Okabe & Ito, which people with a colour vision deficiency tell apart; and marks besides.
STYLES = {"right": ("#0072B2", "o"), "wrong": ("#D55E00", "s")}
NAMES = {"right": "right recognised", "wrong": "wrong detected"}
UNITS = {
    "hands": "{cm:g} cm, {deg:g} degrees and {lost:g} % drop-outs",
    "joints": "{deg:g} degrees and {lost:g} % drop-outs",
    "camera": "{pixel:g} pixels and {lost:g} % of the markers missed",
}


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
    axes.set_title(
        f"{first.source}, {first.recogniser}, {first.users} people", loc="left", fontsize=10
    )
    axes.legend(loc="lower left", frameon=False)
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()
