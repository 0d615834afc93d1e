"""Keeps the last events in a file, across restarts of the monitor."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from pipeline.errors import InputError, RunError
from pipeline.event_log import EventLog
from pipeline.settings import Settings
from pipeline.verdict import Event, Report


class EventsSettings(Settings):
    """path: the file; left out, `<rig>.events.jsonl` beside the configuration. keep: events that are there at least."""

    type: Literal["events"] = "events"
    path: str | None = None
    keep: int = Field(default=1000, ge=1, le=1_000_000)

    def file(self, base: Path, rig: str) -> Path:
        """base: the folder that a relative path counts from."""
        return base / (self.path or f"{rig}.events.jsonl")


class EventsSink:
    """Appends every event to a log that `syncwatch events` lists, and that late subscribers get over Zenoh.

    Raises InputError where the file cannot be written.
    """

    lossless = True

    def __init__(self, settings: EventsSettings, *, base: Path, rig: str) -> None:
        self._path = settings.file(base, rig)
        if not self._path.parent.is_dir():
            raise InputError(f"{self._path}: cannot be written: there is no folder {self._path.parent}")
        self._log = EventLog(self._path, settings.keep)

    def start(self) -> None:
        try:
            self._log.open()
        except OSError as error:
            raise InputError(f"{self._path}: cannot be written: {error.strerror}") from error

    def take(self, report: Report) -> None:
        if not isinstance(report, Event):
            return
        try:
            self._log.append(report.to_message())
        except OSError as error:
            raise RunError(f"{self._path}: cannot be written any more: {error.strerror}") from error

    def stop(self) -> None:
        self._log.close()
