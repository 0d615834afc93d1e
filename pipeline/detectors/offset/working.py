"""The small grey picture on which everything is measured."""

from __future__ import annotations

from dataclasses import dataclass

import cv2

from pipeline.frame import Picture
from pipeline.pictures import grey, reduced

COARSE_WIDTH_PX = 160
"""Width of the picture for motion signals: a 4 px block of a VGA picture is one of its pixels, so codec noise averages
out while the motion of a hand or a head remains."""


@dataclass(frozen=True, slots=True)
class Working:
    """A reduced grey picture with its brightness.

    image: h x w uint8, w <= the working width. coarse: about 120 x 160 uint8. mean, deviation: of `image`, in levels.
    """

    image: Picture
    coarse: Picture
    mean: float
    deviation: float


def work_on(image: Picture, width_px: int) -> Working:
    """Reduces by area averaging, which keeps corners where they are and removes the noise of single pixels."""
    flat = reduced(grey(image), width_px)
    mean, deviation = (float(v[0, 0]) for v in cv2.meanStdDev(flat))
    return Working(flat, reduced(flat, COARSE_WIDTH_PX), mean, deviation)
