"""What all faults share: which camera, when, and a stream of slots that they bend."""

from __future__ import annotations

import random
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from pydantic import Field, model_validator

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, Camera, Frame
from pipeline.settings import Settings


@dataclass(frozen=True, slots=True)
class TimedSlot:
    """What the rig's own pairing put together, and how long after its first frame, before any fault.

    repeated: the cameras whose frame is delivered twice.
    """

    stream_ns: int
    frames: dict[str, Frame | None]
    repeated: frozenset[str] = frozenset()


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
    """Bends one camera's frames while it is active; the groups they were delivered in stay as they are.

    Raises InputError for a camera that the rig does not have.
    """

    def __init__(self, kind: str, settings: FaultSettings, cameras: Iterable[Camera], seed: int) -> None:
        self._cameras = {camera.name: camera for camera in cameras}
        self.kind = kind
        if len(self._cameras) < 2:
            raise InputError(f"fault {kind}: the source has one camera only: two or more are needed")
        self.camera = self.camera_named(list(self._cameras)[1] if settings.camera is None else settings.camera)
        own = settings.model_copy(update={"camera": self.camera.name})
        self._chance_key = f"{seed}/{kind}/{own!r}"
        self._start_ns = round(settings.start_s * NS_PER_S)
        self._stop_ns = None if settings.stop_s is None else round(settings.stop_s * NS_PER_S)

    @abstractmethod
    def apply(self, slots: Iterable[TimedSlot]) -> Iterator[TimedSlot]:
        """Yields as many slots as it takes, in the same order, looking a bounded number ahead or back."""

    def active(self, slot: TimedSlot) -> bool:
        return slot.stream_ns >= self._start_ns and (self._stop_ns is None or slot.stream_ns < self._stop_ns)

    def camera_named(self, name: str) -> Camera:
        if name not in self._cameras:
            raise InputError(f"fault {self.kind}: no camera '{name}': this rig has {', '.join(self._cameras)}")
        return self._cameras[name]

    def partner_named(self, key: str, name: str | None) -> Camera:
        """Another camera than the fault's own, by default the rig's first."""
        others = (other for other in self._cameras if other != self.camera.name)
        partner = self.camera_named(next(others) if name is None else name)
        if partner is self.camera:
            raise InputError(f"fault {self.kind}: {key}: '{partner.name}' is the camera itself: name another one")
        return partner

    def chance(self, frame: Frame) -> random.Random:
        """Chance that depends on the seed, the fault, its camera and the slot, not on what was read before."""
        return random.Random(f"{self._chance_key}/{frame.group}")

    def marked(self, frame: Frame) -> Frame:
        """The frame with this fault's kind noted as acting on it."""
        if frame.truth is None or self.kind in frame.truth.faults:
            return frame
        return replace(frame, truth=replace(frame.truth, faults=(*frame.truth.faults, self.kind)))

    def with_frame(self, slot: TimedSlot, frame: Frame | None) -> TimedSlot:
        """The slot with another frame of this fault's camera, marked as tampered with."""
        return replace(slot, frames={**slot.frames, self.camera.name: frame and self.marked(frame)})


class SlotFault(Fault):
    """A fault that bends one slot at a time."""

    def apply(self, slots: Iterable[TimedSlot]) -> Iterator[TimedSlot]:
        for slot in slots:
            yield self.bend_slot(slot) if self.active(slot) else slot

    @abstractmethod
    def bend_slot(self, slot: TimedSlot) -> TimedSlot:
        """What becomes of an active slot."""


class FrameFault(SlotFault):
    """A fault that bends one frame at a time."""

    def bend_slot(self, slot: TimedSlot) -> TimedSlot:
        frame = slot.frames[self.camera.name]
        return slot if frame is None else self.with_frame(slot, self.bend(frame))

    @abstractmethod
    def bend(self, frame: Frame, /) -> Frame | None:
        """What becomes of an active frame; None drops it."""


class EveryNth:
    """Counts active frames."""

    def __init__(self, every: int) -> None:
        self._every = every
        self._seen = 0

    def next_is_due(self) -> bool:
        """Counts one more and says whether it is the n-th, 2n-th, ..."""
        self._seen += 1
        return self._seen % self._every == 0
