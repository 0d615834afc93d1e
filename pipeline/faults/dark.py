"""A camera that sees next to nothing."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipeline.faults.base import FaultSettings, FrameFault
from pipeline.faults.moment import repainted
from pipeline.frame import Camera, Frame, Picture

DARKENING = 0.01
"""What is left of the light: the brightest pixel reads 2.55 levels, not far above the noise."""

NOISE_LEVELS = 1.0
"""Standard deviation of the sensor's noise, which does not go out with the light."""


class DarkSettings(FaultSettings):
    """The lens is covered, or the light is out."""

    type: Literal["dark"] = "dark"


class Dark(FrameFault):
    """Pictures are near black and noisy; stamps and ids go on.

    Signature: stamps 0, ids equal, pictures cannot tell. No report: it happens wherever there is a night or a lens cap.
    """

    def __init__(self, settings: DarkSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)

    def bend(self, frame: Frame) -> Frame:
        seed = self.chance(frame).getrandbits(64)

        def darken(image: Picture) -> Picture:
            noise = np.random.default_rng(seed).standard_normal(image.shape, np.float32)
            seen = image * np.float32(DARKENING) + np.float32(NOISE_LEVELS) * noise
            return np.asarray(np.clip(np.rint(seen), 0, 255), np.uint8)

        return repainted(frame, darken)
