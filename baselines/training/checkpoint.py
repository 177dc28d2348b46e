"""Checkpoints: all that a training run needs to go on as if it had never stopped.

A file is written beside its place, forced to the disk and then renamed, so that a run that is killed at
any moment leaves the old file or the new one, never a part. It is read without running any code in it.
"""

from __future__ import annotations

import os
import pickle
import random
import shutil
import zipfile
from collections import OrderedDict
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

import rcare_marl
from rcare_marl.errors import ConfigError, near_files, shown
from rcare_marl.reading import check_regular, refusing

FORMAT = 1  # of the file; counts up when what is in it changes
LARGEST = 1 << 36  # [bytes]: a buffer of pictures is large
LAST, BEST = "checkpoint.pt", "best.pt"  # names in the folder of a run
# What may change between two parts of a run: how long it is and who computes it, not what is learned.
FREE = ("steps", "minutes", "workers", "threads", "stop_success")
RNG = "rng"  # where the states of shared generators are among what is loaded
_ARRAY = "__array__"  # marks a numpy array, which torch refuses to read without running code


def restore_rng(saved: Mapping[str, Any]) -> None:
    """Put the generators that a process shares, of torch, numpy and Python, to where they were.

    Do this last, just before the run goes on: whatever is built draws from them.

    Args:
        saved: What `load` returned.
    """
    states = saved[RNG]
    torch.set_rng_state(states["torch"])
    if torch.cuda.is_available() and states["cuda"]:
        torch.cuda.set_rng_state_all(states["cuda"])
    np.random.set_state(states["numpy"])
    version, words, spare = states["python"]
    random.setstate((version, tuple(words), spare))


def save(
    path: str | Path,
    state: Mapping[str, Any],
    *,
    config: Mapping[str, Any] | None = None,
    is_best: bool = False,
) -> None:
    """Write a checkpoint, whole or not at all, and remove what killed runs left half written.

    Args:
        path: Where to; its folder is made.
        state: Of tensors, arrays, numbers, texts, None, and mappings and sequences of them.
        config: Of the run, to check on `load` that a file fits; numbers and texts likewise.
        is_best: Whether to keep it as `best.pt` in the same folder too, whatever follows.

    Raises:
        ConfigError: If something in the state cannot be kept, or the file cannot be written.
    """
    file = Path(path)
    content = {
        "format": FORMAT,
        "version": rcare_marl.__version__,
        "config": _plain(dict(config or {}), "config"),
        "state": _plain({**state, RNG: _random_states()}, "state"),
    }
    temporary = file.parent / f".{file.name}-{os.getpid()}.tmp"
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        for left in file.parent.glob(f".{file.name}-*.tmp"):
            left.unlink(missing_ok=True)
        try:
            with temporary.open("wb") as stream:
                torch.save(content, stream)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(temporary, file)
        finally:
            temporary.unlink(missing_ok=True)
        if is_best:
            _keep(file, file.with_name(BEST))
        _force_folder(file.parent)
    except (OSError, RuntimeError) as error:  # Torch ends a file that it cannot write by the latter
        cause = error if isinstance(error, OSError) else error.__context__
        if not isinstance(cause, OSError):
            raise
        raise ConfigError(f"cannot write {file}: {cause.strerror or cause}") from error


def _keep(file: Path, name: Path) -> None:
    """Give a file a second name at once, without copying it where the disk can."""
    temporary = name.with_name(f".{file.name}-{os.getpid()}-best.tmp")
    try:
        os.link(file, temporary)
    except OSError:  # a disk without links
        shutil.copyfile(file, temporary)
    os.replace(temporary, name)


def _force_folder(folder: Path) -> None:
    """Force the names in a folder to the disk, so that a power cut does not undo a rename."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def load(
    path: str | Path,
    *,
    config: Mapping[str, Any] | None = None,
    free: Collection[str] = FREE,
) -> dict[str, Any]:
    """Return what was saved, and under `rng` the states of the generators that a process shares.

    Args:
        path: The file.
        config: Of the run that is to go on; not compared if None.
        free: Fields of it that may differ, such as `steps`, or `algorithm.batch` in another.

    Raises:
        ConfigError: If there is no such file, it is damaged or of another format, or it does not fit the
            config; says which fields differ.
    """
    file = Path(path)
    if not os.path.isfile(file):
        raise ConfigError(f"no checkpoint at {file}.{near_files(file)}")
    content = _read(file)
    if not isinstance(content, dict) or "format" not in content:
        raise ConfigError(f"{file} is no checkpoint of this package")
    if content["format"] != FORMAT:
        raise ConfigError(
            f"{file} has format {shown(content['format'])}, written by rcare-marl "
            f"{str(content.get('version'))[:40]}; "
            f"rcare-marl {rcare_marl.__version__} reads format {FORMAT}: go on with that version, or "
            "start anew in another folder"
        )
    with refusing(file, "a checkpoint of this package"):
        saved, state = _restored(content["config"]), _restored(content["state"])
        if not isinstance(saved, dict) or not isinstance(state, dict) or RNG not in state:
            raise ConfigError("it lacks the config, the state or its generators")
    changes = [] if config is None else differences(saved, config, free=free)
    if changes:
        raise ConfigError(f"{file} does not fit: {'; '.join(changes)}")
    return state


def differences(
    saved: Mapping[str, Any],
    wanted: Mapping[str, Any],
    *,
    free: Collection[str] = (),
    names: tuple[str, str] = ("in the checkpoint", "in the config"),
) -> list[str]:
    """Return in words how two configs differ, field by field.

    Args:
        saved: That of the checkpoint.
        wanted: That of the run.
        free: Fields that may differ, with all that is in them.
        names: What to call where the two are.
    """
    old, new = _flat(saved), _flat(wanted)
    (here, there), out = names, []
    for name in [*old, *(name for name in new if name not in old)]:
        if any(name == each or name.startswith(f"{each}.") for each in free):
            continue
        if name not in new:
            out.append(f"{name} is {old[name]!r} {here} and not set {there}")
        elif name not in old:
            out.append(f"{name} is not set {here} and {new[name]!r} {there}")
        elif old[name] != new[name]:
            out.append(f"{name} is {old[name]!r} {here} and {new[name]!r} {there}")
    return out


def _flat(value: Mapping[str, Any], stem: str = "") -> dict[str, Any]:
    """Return the fields of nested mappings by their full names; sequences are alike as lists."""
    out: dict[str, Any] = {}
    for name, each in value.items():
        if isinstance(each, Mapping):
            out |= _flat(each, f"{stem}{name}.")
        else:
            out[f"{stem}{name}"] = _listed(each)
    return out


def _listed(value: Any) -> Any:
    return [_listed(each) for each in value] if isinstance(value, list | tuple) else value


def _read(file: Path) -> Any:
    """Return what is in a file, having checked that all of it is there as it was written."""
    damaged = (
        f"{file} is damaged or was cut short: take another file, such as {BEST}, or start anew in another "
        "folder"
    )
    check_regular(file, "a checkpoint", most=LARGEST)
    try:
        with zipfile.ZipFile(file) as archive:
            if archive.testzip() is not None:
                raise ConfigError(damaged)
        with refusing(file, "a checkpoint of this package"):
            return torch.load(file, map_location="cpu", weights_only=True)
    except ConfigError as error:
        if isinstance(error.__cause__, pickle.UnpicklingError):
            raise ConfigError(
                f"{file} holds more than tensors, numbers and texts, and is not read: what it holds could "
                "run as a program"
            ) from error
        raise
    except Exception as error:  # of an archive that is damaged
        raise ConfigError(damaged) from error


def _random_states() -> dict[str, Any]:
    has_cuda = torch.cuda.is_available() and torch.cuda.is_initialized()  # type: ignore[no-untyped-call]
    return {
        "torch": torch.get_rng_state(),
        "cuda": torch.cuda.get_rng_state_all() if has_cuda else [],
        "numpy": np.random.get_state(legacy=False),
        "python": random.getstate(),
    }


def _plain(value: Any, where: str) -> Any:
    """Return a value as torch reads it without running code; ConfigError names what cannot be kept."""
    if value is None or type(value) in (bool, int, float, str, bytes):
        return value
    if isinstance(value, torch.Tensor):
        whole = value.untyped_storage().nbytes()  # torch writes all of it, also for a small part
        is_part = value.numel() * value.element_size() < whole
        return value.detach().clone() if is_part else value.detach()
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        data = bytearray(value.tobytes())
        raw = (
            torch.frombuffer(data, dtype=torch.uint8) if data else torch.zeros(0, dtype=torch.uint8)
        )
        return {_ARRAY: raw, "dtype": value.dtype.str, "shape": list(value.shape)}
    if isinstance(value, np.bool_ | np.integer | np.floating):
        return value.item()
    if isinstance(value, torch.Size | torch.device | torch.dtype):
        return value
    if isinstance(value, Mapping):
        for key in value:
            if type(key) not in (str, int):
                raise ConfigError(
                    f"{where}: a checkpoint has texts and whole numbers as keys, not {key!r}"
                )
        return _like(value, {key: _plain(each, f"{where}.{key}") for key, each in value.items()})
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        parts = [_plain(each, f"{where}[{i}]") for i, each in enumerate(value)]
        return tuple(parts) if isinstance(value, tuple) else parts
    raise ConfigError(
        f"{where} is a {type(value).__name__}: a checkpoint holds tensors, arrays, numbers and texts"
    )


def _like(old: Mapping[Any, Any], new: dict[Any, Any]) -> dict[Any, Any]:
    """Return `new`, with what torch hangs on the states of modules and tensordicts, if `old` has it."""
    about = getattr(old, "_metadata", None)
    if about is None:
        return new
    out = OrderedDict(new)
    vars(out)["_metadata"] = OrderedDict((name, dict(each)) for name, each in about.items())
    return out


def _restored(value: Any) -> Any:
    """Return a value as it was before `_plain`."""
    if isinstance(value, dict):
        if _ARRAY in value:
            dtype = np.dtype(value["dtype"])
            data = value[_ARRAY].numpy().tobytes()
            return np.frombuffer(data, dtype).reshape(value["shape"]).copy()
        return _like(value, {key: _restored(each) for key, each in value.items()})
    if isinstance(value, torch.Size):
        return value
    if isinstance(value, list | tuple):
        parts = [_restored(each) for each in value]
        return tuple(parts) if isinstance(value, tuple) else parts
    return value
