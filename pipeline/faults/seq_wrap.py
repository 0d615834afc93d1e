"""A camera whose frame counter has few bits and starts again from 0."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from pydantic import Field

from pipeline.faults.base import FaultSettings, FrameFault
from pipeline.frame import Camera, Frame


class SeqWrapSettings(FaultSettings):
    """bits: how many the counter has. after: how many ids it wraps after the onset.

    The default is a second at 30 fps, so that even a short recording shows it.
    """

    type: Literal["seq_wrap"] = "seq_wrap"
    bits: int = Field(default=16, ge=1, le=64)
    after: int = Field(default=30, ge=1)


class SeqWrap(FrameFault):
    """The camera has been on for long: its ids end at 2^bits - 1 and go on from 0.

    Signature: stamps 0, ids jump, pictures 0. Seen in: ouster-lidar/ouster-sdk#454, AravisProject/aravis#762.
    """

    def __init__(self, settings: SeqWrapSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._after = settings.after
        self._modulus = 1 << settings.bits
        self._first: int | None = None

    def bend(self, frame: Frame) -> Frame:
        if frame.sequence is None:
            return frame
        if self._first is None:
            self._first = frame.sequence
        return replace(frame, sequence=(frame.sequence - self._first - self._after) % self._modulus)
