"""Merges the streams of a recording into one, in the order in which a rig would have delivered them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass

from pipeline.frame import NS_PER_S
from sources.replay.streams import Entry, Stream

DISORDER_NS, DISORDER_PERIODS = NS_PER_S, 10
"""Stamps that go back by less than both are of frames that were stored out of order; by more, a clock was set."""

LONGEST_GAP_NS = 24 * 3600 * NS_PER_S
"""No recording pauses for longer: a clock was set."""


@dataclass(slots=True)
class _Lane:
    """One stream: its next entry, or None once it has ended, and where its first and latest entries stand.

    at_ns: when the next entry is due. Time goes on where stamps say that a clock was set, so that all streams are still
    read side by side.
    """

    stream: Stream
    entries: Generator[Entry, None, None]
    head: Entry | None = None
    at_ns: int = 0
    first: int = 0
    last: int = 0
    _set_by_ns: int = 0
    _begun: bool = False

    def advance(self) -> None:
        self.head = next(self.entries, None)
        if self.head is None:
            return
        at_ns, period_ns = self.stream.at_ns(self.head) + self._set_by_ns, self.stream.period_ns
        step_ns = at_ns - self.at_ns
        disorder_ns = max(DISORDER_NS, DISORDER_PERIODS * period_ns)
        if self._begun and not -disorder_ns <= step_ns <= max(LONGEST_GAP_NS, DISORDER_PERIODS * period_ns):
            self._set_by_ns += period_ns - step_ns
            at_ns = self.at_ns + period_ns
        self.at_ns, self._begun = at_ns, True

    def place(self) -> int:
        """Where the next entry stands in the recording, comparable over its streams."""
        assert self.head is not None
        return self.head.group if self.head.group is not None and self.head.at_ns is None else self.at_ns


class Merge:
    """One pass over all streams.

    unmatched: counts frames by (camera, the camera that was not running then). ended: streams read to their end.
    """

    def __init__(self, streams: Sequence[Stream]) -> None:
        self._streams = streams
        self.unmatched: Counter[tuple[str, str]] = Counter()
        self.ended: set[str] = set()

    def entries(self) -> Generator[tuple[Stream, Entry, int], None, None]:
        """Every entry of every stream by group, else time, and when it is due in ns; equal ones in the streams' order.

        An entry's picture is loaded before the next entry is asked for: a video has no other moment for it.
        """
        with ExitStack() as stack:
            lanes = [_Lane(stream, stack.enter_context(closing(stream.entries()))) for stream in self._streams]
            for lane in lanes:
                lane.advance()
                if lane.head is not None:
                    lane.first = lane.last = lane.place()
            while waiting := [lane for lane in lanes if lane.head is not None]:
                lane = min(waiting, key=_Lane.place)
                assert lane.head is not None
                lane.last = max(lane.last, lane.place())
                self._compare(lane, lanes)
                yield lane.stream, lane.head, lane.at_ns
                lane.advance()
                self.ended = {lane.stream.name for lane in lanes if lane.head is None}

    def said(self) -> str | None:
        """A sentence on frames for which another camera was not yet, or no longer, running."""
        parts = [
            f"{one} has {count} frame{'s' * (count > 1)} that {other} does not have"
            for (one, other), count in self.unmatched.items()
        ]
        return "; ".join(parts) + ": they have no partner" if parts else None

    def _compare(self, lane: _Lane, lanes: Sequence[_Lane]) -> None:
        for other in lanes:
            # Each camera against the first, and the first against each: what others lack of each other follows.
            if other is lane or lanes[0] not in (lane, other):
                continue
            grouped = lane.head is not None and lane.head.group is not None and lane.head.at_ns is None
            slack = 0 if grouped else other.stream.period_ns
            place = lane.place()
            if place < other.first - slack or (other.head is None and place > other.last + slack):
                self.unmatched[lane.stream.name, other.stream.name] += 1
