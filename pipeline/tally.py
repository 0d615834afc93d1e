"""Counts verdicts and, where the truth is known, what was found and what was a false alarm."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from pipeline.conditions import Steady
from pipeline.verdict import State, Verdict


@dataclass(slots=True)
class Injected:
    """A stretch during which a pair was out of sync on purpose; `found` is the frames it took to say so."""

    faults: tuple[str, ...]
    start: int
    frames: int = 0
    found: int | None = None


@dataclass(slots=True)
class PairTally:
    """What was said of one pair. `longest_async` counts frames in a row, one wrong frame in ten forgiven."""

    states: Counter[State] = field(default_factory=Counter)
    truth_known: bool = False
    injected: list[Injected] = field(default_factory=list)
    false_alarms: int = 0
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
        self._follow_truth(verdict)
        change = self._steady.add(verdict)
        if change is None or change.state is not State.ASYNC or verdict.truth is None:
            return
        if self._current is None:
            self.false_alarms += 1
        elif self._current.found is None:
            self._current.found = self._current.frames

    def _follow_truth(self, verdict: Verdict) -> None:
        if verdict.truth is None:
            return
        self.truth_known = True
        if verdict.truth.state is not State.ASYNC:
            self._current = None
            return
        if self._current is None:
            self._current = Injected(verdict.truth.faults, verdict.frame or 0)
            self.injected.append(self._current)
        self._current.frames += 1
        if self._steady.state is State.ASYNC and self._current.found is None and verdict.state is State.ASYNC:
            self._current.found = self._current.frames

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
