"""The figure of an evaluation of several policies: success, returns, and force on the person."""

from __future__ import annotations

import io
import os.path
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rcare_marl.envs.task_options import FORCE_LIMIT

from .episode_figure import DPI, LIMIT, PALETTE, style
from .protocol import Record

WIDTH, HEIGHT, ROW = 7.2, 5.2, 0.28  # [inch] of the page, of the lower panels, and of each policy
LABEL = 34  # [characters] of a policy's name
ALL = "#222222"


def draw(record: Record) -> bytes:
    """Return the figure as a PNG."""
    names = [*labels(record.plan.policies), "all"]
    upper = ROW * (len(names) + 3)
    figure = Figure(figsize=(WIDTH, upper + HEIGHT), dpi=DPI, layout="constrained")
    has_force = "peak_force_n" in record.runs[0].episodes[0].metrics
    ratios = [upper, HEIGHT / 2, HEIGHT / 2] if has_force else [upper, HEIGHT]
    axes: list[Axes] = list(figure.subplots(len(ratios), 1, gridspec_kw={"height_ratios": ratios}))
    style(*axes)
    plan, models = record.plan, record.runs[0].cast
    who = " and ".join(models.values())
    title = f"{plan.task}: {who}, {plan.episodes} episodes each"
    figure.suptitle(title, fontsize=11, fontweight="bold", x=0.01, ha="left")
    _draw_success(axes[0], record, names)
    _draw_returns(axes[1], record, names)
    if has_force:
        _draw_forces(axes[2], record, names)
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()


def labels(policies: Sequence[str]) -> list[str]:
    """Return names that tell policies apart in little room: paths without what they share."""
    parts = [Path(policy).parts for policy in policies]
    if len(parts) > 1 and all(len(each) > 1 for each in parts):
        shared = len(os.path.commonprefix([each[:-1] for each in parts]))
        parts = [each[shared:] for each in parts]
        if len({each[-1] for each in parts}) == 1 and all(len(each) > 1 for each in parts):
            parts = [each[:-1] for each in parts]
    texts = ["/".join(each).removesuffix(".npz") for each in parts]
    return [text if len(text) <= LABEL else f"...{text[3 - LABEL :]}" for text in texts]


def _colour(number: int) -> str:
    return PALETTE[number % (len(PALETTE) - 1)]  # the last is black: that of all together


def _draw_success(axis: Axes, record: Record, names: Sequence[str]) -> None:
    rows = [
        (run.success_rate, run.success_interval, _colour(i)) for i, run in enumerate(record.runs)
    ]
    numbers = record.summary()["success"]
    rows.append((numbers["mean"], tuple(numbers["interval_95"]), ALL))
    for place, (rate, (low, high), colour) in enumerate(rows):
        axis.plot([100 * low, 100 * high], [place, place], color=colour, linewidth=2, zorder=2)
        axis.plot(100 * rate, place, "o", color=colour, markersize=6, zorder=3)
        axis.annotate(
            f"{100 * rate:.1f} %", (101.5, place), va="center", fontsize=8, annotation_clip=False
        )
    axis.axhline(len(rows) - 1.5, color="0.8", linewidth=0.8)
    axis.set_yticks(range(len(rows)), names, fontsize=8)
    axis.set_ylim(len(rows) - 0.4, -0.6)
    axis.set_xlim(-1, 101)
    axis.set_xlabel("success [%], with its 95 % interval")


def _draw_returns(axis: Axes, record: Record, names: Sequence[str]) -> None:
    role = next(iter(record.runs[0].episodes[0].returns))
    for i, run in enumerate(record.runs):
        values = np.array([episode.returns[role] for episode in run.episodes])
        spread = np.linspace(-0.32, 0.32, len(values))  # side by side, in the order of their seeds
        good = np.array([episode.success for episode in run.episodes])
        axis.plot([i - 0.42, i + 0.42], [values.mean()] * 2, color=ALL, linewidth=0.9, zorder=2)
        axis.scatter(i + spread[good], values[good], s=9, color=_colour(i), linewidths=0, zorder=3)
        axis.scatter(
            i + spread[~good],
            values[~good],
            s=14,
            color=LIMIT,
            marker="x",
            linewidths=0.8,
            zorder=3,
        )
    count = len(record.runs)
    short = names[:-1] if count <= 6 else [str(i + 1) for i in range(count)]
    axis.set_xticks(range(count), short, fontsize=8)
    axis.set_xlim(-0.6, count - 0.4)
    axis.set_ylabel(f"return of {role} [1]")
    axis.set_title(
        "each episode; crosses are those without success, lines the means", fontsize=8, loc="left"
    )


def _draw_forces(axis: Axes, record: Record, names: Sequence[str]) -> None:
    limit = float(record.plan.options.get("force_limit", FORCE_LIMIT))
    peaks = [np.sort(run.values("peak_force_n")) for run in record.runs]
    top = 1.05 * max(limit, *(float(values[-1]) for values in peaks))
    for i, values in enumerate(peaks):
        share = 100 * np.arange(1, len(values) + 1) / len(values)
        axis.step(
            [0, *values, top],
            [0, *share, 100],
            where="post",
            color=_colour(i),
            linewidth=1.4,
            label=names[i],
        )
    axis.axvline(limit, color=LIMIT, linewidth=1, linestyle="--")
    axis.annotate(
        "limit", (limit, 104), ha="center", color=LIMIT, fontsize=8, annotation_clip=False
    )
    axis.set_xlim(-0.02 * top, top)
    axis.set_ylim(-2, 103)
    axis.set_xlabel("peak force on the person [N]")
    axis.set_ylabel("episodes up to it [%]")
    axis.legend(frameon=False, fontsize=8, loc="lower right")
