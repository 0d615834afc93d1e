"""A camera whose automatic exposure hunts."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import Field

from pipeline.faults.base import FaultSettings, SlotFault, TimedSlot
from pipeline.faults.moment import repainted
from pipeline.frame import NS_PER_S, Camera, Picture


class ExposureSettings(FaultSettings):
    """stops: how far brightness swings either way, in powers of two. period_s: how long a swing takes."""

    type: Literal["exposure"] = "exposure"
    stops: float = Field(default=0.5, gt=0, le=4)
    period_s: float = Field(default=7.0, gt=0, le=100_000)


class Exposure(SlotFault):
    """Pictures get brighter and darker; stamps and ids go on.

    Signature: stamps 0, ids equal, pictures 0. No report: wherever exposure is automatic, each camera follows its own.
    """

    def __init__(self, settings: ExposureSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._stops = settings.stops
        self._period_ns = settings.period_s * NS_PER_S

    def bend_slot(self, slot: TimedSlot) -> TimedSlot:
        frame = slot.frames[self.camera.name]
        if frame is None:
            return slot
        gain = np.float32(2 ** (self._stops * math.sin(2 * math.pi * slot.stream_ns / self._period_ns)))

        def expose(image: Picture) -> Picture:
            return np.asarray(np.clip(np.rint(image * gain), 0, 255), np.uint8)

        return self.with_frame(slot, repainted(frame, expose))
