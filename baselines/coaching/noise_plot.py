"""Draws where recognition breaks as the noise of its sensors grows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from .evaluation import CoachEvaluation
from .noise import NoiseModel

# Of the palette of Okabe & Ito, which people with a colour vision deficiency tell apart; and marks besides.
STYLES = {"right_recognised": ("#0072B2", "o"), "wrong_detected": ("#D55E00", "s")}
NAMES = {"right_recognised": "right recognised", "wrong_detected": "wrong detected"}


def draw_noise(evaluations: Mapping[float, CoachEvaluation], file: str | Path) -> Path:
    """Draw both shares, with their 95 % intervals, over the level of the noise; return the file.

    Args:
        evaluations: By level of the noise, as of `evaluation.sweep_noise`.
        file: Where the picture goes, PNG or SVG.
    """
    figure = Figure(figsize=(7.0, 4.2), dpi=140, layout="constrained")
    axes = figure.subplots()
    levels = sorted(evaluations)
    for key, (color, marker) in STYLES.items():
        told = [evaluations[level].to_dict()[key.split("_", maxsplit=1)[0]] for level in levels]
        shares = [100 * each["share"] for each in told]
        low = [100 * (each["share"] - each["interval"][0]) for each in told]
        high = [100 * (each["interval"][1] - each["share"]) for each in told]
        axes.errorbar(
            levels,
            shares,
            yerr=(low, high),
            color=color,
            marker=marker,
            capsize=3,
            label=NAMES[key],
        )
    axes.axhline(99, color="0.5", linestyle=":", linewidth=1)
    usual = NoiseModel()
    axes.set_xlabel(
        f"noise, times {100 * usual.position:g} cm, {usual.angle_deg:g} degrees and "
        f"{100 * usual.dropout:g} % drop-outs"
    )
    axes.set_ylabel("share [%]")
    axes.set_ylim(top=101)
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left")
    path = Path(file)
    figure.savefig(path)
    return path
