"""The figures of the demo, of what happened in episodes step by step, and of several policies."""

from __future__ import annotations

import io
import os.path
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rcare_marl.agents.agent import Array
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.task_options import FORCE_LIMIT

from .evaluate import Episode
from .protocol import Record

SIZE = (7.2, 7.6)  # [inch], the width of a page of text
DPI = 200
# Okabe and Ito's palette, which colour-blind readers can tell apart.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
FAINT, STRONG, GOOD, BAD, LIMIT = "#9FB3C4", "#0072B2", "#009E73", "#D55E00", "#B3261E"


class Recorder:
    """Notes time, the task's metrics and the robots' motor torques once a control step.

    Give it to `run_episode` as `on_step`; it reads and changes nothing.
    """

    def __init__(self) -> None:
        self._times: list[float] = []
        self._metrics: dict[str, list[float]] = {}
        self._torques: dict[str, list[list[float]]] = {}

    def __call__(self, env: CareEnv) -> None:
        self._times.append(env.world.time)
        for name, value in env.task.report().items():
            self._metrics.setdefault(name, []).append(float(value))
        for role, agent in env.cast.items():
            if isinstance(agent, Robot):
                torques = agent.body.joint_torques(agent.arm.indices)
                if env.world.time == 0:  # Bullet still tells those of the last episode
                    torques = [0.0] * len(torques)
                self._torques.setdefault(role, []).append(torques)

    @property
    def time(self) -> Array:
        """Simulated times [s], shape [steps + 1]; the first is that of the reset."""
        return np.array(self._times)

    def metric(self, name: str) -> Array:
        """Return a metric over time, in its own unit, shape [steps + 1]."""
        return np.array(self._metrics[name])

    def torques(self, role: str) -> Array:
        """Return what the motors of a robot's arm applied [N·m or N], shape [steps + 1, joints].

        What a control mode adds to carry the weight of the arm is not in it. The first row is zero:
        no motor has worked yet.
        """
        return np.array(self._torques[role])

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists for JSON; keys end in their unit."""
        return {
            "time_s": _rounded(self._times),
            **{name: _rounded(values) for name, values in self._metrics.items()},
            "motor_torque_nm": {
                role: [_rounded(row) for row in rows] for role, rows in self._torques.items()
            },
        }


def _rounded(values: list[float]) -> list[float]:
    return [round(value, 6) for value in values]  # a micrometre is enough, and files stay small


def draw(
    path: Path,
    episodes: Sequence[Episode],
    records: Sequence[Recorder],
    *,
    title: str,
    reach: float,
    force_limit: float,
    robot: str = "robot",
) -> None:
    """Write the figure as a PNG.

    Args:
        path: The file.
        episodes: What came of each episode.
        records: What happened in each.
        title: What was done by whom.
        reach: Distance from the mouth within which food is eaten [m].
        force_limit: Force on the person that ends an episode as a failure [N].
        robot: The role whose torques are shown.
    """
    figure = Figure(figsize=SIZE, dpi=DPI, layout="constrained")
    axes: list[Axes] = list(figure.subplots(3, 1, sharex=True))
    style(*axes)
    figure.suptitle(title, fontsize=11, fontweight="bold", x=0.01, ha="left")
    _draw_distances(axes[0], episodes, records, reach)
    _draw_forces(axes[1], records, force_limit)
    _draw_torques(axes[2], records[0], episodes[0], robot)
    axes[2].set_xlabel("time [s]")
    axes[2].set_xlim(0, max(float(record.time[-1]) for record in records) * 1.02)
    figure.align_ylabels(axes)
    figure.savefig(path, format="png")


def style(*axes: Axes) -> None:
    """Give axes a faint grid behind what is drawn, and no frame above and on the right."""
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(color="0.92", linewidth=0.6)
        axis.set_axisbelow(True)


def _draw_distances(
    axis: Axes, episodes: Sequence[Episode], records: Sequence[Recorder], reach: float
) -> None:
    for episode, record in zip(episodes, records, strict=True):
        distance = 100 * record.metric("distance_m")
        axis.plot(record.time, distance, **_style(episode is episodes[0]))
        axis.plot(
            record.time[-1],
            distance[-1],
            marker="o" if episode.success else "X",
            color=GOOD if episode.success else BAD,
            markeredgecolor="white",
            markersize=7,
            linestyle="none",
            zorder=5,
        )
    axis.axhline(100 * reach, color="0.45", linewidth=0.9, linestyle=":")
    axis.set_ylim(bottom=0)
    axis.set_ylabel("spoon to mouth [cm]")
    handles = [Line2D([], [], label=f"seed {episodes[0].seed}", **_style(True))]
    if len(episodes) > 1:
        handles.append(Line2D([], [], label="other seeds", **_style(False)))
    outcomes = {episode.success for episode in episodes}
    if True in outcomes:
        handles.append(Line2D([], [], color=GOOD, marker="o", linestyle="none", label="success"))
    if False in outcomes:
        handles.append(Line2D([], [], color=BAD, marker="X", linestyle="none", label="no success"))
    near = f"eaten within {100 * reach:g} cm"
    handles.append(Line2D([], [], color="0.45", linestyle=":", label=near))
    axis.legend(handles=handles, **_LEGEND)


def _draw_forces(axis: Axes, records: Sequence[Recorder], limit: float) -> None:
    peak = 0.0
    for number, record in enumerate(records):
        force = record.metric("force_n")
        peak = max(peak, float(force.max()))
        axis.plot(record.time, force, **_style(number == 0))
    axis.axhline(limit, color=LIMIT, linewidth=1.1, linestyle="--")
    axis.set_ylim(0, 1.15 * max(limit, peak))
    axis.set_ylabel("force on the person [N]")
    axis.legend(
        handles=[
            Line2D([], [], color=LIMIT, linestyle="--", label=f"limit, {limit:g} N"),
            Line2D([], [], linestyle="none", label=f"greatest, {peak:.1f} N"),
        ],
        **_LEGEND,
    )


def _draw_torques(axis: Axes, record: Recorder, episode: Episode, robot: str) -> None:
    torques = record.torques(robot)[1:]  # before the first step no motor has worked
    for joint in range(torques.shape[1]):
        axis.plot(
            record.time[1:],
            torques[:, joint],
            color=PALETTE[joint % len(PALETTE)],
            linewidth=1.1,
            label=f"joint {joint + 1}",
        )
    axis.axhline(0, color="0.75", linewidth=0.6, zorder=1)
    axis.set_ylabel("motor torque of joints [N·m]")
    axis.legend(title=f"seed {episode.seed}", title_fontsize=8, **_LEGEND)


_LEGEND: dict[str, Any] = {
    "loc": "upper left",
    "bbox_to_anchor": (1.0, 1.0),
    "frameon": False,
    "fontsize": 8,
}


def _style(is_first: bool) -> dict[str, Any]:
    if is_first:
        return {"color": STRONG, "linewidth": 1.6, "zorder": 4}
    return {"color": FAINT, "linewidth": 0.8, "zorder": 2}


WIDTH, HEIGHT, ROW = 7.2, 5.2, 0.28  # [inch] of the page, of the lower panels, and of each policy
LABEL = 34  # [characters] of a policy's name
ALL = "#222222"


def draw_record(record: Record) -> bytes:
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
        _draw_peaks(axes[2], record, names)
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


def _draw_peaks(axis: Axes, record: Record, names: Sequence[str]) -> None:
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
