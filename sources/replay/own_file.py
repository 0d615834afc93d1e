"""Reads an MCAP file of ours in one direction and in constant memory, as far as it is whole."""

from __future__ import annotations

import struct
from collections import OrderedDict
from collections.abc import Collection, Generator, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeAlias

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema, Statistics
from mcap.stream_reader import breakup_chunk

from sources.replay.files import unreadable
from sources.replay.notices import Notices

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")
FOOTER_BYTES = RECORD_HEAD.size + 20

CHUNKS_KEPT = 3
"""Chunks that are kept unpacked: the streams of a recording are read side by side, each by itself."""

MOST_UNPACKED_BYTES = 1 << 30

HEAD_OPCODES = frozenset({Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA})

DAMAGED = (ValueError, RuntimeError, struct.error, EOFError, McapError, zstandard.ZstdError)
"""What the libraries raise over bytes that are not what they should be."""

Place: TypeAlias = tuple[int, int, int]
"""Opcode, offset and length of the content of a record."""


class Logged(NamedTuple):
    """A message with the topic and the schema of its channel."""

    topic: str
    schema: str
    message: Message


def metadata_of(path: Path, name: str) -> Mapping[str, str] | None:
    """The metadata record `name` that stands before all data, if the file is an MCAP file that has it."""
    try:
        with path.open("rb") as stream:
            for opcode, offset, length in _places(stream):
                if opcode not in HEAD_OPCODES:
                    return None
                if opcode == Opcode.METADATA:
                    record = Metadata.read(_stream(_content(stream, offset, length)))
                    if record.name == name:
                        return dict(record.metadata)
    except (OSError, *DAMAGED):
        return None
    return None


class OwnFile:
    """An MCAP file. Several readers may run through `messages`, one after the other or side by side in one thread.

    Raises InputError where the file cannot be read.
    """

    def __init__(self, path: Path, notices: Notices) -> None:
        self.path = path
        self._notices = notices
        self._unpacked: OrderedDict[int, list[McapRecord]] = OrderedDict()
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, str] = {}

    def counts(self) -> Mapping[str, int] | None:
        """How many messages there are of each topic; None for a file that was not finished."""
        try:
            with self.path.open("rb") as stream:
                return _summarised(stream)
        except OSError as error:
            raise unreadable(self.path, error) from error
        except DAMAGED:
            return None

    def messages(self, topics: Collection[str]) -> Generator[Logged, None, None]:
        """The messages of `topics` in the order of the file, up to the last whole record."""
        try:
            with self.path.open("rb") as stream:
                for opcode, offset, length in _places(stream):
                    for record in self._records(stream, opcode, offset, length):
                        if isinstance(record, Schema):
                            self._schemas[record.id] = record.name
                        elif isinstance(record, Channel):
                            self._channels[record.id] = record
                        elif isinstance(record, Message):
                            channel = self._channels.get(record.channel_id)
                            if channel is not None and channel.topic in topics:
                                yield Logged(channel.topic, self._schemas.get(channel.schema_id, ""), record)
        except OSError as error:
            raise unreadable(self.path, error) from error

    def _records(self, stream: BinaryIO, opcode: int, offset: int, length: int) -> list[McapRecord]:
        if opcode not in {Opcode.CHUNK, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE}:
            return []
        if offset in self._unpacked:
            return self._unpacked[offset]
        try:
            records = _unpacked(opcode, _content(stream, offset, length))
        except DAMAGED:
            self._notices.warning(f"{self.path}: damaged at byte {offset}: what is stored there is left out")
            records = []
        if opcode == Opcode.CHUNK:
            self._unpacked[offset] = records
            if len(self._unpacked) > CHUNKS_KEPT:
                self._unpacked.popitem(last=False)
        return records


def _places(stream: BinaryIO) -> Iterator[Place]:
    """The records of a file, up to the end of its data or the first one that is cut off."""
    end = stream.seek(0, 2)
    stream.seek(0)
    if stream.read(len(MAGIC)) != MAGIC:
        return
    at = len(MAGIC)
    while at + RECORD_HEAD.size <= end:
        stream.seek(at)
        opcode, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
        at += RECORD_HEAD.size
        # Opcode 0 is what the tail of a file is full of after a power failure.
        if opcode in {0, Opcode.DATA_END, Opcode.FOOTER} or at + length > end:
            return
        yield opcode, at, length
        at += length


def _content(stream: BinaryIO, offset: int, length: int) -> bytes:
    stream.seek(offset)
    return stream.read(length)


def _stream(data: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(data))


def _unpacked(opcode: int, data: bytes) -> list[McapRecord]:
    """Raises one of DAMAGED."""
    if opcode == Opcode.SCHEMA:
        return [Schema.read(_stream(data))]
    if opcode == Opcode.CHANNEL:
        return [Channel.read(_stream(data))]
    if opcode == Opcode.MESSAGE:
        return [Message.read(_stream(data), len(data))]
    chunk = Chunk.read(_stream(data))
    if chunk.uncompressed_size > MOST_UNPACKED_BYTES:
        raise ValueError("a chunk larger than any recording has")
    return breakup_chunk(chunk, validate_crc=True)


def _summarised(stream: BinaryIO) -> Mapping[str, int] | None:
    """Message counts by topic from the summary at the end. Raises one of DAMAGED."""
    end = stream.seek(0, 2) - len(MAGIC)
    if end < FOOTER_BYTES + len(MAGIC) or _content(stream, end, len(MAGIC)) != MAGIC:
        return None
    footer = Footer.read(_stream(_content(stream, end - FOOTER_BYTES + RECORD_HEAD.size, FOOTER_BYTES)))
    topics: dict[int, str] = {}
    at = footer.summary_start
    while 0 < at < end:
        stream.seek(at)
        opcode, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
        data = stream.read(length)
        if opcode == Opcode.CHANNEL:
            channel = Channel.read(_stream(data))
            topics[channel.id] = channel.topic
        if opcode == Opcode.STATISTICS:
            counted = Statistics.read(_stream(data)).channel_message_counts
            return {topics[channel]: count for channel, count in counted.items() if channel in topics}
        at += RECORD_HEAD.size + length
    return {}
