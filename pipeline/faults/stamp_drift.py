"""A camera whose clock runs fast or slow while it is triggered together with the others."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from pydantic import Field

from pipeline.faults.base import FaultSettings, FrameFault
from pipeline.frame import Camera, Frame


class StampDriftSettings(FaultSettings):
    """ppm: how fast the camera's clock runs away; positive = fast."""

    type: Literal["stamp_drift"] = "stamp_drift"
    ppm: float = Field(default=100, gt=-1e6, le=1e6)


class StampDrift(FrameFault):
    """Stamps drift away; ids and pictures stay together.

    Signature: stamps ramp, ids equal, pictures 0. Seen in: realsenseai/librealsense#14131 and #3565.
    """

    def __init__(self, settings: StampDriftSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._ppm = settings.ppm
        self._began_ns: int | None = None

    def bend(self, frame: Frame) -> Frame:
        if self._began_ns is None:
            self._began_ns = frame.captured_ns
        drift_ns = round((frame.captured_ns - self._began_ns) * self._ppm * 1e-6)
        return replace(frame, captured_ns=frame.captured_ns + drift_ns)
