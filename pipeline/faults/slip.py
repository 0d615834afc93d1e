"""A camera that is whole frames (or a fraction) ahead or behind, and says so in its stamps."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from pydantic import Field

from pipeline.faults.base import FaultSettings
from pipeline.faults.shift import MAX_FRAMES, ShiftFault
from pipeline.frame import Frame


class SlipSettings(FaultSettings):
    """frames: how much later the camera's moment is than its slot's; negative = stale."""

    type: Literal["slip"] = "slip"
    frames: float = Field(default=1, ge=-MAX_FRAMES, le=MAX_FRAMES)


class Slip(ShiftFault):
    """Picture and stamp of frame n + k under id n in slot n.

    Signature: stamps +k, ids equal, pictures +k. Seen in: the report's own rig (46 frames, ended by a drop),
    introlab/rtabmap#742; as a start race in TheImagingSource/tiscamera#391 and ksseverson57/campy#24; as a step after
    hours in realsenseai/librealsense#12877 and basler/pypylon#268; as a stale buffer in raspberrypi/picamera2#1116; by
    half a frame in orbbec/OrbbecSDK_v2#117.
    """

    def combine(self, frame: Frame, other: Frame) -> Frame:
        return replace(other, sequence=frame.sequence, group=frame.group, arrived_ns=frame.arrived_ns)
