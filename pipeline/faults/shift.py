"""Putting something of another moment into a slot: of a neighbouring frame, or rendered for a fraction of a frame."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace

from pipeline.errors import InputError
from pipeline.faults.base import Fault, FaultSettings, TimedSlot
from pipeline.faults.moment import retaken
from pipeline.frame import Camera, Frame, Renderer

MAX_FRAMES = 300
"""How far frames are moved at most, as the pictures of so many slots are kept: ten seconds at 30 fps."""


class ShiftFault(Fault):
    """A fault that puts something of frame n + `frames` into slot n; fractions are rendered.

    Raises InputError for a fraction when the source cannot render.
    """

    def __init__(
        self,
        kind: str,
        settings: FaultSettings,
        cameras: Iterable[Camera],
        seed: int,
        frames: float,
        renderer: Renderer | None,
    ) -> None:
        super().__init__(kind, settings, cameras, seed)
        self._frames = frames
        self._whole = float(frames).is_integer()
        if not self._whole and renderer is None:
            raise InputError(
                f"fault {kind}: frames: {frames} is not a whole number, and only rendered pictures "
                "(source.type: synthetic) can be shifted by a fraction of a frame"
            )

    @abstractmethod
    def combine(self, frame: Frame, other: Frame) -> Frame:
        """Slot n's frame with what this fault takes from the moment `frames` later."""

    def apply(self, slots: Iterable[TimedSlot]) -> Iterator[TimedSlot]:
        if not self._whole:
            for slot in slots:
                frame = slot.frames[self.camera.name]
                yield self._shifted(slot, frame and self._rendered(frame)) if self.active(slot) else slot
            return
        frames = int(self._frames)
        ahead, behind = max(frames, 0), max(-frames, 0)
        around: deque[TimedSlot | None] = deque([None] * (behind + ahead), maxlen=behind + ahead + 1)
        for later in _chain(slots, [None] * ahead):
            around.append(later)
            if len(around) == behind + ahead + 1 and (current := around[behind]) is not None:
                other = around[behind + frames]
                donor = None if other is None else other.frames[self.camera.name]
                yield self._shifted(current, donor) if self.active(current) else current

    def _shifted(self, slot: TimedSlot, donor: Frame | None) -> TimedSlot:
        frame = slot.frames[self.camera.name]
        if frame is None:
            return slot
        return self.with_frame(slot, None if donor is None else self.combine(frame, donor))

    def _rendered(self, frame: Frame) -> Frame:
        shift_ns = round(self._frames * self.camera.period_ns)
        return replace(retaken(frame, shift_ns), captured_ns=frame.captured_ns + shift_ns)


def _chain(slots: Iterable[TimedSlot], tail: Iterable[None]) -> Iterator[TimedSlot | None]:
    yield from slots
    yield from tail
