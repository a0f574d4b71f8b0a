"""Logs in MCAP, the format of Foxglove and PlotJuggler: channels of JSON messages.

A row of a log is a message of the motors' readings with the nearest message in time of every other
channel.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from truepose.exceptions import InputError
from truepose.files import mark
from truepose.logs.limits import require
from truepose.logs.reading import spoilt
from truepose.logs.writing import Column

MAGIC = b"\x89MCAP"
#: Largest time between messages of two channels at one pose, s.
TOLERANCE = 0.01


def read(path: Path, data: bytes, wanted: tuple[str, ...]) -> dict[str, Any]:
    """Return the columns of an MCAP file's bytes; `wanted` are the names of the readings."""
    try:
        from mcap.reader import make_reader
    except ImportError:
        raise InputError(
            f"{path}: MCAP needs mcap: pip install 'truepose[mcap]'; CSV needs no package"
        ) from None
    sent: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    owner: dict[str, str] = {}
    try:
        for _, channel, message in _messages(path, make_reader(io.BytesIO(data))):
            if channel.message_encoding != "json":
                continue
            cells = json.loads(message.data)
            for name in cells if isinstance(cells, dict) else ():
                if owner.setdefault(name, channel.topic) != channel.topic:
                    raise InputError(
                        f"{path}: column '{name}' is in two channels, {owner[name]} and "
                        f"{channel.topic}"
                    )
            if isinstance(cells, dict):
                sent.setdefault(channel.topic, []).append((message.log_time, cells))
    except InputError:
        raise
    except Exception as error:  # a damaged file may raise anything
        raise spoilt(path, "MCAP", error) from None
    if not owner:
        raise InputError(f"{path}: no channel of JSON messages")
    return _joined(path, sent, owner, wanted)


def _joined(
    path: Path, sent: dict[str, list], owner: dict[str, str], wanted: tuple[str, ...]
) -> dict[str, Any]:
    """Return the columns of channels whose messages come at different times."""
    leading = next((owner[name] for name in wanted if name in owner), next(iter(sent)))
    at = {}
    for topic, messages in sent.items():
        messages.sort(key=lambda message: message[0])
        at[topic] = np.array([time for time, _ in messages])
    times = at[leading]
    half = np.median(np.diff(times)) / 2 if len(times) > 1 else np.inf
    tolerance = min(1e9 * TOLERANCE, half) if half > 0 else 0
    table: dict[str, Any] = {}
    for topic, messages in sent.items():
        later = np.clip(np.searchsorted(at[topic], times), 1, max(len(messages) - 1, 1))
        earlier = later - 1
        later = np.minimum(later, len(messages) - 1)
        nearer = np.abs(at[topic][later] - times) < np.abs(times - at[topic][earlier])
        nearest = np.where(nearer, later, earlier)
        if topic == leading:
            nearest = np.arange(len(times))
        near = np.abs(at[topic][nearest] - times) <= tolerance
        names = [name for name, own in owner.items() if own == topic]
        if not near.any() and any(name in wanted for name in names):
            raise InputError(
                f"{path}: {topic}: no message within {1e-6 * tolerance:.3g} ms of one of {leading}"
            )
        for name in names:
            column = [messages[k][1].get(name) for k in nearest]
            table[name] = [cell if by else None for cell, by in zip(column, near, strict=True)]
    return table


def write(path: Path, listed: list[Column]) -> bytes:
    """Encode one channel per topic, one message per row, as JSON with its schema.

    The time of a row is the run's, or one second per pose.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        raise InputError(
            f"{path}: MCAP needs mcap: pip install 'truepose[mcap]'; CSV needs no package"
        ) from None
    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start(profile="", library=mark("log"))
    times = np.round(1e9 * listed[0].values).astype(np.int64).tolist()
    for topic in dict.fromkeys(c.topic for c in listed):
        own = [c for c in listed if c.topic == topic]
        schema = {
            "type": "object",
            "title": topic,
            "properties": {
                c.name: {"type": ["number", "null"], "description": f"{c.what}, {c.unit}"}
                for c in own
            },
        }
        text = json.dumps(schema, ensure_ascii=False).encode()
        number = writer.register_schema(f"truepose.{topic}", "jsonschema", text)
        channel = writer.register_channel(f"/{topic}", "json", number)
        rows = zip(*(c.values.tolist() for c in own), strict=True)
        for at, row in zip(times, rows, strict=True):
            cells = {c.name: v if np.isfinite(v) else None for c, v in zip(own, row, strict=True)}
            writer.add_message(channel, at, json.dumps(cells).encode(), at)
    writer.finish()  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def _messages(path: Path, reader: Any) -> Iterator[Any]:
    """Yield the messages of an MCAP file's reader, each as schema, channel, message."""
    summary = reader.get_summary()
    chunks = summary.chunk_indexes if summary else ()
    require(path, 0, 0, sum(chunk.uncompressed_size for chunk in chunks))
    for count, message in enumerate(reader.iter_messages(), 1):
        require(path, count, 0)
        yield message
