"""Turns the stream of verdicts into changes that last, and changes into events with an onset and an end."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace

from pipeline.verdict import Event, State, Verdict, ms

CONFIRM = 5
"""Verdicts in a row that make a change: a detector that errs on one frame in three does so five times in a row in less
than one case in a hundred, and at 30 fps a fault is still told within 0.2 s."""


@dataclass(frozen=True, slots=True)
class Change:
    """A state that has lasted: `first` is the verdict it began with, `before` the state that it replaced."""

    before: State | None
    state: State
    first: Verdict


class Steady:
    """The state of one pair without flicker: it changes when the same other state was said CONFIRM times in a row."""

    def __init__(self) -> None:
        self.state: State | None = None
        self._first: Verdict | None = None
        self._times = 0

    def add(self, verdict: Verdict) -> Change | None:
        """Takes the pair's next verdict; returns the change it confirms, if any."""
        if verdict.state is self.state:
            self._first = None
            return None
        if self._first is None or self._first.state is not verdict.state:
            self._first, self._times = verdict, 0
        self._times += 1
        if self._times < CONFIRM:
            return None
        change = Change(self.state, verdict.state, self._first)
        self.state, self._first = verdict.state, None
        return change


class Conditions:
    """Opens an event when a pair is out of sync to stay and closes it when it is in sync again; `unknown` does neither.

    wall_ns: the time of day in nanoseconds since 1970, for `since` and `until`.
    """

    def __init__(self, rig: str, wall_ns: Callable[[], int]) -> None:
        self._rig = rig
        self._wall_ns = wall_ns
        self._run = uuid.uuid4().hex[:4]
        self._count = 0
        self._steady: dict[str, Steady] = {}
        self._began_ns: dict[str, int] = {}
        self._open: dict[str, Event] = {}

    def add(self, verdict: Verdict) -> list[Event]:
        """Takes a verdict; returns the events that begin or end with it."""
        now_ns = self._wall_ns()
        steady = self._steady.setdefault(verdict.pair, Steady())
        if verdict.state is State.ASYNC:
            self._began_ns.setdefault(verdict.pair, now_ns)
        elif verdict.pair not in self._open:
            self._began_ns.pop(verdict.pair, None)
        self._follow(verdict)
        change = steady.add(verdict)
        if change is None:
            return []
        if change.state is State.ASYNC and verdict.pair not in self._open:
            return [self._onset(verdict, change)]
        if change.state is State.SYNC and verdict.pair in self._open:
            return [self._end(verdict.pair, now_ns, change.first.frame)]
        return []

    def finish(self) -> list[Event]:
        """Closes what is open when the run ends."""
        now_ns = self._wall_ns()
        return [self._end(pair, now_ns, None) for pair in list(self._open)]

    def _follow(self, verdict: Verdict) -> None:
        event = self._open.get(verdict.pair)
        if event and verdict.state is State.ASYNC and abs(verdict.offset_ns or 0) > abs(event.worst_offset_ns or 0):
            self._open[verdict.pair] = replace(event, worst_offset_ns=verdict.offset_ns)

    def _onset(self, verdict: Verdict, change: Change) -> Event:
        self._count += 1
        camera = verdict.pair.rpartition("-")[2]
        event = Event(
            rig=self._rig,
            id=f"{self._run}-{self._count}",
            kind="async",
            phase="onset",
            pair=verdict.pair,
            camera=camera,
            cause=verdict.cause,
            since_ns=self._began_ns[verdict.pair],
            until_ns=None,
            worst_offset_ns=verdict.offset_ns,
            text=f"{describe_offset(verdict)} since frame {change.first.frame}",
        )
        self._open[verdict.pair] = event
        return event

    def _end(self, pair: str, now_ns: int, frame: int | None) -> Event:
        event = self._open.pop(pair)
        self._began_ns.pop(pair, None)
        text = f"{pair} in sync again from frame {frame}" if frame is not None else f"{pair} was out of sync to the end"
        return replace(event, phase="end", until_ns=now_ns, text=text)


def describe_offset(verdict: Verdict) -> str:
    """For people: which camera is how much later or earlier than which."""
    first, _, second = verdict.pair.rpartition("-")
    offset = ms(verdict.offset_ns)
    if not offset:
        return f"{first} and {second} are out of sync"
    return f"{second} is {abs(offset):.1f} ms {'later' if offset > 0 else 'earlier'} than {first}"
