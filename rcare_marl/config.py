"""Strict loading of frozen dataclasses from YAML: unknown keys and wrong types are errors."""

from __future__ import annotations

import copy
import dataclasses
import math
import types
import typing
from collections.abc import Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml

from .errors import ConfigError, UnknownNameError, check_name, shown
from .reading import DEPTH, read_text, reason

LARGEST_YAML = 8 << 20  # [bytes]
KEPT_YAML = 1 << 16  # [characters] up to which what a text says is kept: scenes read files anew
MOST_PARTS = 300_000  # of a YAML file, aliases written out
LARGEST_NUMBER = 1 << 64

T = TypeVar("T")


def read_yaml(path: str | Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Raises:
        ConfigError: If there is no such file, it is no YAML, or it holds no mapping.
    """
    text = read_text(path, "YAML", most=LARGEST_YAML)
    data = parse_yaml(text, str(path))
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: expected a mapping, got {type(data).__name__}")
    return data


@lru_cache(maxsize=128)
def _parsed(text: str) -> Any:
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _check_size(node)
        return loader.construct_document(node)
    finally:
        loader.dispose()


def parse_yaml(text: str, where: str) -> Any:
    """Return what a YAML text says; ConfigError, naming `where` it is from, if it is none."""
    try:
        return copy.deepcopy(_parsed(text)) if len(text) < KEPT_YAML else _parsed.__wrapped__(text)
    except (
        Exception
    ) as error:  # of dates, numbers and sets that are none, and of what is nested deeply
        raise ConfigError(f"{where} is not valid YAML: {reason(error)}") from error


def _check_size(root: yaml.Node) -> None:
    """Refuse what is nested too deeply, or has too many parts once every alias is written out."""
    sizes: dict[int, int] = {}

    def size(node: yaml.Node, depth: int) -> int:
        if depth > DEPTH:
            raise ConfigError(f"it is nested more than {DEPTH} deep")
        if id(node) not in sizes:
            parts = node.value if not isinstance(node, yaml.ScalarNode) else ()
            inner = (each for part in parts for each in (part if type(part) is tuple else (part,)))
            sizes[id(node)] = 1 + sum(size(each, depth + 1) for each in inner)
        if sizes[id(node)] > MOST_PARTS:
            raise ConfigError(f"it has more than {MOST_PARTS:,} parts with its aliases written out")
        return sizes[id(node)]

    size(root, 0)


_FASTEST: Any = getattr(
    yaml, "CSafeLoader", yaml.SafeLoader
)  # in C, where PyYAML was built with it


class _Loader(_FASTEST):  # type: ignore[misc]  # mypy does not know which of the two it is
    """Refuses a key that stands twice, which YAML's own loader silently lets win."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = set[Any]()
        for part, _ in node.value:
            key = self.construct_object(part, deep=True)
            if key in keys:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {shown(key)} stands twice", node.start_mark
                )
            keys.add(key)
        return super().construct_mapping(node, deep)


def load(cls: type[T], source: str | Path | Mapping[str, Any], where: str = "") -> T:
    """Build the dataclass `cls` from a YAML file or a mapping.

    Args:
        cls: A frozen dataclass; nested dataclasses, tuples and dicts are built in turn.
        source: A YAML file or an already parsed mapping.
        where: Path of the value inside its file, for messages.

    Raises:
        ConfigError: If a key is missing, or a value has the wrong type or is refused by `cls`.
        UnknownNameError: If a key is not a field of `cls`.
    """
    is_file = isinstance(source, str | Path)
    data: Any = read_yaml(source) if is_file else source  # type: ignore[arg-type]
    where = where or (str(source) if is_file else cls.__name__)
    if not isinstance(data, Mapping):
        raise ConfigError(f"{where}: expected a mapping, got {type(data).__name__}")
    hints = _hints(typing.cast(Any, cls))
    for key in data:
        check_name(f"field of {cls.__name__} ({where})", key, hints)
    missing = [
        f.name
        for f in dataclasses.fields(typing.cast(Any, cls))
        if f.name not in data
        and f.default is dataclasses.MISSING
        and f.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise ConfigError(f"{where}: missing {', '.join(missing)}")
    if where.count(".") + where.count("[") > DEPTH:
        raise ConfigError(f"{where[:100]}…: nested too deeply")
    values = {k: _convert(hints[k], v, f"{where}.{k}") for k, v in data.items()}
    try:
        return cls(**values)
    except (UnknownNameError, TypeError, ValueError) as error:
        raise ConfigError(f"{where}: {error}") from error


@cache
def _hints(cls: Any) -> dict[str, Any]:
    """Return the type of each field; what belongs to the class alone cannot be set."""
    hints = typing.get_type_hints(cls)
    return {f.name: hints[f.name] for f in dataclasses.fields(cls)}


def _convert(hint: Any, value: Any, where: str) -> Any:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return value
    if origin in (types.UnionType, typing.Union):
        return _convert_union(args, value, where)
    if dataclasses.is_dataclass(hint):
        return load(typing.cast(type, hint), value, where)
    if origin is tuple:
        return _convert_tuple(args, value, where)
    if origin is dict:
        if not isinstance(value, dict):
            raise ConfigError(f"{where}: expected a mapping, got {_shown(value)}")
        return {
            _convert(args[0], k, f"{where} (key)"): _convert(args[1], v, f"{where}.{k}")
            for k, v in value.items()
        }
    if origin is typing.Literal:
        if not any(type(value) is type(each) and value == each for each in args):
            raise UnknownNameError(f"value for {where}", _text(value), [str(a) for a in args])
        return value
    if isinstance(value, int) and abs(value) > LARGEST_NUMBER:
        raise ConfigError(f"{where}: expected a number of at most {LARGEST_NUMBER:.3g}")
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if (
        origin is None
        and isinstance(hint, type)
        and (not isinstance(value, hint) or (isinstance(value, bool) and hint is not bool))
    ):
        raise ConfigError(f"{where}: expected {hint.__name__}, got {_shown(value)}")
    if hint is float and not math.isfinite(value):
        raise ConfigError(f"{where}: expected a finite number, got {value}")
    return value


def _convert_union(args: tuple[Any, ...], value: Any, where: str) -> Any:
    if value is None and type(None) in args:
        return None
    options = [a for a in args if a is not type(None)]
    if len(options) == 1:
        return _convert(options[0], value, where)
    problems = []
    for option in options:
        try:
            return _convert(option, value, where)
        except (ConfigError, UnknownNameError) as error:
            problems.append(str(error))
    raise ConfigError(f"{where}: " + "; or ".join(problems))


def _convert_tuple(args: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise ConfigError(f"{where}: expected a list, got {_shown(value)}")
    item = [args[0]] * len(value) if args[-1] is Ellipsis else list(args)
    if len(item) != len(value):
        raise ConfigError(f"{where}: expected {len(item)} values, got {len(value)}")
    return tuple(
        _convert(h, v, f"{where}[{i}]") for i, (h, v) in enumerate(zip(item, value, strict=True))
    )


def plain(value: Any, where: str) -> Any:
    """Return a value as JSON and YAML can hold it; ConfigError, naming `where`, if they cannot.

    Paths become texts, tuples lists, and NumPy's numbers Python's.
    """
    if isinstance(value, Mapping):
        return {str(k): plain(v, f"{where}.{k}") for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v, f"{where}[{i}]") for i, v in enumerate(value)]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float) and math.isfinite(value):
        return value
    raise ConfigError(f"{where} cannot be written to a file: {_shown(value)}")


def _shown(value: Any) -> str:
    return f"{type(value).__name__} {shown(value)}"


def _text(value: Any) -> str:
    return value if isinstance(value, str) else shown(value)
