"""Puts the frames of a recording together anew, by what was measured."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import replace

from pipeline.align import slots_per_frame
from pipeline.frame import Frame, Rig, StampOrigin, Window
from pipeline.repair.measured import PairRepair


class Regrouper:
    """Windows in, groups of frames out: one frame of the first camera, and of others those that belong to it.

    Each frame is used once. Frames of a camera without partner are in no group, nor are those whose partner lies beyond
    a gap. restamp: stamps of the other cameras are put on the first one's clock by what the pictures say. left_out
    counts frames by camera, unstamped the frames whose stamps could not be corrected.
    """

    def __init__(self, rig: Rig, pairs: Mapping[str, PairRepair], *, restamp: bool) -> None:
        self._first = rig.pairs[0].first
        self._repairs = {pair.second: pairs[pair.name] for pair in rig.pairs}
        self._steps = {pair.second: slots_per_frame(pair, rig) for pair in rig.pairs}
        self._restamp = restamp
        moves = [
            -stretch.shift * self._steps[name] for name, repair in self._repairs.items() for stretch in repair.stretches
        ]
        self._ahead, self._behind = max([0, *moves]), -min([0, *moves])
        self._slots: deque[Window] = deque()
        self._next = 0
        self._used: dict[str, int] = {}
        self.groups = 0
        self.unstamped = 0
        self._seen: Counter[str] = Counter()
        self._written: Counter[str] = Counter()

    @property
    def left_out(self) -> dict[str, int]:
        return {name: self._seen[name] - self._written[name] for name in self._seen}

    def take(self, window: Window) -> Iterator[list[Frame]]:
        """Takes the next window; the groups that are complete now."""
        for name, triple in window.cameras.items():
            self._seen[name] += triple.current is not None
        if self._slots and all(triple.previous is None for triple in window.cameras.values()):
            yield from self.finish()
        self._slots.append(window)
        while self._next + self._ahead <= window.index:
            yield from self._group()
        while self._slots and self._slots[0].index < self._next - self._behind:
            self._slots.popleft()

    def finish(self) -> Iterator[list[Frame]]:
        """The groups that are left at the end of the stream, or before a gap."""
        while self._slots and self._next <= self._slots[-1].index:
            yield from self._group()
        self._slots.clear()

    def _group(self) -> Iterator[list[Frame]]:
        slot = self._slot(self._next)
        self._next += 1
        first = None if slot is None else slot.cameras[self._first]
        if slot is None or first is None or first.current is None or first.number is None:
            return
        partners = [
            partner
            for name in self._repairs
            if (partner := self._partner(name, slot.index, first.current, first.number)) is not None
        ]
        if not partners:
            return
        group = [replace(frame, group=self.groups) for frame in (first.current, *partners)]
        self.groups += 1
        self._written.update(frame.camera for frame in group)
        yield group

    def _partner(self, name: str, index: int, first: Frame, number: int) -> Frame | None:
        repair = self._repairs[name]
        place = index - repair.shift(number) * self._steps[name]
        slot = self._slot(place)
        frame = None if slot is None else slot.cameras[name].current
        if frame is None or place <= self._used.get(name, -1):
            return None
        self._used[name] = place
        return self._restamped(repair, number, first, frame) if self._restamp else frame

    def _restamped(self, repair: PairRepair, number: int, first: Frame, frame: Frame) -> Frame:
        error_ns = repair.error_ns(number)
        if error_ns is None:
            self.unstamped += 1
            return frame
        # Stamps that follow from the pictures are no evidence of when these were taken.
        return replace(
            frame,
            captured_ns=frame.captured_ns - error_ns,
            clock=first.clock,
            stamp_origin=StampOrigin.SYNTHESISED,
        )

    def _slot(self, index: int) -> Window | None:
        if not self._slots:
            return None
        place = index - self._slots[0].index
        return self._slots[place] if 0 <= place < len(self._slots) else None
