"""What all faults share: which camera, when, and a stream of slots that they bend."""

from __future__ import annotations

import random
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from pydantic import Field, model_validator

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, Camera, Frame, Renderer
from pipeline.settings import Settings


@dataclass(frozen=True, slots=True)
class TimedSlot:
    """What the rig's own pairing put together, and how long after its first frame, before any fault."""

    stream_ns: int
    frames: dict[str, Frame | None]


class FaultSettings(Settings):
    """Common to all faults.

    camera: the camera that is tampered with (default: the rig's second).
    start_s, stop_s: stream time from the first frame; the default is the whole run.
    """

    camera: str | None = None
    start_s: float = Field(default=0.0, ge=0)
    stop_s: float | None = Field(default=None, ge=0)

    @model_validator(mode="after")
    def _stops_after_start(self) -> FaultSettings:
        if self.stop_s is not None and self.stop_s <= self.start_s:
            raise ValueError(f"stop_s must be later than start_s: {self.stop_s} is not after {self.start_s}")
        return self


class Fault(ABC):
    """Bends one camera's frames while it is active; the groups they were delivered in stay as they are."""

    def __init__(self, kind: str, settings: FaultSettings, cameras: Iterable[Camera], seed: int) -> None:
        by_name = {camera.name: camera for camera in cameras}
        if len(by_name) < 2:
            raise InputError(f"fault {kind}: the source has one camera only: two or more are needed")
        name = settings.camera or list(by_name)[1]
        if name not in by_name:
            raise InputError(f"fault {kind}: no camera '{name}': this rig has {', '.join(by_name)}")
        self.kind = kind
        self.camera = by_name[name]
        self.random = random.Random(f"{seed}/{name}/{settings!r}")
        self._start_ns = round(settings.start_s * NS_PER_S)
        self._stop_ns = None if settings.stop_s is None else round(settings.stop_s * NS_PER_S)

    @abstractmethod
    def apply(self, slots: Iterable[TimedSlot]) -> Iterator[TimedSlot]:
        """Yields as many slots as it takes, in the same order, looking a bounded number ahead or back."""

    def active(self, slot: TimedSlot) -> bool:
        return slot.stream_ns >= self._start_ns and (self._stop_ns is None or slot.stream_ns < self._stop_ns)

    def with_frame(self, slot: TimedSlot, frame: Frame | None) -> TimedSlot:
        """The slot with another frame of this fault's camera, marked as tampered with."""
        if frame is not None and frame.truth is not None and self.kind not in frame.truth.faults:
            frame = replace(frame, truth=replace(frame.truth, faults=(*frame.truth.faults, self.kind)))
        return TimedSlot(slot.stream_ns, {**slot.frames, self.camera.name: frame})


class FrameFault(Fault):
    """A fault that bends one frame at a time."""

    def apply(self, slots: Iterable[TimedSlot]) -> Iterator[TimedSlot]:
        for slot in slots:
            frame = slot.frames[self.camera.name]
            if frame is not None and self.active(slot):
                yield self.with_frame(slot, self.bend(frame))
            else:
                yield slot

    @abstractmethod
    def bend(self, frame: Frame) -> Frame | None:
        """What becomes of an active frame; None drops it."""


class ShiftFault(Fault):
    """A fault that puts something of frame n + `frames` into slot n; fractions are rendered."""

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
        self._renderer = renderer
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
        ahead = max(int(self._frames), 0) if self._whole else 0
        behind = max(-int(self._frames), 0) if self._whole else 0
        around: deque[TimedSlot | None] = deque([None] * (behind + ahead), maxlen=behind + ahead + 1)
        endless = (*[None] * ahead,)
        for slot in _chain(slots, endless):
            around.append(slot)
            if len(around) == behind + ahead + 1 and (current := around[behind]) is not None:
                yield self._shifted(current, around[behind + int(self._frames)] if self._whole else current)

    def _shifted(self, slot: TimedSlot, other: TimedSlot | None) -> TimedSlot:
        frame = slot.frames[self.camera.name]
        if frame is None or not self.active(slot):
            return slot
        if self._whole:
            donor = other.frames[self.camera.name] if other is not None else None
        else:
            donor = self._rendered(frame)
        return self.with_frame(slot, None if donor is None else self.combine(frame, donor))

    def _rendered(self, frame: Frame) -> Frame:
        assert self._renderer is not None
        assert frame.truth is not None
        shift_ns = round(self._frames * self.camera.period_ns)
        shown_ns = frame.truth.shown_ns + shift_ns
        return replace(
            frame,
            captured_ns=frame.captured_ns + shift_ns,
            image=self._renderer.picture_at(self.camera.name, shown_ns),
            truth=replace(frame.truth, shown_ns=shown_ns),
        )


def _chain(slots: Iterable[TimedSlot], tail: Iterable[None]) -> Iterator[TimedSlot | None]:
    yield from slots
    yield from tail
