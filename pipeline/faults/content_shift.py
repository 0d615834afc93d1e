"""A camera whose pictures are stale or early while its stamps and ids say that all is well."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from pipeline.faults.base import FaultSettings
from pipeline.faults.moment import with_picture_of
from pipeline.faults.shift import MAX_FRAMES, ShiftFault
from pipeline.frame import Frame


class ContentShiftSettings(FaultSettings):
    """frames: how much later the picture's moment is than its slot's; negative = stale."""

    type: Literal["content_shift"] = "content_shift"
    frames: float = Field(default=-1, ge=-MAX_FRAMES, le=MAX_FRAMES)


class ContentShift(ShiftFault):
    """The picture alone of frame n + k in slot n.

    Signature: stamps 0, ids equal, pictures k. Seen in: raspberrypi/picamera2#1107, luxonis/depthai-ros#713,
    stereolabs/zed-ros-wrapper#629; by half a frame in basler/pypylon#731.
    """

    def combine(self, frame: Frame, other: Frame) -> Frame:
        return with_picture_of(frame, other)
