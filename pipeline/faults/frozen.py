"""A camera that delivers the same picture again and again under new stamps and ids."""

from __future__ import annotations

from typing import Literal

from pipeline.faults.base import FaultSettings, FrameFault
from pipeline.faults.moment import stood_still, with_picture_of
from pipeline.frame import Camera, Frame


class FrozenSettings(FaultSettings):
    """The picture of the first active frame stays."""

    type: Literal["frozen"] = "frozen"


class Frozen(FrameFault):
    """The picture stands still; stamps and ids go on.

    Signature: stamps 0, ids equal, one side's pictures stand still. Seen in: blakeblackshear/frigate#5178 and #1699.
    """

    def __init__(self, settings: FrozenSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._still: Frame | None = None

    def bend(self, frame: Frame) -> Frame:
        self._still = self._still or stood_still(frame)
        return with_picture_of(frame, self._still)
