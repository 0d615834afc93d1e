"""Two cameras whose pictures are mistaken for each other."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from pipeline.faults.base import FaultSettings, SlotFault, TimedSlot
from pipeline.faults.moment import with_picture_of
from pipeline.frame import Camera, Frame


class SwapSettings(FaultSettings):
    """partner: the camera with which pictures are exchanged (default: the rig's first that is not the fault's own)."""

    type: Literal["swap"] = "swap"
    partner: str | None = None


class Swap(SlotFault):
    """Each of two cameras delivers the other's pictures under its own name, stamps and ids.

    Signature: stamps 0, ids equal, disparity has the wrong sign. Seen in: stereolabs/zed-ros-wrapper#772.
    Where one of the two is missing, the frame that is there goes over to the other's name as it is.
    """

    def __init__(self, settings: SwapSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._partner = self.partner_named("partner", settings.partner).name

    def bend_slot(self, slot: TimedSlot) -> TimedSlot:
        own, other = slot.frames[self.camera.name], slot.frames[self._partner]
        exchanged = {
            self.camera.name: self._instead(self.camera.name, own, other),
            self._partner: self._instead(self._partner, other, own),
        }
        return replace(slot, frames={**slot.frames, **exchanged})

    def _instead(self, name: str, frame: Frame | None, shown: Frame | None) -> Frame | None:
        if shown is None:
            return None
        return self.marked(replace(shown, camera=name) if frame is None else with_picture_of(frame, shown))
