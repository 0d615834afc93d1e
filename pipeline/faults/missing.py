"""A camera whose frames stop coming: some before the end, or all of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Literal

from pydantic import Field

from pipeline.faults.base import Fault, FaultSettings, FrameFault, TimedSlot
from pipeline.frame import Camera, Frame


class TruncateSettings(FaultSettings):
    """frames: how many of the last slots are empty; while it is running, so many are held back."""

    type: Literal["truncate"] = "truncate"
    frames: int = Field(default=20, ge=1, le=1000)


class Truncate(Fault):
    """The camera's last n frames are missing, as where a recorder was stopped one camera at a time.

    Signature: stamps 0, ids equal, pictures 0, then nothing. Seen in: marcelsheeny/radiate_sdk#45.
    """

    def __init__(self, settings: TruncateSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._frames = settings.frames
        self.ended = False

    def apply(self, slots: Iterable[TimedSlot]) -> Iterator[TimedSlot]:
        last: deque[TimedSlot] = deque()
        for slot in slots:
            last.append(slot)
            if len(last) > self._frames:
                yield last.popleft()
        self.ended = True
        for slot in last:
            yield self.with_frame(slot, None) if self.active(slot) else slot


class DeadSettings(FaultSettings):
    """The camera is unplugged, or its process has died."""

    type: Literal["dead"] = "dead"


class Dead(FrameFault):
    """No frames come any more.

    Signature: nothing is left to compare. Seen with every kind of camera.
    """

    def __init__(self, settings: DeadSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)

    def bend(self, _: Frame) -> Frame | None:
        return None
