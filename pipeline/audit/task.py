"""What an audit has to judge, and what it says of it."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from pipeline.assemble import version
from pipeline.errors import InputError
from pipeline.messages import AuditShape
from pipeline.plan import Plan
from pipeline.terms import State
from sources.replay.files import VIDEO_SUFFIXES

SCHEMA = "syncwatch.audit.v1"
FINGERPRINT_DIGITS = 16
VIDEO_EFFORT = 10

MakePlan: TypeAlias = Callable[[str], Plan]
"""The plan of the recording at a path; raises InputError. Travels to other processes."""

EMPTY: dict[str, Any] = {
    "cameras": [],
    "frames": 0,
    "duration_s": 0.0,
    "state": State.UNKNOWN,
    "cause": None,
    "reason": None,
    "offset_ms": None,
    "coverage": 0.0,
    "pairs": {},
    "segments": [],
    "answer": None,
    "error": None,
    "warnings": [],
    "took_s": 0.0,
}
"""What is said where nothing is known."""


@dataclass(frozen=True, slots=True)
class Task:
    """A recording to be judged, or what looks like one and cannot be.

    path: absolute, or a URL. settings: fingerprint of how it is judged. effort: what it takes, in bytes of pictures.
    """

    path: str
    format: str | None
    fingerprint: str
    settings: str
    effort: int
    trouble: str | None = None

    def record(self, **said: Any) -> AuditShape:
        """What the audit says of it; what is not given is not known."""
        return AuditShape(
            **{
                **EMPTY,
                "schema": SCHEMA,
                "path": self.path,
                "format": self.format,
                "error": self.trouble,
                "version": version(),
                "fingerprint": self.fingerprint,
                "settings": self.settings,
                **said,
            }
        )

    def is_told_by(self, record: AuditShape) -> bool:
        """Whether the record is of the same files, judged in the same way, and as a recording if this is one."""
        same = (self.fingerprint, self.settings) == (record.fingerprint, record.settings)
        return same and self.format in {record.format, None}


def fingerprint(facts: Iterable[object]) -> str:
    """Equal for equal facts, whatever their order."""
    text = "\n".join(sorted(json.dumps(fact, default=str, sort_keys=True) for fact in facts))
    return hashlib.sha256(text.encode()).hexdigest()[:FINGERPRINT_DIGITS]


def file_facts(path: Path, skip: Collection[str] = ()) -> Iterator[tuple[str, int, int]]:
    """Name, size in bytes and time of change in ns of a file, or of all files below a folder, hidden ones left out."""
    waiting, met = [path], set(skip)
    while waiting:
        place = waiting.pop()
        real = os.path.realpath(place)
        if real in met:
            continue
        met.add(real)
        try:
            if place.is_dir():
                waiting += [one for one in place.iterdir() if not one.name.startswith(".")]
            else:
                told = place.stat()
                yield str(place.relative_to(path)), told.st_size, told.st_mtime_ns
        except OSError:  # what cannot be looked at cannot be read either, and that is said when it is judged
            continue


def effort(sizes: Iterable[tuple[str, int]]) -> int:
    """Of files by name and size in bytes: videos hold more pictures a byte."""
    return sum(size * (VIDEO_EFFORT if name.lower().endswith(VIDEO_SUFFIXES) else 1) for name, size in sizes)


def settings_fingerprint(make_plan: MakePlan) -> str:
    """Of the configuration that all recordings are judged with. Raises InputError for one that no audit can use."""
    anything = "recording"
    plan = make_plan(anything)
    settings = plan.source.settings
    if getattr(settings, "path", None) != anything:
        raise InputError("--set source: an audit judges what is found at PATH: give its other settings alone")
    if getattr(settings, "loop", False):
        raise InputError("--set source.loop=true: an audit would never end")
    if plan.sinks:
        raise InputError(f"--set sinks.{next(iter(plan.sinks))}: an audit writes to -o DIR alone")
    document = {key: value for key, value in plan.document.data.items() if key != "rig"}
    return fingerprint([document])
