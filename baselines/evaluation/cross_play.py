"""Cross-play: how each of several policies fares with each of several partners.

A policy that was trained with one partner may know only the ways of that one. The matrix of all pairs
shows it: what stands where policy and partner trained together is compared with the rest.

Example:
    >>> zoo = partner_zoo("feeding", "recipient", avatars=("karan", "kim"))
    >>> found = cross_play("feeding", {"scripted": "scripted", "chance": "random"}, zoo, episodes=5)
    >>> found.success.shape
    (2, 8)
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from rcare_marl.console import markdown_table
from rcare_marl.envs.registry import lead_roles
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array
from rcare_marl.provenance import versions
from rcare_marl.reading import read_json

from ..partners import Partner
from .evaluate import Episode, Job, run_jobs, wilson_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Flags = npt.NDArray[np.bool_]
MEASURES = ("success", "return", "peak_force", "cost", "steps")
GREATEST = (
    "peak_force",
)  # measures of which the greatest over episodes counts, as it is what harms
TITLES = {
    "success": "success [%]",
    "return": "mean return of an episode",
    "peak_force": "greatest force on the person [N]",
    "cost": "mean cost of an episode, see docs/safety.md",
    "steps": "mean control steps of an episode",
}
FORCE = "peak_force_n"  # as tasks report it
CELL, MARGIN = (0.74, 0.42), (2.4, 2.0)  # [inch] of the picture
DPI = 150


class Gap(NamedTuple):
    """A measure where policy and partner trained together, and where they did not."""

    own: float
    others: float


@dataclass(frozen=True)
class CrossPlay:
    """What came of each policy with each partner, episode by episode.

    Attributes:
        task: Name of the task.
        role: Whom the partners play.
        policies: Names of the policies, P of them.
        partners: Names of the partners, Q of them.
        values: Each of `MEASURES`, shape [P, Q, episodes]; NaN where a task does not report it.
        own: For a policy, the partners that it trained with.
        seed: Of the first episode of each pair; each further one has the next.
        about: Of each partner what `Partner.to_dict` says, and of each policy what was asked for.
        versions: Versions of what the numbers depend on.
    """

    task: str
    role: str
    policies: tuple[str, ...]
    partners: tuple[str, ...]
    values: Mapping[str, Array]
    own: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    seed: int = 0
    about: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=lambda: versions())

    def __post_init__(self) -> None:
        for policy, partners in self.own.items():
            for name, kind, known in (
                (policy, "policy in the matrix", self.policies),
                *((partner, "partner in the matrix", self.partners) for partner in partners),
            ):
                check_name(kind, name, known)

    @property
    def episodes(self) -> int:
        """Episodes of each pair."""
        return int(self.values["success"].shape[2])

    @property
    def success(self) -> Array:
        """Share of episodes that succeeded, shape [P, Q]."""
        return self.matrix("success")

    def matrix(self, measure: str) -> Array:
        """Return a measure of each pair, shape [P, Q]: the mean, or the greatest of a peak.

        Raises:
            UnknownNameError: If the measure is none of `MEASURES`.
        """
        check_name("measure", measure, MEASURES)
        values = self.values[measure]
        return values.max(axis=2) if measure in GREATEST else values.mean(axis=2)

    def is_own(self) -> Flags:
        """Return whether policy and partner trained together, shape [P, Q]."""
        return np.array([[q in self.own.get(p, ()) for q in self.partners] for p in self.policies])

    def gap(self, measure: str = "success") -> Gap:
        """Return a measure with partners known from training, and the same of the other pairs.

        Each is the mean over pairs; NaN where there are none.
        """
        matrix, own = self.matrix(measure), self.is_own()
        return Gap(*(float(matrix[m].mean()) if m.any() else float("nan") for m in (own, ~own)))

    def select(
        self, policies: Iterable[str] | None = None, partners: Iterable[str] | None = None
    ) -> CrossPlay:
        """Return a part of the matrix, in the order of the names; all of them where None.

        Raises:
            UnknownNameError: If there is no such policy or partner.
        """
        rows = _numbers("policy in the matrix", policies, self.policies)
        columns = _numbers("partner in the matrix", partners, self.partners)
        names = tuple(self.policies[i] for i in rows), tuple(self.partners[j] for j in columns)
        own = {p: tuple(q for q in self.own.get(p, ()) if q in names[1]) for p in names[0]}
        values = {name: array[np.ix_(rows, columns)] for name, array in self.values.items()}
        own = {policy: met for policy, met in own.items() if met}
        return replace(self, policies=names[0], partners=names[1], values=values, own=own)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, the same on every run of the same seeds."""
        values = {name: _listed(array) for name, array in self.values.items()}
        counts = {"episodes": self.episodes, "success": self.success.tolist()}
        return {**vars(self), "values": values, **counts}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> CrossPlay:
        """Return what `to_dict` gave.

        Raises:
            ConfigError: If something is missing or misshapen.
        """
        try:
            shape = (len(data["policies"]), len(data["partners"]), data["episodes"])
            values = {n: np.array(data["values"][n], np.float64).reshape(shape) for n in MEASURES}
            given = {each.name: data[each.name] for each in fields(cls)}
            given |= {name: tuple(data[name]) for name in ("policies", "partners")}
            own = {name: tuple(partners) for name, partners in data["own"].items()}
            return cls(**{**given, "values": values, "own": own})
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"no record of a cross-play: {error!r}") from error

    def save(self, path: str | Path) -> None:
        """Write the record as JSON."""
        Path(path).write_text(json.dumps(self.to_dict()) + "\n", encoding="utf-8")

    @classmethod
    def read(cls, path: str | Path) -> CrossPlay:
        """Return the record in a JSON file.

        Raises:
            ConfigError: If it cannot be read.
        """
        return cls.from_dict(read_json(path, "a record"))

    def table(self, measure: str = "success") -> str:
        """Return a measure of all pairs as a table in Markdown; own partners are in bold."""
        shown, own = self._shown(measure), self.is_own()
        rows = []
        for i, policy in enumerate(self.policies):
            cells = [
                f"**{_text(v)}**" if o else _text(v) for v, o in zip(shown[i], own[i], strict=True)
            ]
            rows.append((policy, *cells, _text(float(shown[i].mean()))))
        return markdown_table((TITLES[measure], *self.partners, "mean"), rows) + "\n"

    def interval(self, policy: str, partners: Iterable[str] | None = None) -> tuple[float, float]:
        """Return Wilson's 95 % interval of the success of a policy over some partners together."""
        part = self.select([policy], partners).values["success"]
        return wilson_interval(int(part.sum()), part.size)

    def _shown(self, measure: str) -> Array:
        return self.matrix(measure) * (100.0 if measure == "success" else 1.0)

    def draw(
        self,
        path: str | Path,
        measure: str = "success",
        *,
        title: str = "",
        partners_down: bool = False,
    ) -> None:
        """Write a picture of the matrix, PNG or SVG, with the numbers in its cells.

        Pairs that trained together have a frame.

        Args:
            path: The file.
            measure: One of `MEASURES`.
            title: What to write above; the measure if empty.
            partners_down: Whether each partner has a row and each policy a column, for many partners.
        """
        from matplotlib.figure import Figure

        down, across = self.policies, self.partners
        shown, own = self._shown(measure), self.is_own()
        if partners_down:
            down, across, shown, own = across, down, shown.T, own.T
        rows, columns = shown.shape
        size = (MARGIN[0] + CELL[0] * columns, MARGIN[1] + CELL[1] * rows)
        figure = Figure(figsize=size, dpi=DPI, layout="constrained")
        axis = figure.subplots()
        is_share = measure == "success"
        scale = (0.0, 100.0) if is_share else (float(np.nanmin(shown)), float(np.nanmax(shown)))
        colours = "cividis" if measure in ("success", "return") else "cividis_r"
        drawn = axis.imshow(shown, cmap=colours, vmin=scale[0], vmax=scale[1], aspect="auto")
        axis.set_xticks(range(columns), across, rotation=40, ha="right", fontsize=8)
        axis.set_yticks(range(rows), down, fontsize=8)
        named = title or f"{self.task}: {TITLES[measure]}"
        figure.suptitle(named, fontsize=10, x=0.01, ha="left", wrap=True)
        _write_numbers(axis, shown, own, drawn)
        figure.savefig(path)


def cross_play(
    task: str,
    policies: Mapping[str, str],
    partners: Sequence[Partner],
    *,
    episodes: int = 20,
    seed: int = 0,
    options: Mapping[str, Any] | None = None,
    own: Mapping[str, Sequence[str]] | None = None,
    processes: int = 1,
) -> CrossPlay:
    """Play seeded episodes of each policy with each partner.

    The result is the same whatever `processes` is.

    Args:
        task: Name of the task.
        policies: By a name for the matrix, the policy of the robots: its name or a policy file.
        partners: Whom they meet, all in one role.
        episodes: Of each pair.
        seed: Episode i of each pair has the seed `seed + i`.
        options: Settings of the task.
        own: By the name of a policy, names of the partners that it trained with.
        processes: How many pairs to play at once.

    Raises:
        ConfigError: If there is nobody to play, partners play several roles, or names are not unique.
        UnknownNameError: If a name does not exist.
    """
    if not policies or not partners:
        raise ConfigError("cross-play needs one policy and one partner at least")
    names = tuple(partner.name for partner in partners)
    if len(set(names)) < len(names):
        raise ConfigError(f"partners must have names of their own, got {', '.join(names)}")
    roles = {partner.role for partner in partners}
    if len(roles) > 1 or partners[0].role in lead_roles(task):
        raise ConfigError(
            f"partners must all play one role that is not in question, got {sorted(roles)}"
        )
    leads = lead_roles(task)
    jobs = [
        Job(
            task,
            {**dict.fromkeys(leads, policy), **partner.policies()},
            episodes,
            seed,
            dict(options or {}),
            partner.cast(),
        )
        for policy in policies.values()
        for partner in partners
    ]
    cells = [_measures(played.episodes, leads) for played in run_jobs(jobs, processes)]
    shape = (len(policies), len(partners), episodes)
    values = {m: np.array([cell[m] for cell in cells]).reshape(shape) for m in MEASURES}
    about = {
        "partners": [partner.to_dict() for partner in partners],
        "policies": {name: Path(policy).name for name, policy in policies.items()},
        "options": dict(options or {}),
    }
    known = {name: tuple(met) for name, met in (own or {}).items()}
    return CrossPlay(task, partners[0].role, tuple(policies), names, values, known, seed, about)


def _measures(episodes: Sequence[Episode], leads: Sequence[str]) -> dict[str, list[float]]:
    """Return each measure of each episode of one pair."""
    out: dict[str, list[float]] = {name: [] for name in MEASURES}
    for episode in episodes:
        out["success"].append(float(episode.success))
        out["return"].append(float(np.mean([episode.returns[role] for role in leads])))
        out["peak_force"].append(episode.metrics.get(FORCE, float("nan")))
        costs = [episode.costs[role] for role in leads if role in episode.costs]
        out["cost"].append(float(np.mean(costs)) if costs else float("nan"))
        out["steps"].append(float(episode.steps))
    return out


def _write_numbers(axis: Axes, shown: Array, own: Flags, drawn: Any) -> None:
    from matplotlib.patches import Rectangle

    for i, j in np.ndindex(shown.shape):
        red, green, blue, _ = drawn.cmap(drawn.norm(shown[i, j]))
        is_dark = 0.299 * red + 0.587 * green + 0.114 * blue < 0.5
        colour = "white" if is_dark else "black"
        text = _text(float(shown[i, j]))
        axis.text(j, i, text, ha="center", va="center", color=colour, fontsize=8)
        if own[i, j]:
            corner = (j - 0.46, i - 0.44)
            axis.add_patch(Rectangle(corner, 0.92, 0.88, fill=False, edgecolor="#D55E00", lw=2))


def _numbers(kind: str, wanted: Iterable[str] | None, known: Sequence[str]) -> list[int]:
    if wanted is None:
        return list(range(len(known)))
    out = []
    for name in wanted:
        check_name(kind, name, known)
        out.append(known.index(name))
    return out


def _listed(array: Array) -> list[Any]:
    """Return an array as lists; NaN as None, which JSON can hold."""
    out = array.astype(object)
    out[np.isnan(array)] = None
    return out.tolist()


def _text(value: float) -> str:
    if np.isnan(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 10 or value == 0 else f"{value:.1f}"
