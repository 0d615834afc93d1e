"""Events in a file: one message a line, the last ones kept, in two files that take turns."""

from __future__ import annotations

import errno
import json
import logging
import os
import stat
from collections import deque
from io import FileIO
from pathlib import Path
from typing import TextIO

from pipeline.errors import InputError
from pipeline.terms import EVENT_SCHEMA, Message

log = logging.getLogger("syncwatch.events")

LONGEST_LINE = 64 * 1024
"""Characters; an event has about 400. What is longer was not written here."""


class EventLog:
    """Appends; when `keep` lines are in the file it becomes `<path>.1` in place of the one before.

    So between `keep` and twice as many events are there. Each is on disk when `append` returns. One writer a file.
    """

    def __init__(self, path: Path, keep: int) -> None:
        self._path = path
        self._keep = keep
        self._lines = 0
        self._file: FileIO | None = None

    def open(self) -> None:
        """Goes on with the file that is there, also after a power cut in the middle of a line. Raises OSError."""
        torn = False
        if self._path.is_file():
            with self._path.open("rb") as file:
                for block in iter(lambda: file.read(LONGEST_LINE), b""):
                    self._lines += block.count(b"\n")
                    torn = not block.endswith(b"\n")
        self._open()
        if torn:
            self._write(b"\n")

    def append(self, event: Message) -> None:
        """Raises OSError."""
        if self._lines >= self._keep:
            self._rotate()
        self._write(json.dumps(event, allow_nan=False).encode() + b"\n")
        self._lines += 1

    def close(self) -> None:
        if self._file is not None:
            self._file.close()

    def _rotate(self) -> None:
        self.close()
        self._path.replace(older(self._path))
        self._lines = 0
        self._open()

    def _open(self) -> None:
        self._file = self._path.open("ab", buffering=0)

    def _write(self, line: bytes) -> None:
        """Without a buffer, so that nothing is left to be written when a disk is full and the file is closed."""
        assert self._file is not None
        if self._file.write(line) < len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if stat.S_ISREG(os.fstat(self._file.fileno()).st_mode):
            os.fsync(self._file.fileno())


def older(path: Path) -> Path:
    """Where the events before those of `path` are."""
    return path.with_name(f"{path.name}.1")


def read_events(path: Path, last: int) -> list[Message]:
    """The last events of a log, or of any file of JSON lines among others; oldest first, none where there is no file.

    Lines that are no messages are left out and counted in a warning. Raises InputError where a file cannot be read.
    """
    kept: deque[Message] = deque(maxlen=last)
    for file in (older(path), path):
        if file.exists() and not file.is_file():
            raise InputError(f"{file}: cannot be read: it is not a file")
        try:
            with file.open(encoding="utf-8", errors="replace") as lines:
                _read(file, lines, kept)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise InputError(f"{file}: cannot be read: {error.strerror}") from error
    return list(kept)


def _read(path: Path, lines: TextIO, kept: deque[Message]) -> None:
    broken = 0
    while line := lines.readline(LONGEST_LINE):
        try:
            message = json.loads(line)
        except ValueError:
            broken += bool(line.strip())
            continue
        if isinstance(message, dict) and message.get("schema") == EVENT_SCHEMA:
            kept.append(message)
    if broken:
        log.warning("%s: %d lines that are no messages were left out", path, broken)
