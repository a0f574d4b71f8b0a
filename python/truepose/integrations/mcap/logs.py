"""Logs in MCAP, the format of Foxglove, PlotJuggler and ROS 2: JSON and ROS 2 messages."""

import dataclasses
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
from truepose.plugins import package

MAGIC = b"\x89MCAP"
#: Largest array of a message whose entries become columns: a covariance of a pose.
_MOST_ENTRIES = 36
#: Largest time between messages of two channels at one pose, s.
TOLERANCE = 0.01


def read(path: Path, data: bytes, wanted: tuple[str, ...], formulas: str = "") -> dict[str, Any]:
    """Return the columns of an MCAP file's bytes; `wanted` are the readings, also by formulas."""
    make_reader = _mcap(path).reader.make_reader
    channels: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    owner: dict[str, str] = {}
    try:
        reader = make_reader(io.BytesIO(data))
        summary = reader.get_summary()
        chunks = summary.chunk_indexes if summary else ()
        require(path, 0, 0, sum(chunk.uncompressed_size for chunk in chunks))
        ros = _Ros(path)
        for count, (schema, channel, message) in enumerate(reader.iter_messages(), 1):
            require(path, count, 0)
            cells = None
            if channel.message_encoding == "json":
                cells = json.loads(message.data)
            elif channel.message_encoding == "cdr" and schema and schema.encoding == "ros2msg":
                cells = ros.cells(schema, channel.topic, message.data)
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
        raise InputError(f"{path}: no channel of JSON or ROS 2 messages")
    by_formula = sorted((name for name in owner if name in formulas), key=formulas.index)
    return _joined(path, channels, owner, (*wanted, *by_formula))


class _Ros:
    """Decoder of ROS 2 messages, whose definitions the file has."""

    def __init__(self, path: Path) -> None:
        self._path, self._known = path, set[str]()
        self._store: Any = None  # of message types, when it is needed

    def cells(self, schema: Any, topic: str, data: bytes) -> dict[str, float]:
        """Return a message's numbers: of a JointState by joint, else by topic and field."""
        if self._store is None:
            missing = f"{self._path}: ROS 2 messages need rosbags: pip install rosbags"
            package("rosbags.typesys", missing)
            from rosbags.typesys import Stores, get_typestore

            self._store = get_typestore(Stores.EMPTY)
        if schema.name not in self._known:
            from rosbags.typesys import get_types_from_msg

            self._store.register(get_types_from_msg(schema.data.decode(), schema.name))
            self._known.add(schema.name)
        message = self._store.deserialize_cdr(data, schema.name)
        if schema.name.endswith("/JointState"):
            return dict(zip(message.name, message.position.tolist(), strict=False))
        return dict(_numbers(topic, message))


def _numbers(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a message's fields, of its messages too."""
    if isinstance(value, (int, float)):
        yield name, float(value)
    elif isinstance(value, np.ndarray) and value.size <= _MOST_ENTRIES:
        yield from ((f"{name}[{k}]", float(v)) for k, v in enumerate(value.ravel()))
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            if field.name not in ("header", "__msgtype__"):
                yield from _numbers(f"{name}.{field.name}", getattr(value, field.name))


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
    missing = f"{path}: MCAP needs mcap: pip install mcap; CSV needs no package"
    package("mcap.reader", missing)
    return package("mcap.writer", missing)
