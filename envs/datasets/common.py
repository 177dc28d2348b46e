"""What all formats of datasets share: the header as data, and putting an episode together again."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from rcare_marl.config import load, plain
from rcare_marl.errors import ConfigError, shown
from rcare_marl.reading import check_numbers

from ..episode import Header, RecordedEpisode

WHAT = "recorded episodes"
Arrays = Mapping[str, npt.NDArray[Any]]


class Writer(Protocol):
    """Writes episodes of one cast, one after the other."""

    def add(self, episode: RecordedEpisode) -> None:
        """Write an episode."""

    def close(self) -> None:
        """Finish the files."""


def header_of(episode: RecordedEpisode) -> dict[str, Any]:
    """Return all of an episode but its arrays, as data for JSON; ConfigError if it holds objects."""
    return plain(dataclasses.asdict(episode.header), "episode")


def read_header(data: Any, where: str | Path) -> Header:
    """Return a header; ConfigError if it is none, or of an episode of which nothing was to be seen."""
    header = load(Header, data, "header")
    missing = {"lead", "observes", "arrays", "acts", "lows", "late"} - set(header.facts)
    if missing:
        raise ConfigError(f"{where}: the header's facts lack {', '.join(sorted(missing))}")
    if header.facts["lead"] not in header.roles:
        raise ConfigError(f"{where}: there is no role {shown(header.facts['lead'])}")
    return header


def lead_first(header: Header) -> list[str]:
    """Return the roles, who is to learn first: formats that know one actor take that one."""
    lead = header.facts["lead"]
    return [lead, *(role for role in header.roles if role != lead)]


def is_picture(values: npt.NDArray[Any]) -> bool:
    """Return whether rows are pictures, shape [rows, height, width, 3]."""
    return values.dtype == np.uint8 and values.ndim == 4 and values.shape[-1] == 3


def assembled(
    header: Header, actions: Arrays, digests: npt.NDArray[Any], numbers: Any, seen: Arrays
) -> RecordedEpisode:
    """Return the episode whose parts were read from a file.

    Args:
        header: From `read_header`.
        actions: Of each role.
        digests: Whole numbers of 64 bits, signed or not.
        numbers: The measures.
        seen: What was observed.

    Raises:
        ConfigError: If the parts do not fit each other.
    """
    if digests.dtype not in (np.int64, np.uint64):
        raise ConfigError(f"digests must be whole numbers of 64 bits, got {digests.dtype}")
    check_numbers({**actions, **{r: v for r, v in seen.items() if r in header.roles}}, WHAT)
    return RecordedEpisode(
        header,
        {role: np.asarray(actions[role], np.float64) for role in header.roles},
        np.ascontiguousarray(digests).view(np.uint64),
        np.asarray(numbers).astype(np.float64, casting="same_kind"),
        seen,
    )


def check_rewards(episode: RecordedEpisode, rewards: Arrays) -> RecordedEpisode:
    """Return the episode; ConfigError if the format's own rewards are others than those measured."""
    for role, values in rewards.items():
        if not np.array_equal(values, episode.rewards(role)):
            raise ConfigError(f"the rewards of {role!r} are not those that were measured")
    return episode
