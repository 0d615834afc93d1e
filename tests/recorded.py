"""Records frames and reports, and reads recordings with the libraries that others read them with."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from pipeline.frame import Frame, Rig
from pipeline.verdict import Report
from sinks.mcap.settings import McapSettings
from sinks.mcap.sink import McapSink
from sources.replay.settings import ReplaySettings
from sources.replay.source import ReplaySource
from tests.frames import RIG

WALL_NS = 1_790_000_000_000_000_000


class Clock:
    """Stands still until it is told to go on."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns = now_ns

    def __call__(self) -> int:
        return self.now_ns


def mcap_sink(
    path: Path, *, rig: Rig = RIG, live: bool = False, clock: Clock | None = None, **settings: Any
) -> McapSink:
    """A sink whose clocks do not go by themselves."""
    clock = clock or Clock()
    return McapSink(
        McapSettings(path=str(path), **settings),
        base=path.parent,
        rig=rig,
        detectors=["timestamp", "offset"],
        version="1.2.3",
        live=live,
        wall_ns=lambda: WALL_NS + clock(),
        monotonic_ns=clock,
    )


def record(path: Path, *items: Frame | Report, **options: Any) -> Path:
    """A finished recording of the items, in their order."""
    sink = mcap_sink(path, **options)
    sink.start()
    try:
        for item in items:
            if isinstance(item, Frame):
                sink.take_frame(item)
            else:
                sink.take(item)
    finally:
        sink.stop()
    return path


def decoded(path: Path) -> dict[str, list[Any]]:
    """All messages by topic, decoded by the public libraries."""
    messages = defaultdict(list)
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            if channel.message_encoding == "json":
                messages[channel.topic].append(json.loads(message.data))
            else:
                decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
                messages[channel.topic].append(decode(message.data))
    return messages


def salvaged(path: Path) -> dict[str, list[Message]]:
    """The messages by topic that a plain stream reader finds before the file breaks off."""
    channels: dict[int, Channel] = {}
    messages = defaultdict(list)
    with path.open("rb") as stream:
        try:
            for record in StreamReader(stream).records:
                if isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    messages[channels[record.channel_id].topic].append(record)
        except Exception:  # noqa: BLE001, S110 - the end of a file that breaks off
            pass
    return messages


def schemas(path: Path) -> dict[str, Schema]:
    """The schema of each topic."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        return {channel.topic: summary.schemas[channel.schema_id] for channel in summary.channels.values()}


def replayed(path: Path, **settings: Any) -> list[Frame]:
    source = ReplaySource(ReplaySettings(path=str(path), **settings), base=path.parent)
    source.open()
    try:
        return list(source.frames())
    finally:
        source.close()


def same(one: Frame, other: Frame) -> bool:
    """Whether two frames are equal in every field and every pixel."""
    fields = [name for name in Frame.__dataclass_fields__ if name != "image"]
    return all(getattr(one, name) == getattr(other, name) for name in fields) and np.array_equal(one.image, other.image)
