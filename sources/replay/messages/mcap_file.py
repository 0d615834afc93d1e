"""MCAP files by the mcap library: with an index, without one, truncated, and split over several files."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import Channel, Schema
from mcap.stream_reader import StreamReader

from sources.replay.messages.container import Message, Topic, damage_refused, magic, until_damaged
from sources.replay.notices import Notices

MAGIC = b"\x89MCAP"
LOOKED_THROUGH = 6400
"""Records of a file without an index that are searched for topics: recorders announce all of them early."""


def is_mcap(path: Path) -> bool:
    return magic(path).startswith(MAGIC)


class McapFile:
    """One MCAP file. Raises InputError where it is no MCAP, or nothing of it can be read."""

    def __init__(self, path: Path, notices: Notices) -> None:
        self.where = path
        self._notices = notices
        with damage_refused(path), path.open("rb") as file:
            self.indexed, self._topics = _topics(file)
        if not self.indexed:
            notices.warning(f"{path}: has no index, as after a recorder that was killed: read from the start")

    @property
    def topics(self) -> Sequence[Topic]:
        return self._topics

    def messages(self, topic: str, from_ns: int | None = None) -> Generator[Message, None, None]:
        yield from until_damaged(self.where, self._notices, partial(self._read, topic, from_ns))

    def _read(self, topic: str, from_ns: int | None) -> Iterator[Message]:
        with self.where.open("rb") as file:
            reader = SeekingReader(file) if self.indexed else NonSeekingReader(file)
            found = reader.iter_messages(topics=[topic], log_time_order=False, starting_at=from_ns)
            for _, __, message in found:
                yield Message(message.log_time, message.sequence, message.data)


def _topics(file: BinaryIO) -> tuple[bool, list[Topic]]:
    """Whether the file has an index, and its topics."""
    try:
        summary = SeekingReader(file).get_summary()
    except (McapError, ValueError, OSError):
        summary = None
    if summary is None or not summary.chunk_indexes:
        file.seek(0)
        return False, _announced(file)
    counts = summary.statistics.channel_message_counts if summary.statistics is not None else {}
    return True, [
        _topic(channel, summary.schemas.get(channel.schema_id), counts.get(channel.id))
        for channel in summary.channels.values()
    ]


def _announced(file: BinaryIO) -> list[Topic]:
    """The topics that the first chunks hold."""
    schemas: dict[int, Schema] = {}
    topics: dict[str, Topic] = {}
    try:
        for told, record in enumerate(StreamReader(file).records, 1):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                topics.setdefault(record.topic, _topic(record, schemas.get(record.schema_id), None))
            if told >= LOOKED_THROUGH and topics:
                break
    except Exception:
        if not topics:
            raise
    return list(topics.values())


def _topic(channel: Channel, schema: Schema | None, count: int | None) -> Topic:
    name = schema.name if schema is not None else ""
    definition = schema.data.decode("utf-8", "replace") if schema is not None else ""
    if channel.message_encoding in {"ros1", "cdr"} and name.count("/") == 1:
        name = name.replace("/", "/msg/")
    return Topic(channel.topic, name, channel.message_encoding, count, definition)
