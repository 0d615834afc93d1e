"""A camera whose frame counter started elsewhere."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from pipeline.faults.base import FaultSettings, FrameFault
from pipeline.frame import Camera, Frame


class SeqOffsetSettings(FaultSettings):
    """ids: what is added to the camera's frame ids."""

    type: Literal["seq_offset"] = "seq_offset"
    ids: int = 1


class SeqOffset(FrameFault):
    """Ids differ by a constant; everything else is well.

    Signature: stamps 0, ids +k, pictures 0. Seen in: luxonis/depthai-ros#441 and #421.
    """

    def __init__(self, settings: SeqOffsetSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._ids = settings.ids

    def bend(self, frame: Frame) -> Frame:
        return frame if frame.sequence is None else replace(frame, sequence=frame.sequence + self._ids)
