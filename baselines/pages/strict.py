"""Messages of a page, strictly read: a JSON object with exactly the fields of its type, one dataclass each.

Numbers are finite and within bounds. Whatever is not so is refused; nothing of it is used.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, field, fields
from typing import Any, NoReturn, TypeVar

from rcare_marl.errors import RcareError

LARGEST = 16 * 1024  # of a message [bytes]

M = TypeVar("M")


class MessageError(RcareError, ValueError):
    """A message of the page is not what it may be."""


Reader = Callable[[Any, str], Any]  # what is given, and its name for messages


def field_of(reader: Reader, default: Any = MISSING) -> Any:
    """Return a field of a message, with what reads it."""
    return field(default=default, metadata={"read": reader})


def flag(value: Any, name: str) -> bool:
    """Read a truth value."""
    if not isinstance(value, bool):
        raise MessageError(f"{name} is true or false")
    return value


def number(low: float, high: float) -> Reader:
    """Return what reads a number within bounds."""

    def read(value: Any, name: str) -> float:
        # A bool is an int to Python; a whole number may be too long for a float.
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not low <= value <= high
        ):
            raise MessageError(f"{name} is a number from {low:g} to {high:g}")
        return float(value)

    return read


def whole(low: int, high: int) -> Reader:
    """Return what reads a whole number within bounds."""

    def read(value: Any, name: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise MessageError(f"{name} is a whole number from {low} to {high}")
        return value

    return read


def one_of(known: Sequence[str]) -> Reader:
    """Return what reads one of some texts."""

    def read(value: Any, name: str) -> str:
        if not isinstance(value, str) or value not in known:
            raise MessageError(f"{name} is one of {', '.join(known)}")
        return value

    return read


def or_null(reader: Reader) -> Reader:
    """Return what reads null, or what another reader reads."""
    return lambda value, name: None if value is None else reader(value, name)


def numbers(value: Any, name: str, count: int, bound: float) -> list[float]:
    """Read a list of so many numbers within a bound."""
    if not isinstance(value, list) or len(value) != count:
        raise MessageError(f"{name} is a list of {count} numbers")
    return [number(-bound, bound)(each, name) for each in value]


def parse_as(text: str, kinds: Mapping[str, type[M]]) -> M:
    """Return the message that a text is, one of some kinds by the name of its type.

    Raises:
        MessageError: If it is none; it says why.
    """
    if len(text) > LARGEST or len(text.encode("utf-8", "surrogatepass")) > LARGEST:
        raise MessageError(f"a message has at most {LARGEST} bytes")
    try:
        data = json.loads(text, object_pairs_hook=_once, parse_constant=_constant)
    except MessageError:
        raise
    except (ValueError, RecursionError) as error:
        # A long number and deep nesting end up here, too.
        raise MessageError("a message is a JSON object") from error
    if not isinstance(data, dict):
        raise MessageError("a message is a JSON object")
    kind = data.pop("type", None)
    if not isinstance(kind, str) or kind not in kinds:
        raise MessageError(f"the type of a message is one of {', '.join(kinds)}")
    made = kinds[kind]
    known = {each.name: each for each in fields(made)}  # type: ignore[arg-type]
    needed = {name for name, each in known.items() if each.default is MISSING}
    missing, unknown = needed - data.keys(), data.keys() - known.keys()
    if missing:
        raise MessageError(f"missing: {', '.join(sorted(missing))}")
    if unknown:  # their names come from outside and are not repeated
        raise MessageError(f"unknown fields; known: {', '.join(sorted(known))}")
    return made(**{name: known[name].metadata["read"](value, name) for name, value in data.items()})


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out = dict(pairs)
    if len(out) != len(pairs):
        raise MessageError("a field is given twice")
    return out


def _constant(name: str) -> NoReturn:
    raise MessageError(f"{name} is no number that may be sent")
