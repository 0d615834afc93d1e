"""Writes one JSON object a line: verdicts, and on request events and status."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Literal, TextIO

from pipeline.errors import InputError, RunError
from pipeline.settings import Settings
from pipeline.verdict import AlignedPair, Event, Report, Status, Verdict

KINDS: dict[str, type[Report]] = {
    "verdict": Verdict,
    "event": Event,
    "status": Status,
    "aligned": AlignedPair,
}


class JsonlSettings(Settings):
    """path: a file, or `-` for standard output. what: which messages are written."""

    type: Literal["jsonl"] = "jsonl"
    path: str
    what: tuple[Literal["verdict", "event", "status", "aligned"], ...] = ("verdict",)


class JsonlSink:
    """Appends nothing: the file is written anew, and each line is complete when it is there at all.

    base: the folder that a relative path counts from. Raises InputError where there is no folder to write in.
    """

    lossless = True

    def __init__(self, settings: JsonlSettings, *, base: Path) -> None:
        self._path = None if settings.path == "-" else base / settings.path
        if self._path is not None and not self._path.parent.is_dir():
            raise InputError(f"{self._path}: cannot be written: there is no folder {self._path.parent}")
        self._kinds = tuple(KINDS[kind] for kind in settings.what)
        self._file: TextIO = sys.stdout

    def start(self) -> None:
        """Opens the file. Raises InputError where it cannot be written."""
        if self._path is None:
            return
        try:
            self._file = self._path.open("w", encoding="utf-8")
        except OSError as error:
            raise InputError(f"{self._path}: cannot be written: {error.strerror}") from error

    def take(self, report: Report) -> None:
        if not isinstance(report, self._kinds):
            return
        try:
            self._file.write(json.dumps(report.to_message(), allow_nan=False) + "\n")
            self._file.flush()
        except BrokenPipeError as error:
            raise RunError("the reader of standard output has gone away") from error
        except OSError as error:
            raise RunError(
                f"{self._path or 'standard output'}: cannot be written any more: {error.strerror}"
            ) from error

    def stop(self) -> None:
        if self._path is not None:
            self._file.close()
