"""Biovision Hierarchy (BVH): reading the public text format of motion capture, and writing it.

A file has a HIERARCHY of joints, each with an OFFSET from its parent and CHANNELS, and a MOTION with one
line of channel values a frame. Rotations apply in the order in which the channels stand, each about the
axes that the one before has turned. Angles are in degrees; the unit of length is the file's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array
from rcare_marl.reading import DEPTH, read_text

POSITIONS = ("Xposition", "Yposition", "Zposition")
ROTATIONS = ("Xrotation", "Yrotation", "Zrotation")
LARGEST = 1e9  # of any number


@dataclass(frozen=True, eq=False)
class Bvh:
    """What a BVH file holds.

    Attributes:
        names: The joints, parents first.
        parents: Index of each one's parent, -1 for the root.
        offsets: From the parent's joint in the rest posture, shape [n, 3].
        channels: Of each joint, in the order of the file.
        frame_time: Between two frames [s].
        values: Channel values, one row a frame, shape [t, c].
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Array
    channels: tuple[tuple[str, ...], ...]
    frame_time: float
    values: Array

    def local_rotations(self) -> Array:
        """Return the rotation of each joint against its parent, shape [t, n, 3, 3]."""
        out = np.tile(np.eye(3), (len(self.values), len(self.names), 1, 1))
        column = 0
        for j, channels in enumerate(self.channels):
            turning = [k for k, channel in enumerate(channels) if channel in ROTATIONS]
            if turning:
                order = "".join(channels[k][0] for k in turning)
                angles = self.values[:, [column + k for k in turning]]
                out[:, j] = Rotation.from_euler(order, angles, degrees=True).as_matrix()
            column += len(channels)
        return out

    def root_positions(self) -> Array:
        """Return where the root is in each frame, shape [t, 3]."""
        out = np.tile(self.offsets[0], (len(self.values), 1))
        for column, channel in enumerate(self.channels[0]):
            if channel in POSITIONS:
                out[:, POSITIONS.index(channel)] = self.values[:, column]
        return out

    def rest_positions(self) -> Array:
        """Return the joints in the rest posture, the root at the origin, shape [n, 3]."""
        out = np.zeros((len(self.names), 3))
        for j, parent in enumerate(self.parents):
            if parent >= 0:
                out[j] = out[parent] + self.offsets[j]
        return out


class _Reader:
    """The lines of a file, one after the other, with messages that name them."""

    def __init__(self, path: Path) -> None:
        text = read_text(path, "BVH")
        self._path = path
        numbered = enumerate(text.splitlines(), start=1)
        self._rows = [(n, line.split()) for n, line in numbered if line.strip()]
        self._next = 0

    def fail(self, wanted: str, *, at: int | None = None) -> ConfigError:
        """Return the error for the line that was read last, or for the row `at`."""
        row = self._next - 1 if at is None else at
        if row >= len(self._rows):
            last = self._rows[-1][0] if self._rows else 0
            return ConfigError(f"{self._path}, after line {last}: expected {wanted}, got the end")
        number, words = self._rows[row]
        got = " ".join(words)
        return ConfigError(f"{self._path}, line {number}: expected {wanted}, got {got[:80]!r}")

    def read(self, wanted: str) -> list[str]:
        """Return the words of the next line; `wanted` says what should stand there."""
        self._next += 1
        if self._next > len(self._rows):
            raise self.fail(wanted)
        return self._rows[self._next - 1][1]

    def read_keyword(self, *keyword: str, values: int = 0) -> list[str]:
        """Return what follows a keyword, of one or more words, on the next line."""
        shown = " ".join(keyword)
        wanted = f"{shown!r}" + (f" and {values} value{'s' * (values > 1)}" if values else "")
        words = self.read(wanted)
        head = [word.upper() for word in words[: len(keyword)]]
        if head != [word.upper() for word in keyword] or len(words) != len(keyword) + values:
            raise self.fail(wanted)
        return words[len(keyword) :]

    def read_numbers(self, *keyword: str, count: int) -> list[float]:
        """Return the numbers after a keyword on the next line."""
        return self.numbers(self.read_keyword(*keyword, values=count), count)

    def numbers(self, words: list[str], count: int) -> list[float]:
        """Return the words of the last line as `count` finite numbers."""
        wanted = f"{count} finite number{'s' * (count > 1)}"
        if len(words) != count:
            raise self.fail(f"{wanted}, one a channel, of which there are {len(words)}")
        try:
            out = [float(word) for word in words]
        except ValueError as error:
            raise self.fail(wanted) from error
        if not all(abs(value) <= LARGEST for value in out):
            raise self.fail(wanted)
        return out

    def is_over(self) -> bool:
        return self._next >= len(self._rows)


def read_bvh(path: str | Path) -> Bvh:
    """Read a BVH file.

    Raises:
        ConfigError: If it cannot be read or breaks the format; the message names the line and what
            was expected there.
    """
    reader = _Reader(Path(path))
    reader.read_keyword("HIERARCHY")
    names, parents, offsets, channels = _read_hierarchy(reader)
    reader.read_keyword("MOTION")
    (frames,) = reader.read_numbers("Frames:", count=1)
    if frames < 1 or frames != int(frames):
        raise reader.fail("a whole number of frames, at least 1")
    (frame_time,) = reader.read_numbers("Frame", "Time:", count=1)
    if frame_time <= 0:
        raise reader.fail("a positive frame time [s]")
    count = sum(map(len, channels))
    rows = [
        reader.numbers(reader.read(f"frame {k + 1} of {int(frames)}"), count)
        for k in range(int(frames))
    ]
    if not reader.is_over():
        reader.read("the end")
        raise reader.fail(f"the end after {int(frames)} frames")
    values = np.array(rows, np.float64).reshape(int(frames), count)
    return Bvh(tuple(names), tuple(parents), np.array(offsets), tuple(channels), frame_time, values)


def _read_hierarchy(
    reader: _Reader,
) -> tuple[list[str], list[int], list[list[float]], list[tuple[str, ...]]]:
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    channels: list[tuple[str, ...]] = []
    stack: list[int] = []  # open joints; -1 for an End Site
    while True:
        words = reader.read("'JOINT', 'End Site' or '}'" if stack else "'ROOT' and a name")
        word = words[0].upper()
        if stack and word == "}" and len(words) == 1:
            stack.pop()
            if not stack:
                return names, parents, offsets, channels
        elif stack and stack[-1] >= 0 and [w.upper() for w in words] == ["END", "SITE"]:
            reader.read_keyword("{")
            reader.read_numbers("OFFSET", count=3)
            stack.append(-1)
        elif len(words) > 1 and word == ("JOINT" if stack else "ROOT") and stack[-1:] != [-1]:
            name = " ".join(words[1:])
            if name in names:
                raise reader.fail(f"a new name, since {name!r} stands above")
            names.append(name)
            parents.append(stack[-1] if stack else -1)
            reader.read_keyword("{")
            offsets.append(reader.read_numbers("OFFSET", count=3))
            channels.append(_read_channels(reader))
            stack.append(len(names) - 1)
            if len(stack) > DEPTH:
                raise reader.fail(f"at most {DEPTH} joints in a row")
        else:
            raise reader.fail(
                "'JOINT' and a name, 'End Site' or '}'" if stack else "'ROOT' and a name"
            )


def _read_channels(reader: _Reader) -> tuple[str, ...]:
    wanted = f"'CHANNELS', their number and names of {', '.join((*POSITIONS, *ROTATIONS))}"
    words = reader.read(wanted)
    known = {name.lower(): name for name in (*POSITIONS, *ROTATIONS)}
    if len(words) < 2 or words[0].upper() != "CHANNELS" or not words[1].isdigit():
        raise reader.fail(wanted)
    chosen = words[2:]
    if len(chosen) != int(words[1]):
        raise reader.fail(f"{words[1]} channels after their number")
    if any(name.lower() not in known for name in chosen):
        raise reader.fail(wanted)
    if len({name.lower() for name in chosen}) != len(chosen):
        raise reader.fail("each channel once")
    return tuple(known[name.lower()] for name in chosen)


def write_bvh(path: str | Path, bvh: Bvh) -> None:
    """Write a BVH file; reading it gives the same numbers to six digits after the point."""
    lines = ["HIERARCHY"]

    def add(j: int, depth: int) -> None:
        pad = "  " * depth
        x, y, z = bvh.offsets[j]
        lines.append(f"{pad}{'JOINT' if depth else 'ROOT'} {bvh.names[j]}")
        lines.append(f"{pad}{{")
        lines.append(f"{pad}  OFFSET {x:.6f} {y:.6f} {z:.6f}")
        lines.append(f"{pad}  CHANNELS {len(bvh.channels[j])} {' '.join(bvh.channels[j])}")
        children = [k for k, parent in enumerate(bvh.parents) if parent == j]
        for k in children:
            add(k, depth + 1)
        if not children:
            lines.extend((f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET 0.0 0.0 0.0"))
            lines.append(f"{pad}  }}")
        lines.append(f"{pad}}}")

    add(0, 0)
    # Channels are written depth first, which need not be the order of the joints.
    starts = np.cumsum([0, *map(len, bvh.channels)])
    order = [line.split()[1] for line in lines if line.strip().startswith(("ROOT ", "JOINT "))]
    columns = [
        column
        for name in order
        for column in range(starts[bvh.names.index(name)], starts[bvh.names.index(name) + 1])
    ]
    lines += ["MOTION", f"Frames: {len(bvh.values)}", f"Frame Time: {bvh.frame_time:.9g}"]
    lines += [" ".join(f"{value:.6f}" for value in row[columns]) for row in bvh.values]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
