"""Counts verdicts and, where the truth is known, what was found and what was a false alarm."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from pipeline.steady import CONFIRM, Steady
from pipeline.verdict import State, Verdict


@dataclass(slots=True)
class Injected:
    """A stretch during which a pair was out of sync on purpose; `found` is the frames it took to say so."""

    frames: int = 0
    in_a_row: int = 0
    found: int | None = None


@dataclass(slots=True)
class PairTally:
    """What was said of one pair, and how that compares with the truth where it is known.

    longest_async: frames of the longest stretch out of sync, one frame in ten forgiven.
    false_alarms: lasting changes to async while the pair was in sync.
    wrong: decided frames, each by itself, that contradict the truth.
    """

    states: Counter[State] = field(default_factory=Counter)
    truth_known: bool = False
    truth_assumed: bool = False
    injected: list[Injected] = field(default_factory=list)
    false_alarms: int = 0
    wrong: int = 0
    longest_async: int = 0
    _steady: Steady = field(default_factory=Steady)
    _current: Injected | None = None
    _streak: int = 0
    _slack: int = 0

    @property
    def total(self) -> int:
        return self.states.total()

    @property
    def decided(self) -> int:
        return self.total - self.states[State.UNKNOWN]

    def add(self, verdict: Verdict) -> None:
        self.states[verdict.state] += 1
        self._follow_streak(verdict.state)
        change = self._steady.add(verdict)
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
            stretch.found = stretch.frames

    def _follow_streak(self, state: State) -> None:
        if state is State.ASYNC:
            self._streak += 1
            self.longest_async = max(self.longest_async, self._streak)
        elif state is State.SYNC:
            self._slack += 10
        if self._slack > self._streak:
            self._streak = self._slack = 0


class Tally:
    """Counts by pair, in order of appearance."""

    def __init__(self) -> None:
        self.pairs: dict[str, PairTally] = {}

    def add(self, verdict: Verdict) -> None:
        self.pairs.setdefault(verdict.pair, PairTally()).add(verdict)
