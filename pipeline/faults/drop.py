"""A camera that loses frames, with or without a gap in its ids."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Literal

from pydantic import Field, model_validator

from pipeline.faults.base import EveryNth, FaultSettings, FrameFault, TimedSlot
from pipeline.frame import Camera, Frame


class DropSettings(FaultSettings):
    """probability: of losing a frame; every: lose every n-th instead. renumber: ids show no gap."""

    type: Literal["drop"] = "drop"
    probability: float | None = Field(default=None, gt=0, le=1)
    every: int | None = Field(default=None, ge=1)
    renumber: bool = False

    @model_validator(mode="after")
    def _one_way(self) -> DropSettings:
        if (self.probability is None) == (self.every is None):
            raise ValueError("give either probability (e.g. 0.05) or every (e.g. 40)")
        return self


class Drop(FrameFault):
    """Slots stay empty on one side.

    Signature: gaps in stamps, gaps in ids (none with `renumber`), pictures 0. Seen in: realsenseai/librealsense#10516;
    silently in raspberrypi/picamera2#1201.
    """

    def __init__(self, settings: DropSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._renumber = settings.renumber
        self._probability = settings.probability
        self._nth = None if settings.every is None else EveryNth(settings.every)
        self._lost = 0

    def apply(self, slots: Iterable[TimedSlot]) -> Iterator[TimedSlot]:
        for slot in super().apply(slots):
            frame = slot.frames[self.camera.name]
            if frame is not None and self._renumber and frame.sequence is not None:
                # A counter that has missed frames does not catch up when the losses end.
                frame = replace(frame, sequence=frame.sequence - self._lost)
            yield replace(slot, frames={**slot.frames, self.camera.name: frame})

    def bend(self, frame: Frame) -> Frame | None:
        if not self._is_lost(frame):
            return frame
        self._lost += 1
        return None

    def _is_lost(self, frame: Frame) -> bool:
        if self._nth is not None:
            return self._nth.next_is_due()
        return self.chance(frame).random() < (self._probability or 0)
