"""Reads MCAP files in one direction and in constant memory, as far as they are whole."""

from __future__ import annotations

import struct
from bisect import bisect_left
from collections import OrderedDict
from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeAlias

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Footer, McapRecord, Message, Metadata, Schema, Statistics
from mcap.stream_reader import breakup_chunk

from sources.replay.files import unreadable
from sources.replay.notices import Notices

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")
FOOTER_BYTES = RECORD_HEAD.size + 20
CHUNK_TIMES = struct.Struct("<QQ")

CHUNKS_KEPT = 3
"""Chunks that are kept unpacked: the streams of a recording are read side by side, each by itself."""

MOST_UNPACKED_BYTES = 1 << 30

LOOKED_THROUGH_BYTES = 1 << 28
"""How much of a file without a summary is searched for topics: recorders announce all of them early."""

DAMAGE_TOLD = 5
"""Damaged places that are named, one by one."""

LAST_OPCODE, FIRST_PRIVATE_OPCODE = 0x0F, 0x80
HEAD_OPCODES = frozenset({Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA})
DATA_OPCODES = frozenset({Opcode.CHUNK, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE})

DAMAGED = (ValueError, RuntimeError, struct.error, EOFError, McapError, zstandard.ZstdError)
"""What the libraries raise over bytes that are not what they should be."""

Place: TypeAlias = tuple[int, int, int]
"""Opcode, offset and length of the content of a record."""


class Logged(NamedTuple):
    """A message with its topic, and the schema of its channel where it has one."""

    topic: str
    schema: Schema | None
    message: Message


@dataclass(slots=True)
class _Summary:
    """What stands at the end of a file. chunks: where each begins. counts: messages by channel, None if not told."""

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    chunks: list[int] = field(default_factory=list)
    counts: Mapping[int, int] | None = None

    @property
    def names_all(self) -> bool:
        """Whether every channel is described that has messages."""
        return bool(self.channels) and set(self.counts or ()) <= set(self.channels)


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


class McapReader:
    """An MCAP file. Several readers may run through `messages`, one after the other or side by side in one thread.

    channels, schemas: by their ids, as far as they are known; the ones that come late are known when they are met.
    Every method raises InputError where the file cannot be read; what is damaged is left out, and that is said.
    """

    def __init__(self, path: Path, notices: Notices) -> None:
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self._notices = notices
        self._unpacked: OrderedDict[int, list[McapRecord]] = OrderedDict()
        self._damaged: set[int] = set()
        self._summary = self._read_summary()
        if self._summary is None:
            notices.warning(
                f"{path} has no end, as after a recorder that was killed: it is read up to its last whole piece"
            )
        else:
            self.channels |= self._summary.channels
            self.schemas |= self._summary.schemas
        self._knows_all = self._summary is not None and self._summary.names_all

    def counts(self) -> Mapping[str, int] | None:
        """How many messages there are of each topic; None where the file does not tell."""
        if self._summary is None or self._summary.counts is None or not self._knows_all:
            return None
        counts = dict.fromkeys((channel.topic for channel in self.channels.values()), 0)
        for number, count in self._summary.counts.items():
            counts[self.channels[number].topic] += count
        return counts

    def announced(self) -> Sequence[Channel]:
        """The channels of the file; where its end does not tell, those that its first pieces hold."""
        if not self._knows_all:
            end = LOOKED_THROUGH_BYTES
            for _, offset in self._records():
                if offset > end and self.channels:
                    break
        return list(self.channels.values())

    def messages(self, topics: Collection[str], from_ns: int | None = None) -> Generator[Logged, None, None]:
        """The messages of `topics` logged at `from_ns` or later, in the order of the file, up to the last whole one."""
        for record, _ in self._records(from_ns):
            if not isinstance(record, Message) or (from_ns is not None and record.log_time < from_ns):
                continue
            channel = self.channels.get(record.channel_id)
            if channel is not None and channel.topic in topics:
                yield Logged(channel.topic, self.schemas.get(channel.schema_id), record)

    def _read_summary(self) -> _Summary | None:
        try:
            with self.path.open("rb") as stream:
                return _summarised(stream)
        except OSError as error:
            raise unreadable(self.path, error) from error
        except DAMAGED:
            return None

    def _records(self, from_ns: int | None = None) -> Generator[tuple[McapRecord, int], None, None]:
        """Schemas and channels, which are noted, and messages, with the offsets of what they are stored in.

        Chunks that end before `from_ns` may be left out.
        """
        chunks = [] if self._summary is None else self._summary.chunks
        skip_until_ns = from_ns if self._knows_all else None
        try:
            with self.path.open("rb") as stream:
                for opcode, offset, length in self._whole(stream, chunks):
                    if opcode == Opcode.CHUNK and _ended_before(stream, offset, skip_until_ns):
                        continue
                    for record in self._unpack(stream, opcode, offset, length):
                        if isinstance(record, Schema):
                            self.schemas[record.id] = record
                        elif isinstance(record, Channel):
                            self.channels[record.id] = record
                        yield record, offset
        except OSError as error:
            raise unreadable(self.path, error) from error

    def _whole(self, stream: BinaryIO, chunks: Sequence[int]) -> Iterator[Place]:
        """The records that hold data. After one that makes no sense, reading goes on with the next chunk known of."""
        at, tried = 0, -1
        while True:
            for opcode, offset, length in _places(stream, at):
                at = offset + length
                if opcode in DATA_OPCODES:
                    yield opcode, offset, length
            following = bisect_left(chunks, max(at, tried + 1))
            if following == len(chunks):
                return
            self._say_damaged(at)
            at = tried = chunks[following]

    def _unpack(self, stream: BinaryIO, opcode: int, offset: int, length: int) -> list[McapRecord]:
        if offset in self._unpacked:
            return self._unpacked[offset]
        try:
            records = _unpacked(opcode, _content(stream, offset, length))
        except DAMAGED:
            self._say_damaged(offset)
            records = []
        if opcode == Opcode.CHUNK:
            self._unpacked[offset] = records
            if len(self._unpacked) > CHUNKS_KEPT:
                self._unpacked.popitem(last=False)
        return records

    def _say_damaged(self, offset: int) -> None:
        if len(self._damaged) <= DAMAGE_TOLD:
            self._damaged.add(offset)
        if len(self._damaged) > DAMAGE_TOLD:
            self._notices.warning(f"{self.path}: more of it is damaged: what is stored there is left out, too")
        else:
            self._notices.warning(f"{self.path}: damaged at byte {offset}: what is stored there is left out")


def _places(stream: BinaryIO, at: int = 0) -> Iterator[Place]:
    """The records of a file from `at` on, up to the end of its data or the first one that makes no sense."""
    end = stream.seek(0, 2)
    if at == 0:
        stream.seek(0)
        if stream.read(len(MAGIC)) != MAGIC:
            return
        at = len(MAGIC)
    while at + RECORD_HEAD.size <= end:
        stream.seek(at)
        opcode, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
        at += RECORD_HEAD.size
        # Opcode 0 is what the tail of a file is full of after a power failure.
        known = 0 < opcode <= LAST_OPCODE or opcode >= FIRST_PRIVATE_OPCODE
        if not known or opcode in {Opcode.DATA_END, Opcode.FOOTER} or at + length > end:
            return
        yield opcode, at, length
        at += length


def _content(stream: BinaryIO, offset: int, length: int) -> bytes:
    """Raises ValueError, one of DAMAGED, for what is longer than anything that can be unpacked."""
    if length > MOST_UNPACKED_BYTES:
        raise ValueError("a piece larger than any recording has")
    stream.seek(offset)
    return stream.read(length)


def _ended_before(stream: BinaryIO, offset: int, from_ns: int | None) -> bool:
    """Whether all messages of a chunk were logged before `from_ns`."""
    times = b"" if from_ns is None else _content(stream, offset, CHUNK_TIMES.size)
    return from_ns is not None and len(times) == CHUNK_TIMES.size and CHUNK_TIMES.unpack(times)[1] < from_ns


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


def _summarised(stream: BinaryIO) -> _Summary | None:
    """What the summary at the end tells; None for a file that was not finished. Raises one of DAMAGED."""
    end = stream.seek(0, 2) - len(MAGIC)
    if end < FOOTER_BYTES + len(MAGIC) or _content(stream, end, len(MAGIC)) != MAGIC:
        return None
    footer = Footer.read(_stream(_content(stream, end - FOOTER_BYTES + RECORD_HEAD.size, FOOTER_BYTES)))
    found = _Summary()
    at = footer.summary_start
    with suppress(*DAMAGED):  # then as much of it is known as was read
        while 0 < at < end:
            stream.seek(at)
            opcode, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
            _take(found, opcode, stream.read(min(length, end - at)))
            at += RECORD_HEAD.size + length
    found.chunks.sort()
    return found


def _take(found: _Summary, opcode: int, data: bytes) -> None:
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(_stream(data))
        found.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(_stream(data))
        found.channels[channel.id] = channel
    elif opcode == Opcode.CHUNK_INDEX:
        found.chunks.append(ChunkIndex.read(_stream(data)).chunk_start_offset)
    elif opcode == Opcode.STATISTICS:
        found.counts = Statistics.read(_stream(data)).channel_message_counts
