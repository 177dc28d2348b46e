"""Running the record of an evaluation once more, to see that its numbers are what they say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.provenance import changes, machine

from .. import trained
from ..policy_file import SUFFIX
from .protocol import Plan, Progress, columns, digest, run


@dataclass(frozen=True)
class Repetition:
    """What came of running a record once more.

    Attributes:
        episodes: How many episodes were run again.
        repeated: The policies that were.
        missing: Those that were not, and why.
        differences: Every number that came out otherwise, as a text; none if all are the same.
        elsewhere: Versions and facts of the machine that differ, as texts: what may explain it.
    """

    episodes: int
    repeated: tuple[str, ...]
    missing: tuple[str, ...]
    differences: tuple[str, ...]
    elsewhere: tuple[str, ...]


def repeat(
    record: Mapping[str, Any], *, processes: int = 1, on_progress: Progress | None = None
) -> Repetition:
    """Run a record once more and compare every episode.

    A file that is not where it was is looked for among those that ship, by its SHA-256.

    Args:
        record: As `read_record` returns it.
        processes: As for `assess`.
        on_progress: As for `assess`.

    Raises:
        ConfigError: If no policy of it is here.
    """
    plan = load(Plan, record["plan"], "plan of the record")
    found: dict[str, str] = {}
    missing: list[str] = []
    for entry in record["policies"]:
        try:
            found[entry["policy"]] = _same_policy(entry)
        except ConfigError as error:
            missing.append(str(error))
    if not found:
        raise ConfigError(f"nothing to repeat: {'; '.join(missing)}")
    here = replace(plan, policies=tuple(found))
    runs = run(here, tuple(found.values()), processes=processes, on_progress=on_progress)
    kept = [entry for entry in record["policies"] if entry["policy"] in found]
    differences = [
        text
        for entry, again in zip(kept, runs, strict=True)
        for text in _differences(entry["policy"], entry["episodes"], columns(again.episodes))
    ]
    then = {**record["versions"], **record["machine"]}
    elsewhere = changes(then, {**runs[0].versions, **machine()})
    count = plan.episodes * len(runs)
    return Repetition(count, tuple(found), tuple(missing), tuple(differences), elsewhere)


def _same_policy(entry: Mapping[str, Any]) -> str:
    """Return where the policy of a record is now; ConfigError if it is not, or is another one."""
    name, facts = entry["policy"], entry["file"]
    if facts is None:
        return str(name)
    path, wanted = Path(name), facts["sha256"]
    if path.is_file() and digest(path) == wanted:
        return str(name)
    for shipped in sorted(trained.FOLDER.glob(f"*{SUFFIX}")):
        if digest(shipped) == wanted:
            return str(shipped)
    why = "is another file than it was" if path.is_file() else "is not here"
    raise ConfigError(f"{name} {why}")


def _differences(policy: str, then: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield what came out otherwise, column by column: the first episode of each."""
    for name in (*then, *(extra for extra in now if extra not in then)):
        old, new = then.get(name), now.get(name)
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            yield from _differences(f"{policy}, {name}", old, new)
        elif old is None or new is None:
            yield f"{policy}: {name} is in one of them only"
        elif old != new:
            others = [i for i, pair in enumerate(zip(old, new, strict=False)) if pair[0] != pair[1]]
            if others:
                i = others[0]
                yield (
                    f"{policy}: {name} of episode {i} is {new[i]}, was {old[i]}; {len(others)} of "
                    f"{len(old)} differ"
                )
            else:
                yield f"{policy}: {name} of {len(new)} episodes, were {len(old)}"
