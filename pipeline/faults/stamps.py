"""Cameras whose stamps are wrong while pictures and ids are right: shifted, noisy, copied or repeated."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field

from pipeline.faults.base import EveryNth, FaultSettings, FrameFault, SlotFault, TimedSlot
from pipeline.frame import NS_PER_MS, Camera, Frame, StampReference

StampMs = Annotated[float, Field(ge=-2e12, le=2e12)]
"""63 years: more than lie between any two clocks' epochs, less than would overflow 64 bits of nanoseconds."""


class StampOffsetSettings(FaultSettings):
    """ms: what is added to the camera's stamps.

    reference, exposure_ms: which moment of how long an exposure its frames then say the stamp marks; left out: as they
    did.
    """

    type: Literal["stamp_offset"] = "stamp_offset"
    ms: StampMs = 4
    reference: StampReference | None = None
    exposure_ms: float | None = Field(default=None, gt=0, le=10_000)


class StampOffset(FrameFault):
    """Stamps differ by a constant; everything else is well.

    Signature: stamps const, ids equal, pictures 0. Seen in: basler/pypylon#656 (37 s) and
    NVIDIA-ISAAC-ROS/isaac_ros_argus_camera#39 (18 s), where clocks count from another epoch; luxonis/depthai#795 and
    microsoft/Azure-Kinect-Sensor-SDK#868 (a fraction of a frame), where stamps mark another moment of the exposure.
    """

    def __init__(self, settings: StampOffsetSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._offset_ns = round(settings.ms * NS_PER_MS)
        self._reference = settings.reference
        self._exposure_ns = None if settings.exposure_ms is None else round(settings.exposure_ms * NS_PER_MS)

    def bend(self, frame: Frame) -> Frame:
        return replace(
            frame,
            captured_ns=frame.captured_ns + self._offset_ns,
            stamp_reference=self._reference or frame.stamp_reference,
            exposure_ns=self._exposure_ns or frame.exposure_ns,
        )


class StampJitterSettings(FaultSettings):
    """bias_ms, sigma_ms: mean and standard deviation of what is added to each stamp, normally distributed."""

    type: Literal["stamp_jitter"] = "stamp_jitter"
    bias_ms: StampMs = 0
    sigma_ms: float = Field(default=2, ge=0, le=1e6)


class StampJitter(FrameFault):
    """Stamps are late by a bias and noisy, as those of arrival are; noise beyond a period may put them out of order.

    Signature: stamps bias + noise, ids equal, pictures 0. Seen in: ros-drivers/usb_cam#75; with pictures half a frame
    off in orbbec/OrbbecSDK_v2#117.
    """

    def __init__(self, settings: StampJitterSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._bias_ms = settings.bias_ms
        self._sigma_ms = settings.sigma_ms

    def bend(self, frame: Frame) -> Frame:
        off_ns = round(self.chance(frame).gauss(self._bias_ms, self._sigma_ms) * NS_PER_MS)
        return replace(frame, captured_ns=frame.captured_ns + off_ns)


class CopyStampSettings(FaultSettings):
    """of: the camera whose stamps are copied (default: the rig's first that is not the fault's own)."""

    type: Literal["copy_stamp"] = "copy_stamp"
    of: str | None = None


class CopyStamp(SlotFault):
    """The camera bears the stamps of another; where that one's frame is missing, its own.

    Signature: stamps exactly 0, ids equal, pictures whatever they are. Seen in: introlab/rtabmap_ros#93 (pictures -1).
    """

    def __init__(self, settings: CopyStampSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._of = self.partner_named("of", settings.of).name

    def bend_slot(self, slot: TimedSlot) -> TimedSlot:
        frame, model = slot.frames[self.camera.name], slot.frames[self._of]
        if frame is None or model is None:
            return slot
        return self.with_frame(slot, replace(frame, captured_ns=model.captured_ns, clock=model.clock))


class StampRepeatSettings(FaultSettings):
    """every: each n-th frame bears the stamp of the frame before it."""

    type: Literal["stamp_repeat"] = "stamp_repeat"
    every: int = Field(default=50, ge=2)


class StampRepeat(FrameFault):
    """Now and then a stamp is that of the frame before; the next one is right again.

    Signature: stamps spike by -1, ids equal, pictures 0. Seen in: stereolabs/zed-sdk#743.
    """

    def __init__(self, settings: StampRepeatSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._nth = EveryNth(settings.every)
        self._before_ns = 0

    def bend(self, frame: Frame) -> Frame:
        before_ns, self._before_ns = self._before_ns, frame.captured_ns
        return replace(frame, captured_ns=before_ns) if self._nth.next_is_due() else frame
