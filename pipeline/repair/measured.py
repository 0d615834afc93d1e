"""What judging a recording tells of how to repair it: how far frames are moved, and what stamps are off."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from statistics import median

from pipeline.frame import Pair, Rig
from pipeline.verdict import AlignedPair, Basis, Report, Verdict

SMOOTHED = 15
"""Neighbours on either side over which the error of stamps is smoothed by their median: half a second at 30 fps."""


@dataclass(slots=True)
class Stretch:
    """Frames of the first camera, from `start` on, whose partners are moved by `shift` frames.

    numbers, errors_ns: where it was measured what the second camera's stamps are off, and by how much.
    """

    start: int
    shift: int
    epoch: int
    numbers: list[int] = field(default_factory=list)
    errors_ns: list[int] = field(default_factory=list)

    def error_ns(self, number: int) -> int:
        """The median error near frame `number`; there is at least one."""
        near = bisect_left(self.numbers, number)
        low = max(0, min(near, len(self.numbers) - 1) - SMOOTHED)
        return round(median(self.errors_ns[low : near + SMOOTHED + 1]))


@dataclass(slots=True)
class PairRepair:
    """How one pair is repaired. residuals_ns: what was left between frames that were put together."""

    pair: Pair
    stretches: list[Stretch] = field(default_factory=list)
    residuals_ns: list[int] = field(default_factory=list)
    _since: int | None = None
    _seen_from: int | None = None

    def shift(self, number: int) -> int:
        """By how many frames the partner of the first camera's frame `number` is moved."""
        stretch = self._at(number)
        return 0 if stretch is None else stretch.shift

    def error_ns(self, number: int) -> int | None:
        """What is to be taken off the stamp of that partner; None where nothing near tells."""
        stretch = self._at(number)
        if stretch is None:
            return None
        alike = [other for other in self.stretches if other.epoch == stretch.epoch and other.numbers]
        if stretch.numbers:
            return stretch.error_ns(number)
        nearest = min(alike, key=lambda other: abs(other.start - stretch.start), default=None)
        return None if nearest is None else nearest.error_ns(number)

    def take_verdict(self, verdict: Verdict) -> None:
        if verdict.since_frame is not None:
            self._since = verdict.since_frame
        if verdict.basis is Basis.TIMESTAMPS:
            self._seen_from = None
        elif verdict.basis is Basis.CONTENT and self._seen_from is None:
            self._seen_from = verdict.frame

    def take_pair(self, aligned: AlignedPair) -> None:
        if aligned.first is None:
            return
        first, second = aligned.frames
        latest = self.stretches[-1] if self.stretches else None
        if latest is None or (latest.shift, latest.epoch) != (aligned.shift_frames, second.epoch):
            moved = latest is not None and latest.shift != aligned.shift_frames
            start = self._onset(aligned.first) if moved else aligned.first
            latest = self._begin(Stretch(start, aligned.shift_frames, second.epoch))
        if aligned.residual_ns is None:
            return
        self.residuals_ns.append(aligned.residual_ns)
        # Stamps cannot tell what is wrong with stamps: only offsets seen in pictures can.
        if self._seen_from is not None and aligned.first - max(0, aligned.shift_frames) >= self._seen_from:
            apart_ns = second.captured_ns - first.captured_ns
            latest.numbers.append(aligned.first)
            latest.errors_ns.append(apart_ns - aligned.residual_ns - self.pair.expected_offset_ns)

    def _onset(self, number: int) -> int:
        """Since when frames are apart as they are found to be now: by the judge's account, frames ago."""
        return number if self._since is None else min(self._since, number)

    def _begin(self, stretch: Stretch) -> Stretch:
        """Adds a stretch; what was measured before the change was noticed, but after it came, is forgotten."""
        while self.stretches and self.stretches[-1].start >= stretch.start:
            self.stretches.pop()
        for before in self.stretches[-1:]:
            kept = bisect_left(before.numbers, stretch.start)
            del before.numbers[kept:], before.errors_ns[kept:]
        self.stretches.append(stretch)
        return stretch

    def _at(self, number: int) -> Stretch | None:
        place = bisect_right(self.stretches, number, key=lambda stretch: stretch.start)
        return self.stretches[max(0, place - 1)] if self.stretches else None


class Measured:
    """Listens to a run that judges and aligns."""

    def __init__(self, rig: Rig) -> None:
        self.pairs = {pair.name: PairRepair(pair) for pair in rig.pairs}

    def take(self, report: Report) -> None:
        if isinstance(report, Verdict):
            self.pairs[report.pair].take_verdict(report)
        elif isinstance(report, AlignedPair):
            self.pairs[report.pair].take_pair(report)

    @property
    def is_known(self) -> bool:
        """Whether anything could be measured at all."""
        return any(pair.residuals_ns for pair in self.pairs.values())
