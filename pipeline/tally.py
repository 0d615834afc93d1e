"""Counts verdicts and, where the truth is known, what was found and what was a false alarm."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from pipeline.steady import CONFIRM, Change, Steady, alike
from pipeline.verdict import Basis, Reason, Report, State, Verdict

ENOUGH = 10
"""Frames that must agree before anything is said of a recording: fewer are an anecdote."""

MOST_STRETCHES = 100
"""Stretches out of sync that are remembered: more than anyone reads."""


@dataclass(slots=True)
class Injected:
    """A stretch during which a pair was out of sync on purpose; `found` is the frames until it was said, to stay so."""

    frames: int = 0
    in_a_row: int = 0
    found: int | None = None


@dataclass(slots=True)
class Stretch:
    """A stretch during which a pair was said to be out of sync in one way. offset_ns: the mean of what was told."""

    first: Verdict
    last_frame: int | None
    frames: int = 0
    _sum_ns: int = 0
    _offsets: int = 0

    def add(self, verdict: Verdict) -> None:
        self.frames += 1
        self.last_frame = verdict.frame if verdict.frame is not None else self.last_frame
        if verdict.offset_ns is not None:
            self._sum_ns += verdict.offset_ns
            self._offsets += 1

    def end_before(self, frame: int | None) -> None:
        if frame is not None and self.last_frame is not None:
            self.last_frame = min(self.last_frame, frame - 1)

    @property
    def offset_ns(self) -> int | None:
        return round(self._sum_ns / self._offsets) if self._offsets else None


@dataclass(slots=True)
class PairTally:
    """What was said of one pair, and how that compares with the truth where it is known.

    reasons: why nothing could be said, by frames. stretches: how it was out of sync, the first MOST_STRETCHES.
    false_alarms: lasting changes to async while the pair was in sync.
    wrong: decided frames, each by itself, that contradict the truth.
    by_stamps: decided frames for which timestamps alone spoke. silent: verdicts on no frame, as long as the first
    camera delivers nothing.
    """

    states: Counter[State] = field(default_factory=Counter)
    reasons: Counter[Reason] = field(default_factory=Counter)
    stretches: list[Stretch] = field(default_factory=list)
    truth_known: bool = False
    truth_assumed: bool = False
    injected: list[Injected] = field(default_factory=list)
    false_alarms: int = 0
    wrong: int = 0
    by_stamps: int = 0
    silent: int = 0
    _steady: Steady = field(default_factory=Steady)
    _current: Injected | None = None
    _stretch: Stretch | None = None
    _streak: int = 0
    _slack: int = 0
    _lasted: int = 0

    @property
    def total(self) -> int:
        return self.states.total()

    @property
    def decided(self) -> int:
        return self.total - self.states[State.UNKNOWN]

    @property
    def main_reason(self) -> Reason | None:
        """Why most of the frames that could not be judged could not."""
        return self.reasons.most_common(1)[0][0] if self.reasons else None

    @property
    def never_came(self) -> bool:
        """Whether the first camera has delivered nothing at all."""
        return 0 < self.silent == self.total

    @property
    def lasting_async(self) -> int:
        """Frames of stretches out of sync that last for ENOUGH frames, one frame in ten forgiven."""
        return self._lasted + (self._streak if self._streak >= ENOUGH else 0)

    def add(self, verdict: Verdict) -> None:
        self.states[verdict.state] += 1
        if verdict.reason is not None:
            self.reasons[verdict.reason] += 1
        self.by_stamps += verdict.state is not State.UNKNOWN and verdict.basis is Basis.TIMESTAMPS
        self.silent += verdict.frame is None
        self._follow_streak(verdict.state)
        change = self._steady.add(verdict)
        self._follow_stretch(change, verdict)
        truth = verdict.truth
        if truth is None:
            return
        self.truth_known, self.truth_assumed = True, truth.assumed
        self.wrong += verdict.state not in {truth.state, State.UNKNOWN}
        if truth.state is State.ASYNC:
            self._follow_injected(verdict.state)
            return
        self._current = None
        self.false_alarms += change is not None and change.state is State.ASYNC

    def merge(self, other: PairTally) -> None:
        """Takes over the counts of another part of the recording; nothing that lasts goes on from one to the other."""
        self.states += other.states
        self.reasons += other.reasons
        self.stretches += other.stretches[: MOST_STRETCHES - len(self.stretches)]
        self.truth_known |= other.truth_known
        self.truth_assumed |= other.truth_assumed
        self.injected += other.injected
        self.false_alarms += other.false_alarms
        self.wrong += other.wrong
        self.by_stamps += other.by_stamps
        self.silent += other.silent
        self._lasted += other.lasting_async

    def _follow_stretch(self, change: Change | None, verdict: Verdict) -> None:
        if change is not None and change.state is State.ASYNC:
            if self._stretch is not None:
                self._stretch.end_before(change.first.frame)
            self._stretch = Stretch(change.first, change.first.frame)
            if len(self.stretches) < MOST_STRETCHES:
                self.stretches.append(self._stretch)
            for said in change.verdicts:
                self._stretch.add(said)
        elif change is not None and change.state is State.SYNC:
            self._stretch = None
        elif self._stretch is not None and alike(self._stretch.first, verdict):
            self._stretch.add(verdict)

    def _follow_injected(self, state: State) -> None:
        if self._current is None:
            self._current = Injected()
            self.injected.append(self._current)
        stretch = self._current
        stretch.frames += 1
        if state is State.SYNC:
            stretch.in_a_row = 0
        stretch.in_a_row += state is State.ASYNC
        if stretch.in_a_row == CONFIRM and stretch.found is None:
            stretch.found = stretch.frames - CONFIRM

    def _follow_streak(self, state: State) -> None:
        if state is State.ASYNC:
            self._streak += 1
        elif state is State.SYNC:
            self._slack += 10
        if self._slack > self._streak:
            self._lasted = self.lasting_async
            self._streak = self._slack = 0


class Tally:
    """Counts by pair, in order of appearance."""

    def __init__(self) -> None:
        self.pairs: dict[str, PairTally] = {}

    def add(self, verdict: Verdict) -> None:
        self.pairs.setdefault(verdict.pair, PairTally()).add(verdict)

    def take(self, report: Report) -> None:
        """Adds a verdict; other reports say nothing that is counted."""
        if isinstance(report, Verdict):
            self.add(report)

    def merge(self, other: Tally) -> None:
        """Adds what was counted of another part of the same recording."""
        for name, pair in other.pairs.items():
            self.pairs.setdefault(name, PairTally()).merge(pair)
