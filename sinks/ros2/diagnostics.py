"""A rig's status as the statuses of a diagnostic_msgs/msg/DiagnosticArray."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from pipeline.notes import Note
from pipeline.verdict import CameraStatus, Level, PairStatus, State, Status

BROKEN = frozenset({Note.MISSING.value, Note.FROZEN.value})
"""Conditions of a camera that put its pairs out of sync."""


class DiagnosticLevel(IntEnum):
    """As diagnostic_msgs/msg/DiagnosticStatus numbers them."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


LEVELS = {
    Level.OK: DiagnosticLevel.OK,
    Level.WARN: DiagnosticLevel.WARN,
    Level.ERROR: DiagnosticLevel.ERROR,
    Level.STALE: DiagnosticLevel.STALE,
}


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One status; values in order."""

    level: DiagnosticLevel
    name: str
    message: str
    hardware_id: str
    values: tuple[tuple[str, str], ...]


def diagnostics(status: Status) -> list[Diagnostic]:
    """One of the rig, then one a pair and one a camera, under the names that aggregators group by.

    Being unable to tell is no fault of a pair, as it is none of a rig unless `judge.unknown_is` says so. Of a rig
    without frames everything is stale.
    """
    told = status.to_message()
    stale = status.level is Level.STALE
    rig = Diagnostic(
        level=LEVELS[status.level],
        name=f"syncwatch: {status.rig}",
        message="; ".join(status.reasons) or status.level.value,
        hardware_id=status.rig,
        values=tuple(_values(told["monitor"])),
    )
    parts = [
        *((name, *_pair(pair), told["pairs"][name]) for name, pair in status.pairs.items()),
        *((name, *_camera(camera), told["cameras"][name]) for name, camera in status.cameras.items()),
    ]
    return [
        rig,
        *(
            Diagnostic(
                level=DiagnosticLevel.STALE if stale else level,
                name=f"syncwatch: {status.rig}/{name}",
                message=message,
                hardware_id=status.rig,
                values=tuple(_values(values)),
            )
            for name, level, message, values in parts
        ),
    ]


def _pair(pair: PairStatus) -> tuple[DiagnosticLevel, str]:
    if pair.state is State.ASYNC:
        return DiagnosticLevel.ERROR, f"out of sync ({pair.cause.value})" if pair.cause else "out of sync"
    return DiagnosticLevel.OK, "in sync" if pair.state is State.SYNC else "cannot tell"


def _camera(camera: CameraStatus) -> tuple[DiagnosticLevel, str]:
    if not camera.conditions:
        return DiagnosticLevel.OK, "ok"
    broken = not BROKEN.isdisjoint(camera.conditions)
    return DiagnosticLevel.ERROR if broken else DiagnosticLevel.WARN, ", ".join(camera.conditions)


def _values(told: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Members as text, those of objects with the object's name before theirs; what is unknown or empty is left out."""
    for name, value in told.items():
        if isinstance(value, Mapping):
            yield from _values(value, f"{prefix}{name}.")
        elif isinstance(value, bool):
            yield f"{prefix}{name}", str(value).lower()
        elif isinstance(value, list | tuple):
            if value:
                yield f"{prefix}{name}", ", ".join(map(str, value))
        elif value is not None:
            yield f"{prefix}{name}", str(value)
