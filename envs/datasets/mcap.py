"""Episodes in MCAP, as messages of JSON: for Foxglove and whatever else reads it.

https://mcap.dev/spec. An episode begins with its header on `/episode`. After the reset and after each step
there is a message on `/<role>/observation`, `/<role>/<array>`, `/outcome` and `/digests`, and before each
step one on `/<role>/action`.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.reading import LARGEST, parse_json, read_bytes

from ..episode import Header, RecordedEpisode
from .common import WHAT, assembled, header_of, is_picture, read_header

GAP = 1.0  # [s] between two episodes
OBJECT = {"type": "object"}
PICTURE = {  # foxglove.CompressedImage: https://docs.foxglove.dev/docs/sdk/schemas/compressed-image
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "frame_id": {"type": "string"},
        "data": {"type": "string", "contentEncoding": "base64"},
        "format": {"type": "string"},
    },
}


class McapWriter:
    """Writes one file; times are of the simulation, episode after episode."""

    def __init__(self, path: Path) -> None:
        """Begin a file."""
        from mcap.writer import Writer

        self._stream = path.open("wb")
        self._writer = Writer(self._stream)
        self._writer.start(profile="", library="rcare-marl")
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._start = 0.0

    def add(self, episode: RecordedEpisode) -> None:
        header, dt = episode.header, float(episode.header.facts["control_dt"])
        self._tell("/episode", header_of(episode), 0.0)
        for step in range(episode.steps + 1):
            now = step * dt
            for name, rows in episode.observations.items():
                role, _, array = name.partition(".")
                if not array:
                    parts = _named(header.facts["observes"][role], rows[step])
                    self._tell(f"/{role}/observation", parts, now)
                elif is_picture(rows):
                    self._tell(f"/{role}/{array}", _picture(rows[step], array, now), now, PICTURE)
                else:
                    self._tell(f"/{role}/{array}", _packed(rows[step]), now)
            values = [None if value != value else value for value in episode.numbers[step].tolist()]
            self._tell("/outcome", dict(zip(header.measures, values, strict=True)), now)
            digests = [f"{value:016x}" for value in episode.digests[step].tolist()]
            self._tell("/digests", dict(zip(header.parts, digests, strict=True)), now)
            for role in header.roles if step < episode.steps else ():
                action = {"values": episode.actions[role][step].tolist()}
                self._tell(f"/{role}/action", action, now)
        self._start += episode.steps * dt + GAP

    def _tell(self, topic: str, data: dict[str, Any], now: float, schema: Any = OBJECT) -> None:
        if topic not in self._channels:
            name = "foxglove.CompressedImage" if schema is PICTURE else "rcare_marl.Object"
            if name not in self._schemas:
                text = json.dumps(schema).encode()
                self._schemas[name] = self._writer.register_schema(name, "jsonschema", text)
            self._channels[topic] = self._writer.register_channel(
                topic, "json", self._schemas[name]
            )
        time = round(1e9 * (self._start + now))
        text = json.dumps(data, allow_nan=False).encode()
        self._writer.add_message(self._channels[topic], time, text, time)

    def close(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call, unused-ignore]
        self._stream.close()


def _named(table: list[Any], vector: npt.NDArray[Any]) -> dict[str, Any]:
    """Return the parts of an observed vector by name."""
    ends = np.cumsum([size for _, size, _ in table])
    parts = np.split(vector.astype(float), ends[:-1])
    return {name: part.tolist() for (name, _, _), part in zip(table, parts, strict=True)}


def _picture(pixels: npt.NDArray[Any], name: str, now: float) -> dict[str, Any]:
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    whole = int(now)
    return {
        "timestamp": {"sec": whole, "nsec": round(1e9 * (now - whole))},
        "frame_id": name,
        "data": base64.b64encode(stream.getvalue()).decode(),
        "format": "png",
    }


def _packed(values: npt.NDArray[Any]) -> dict[str, Any]:
    data = base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
    return {"dtype": values.dtype.str, "shape": list(values.shape), "data": data}


def read_mcap(path: Path, only: int | None) -> Iterator[RecordedEpisode]:
    """Yield the episodes of a file, or one of them; pictures and other arrays are left in it."""
    messages: dict[str, list[Any]] = {}
    number = -1
    for topic, data in _messages(read_bytes(path, WHAT)):
        if topic == "/episode":
            if messages and only in (None, number):
                yield _episode(messages, path)
            number, messages = number + 1, {topic: [parse_json(data.decode())]}
        elif not messages:
            raise ConfigError(f"{path} was not recorded by rcare-marl: {topic} precedes /episode")
        elif only in (None, number) and topic.endswith(
            ("/observation", "/action", "/outcome", "/digests")
        ):
            messages.setdefault(topic, []).append(parse_json(data.decode()))
    if not messages:
        raise ConfigError(f"{path} was not recorded by rcare-marl: nothing is on /episode")
    if only in (None, number):
        yield _episode(messages, path)


def _messages(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield topic and text of each message; what is compressed is looked at before it is unpacked."""
    import zstandard
    from mcap.records import Channel, Chunk, Message
    from mcap.stream_reader import StreamReader, breakup_chunk

    topics: dict[int, str] = {}
    left = LARGEST
    reader = StreamReader(
        io.BytesIO(data), emit_chunks=True, validate_crcs=True, record_size_limit=len(data)
    )
    for record in reader.records:
        found = [record]
        if isinstance(record, Chunk):
            size = len(record.data)
            if record.compression == "zstd":
                size = zstandard.frame_content_size(record.data)  # what would be asked for
            left -= size
            if left < 0 or size < 0 or record.compression not in ("", "zstd"):
                raise ConfigError(
                    f"its messages are not of zstd, or of more than {LARGEST:,} bytes"
                )
            found = breakup_chunk(record, validate_crc=True)
        for each in found:
            if isinstance(each, Channel):
                topics[each.id] = each.topic
            elif isinstance(each, Message):
                yield topics[each.channel_id], each.data


def _episode(messages: dict[str, list[Any]], path: Path) -> RecordedEpisode:
    header = read_header(messages["/episode"][0], path)
    actions, seen = {}, {}
    for role in header.roles:
        rows = [each["values"] for each in messages.get(f"/{role}/action", ())]
        width = len(header.facts["acts"][role])
        actions[role] = np.array(rows, float).reshape(-1, width)
        names = [name for name, _, _ in header.facts["observes"][role]]
        rows = [
            sum((each[name] for name in names), []) for each in messages[f"/{role}/observation"]
        ]
        seen[role] = np.array(rows, np.float32)
    digests = [[int(each[part], 16) for part in header.parts] for each in messages["/digests"]]
    numbers = [_numbers(each, header) for each in messages["/outcome"]]
    return assembled(header, actions, np.array(digests, np.uint64), np.array(numbers, float), seen)


def _numbers(outcome: dict[str, Any], header: Header) -> list[float]:
    return [float("nan") if (v := outcome[name]) is None else float(v) for name in header.measures]
