"""A camera that now and then delivers the same frame twice."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from pydantic import Field

from pipeline.faults.base import EveryNth, FaultSettings, FrameFault, TimedSlot
from pipeline.frame import Camera, Frame


class FrameRepeatSettings(FaultSettings):
    """every: each n-th frame is delivered twice."""

    type: Literal["frame_repeat"] = "frame_repeat"
    every: int = Field(default=50, ge=1)


class FrameRepeat(FrameFault):
    """A frame comes again, in its own slot: the same picture, stamp and id.

    Signature: stamps 0, ids repeat, pictures 0. Seen in: realsenseai/librealsense#1686.
    """

    def __init__(self, settings: FrameRepeatSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._nth = EveryNth(settings.every)

    def bend_slot(self, slot: TimedSlot) -> TimedSlot:
        bent = super().bend_slot(slot)
        if slot.frames[self.camera.name] is None or not self._nth.next_is_due():
            return bent
        return replace(bent, repeated=bent.repeated | {self.camera.name})

    def bend(self, frame: Frame) -> Frame:
        return frame
