"""Turns the stream of verdicts into changes that last, and changes into events with an onset and an end."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace

from pipeline.frame import Rig
from pipeline.verdict import Event, State, Verdict, ms

CONFIRM = 5
"""Verdicts in a row that make a change: a detector that errs on one frame in three does so five times in a row in less
than one case in a hundred, and at 30 fps a fault is still told within 0.2 s."""


@dataclass(frozen=True, slots=True)
class Change:
    """A state that has lasted: the verdicts that confirmed it, and the time of day of the first of them."""

    state: State
    verdicts: tuple[Verdict, ...]
    since_ns: int

    @property
    def first(self) -> Verdict:
        return self.verdicts[0]


class Steady:
    """The state of one pair without flicker: it changes when the same other state was said CONFIRM times in a row.

    A frame that cannot be judged speaks neither for nor against a change: it is passed over, unless so many follow each
    other that not being able to tell is itself what lasts.
    """

    def __init__(self) -> None:
        self.state: State | None = None
        self._candidates: list[Verdict] = []
        self._since_ns = 0
        self._unknowns: list[Verdict] = []
        self._unknown_since_ns = 0

    def add(self, verdict: Verdict, now_ns: int = 0) -> Change | None:
        """Takes the pair's next verdict, said at `now_ns`; returns the change it confirms, if any."""
        if verdict.state is State.UNKNOWN:
            return self._cannot_tell(verdict, now_ns)
        self._unknowns.clear()
        if self._candidates and self._candidates[0].state is not verdict.state:
            self._candidates.clear()
        if verdict.state is self.state:
            return None
        if not self._candidates:
            self._since_ns = now_ns
        self._candidates.append(verdict)
        if len(self._candidates) < CONFIRM:
            return None
        return self._change(self._candidates, self._since_ns)

    def _cannot_tell(self, verdict: Verdict, now_ns: int) -> Change | None:
        if not self._unknowns:
            self._unknown_since_ns = now_ns
        if len(self._unknowns) < CONFIRM:
            self._unknowns.append(verdict)
        if len(self._unknowns) < CONFIRM:
            return None
        self._candidates.clear()
        if self.state is State.UNKNOWN:
            return None
        return self._change(self._unknowns, self._unknown_since_ns)

    def _change(self, verdicts: list[Verdict], since_ns: int) -> Change:
        change = Change(verdicts[0].state, tuple(verdicts), since_ns)
        self.state = change.state
        verdicts.clear()
        return change


class Conditions:
    """Opens an event when a pair is out of sync to stay and closes it when it is in sync again; `unknown` does neither.

    wall_ns: the time of day in nanoseconds since 1970, for `since` and `until`.
    """

    def __init__(self, rig: Rig, wall_ns: Callable[[], int]) -> None:
        self._rig = rig.name
        self._expected_ns = {pair.name: pair.expected_offset_ns for pair in rig.pairs}
        self._wall_ns = wall_ns
        self._run = uuid.uuid4().hex[:4]
        self._count = 0
        self._steady: dict[str, Steady] = {}
        self._open: dict[str, Event] = {}

    def add(self, verdict: Verdict) -> list[Event]:
        """Takes a verdict; returns the events that begin or end with it."""
        if verdict.pair in self._open and verdict.state is State.ASYNC:
            event = self._open[verdict.pair]
            worst_ns = self._worse(verdict.pair, event.worst_offset_ns, verdict.offset_ns)
            self._open[verdict.pair] = replace(event, worst_offset_ns=worst_ns)
        change = self._steady.setdefault(verdict.pair, Steady()).add(verdict, self._wall_ns())
        if change is None:
            return []
        if change.state is State.ASYNC and verdict.pair not in self._open:
            return [self._onset(change)]
        if change.state is State.SYNC and verdict.pair in self._open:
            return [self._end(verdict.pair, change.since_ns, change.first.frame)]
        return []

    def finish(self) -> list[Event]:
        """Closes what is open when the run ends."""
        now_ns = self._wall_ns()
        return [self._end(pair, now_ns, None) for pair in list(self._open)]

    def _onset(self, change: Change) -> Event:
        self._count += 1
        verdict = change.verdicts[-1]
        worst_ns: int | None = None
        for said in change.verdicts:
            worst_ns = self._worse(verdict.pair, worst_ns, said.offset_ns)
        event = Event(
            rig=self._rig,
            id=f"{self._run}-{self._count}",
            kind="async",
            phase="onset",
            pair=verdict.pair,
            camera=verdict.pair.rpartition("-")[2],
            cause=verdict.cause,
            since_ns=change.since_ns,
            until_ns=None,
            worst_offset_ns=worst_ns,
            text=f"{describe_offset(verdict)} since frame {change.first.frame}",
        )
        self._open[verdict.pair] = event
        return event

    def _worse(self, pair: str, one_ns: int | None, other_ns: int | None) -> int | None:
        """The offset that is further from what is expected of the pair."""
        known = [value for value in (one_ns, other_ns) if value is not None]
        return max(known, key=lambda value: abs(value - self._expected_ns[pair]), default=None)

    def _end(self, pair: str, now_ns: int, frame: int | None) -> Event:
        event = self._open.pop(pair)
        text = f"{pair} in sync again from frame {frame}" if frame is not None else f"{pair} was out of sync to the end"
        return replace(event, phase="end", until_ns=now_ns, text=text)


def describe_offset(verdict: Verdict) -> str:
    """For people: which camera is how much later or earlier than which."""
    first, _, second = verdict.pair.rpartition("-")
    offset = ms(verdict.offset_ns)
    if not offset:
        return f"{first} and {second} are out of sync"
    return f"{second} is {abs(offset):.1f} ms {'later' if offset > 0 else 'earlier'} than {first}"
