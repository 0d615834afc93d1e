"""Cuts what is said of a pair into segments: good, bad and undecided ones, each with its frames and times."""

from __future__ import annotations

from array import array
from dataclasses import dataclass

from pipeline.frame import NS_PER_S, Pair
from pipeline.messages import SegmentShape
from pipeline.steady import PLAIN, Change, Steady
from pipeline.verdict import Cause, State, Verdict, ms


@dataclass(slots=True)
class _Open:
    """A segment that goes on."""

    first_frame: int
    state: State
    cause: Cause | None = None
    sum_ns: int = 0
    offsets: int = 0

    def add(self, verdict: Verdict) -> None:
        if verdict.state is self.state and verdict.offset_ns is not None:
            self.sum_ns += verdict.offset_ns
            self.offsets += 1

    @property
    def offset_ms(self) -> float | None:
        return ms(round(self.sum_ns / self.offsets)) if self.offsets else None


class Segments:
    """The segments of one pair, made as its verdicts come.

    A segment begins with a change that lasts: at the frame since when it has been so, but after those that could not be
    judged, and after those for which a camera was frozen or missing: that is known of each of them. Together they cover
    every frame.
    """

    def __init__(self, pair: Pair, fps: float) -> None:
        self._pair = pair
        self._period_s = 1 / fps
        self._steady = Steady()
        self._at_s = array("d")
        self._began_ns: int | None = None
        self._done: list[SegmentShape] = []
        self._open = _Open(0, State.UNKNOWN)

    @property
    def frames(self) -> int:
        """Frames of the pair's first camera so far."""
        return len(self._at_s)

    @property
    def duration_s(self) -> float:
        return self._at_s[-1] + self._period_s if self._at_s else 0.0

    def add(self, verdict: Verdict) -> None:
        if verdict.frame is not None:
            self._note(verdict.frame, verdict.captured_ns.get(self._pair.first))
        change = self._steady.add(verdict)
        if change is None:
            self._open.add(verdict)
        else:
            self._begin(change)

    def all(self) -> list[SegmentShape]:
        """Every segment, the last one up to the last frame."""
        return [*self._done, self._closed(self.frames)] if self.frames else []

    def _note(self, frame: int, captured_ns: int | None) -> None:
        """Remembers when a frame was taken. Time never runs backwards, whatever a camera's clock does."""
        last_s = self._at_s[-1] if self._at_s else 0.0
        at_s = last_s
        if captured_ns is not None:
            if self._began_ns is None:
                self._began_ns = captured_ns - round(frame * self._period_s * NS_PER_S)
            at_s = max(last_s, (captured_ns - self._began_ns) / NS_PER_S)
        self._at_s.extend([at_s] * (frame + 1 - len(self._at_s)))

    def _begin(self, change: Change) -> None:
        certain = self._open.state is State.UNKNOWN or self._open.cause in PLAIN
        since = change.first.frame if certain else change.since_frame
        since = self.frames - 1 if since is None else since
        since = min(max(since, self._open.first_frame), max(self.frames - 1, 0))
        if since > self._open.first_frame:
            self._done.append(self._closed(since))
        self._open = _Open(since, change.state, change.first.cause)
        for verdict in change.verdicts:
            self._open.add(verdict)

    def _closed(self, end: int) -> SegmentShape:
        """The open segment up to, but not with, the frame `end`."""
        one = self._open
        stop_s = self._at_s[end] if end < self.frames else self.duration_s
        return SegmentShape(
            pair=self._pair.name,
            start_s=round(self._at_s[one.first_frame], 6),
            stop_s=round(stop_s, 6),
            first_frame=one.first_frame,
            last_frame=end - 1,
            state=one.state,
            cause=one.cause,
            offset_ms=one.offset_ms,
        )
