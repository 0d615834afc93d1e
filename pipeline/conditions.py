"""Makes events, with an onset and an end, of what lasts: pairs out of sync, and what is amiss with cameras."""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from pipeline.frame import NS_PER_MS, Rig
from pipeline.health.observer import Observation
from pipeline.notes import Note
from pipeline.steady import CONFIRM, Change, Steady, alike
from pipeline.verdict import Cause, Event, Reason, State, Verdict, ms
from pipeline.words import describe, drift_ppm

CAMERA_CONDITIONS = {
    Note.DARK: "sees nothing: its pictures are dark",
    Note.SATURATED: "is dazzled: half of its picture or more is clipped",
    Note.BLURRED: "has become blurred against its own past",
}
"""Conditions of a camera that are events of their own; being frozen or missing is told of its pairs."""


class Often(NamedTuple):
    """What happens to single frames and is an event once it has happened `times` within so many windows."""

    times: int
    windows: int
    words: str


HAPPENINGS = {
    Note.DROP: Often(3, 30, "keeps losing frames"),
    Note.RESTARTED: Often(1, 5, "was started anew, or its clock was set"),
}
"""They end when so many windows have passed without it."""

LASTING_WINDOWS = 5
"""Windows in a row with or without a condition that begin or end its event: a single black frame is no event."""


@dataclass(slots=True)
class _Counted:
    """One condition of a camera: windows in a row that differ from what its event says, and since when."""

    windows: int = 0
    since_ns: int = 0


class Conditions:
    """Opens an event when a pair is out of sync to stay and closes it when it is in sync again.

    `unknown` does neither, but that a missing camera is back ends that event, whatever its frames can tell.

    Another cause, or an offset that has jumped, ends an event and begins the next.

    wall_ns: the time of day in nanoseconds since 1970. confirm: verdicts in a row that make a change.
    """

    def __init__(self, rig: Rig, wall_ns: Callable[[], int], *, confirm: int = CONFIRM) -> None:
        self._rig = rig.name
        self._expected_ns = {pair.name: pair.expected_offset_ns for pair in rig.pairs}
        self._wall_ns = wall_ns
        self._run = uuid.uuid4().hex[:8]
        self._count = 0
        self._steady = {pair.name: Steady(confirm) for pair in rig.pairs}
        self._open: dict[tuple[str, str], Event] = {}
        self._told: dict[str, Verdict] = {}
        self._counted: dict[tuple[str, str], _Counted] = {}
        self._lately: dict[tuple[str, str], deque[bool]] = {}

    @property
    def open(self) -> Sequence[Event]:
        """The events that have begun and not ended."""
        return list(self._open.values())

    def add(self, verdict: Verdict) -> list[Event]:
        """Takes a verdict; returns the events that begin or end with it."""
        key = ("async", verdict.pair)
        if key in self._open and verdict.state is State.ASYNC:
            self._open[key] = replace(self._open[key], worst=self._worse(self._open[key].worst, verdict))
        change = self._steady[verdict.pair].add(verdict, self._wall_ns())
        if verdict.state is State.UNKNOWN:
            return self._back(key, verdict)
        self._counted.pop(key, None)
        if change is None:
            return []
        ended = self._changed_end(key, change) if key in self._open else []
        begun = [self._onset(change)] if change.state is State.ASYNC and key not in self._open else []
        return [*ended, *begun]

    def observe(self, seen: Observation) -> list[Event]:
        """Takes what is known of the health of the cameras; returns the events that begin or end with it."""
        events = []
        for camera, lasting in seen.lasting.items():
            for note, words in CAMERA_CONDITIONS.items():
                key = (note.value, camera)
                counted = self._counted.setdefault(key, _Counted())
                if (note in lasting) == (key in self._open):
                    counted.windows = 0
                    continue
                if not counted.windows:
                    counted.since_ns = self._wall_ns()
                counted.windows += 1
                if counted.windows >= LASTING_WINDOWS:
                    counted.windows = 0
                    text = f"{camera} {words}"
                    events.append(self._flip(key, text, counted.since_ns, camera=camera))
        for camera, notes in seen.moment.items():
            events += self._happened(camera, notes)
        return events

    def _happened(self, camera: str, notes: Sequence[Note]) -> list[Event]:
        """Takes the notes of a camera's next frame."""
        events = []
        for note, often in HAPPENINGS.items():
            key = (note.value, camera)
            lately = self._lately.setdefault(key, deque(maxlen=often.windows))
            lately.append(note in notes)
            if (key in self._open and not any(lately)) or (key not in self._open and sum(lately) >= often.times):
                events.append(self._flip(key, f"{camera} {often.words}", self._wall_ns(), camera=camera))
        return events

    def tell(self, kind: str, pair: str, phase: str, worst: Mapping[str, float | None], text: str) -> Event | None:
        """An event of a pair whose onset and end something else has found; None for an end without onset."""
        key = (kind, pair)
        if (phase == "onset") == (key in self._open):
            return None
        event = self._flip(key, text, self._wall_ns(), pair=pair, camera=pair.rpartition("-")[2])
        event = replace(event, worst=worst or event.worst)
        if phase == "onset":
            self._open[key] = event
        return event

    def finish(self) -> list[Event]:
        """Closes what is open when the run ends."""
        now_ns = self._wall_ns()
        return [self._end(key, now_ns, f"to the end: {event.text}") for key, event in list(self._open.items())]

    def _flip(
        self, key: tuple[str, str], text: str, since_ns: int, *, pair: str | None = None, camera: str | None = None
    ) -> Event:
        """Ends the event if it is open, else begins it."""
        if key in self._open:
            return self._end(key, since_ns, f"{key[1]}: {key[0].replace('_', ' ')} no more")
        return self._begin(key, text, since_ns, pair=pair, camera=camera)

    def _begin(
        self,
        key: tuple[str, str],
        text: str,
        since_ns: int,
        *,
        pair: str | None,
        camera: str | None,
        cause: Cause | None = None,
        worst: Mapping[str, float | None] | None = None,
    ) -> Event:
        self._count += 1
        event = Event(
            rig=self._rig,
            id=f"{self._run}-{self._count}",
            kind=key[0],
            phase="onset",
            pair=pair,
            camera=camera,
            cause=cause,
            since_ns=since_ns,
            until_ns=None,
            worst=worst or {},
            text=text,
        )
        self._open[key] = event
        return event

    def _onset(self, change: Change) -> Event:
        verdict = self._told[change.last.pair] = change.last
        worst: Mapping[str, float | None] = {}
        for said in change.verdicts:
            worst = self._worse(worst, said)
        since = "" if change.since_frame is None else f" since frame {change.since_frame}"
        return self._begin(
            ("async", verdict.pair),
            f"{describe(verdict)}{since}",
            change.since_ns,
            pair=verdict.pair,
            camera=verdict.camera or verdict.pair.rpartition("-")[2],
            cause=verdict.cause,
            worst=worst,
        )

    def _worse(self, worst: Mapping[str, float | None], verdict: Verdict) -> Mapping[str, float | None]:
        """With the offset that is further from what is expected of the pair, and the drift if that is the cause."""
        expected_ms = self._expected_ns[verdict.pair] / NS_PER_MS
        known = [value for value in (worst.get("offset_ms"), ms(verdict.offset_ns)) if value is not None]
        offset_ms = max(known, key=lambda value: abs(value - expected_ms), default=None)
        drift = {"drift_ppm": drift_ppm(verdict)} if verdict.cause is Cause.FREE_RUN else {}
        return {**worst, "offset_ms": offset_ms, **drift}

    def _changed_end(self, key: tuple[str, str], change: Change) -> list[Event]:
        if change.state is State.SYNC:
            since = "" if change.since_frame is None else f" from frame {change.since_frame}"
            return [self._end(key, change.since_ns, f"{key[1]} in sync again{since}")]
        if alike(self._told[key[1]], change.last):
            return []
        return [self._end(key, change.since_ns, f"{key[1]} is out of sync in another way from now on")]

    def _back(self, key: tuple[str, str], verdict: Verdict) -> list[Event]:
        """The end of what a missing camera was told for, once its frames come, though nothing can be told of them."""
        event = self._open.get(key)
        if event is None or event.cause is not Cause.MISSING or verdict.reason is Reason.UNPAIRED:
            self._counted.pop(key, None)
            return []
        counted = self._counted.setdefault(key, _Counted(since_ns=self._wall_ns()))
        counted.windows += 1
        if counted.windows < LASTING_WINDOWS:
            return []
        del self._counted[key]
        return [self._end(key, counted.since_ns, f"{event.camera} delivers again")]

    def _end(self, key: tuple[str, str], now_ns: int, text: str) -> Event:
        return replace(self._open.pop(key), phase="end", until_ns=now_ns, text=text)
