"""The rules of accessibility: what is built at each level, what is allowed, and who says so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from rcare_marl import assets
from rcare_marl.config import load, read_yaml
from rcare_marl.errors import ConfigError, check_name

LEVELS = (1, 2, 3)


@dataclass(frozen=True)
class Rule:
    """One rule.

    Attributes:
        title: What it is about.
        unit: Unit of its figures, `m`, `N`, `1`; `choice` where words are built.
        built: What is built at levels 1, 2 and 3; null for nothing of the kind.
        allowed_2: Least and greatest value that level 2 allows, null for no bound; words for choices.
        allowed_3: The same for level 3.
        source: Where the figures are from.
        verified: Whether the figures credited to others at levels 2 and 3 were seen, not remembered.
    """

    title: str
    unit: str
    built: tuple[float | str | None, ...]
    allowed_2: tuple[float | str | None, ...]
    allowed_3: tuple[float | str | None, ...]
    source: str
    verified: bool = False

    def __post_init__(self) -> None:
        if len(self.built) != len(LEVELS):
            raise ConfigError(f"a rule has one figure for each level, got {self.built}")
        for allowed in (self.allowed_2, self.allowed_3):
            if self.unit == "choice":
                is_sound = bool(allowed) and all(isinstance(word, str) for word in allowed)
            else:
                is_sound = len(allowed) == 2 and not any(isinstance(end, str) for end in allowed)
            if not is_sound:
                raise ConfigError(
                    f"a rule allows words, or a least and a greatest value, got {list(allowed)} "
                    f"for {self.title!r} in {self.unit}"
                )

    def allows(self, value: float | str | None, level: int) -> bool:
        """Return whether a value obeys the rule of a level; level 1 allows everything.

        Nothing of the kind, None, is allowed where the rule has no bounds.
        """
        if level == 1:
            return True
        allowed = self._allowed(level)
        if self.unit == "choice":
            return value in allowed
        low, high = (None if end is None else float(end) for end in allowed)
        if value is None:
            return low is None and high is None
        if isinstance(value, str):
            raise ConfigError(f"the rule on {self.title!r} is about a number, got {value!r}")
        return (low is None or value >= low - 1e-6) and (high is None or value <= high + 1e-6)

    def bounds(self, level: int) -> str:
        """Return in words what a level allows, such as `at least 0.815 m`."""
        if level == 1:
            return "anything"
        allowed = self._allowed(level)
        if self.unit == "choice":
            return " or ".join(str(word).replace("_", " ") for word in allowed)
        low, high = allowed
        unit = "" if self.unit == "1" else f" {self.unit}"
        if low is None and high is None:
            return "anything"
        if low is None:
            return f"at most {high:g}{unit}"
        return f"at least {low:g}{unit}" if high is None else f"{low:g} to {high:g}{unit}"

    def _allowed(self, level: int) -> tuple[float | str | None, ...]:
        return self.allowed_2 if level == 2 else self.allowed_3


class Rules(Mapping[str, Rule]):
    """All rules, seen from one level.

    Attributes:
        level: 1 usual, 2 partially barrier-free, 3 completely barrier-free.
    """

    def __init__(self, level: int) -> None:
        """Load the table.

        Raises:
            ConfigError: If `level` is not 1, 2 or 3.
        """
        if isinstance(level, bool) or level not in LEVELS:
            raise ConfigError(
                f"level must be 1 (usual), 2 (partially barrier-free) or 3 (barrier-free), got {level!r}"
            )
        self.level = level
        self._table = _table()

    def __getitem__(self, name: str) -> Rule:
        check_name("rule", name, self._table)
        return self._table[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._table)

    def __len__(self) -> int:
        return len(self._table)

    def figure(self, name: str, otherwise: float | None = None) -> float:
        """Return what is built at this level, a number.

        Where nothing is built it is `otherwise`, or a ConfigError if that is None.
        """
        value = self[name].built[self.level - 1]
        if value is None and otherwise is not None:
            return otherwise
        if value is None or isinstance(value, str):
            raise ConfigError(f"rule {name!r} has no figure at level {self.level}: {value!r}")
        return float(value)

    def choice(self, name: str) -> str:
        """Return what is built at this level, a word; `none` for nothing of the kind."""
        value = self[name].built[self.level - 1]
        if value is not None and not isinstance(value, str):
            raise ConfigError(f"rule {name!r} is about a number, not a choice: {value!r}")
        return value or "none"

    def has(self, name: str) -> bool:
        """Return whether anything of the kind is built at this level."""
        return self[name].built[self.level - 1] is not None


@lru_cache(maxsize=1)
def _table() -> dict[str, Rule]:
    path = assets.find("accessibility", "rules")
    return {
        name: load(Rule, fields, f"rule {name!r} in {path.name}")
        for name, fields in read_yaml(path).items()
    }
