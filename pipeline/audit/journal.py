"""The file that an audit writes to as it goes on, and begins with when it is started again."""

from __future__ import annotations

import fcntl
import json
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from pydantic import ValidationError

from pipeline.errors import InputError, RunError
from pipeline.messages import AuditShape

log = logging.getLogger("syncwatch.audit")

NAME = "audit.jsonl"


class Journal:
    """One line a recording, each written as a whole. `records` holds the last line of each, by path."""

    def __init__(self, file: TextIO, records: dict[str, AuditShape]) -> None:
        self.records = records
        self.superseded = False
        self._file = file

    def add(self, record: AuditShape) -> None:
        """Raises RunError when it cannot be written."""
        self.superseded |= record.path in self.records
        self.records[record.path] = record
        try:
            self._file.write(line_of(record))
            self._file.flush()
        except OSError as error:
            raise RunError(f"{self._file.name}: cannot be written: {error.strerror}") from None


def line_of(record: AuditShape) -> str:
    return json.dumps(record.model_dump(mode="json", by_alias=True), allow_nan=False) + "\n"


def check_folder(folder: Path) -> None:
    """Raises InputError for what cannot become a journal's folder, before anything has been done for it."""
    there = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        raise InputError(f"-o {folder}: {there} is a file: name a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"-o {folder}: cannot be written: permission denied")


@contextmanager
def journal(folder: Path) -> Iterator[Journal]:
    """The journal of a folder, which is made where there is none, and is nobody else's meanwhile.

    A last line that was not written to its end is dropped; a line that is replaced by a later one is, at the end.
    Raises InputError for a folder that cannot be written to, or in use.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        locked = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise InputError(f"-o {folder}: cannot be used as a folder: {error.strerror}") from None
    try:
        try:
            with _unlockable_tolerated():
                fcntl.flock(locked, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"-o {folder}: another audit is writing there: name another folder") from None
        yield from _open(folder / NAME)
    finally:
        os.close(locked)


@contextmanager
def _unlockable_tolerated() -> Iterator[None]:
    """Some network file systems know no locks."""
    try:
        yield
    except BlockingIOError:
        raise
    except OSError as error:
        log.debug("cannot be locked", exc_info=error)


def _open(path: Path) -> Iterator[Journal]:
    records, whole = _read(path)
    try:
        file = path.open("a", encoding="utf-8")
        file.truncate(whole)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    made = Journal(file, records)
    try:
        with file:
            yield made
    finally:
        if made.superseded:
            _replace(path, made)


def _read(path: Path) -> tuple[dict[str, AuditShape], int]:
    """The records of a file and how many of its bytes are whole lines."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return {}, 0
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    whole = content.rfind(b"\n") + 1
    records: dict[str, AuditShape] = {}
    for number, line in enumerate(content[:whole].splitlines(), 1):
        try:
            record = AuditShape.model_validate_json(line)
        except ValidationError:
            log.warning("%s:%d: not a line of an audit: it is passed over", path, number)
            continue
        records[record.path] = record
    return records, whole


def _replace(path: Path, made: Journal) -> None:
    """Writes the file anew, without lines that were replaced."""
    beside = path.with_suffix(".new")
    try:
        beside.write_text("".join(map(line_of, made.records.values())), encoding="utf-8")
        beside.replace(path)
    except OSError as error:  # the last line of a recording counts, so nothing is lost
        log.warning("%s: lines that were replaced could not be dropped: %s", path, error.strerror)
