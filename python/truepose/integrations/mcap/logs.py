"""Logs in MCAP, the format of Foxglove and PlotJuggler: channels of JSON messages."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from truepose.exceptions import InputError
from truepose.files import mark
from truepose.logs.limits import require
from truepose.logs.reading import spoilt
from truepose.logs.writing import Column
from truepose.plugins import package

MAGIC = b"\x89MCAP"
#: Largest time between messages of two channels at one pose, s.
TOLERANCE = 0.01


def read(path: Path, data: bytes, wanted: tuple[str, ...]) -> dict[str, Any]:
    """Return the columns of an MCAP file's bytes; `wanted` are the names of the readings."""
    make_reader = _mcap(path).reader.make_reader
    channels: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    owner: dict[str, str] = {}
    try:
        reader = make_reader(io.BytesIO(data))
        summary = reader.get_summary()
        chunks = summary.chunk_indexes if summary else ()
        require(path, 0, 0, sum(chunk.uncompressed_size for chunk in chunks))
        for count, (_, channel, message) in enumerate(reader.iter_messages(), 1):
            require(path, count, 0)
            cells = json.loads(message.data) if channel.message_encoding == "json" else None
            if not isinstance(cells, dict):
                continue
            for name in cells:
                if owner.setdefault(name, channel.topic) != channel.topic:
                    raise InputError(
                        f"{path}: column '{name}' is in two channels, {owner[name]} and "
                        f"{channel.topic}"
                    )
            channels.setdefault(channel.topic, []).append((message.log_time, cells))
    except InputError:
        raise
    except Exception as error:  # a damaged file may raise anything
        raise spoilt(path, "MCAP", error) from None
    if not owner:
        raise InputError(f"{path}: no channel of JSON messages")
    return _joined(path, channels, owner, wanted)


def _joined(
    path: Path, channels: dict[str, list], owner: dict[str, str], wanted: tuple[str, ...]
) -> dict[str, Any]:
    """Return the columns of channels whose messages come at different times."""
    leading = next((owner[name] for name in wanted if name in owner), next(iter(channels)))
    for messages in channels.values():
        messages.sort(key=lambda message: message[0])
    at = {topic: np.array([m[0] for m in messages]) for topic, messages in channels.items()}
    times = at[leading]
    half = np.median(np.diff(times)) / 2 if len(times) > 1 else np.inf
    tolerance = min(1e9 * TOLERANCE, half) if half > 0 else 0
    table: dict[str, Any] = {}
    for topic, messages in channels.items():
        middles = at[topic][:-1] + np.diff(at[topic]) // 2
        nearest = np.arange(len(times)) if topic == leading else np.searchsorted(middles, times)
        near = np.abs(at[topic][nearest] - times) <= tolerance
        names = [name for name, own in owner.items() if own == topic]
        if not near.any() and not set(names).isdisjoint(wanted):
            raise InputError(
                f"{path}: {topic}: no message within {1e-6 * tolerance:.3g} ms of one of {leading}"
            )
        cells = [messages[k][1] if by else {} for k, by in zip(nearest, near, strict=True)]
        table |= {name: [cell.get(name) for cell in cells] for name in names}
    return table


def write(path: Path, listed: list[Column]) -> bytes:
    """Encode one channel per topic, one message per row, as JSON with its schema.

    The time of a row is the run's, or one second per pose.
    """
    buffer = io.BytesIO()
    writer = _mcap(path).writer.Writer(buffer)
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
    writer.finish()
    return buffer.getvalue()


def _mcap(path: Path) -> Any:
    """Return the package mcap with its modules reader and writer."""
    missing = f"{path}: MCAP needs mcap: pip install 'truepose[mcap]'; CSV needs no package"
    package("mcap.reader", missing)
    return package("mcap.writer", missing)
