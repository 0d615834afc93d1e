"""MCAP files of others as containers of messages by topic: with an index, without one, and truncated."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from pathlib import Path

from mcap.records import Channel, Schema

from pipeline.errors import InputError
from sources.replay.mcap_reader import McapReader
from sources.replay.messages.container import Message, Topic, magic
from sources.replay.notices import Notices

MAGIC = b"\x89MCAP"


def is_mcap(path: Path) -> bool:
    return magic(path).startswith(MAGIC)


class McapFile:
    """One MCAP file. Raises InputError where nothing of it can be read."""

    def __init__(self, path: Path, notices: Notices) -> None:
        self.where = path
        self._file = McapReader(path, notices)
        counts = self._file.counts()
        announced = {channel.topic: channel for channel in self._file.announced()}
        if not announced:
            raise InputError(f"{path}: damaged or no recording: there is no topic in it")
        self._topics = [
            _topic(channel, self._file.schemas.get(channel.schema_id), None if counts is None else counts[name])
            for name, channel in announced.items()
        ]

    @property
    def topics(self) -> Sequence[Topic]:
        return self._topics

    def messages(self, topic: str, from_ns: int | None = None) -> Generator[Message, None, None]:
        for logged in self._file.messages({topic}, from_ns):
            message = logged.message
            yield Message(message.log_time, message.sequence, message.data)


def _topic(channel: Channel, schema: Schema | None, count: int | None) -> Topic:
    name = schema.name if schema is not None else ""
    definition = schema.data.decode("utf-8", "replace") if schema is not None else ""
    if channel.message_encoding in {"ros1", "cdr"} and name.count("/") == 1:
        name = name.replace("/", "/msg/")
    return Topic(channel.topic, name, channel.message_encoding, count, definition)
