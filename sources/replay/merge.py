"""Merges the streams of a recording into one, in the order in which a rig would have delivered them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass

from sources.replay.streams import Entry, Stream


@dataclass(slots=True)
class _Lane:
    """One stream: its next entry, or None once it has ended, and where its first and latest entries stand."""

    stream: Stream
    entries: Generator[Entry, None, None]
    head: Entry | None = None
    first: int = 0
    last: int = 0

    def advance(self) -> None:
        self.head = next(self.entries, None)

    def place(self) -> int:
        assert self.head is not None
        return self.stream.place(self.head)


class Merge:
    """One pass over all streams.

    unmatched: counts frames by (camera, the camera that was not running then). ended: streams read to their end.
    """

    def __init__(self, streams: Sequence[Stream]) -> None:
        self._streams = streams
        self.unmatched: Counter[tuple[str, str]] = Counter()
        self.ended: set[str] = set()

    def entries(self) -> Generator[tuple[Stream, Entry], None, None]:
        """Every entry of every stream by group, else time; equal ones in the order of the streams.

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
                yield lane.stream, lane.head
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
