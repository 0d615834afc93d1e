"""Lets counters and stamps go on rising while a recording is replayed again and again."""

from __future__ import annotations

from dataclasses import dataclass, field

from sources.replay.streams import Entry, Stream

STEPS = 2
"""From the last frame of a round to the first of the next: one more than usual, so that they are not neighbours."""


@dataclass(slots=True)
class _Extent:
    low: int
    high: int

    def take(self, value: int) -> None:
        self.low, self.high = min(self.low, value), max(self.high, value)


@dataclass(slots=True)
class Round:
    """One pass over a recording: what is added to its numbers, and how far they reached.

    The same is added for all cameras, so that what is equal, or off by a constant, stays so.
    """

    shift_sequence: int = 0
    shift_group: int = 0
    shift_ns: int = 0
    shift_epoch: int = 0
    _extents: dict[str, _Extent] = field(default_factory=dict)

    @property
    def is_empty(self) -> bool:
        return not self._extents

    def saw(self, stream: Stream, entry: Entry, at_ns: int) -> None:
        self._take("sequence", entry.sequence or 0)
        self._take("group", entry.group or 0)
        self._take("ns", entry.captured_ns - stream.origin_ns)
        self._take("ns", at_ns)
        self._take("epoch", entry.told.epoch)

    def following(self, period_ns: int) -> Round:
        return Round(
            self.shift_sequence + self._length("sequence") + STEPS,
            self.shift_group + self._length("group") + STEPS,
            self.shift_ns + self._length("ns") + STEPS * period_ns,
            self.shift_epoch + self._length("epoch"),
        )

    def _take(self, what: str, value: int) -> None:
        self._extents.setdefault(what, _Extent(value, value)).take(value)

    def _length(self, what: str) -> int:
        return self._extents[what].high - self._extents[what].low
