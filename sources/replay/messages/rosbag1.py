"""ROS 1 bags: by rosbags where they are indexed, chunk by chunk where the recorder was killed."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from functools import partial
from io import SEEK_CUR, BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

from rosbags.rosbag1 import Reader, ReaderError
from rosbags.rosbag1.reader import Header, RecordType, decompressors, normalize, read_bytes, read_uint32
from rosbags.typesys.msg import normalize_msgtype

from pipeline.errors import InputError
from sources.replay.messages.container import Message, Topic, damage_refused, magic, until_damaged
from sources.replay.notices import Notices

MAGIC = b"#ROSBAG V2.0"


def is_bag(path: Path) -> bool:
    return magic(path).startswith(b"#ROSBAG")


class Rosbag1:
    """One bag file. Raises InputError where it is encrypted, of another version, or nothing of it can be read."""

    def __init__(self, path: Path, notices: Notices) -> None:
        self.where = path
        self._notices = notices
        if not magic(path).startswith(MAGIC):
            raise InputError(f"{path}: a bag of another version: expected version 2.0; convert it with rosbag")
        self._indexed = True
        try:
            with Reader(path) as reader:
                self._topics = [
                    Topic(one.topic, one.msgtype, "ros1", one.msgcount, str(one.msgdef.data))
                    for one in reader.connections
                ]
        except (ReaderError, AssertionError, ValueError):
            self._indexed = False
            with damage_refused(path):
                self._topics = _announced(path)
            notices.warning(f"{path}: not indexed, as after a recorder that was killed: read from the start")

    @property
    def topics(self) -> Sequence[Topic]:
        return self._topics

    def messages(self, topic: str, from_ns: int | None = None) -> Generator[Message, None, None]:
        read = partial(_indexed, self.where, topic, from_ns) if self._indexed else partial(_scanned, self.where, topic)
        yield from until_damaged(self.where, self._notices, read)


def _indexed(path: Path, topic: str, from_ns: int | None) -> Iterator[Message]:
    with Reader(path) as reader:
        chosen = [one for one in reader.connections if one.topic == topic]
        for _, logged_ns, data in reader.messages(chosen, start=from_ns):
            yield Message(logged_ns, None, data)


class _Record(NamedTuple):
    header: Header
    kind: int
    data: bytes


def _scanned(path: Path, topic: str) -> Iterator[Message]:
    names: dict[int, str] = {}
    for record in _records(path):
        number = record.header.get_uint32("conn")
        if record.kind == RecordType.CONNECTION:
            names[number] = normalize(record.header.get_string("topic"))
        elif names.get(number) == topic:
            yield Message(record.header.get_time("time"), None, record.data)


def _announced(path: Path) -> list[Topic]:
    topics: dict[str, Topic] = {}
    try:
        for record in _records(path):
            if record.kind == RecordType.CONNECTION:
                name = normalize(record.header.get_string("topic"))
                topics.setdefault(name, _topic(name, record.data))
    except (ReaderError, ValueError, EOFError, OSError):
        if not topics:
            raise
    return list(topics.values())


def _topic(name: str, connection: bytes) -> Topic:
    fields = _fields(connection)
    return Topic(name, normalize_msgtype(fields.get("type", "")), "ros1", None, fields.get("message_definition", ""))


def _fields(data: bytes) -> Mapping[str, str]:
    header = Header.read(BytesIO(len(data).to_bytes(4, "little") + data))
    return {key: header.get_string(key) for key in ("type", "message_definition") if key in header}


def _records(path: Path) -> Iterator[_Record]:
    """Connections and messages as they lie in the chunks (ROS bag format 2.0)."""
    with path.open("rb") as file:
        file.readline()
        while file.peek(1):
            header = Header.read(file)
            kind = header.get_uint8("op")
            size = read_uint32(file)
            if kind != RecordType.CHUNK:
                file.seek(size, SEEK_CUR)
                continue
            unpack = decompressors[header.get_string("compression")]
            yield from _inside(BytesIO(unpack(read_bytes(file, size))), header.get_uint32("size"))


def _inside(chunk: BinaryIO, size: int) -> Iterator[_Record]:
    while chunk.tell() < size:
        header = Header.read(chunk)
        yield _Record(header, header.get_uint8("op"), read_bytes(chunk, read_uint32(chunk)))
