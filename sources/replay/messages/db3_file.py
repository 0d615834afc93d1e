"""A db3 file that rosbags refuses, cut off by a full disk say, row by row as far as its pages are there."""

from __future__ import annotations

import sqlite3
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from urllib.parse import quote

from sources.replay.messages.container import Message, Topic, damage_refused, until_damaged
from sources.replay.notices import Notices

ROWS = "SELECT timestamp, data FROM messages NOT INDEXED WHERE topic_id = ? AND timestamp >= ? ORDER BY id"


class Db3File:
    """A damaged db3 file, messages not compressed. Raises InputError where not even its topics can be read."""

    def __init__(self, path: Path, notices: Notices) -> None:
        self.where = path
        self._notices = notices
        with damage_refused(path), closing(_opened(path)) as database:
            rows = database.execute("SELECT id, name, type FROM topics").fetchall()
        self._ids = {str(name): int(number) for number, name, _ in rows}
        self._topics = [Topic(str(name), str(kind), "cdr") for _, name, kind in rows]

    @property
    def topics(self) -> Sequence[Topic]:
        return self._topics

    def messages(self, topic: str, from_ns: int | None = None) -> Generator[Message, None, None]:
        yield from until_damaged(self.where, self._notices, partial(self._read, topic, from_ns or 0))

    def _read(self, topic: str, from_ns: int) -> Iterator[Message]:
        with closing(_opened(self.where)) as database:
            for logged_ns, data in database.execute(ROWS, (self._ids[topic], from_ns)):
                yield Message(logged_ns, None, data)


def _opened(path: Path) -> sqlite3.Connection:
    """A connection that does not mind that pages are missing."""
    database = sqlite3.connect(f"file:{quote(str(path.absolute()))}?immutable=1", uri=True)
    database.execute("PRAGMA writable_schema=ON")  # or else SQLite refuses a file shorter than its head tells
    return database
