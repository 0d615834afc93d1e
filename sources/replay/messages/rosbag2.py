"""ROS 2 bags: folders with metadata.yaml, lone db3 files, split and zstd-compressed ones, by rosbags."""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from rosbags.rosbag2 import Reader

from pipeline.errors import InputError
from sources.replay.messages.container import Container, Message, Topic, damage_refused, magic, until_damaged
from sources.replay.messages.db3_file import Db3File
from sources.replay.messages.mcap_file import McapFile, is_mcap
from sources.replay.names import natural_path
from sources.replay.notices import Notices

SQLITE = b"SQLite format 3\0"
PART = re.compile(r"(.+)_[0-9]+\.(db3|mcap)")
METADATA = "metadata.yaml"


def is_db3(path: Path) -> bool:
    return path.suffix == ".db3" and magic(path).startswith(SQLITE)


def is_folder(path: Path) -> bool:
    return path.is_dir() and bool(_has_metadata(path) or _parts(path))


def _has_metadata(path: Path) -> bool:
    metadata = path / METADATA
    with suppress(OSError, UnicodeDecodeError):
        return metadata.is_file() and "rosbag2_bagfile_information" in metadata.read_text(encoding="utf-8")[:1000]
    return False


def _parts(path: Path) -> list[Path]:
    """The files NAME_0.db3, NAME_1.db3 ... of a folder, if they are of one recording."""
    with damage_refused(path):
        found = {file: match for file in path.iterdir() if (match := PART.fullmatch(file.name)) is not None}
    one = len({match.groups() for match in found.values()}) == 1
    return sorted((file for file in found if is_db3(file) or is_mcap(file)), key=natural_path) if one else []


def open_folder(path: Path, notices: Notices) -> Container:
    """A bag's folder, by its metadata; by its files where that is missing or cannot be used. Raises InputError."""
    parts = _parts(path)
    if _has_metadata(path):
        try:
            return Rosbag2(path, notices)
        except InputError as error:
            parts = parts or sorted((one for one in path.iterdir() if is_db3(one) or is_mcap(one)), key=natural_path)
            if not parts:
                raise
            notices.warning(f"{error}: {', '.join(part.name for part in parts)}: read without metadata.yaml")
    return Split(path, [open_file(part, notices) for part in parts])


def open_file(path: Path, notices: Notices) -> Container:
    if is_mcap(path):
        return McapFile(path, notices)
    try:
        return Rosbag2(path, notices)
    except InputError as refused:
        with suppress(InputError):
            return Db3File(path, notices)
        raise refused from None


class Rosbag2:
    """A folder with metadata.yaml, or one db3 file. Raises InputError where nothing of it can be read."""

    def __init__(self, path: Path, notices: Notices) -> None:
        self.where = path
        self._notices = notices
        with damage_refused(path), Reader(path) as reader:
            self._topics = [
                Topic(one.topic, one.msgtype, "cdr", one.msgcount, str(one.msgdef.data)) for one in reader.connections
            ]

    @property
    def topics(self) -> Sequence[Topic]:
        return self._topics

    def messages(self, topic: str, from_ns: int | None = None) -> Generator[Message, None, None]:
        yield from until_damaged(self.where, self._notices, partial(self._read, topic, from_ns))

    def _read(self, topic: str, from_ns: int | None) -> Iterator[Message]:
        with Reader(self.where) as reader:
            chosen = [one for one in reader.connections if one.topic == topic]
            for _, logged_ns, data in reader.messages(chosen, start=from_ns):
                yield Message(logged_ns, None, data)


class Split:
    """Containers that follow one another in time."""

    def __init__(self, where: Path, parts: Sequence[Container]) -> None:
        self.where = where
        self._parts = parts

    @property
    def topics(self) -> Sequence[Topic]:
        found: dict[str, Topic] = {}
        for part in self._parts:
            for topic in part.topics:
                before = found.get(topic.name)
                counts = [one.count for one in (before, topic) if one is not None]
                total = None if None in counts else sum(count or 0 for count in counts)
                found[topic.name] = Topic(topic.name, topic.kind, topic.encoding, total, topic.definition)
        return list(found.values())

    def messages(self, topic: str, from_ns: int | None = None) -> Generator[Message, None, None]:
        for part in self._parts:
            if any(one.name == topic for one in part.topics):
                yield from part.messages(topic, from_ns)
