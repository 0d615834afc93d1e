"""What a camera's pictures say about the camera: dark, saturated, blurred, moving, or not changing at all."""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.frame import NS_PER_S, Picture
from pipeline.pictures import grey

Floats: TypeAlias = npt.NDArray[np.float32]

WIDTH_PX = 160
"""Width of the reduced picture; averaging to it also takes out most of the sensor's noise."""

ROWS_AVERAGED = 4
"""Of larger pictures than 640 px, rows are left out: four rows of many columns average enough, and cost counts."""

BLOCK_PX = 4

DARK_LEVEL = 20
"""With the 99th percentile of the picture at or below, nothing is seen: black is 16 in the video range of BT.601, and
20 is less than half a percent of full light at a gamma of 2.2."""

CLIPPED_LEVEL = 250
CLIPPED_SHARE = 0.5
"""Half of the picture without any detail in it."""

MOTION_RATIO = 2.0
"""Change of block means against that of pixels, in units of what white noise gives (1, at most 4): noise that a codec
or a denoiser has smeared over its neighbours stays below, what moves covers blocks."""

MOTION_LEVELS = 0.25
"""Change of block means below which rounding to whole levels may be all there is."""

MOTION_SHARE = 0.02
OUTLYING_SIGMAS = 6
OUTLYING_LEVELS = 1.0
"""Blocks that change by so many robust standard deviations of all blocks, and by a level, are no noise. A few may be
flicker of a codec; two in a hundred are something small that moves."""

SURE_LEVELS = 2.0
"""Change of block means that no noise makes: it would have to be of 8 levels in a picture already averaged."""

BLUR_RATIO = 0.5
"""Blurred when the mean squared spatial frequency is below this share of what is usual: twice the detail size."""

USUAL_SECONDS = 120
LEARNING_SECONDS = 10
"""Seconds of sharpness that are remembered, and that must be known before anything is called blurred."""

NOISE_FRAMES = 300
NOISE_EVERY = 30
STILL_SHARE = 0.25
"""Change below this share of the camera's own quietest tenth of frames is less than its noise: noise does not fade."""


class Sight:
    """Statistics of a stream of pictures, each reduced once to 160 px width.

    Change is the mean absolute difference to the picture before, in grey levels. Sharpness is the energy of the
    Laplacian over that of the gradient, the mean squared spatial frequency weighted by gradient energy: it does not
    depend on contrast or brightness. The best frame of a second counts, so that motion blur does not.
    """

    def __init__(self, period_ns: int) -> None:
        self._frames_a_second = max(1, round(NS_PER_S / period_ns))
        self._small: Picture | None = None
        self._changes: deque[float] = deque(maxlen=NOISE_FRAMES)
        self._noise_levels = 0.0
        self._seen = 0
        self._second: deque[float] = deque(maxlen=self._frames_a_second)
        self._usual: deque[float] = deque(maxlen=USUAL_SECONDS)
        self.dark = False
        self.saturated = False
        self.moving = False
        self.still = False
        """Nothing changed against the last picture, not even as much as this camera's noise always does."""
        self.sharpness_ratio: float | None = None
        """Sharpness of the last second against what is usual here; None while that is being learned."""

    def same_as_last(self, small: Picture) -> bool:
        return self._small is not None and self._small.shape == small.shape and bool((self._small == small).all())

    def see(self, small: Picture) -> None:
        """Takes the next picture, reduced by `reduced`."""
        histogram = np.bincount(small.ravel(), minlength=256)
        from_above = np.cumsum(histogram[::-1])[::-1] / small.size
        self.dark = bool(from_above[DARK_LEVEL + 1] < 0.01)
        self.saturated = bool(from_above[CLIPPED_LEVEL] > CLIPPED_SHARE)
        before, self._small = self._small, small
        self._seen += 1
        if before is None or before.shape != small.shape:
            self.moving = self.still = False
            self._changes.clear()
        else:
            self._compare(before, small)
        self._judge_sharpness(small)

    def _compare(self, before: Picture, small: Picture) -> None:
        difference: Floats = np.subtract(small, before, dtype=np.float32)
        change = float(np.abs(difference).mean())
        self.still = change <= STILL_SHARE * self._noise_levels
        if not self.still:
            self._changes.append(change)
            if self._seen % NOISE_EVERY == 0:
                self._noise_levels = sorted(self._changes)[len(self._changes) // 10]
        self.moving = _moves(difference - difference.mean())

    def _judge_sharpness(self, small: Picture) -> None:
        if self.dark or self.saturated or min(small.shape) < 3:
            return
        self._second.append(sharpness(small))
        if len(self._second) < self._frames_a_second:
            return
        best = max(self._second)
        if len(self._usual) >= LEARNING_SECONDS:
            self.sharpness_ratio = best / usual if (usual := median(self._usual)) > 0 else None
        if self._seen % self._frames_a_second == 0 and not self.blurred:
            self._usual.append(best)

    @property
    def blurred(self) -> bool:
        return self.sharpness_ratio is not None and self.sharpness_ratio < BLUR_RATIO


def _moves(difference: Floats) -> bool:
    """Whether a difference of two pictures, H x W grey levels of mean 0, shows motion: overall, or of some blocks."""
    size = (max(1, difference.shape[1] // BLOCK_PX), max(1, difference.shape[0] // BLOCK_PX))
    blocks = np.abs(cv2.resize(difference, size, interpolation=cv2.INTER_AREA))
    noise = float(np.abs(difference).mean()) / BLOCK_PX
    if float(blocks.mean()) > min(SURE_LEVELS, max(MOTION_LEVELS, MOTION_RATIO * noise)):
        return True
    usual = 1.4826 * float(np.median(blocks))
    return float((blocks > max(OUTLYING_LEVELS, OUTLYING_SIGMAS * usual)).mean()) > MOTION_SHARE


def reduced(image: Picture) -> Picture:
    """The picture in grey, averaged to 160 px width if it is wider: H x W uint8."""
    height, width = image.shape[:2]
    if width > WIDTH_PX:
        size = (WIDTH_PX, max(1, round(height * WIDTH_PX / width)))
        rows = image[:: max(1, width // (ROWS_AVERAGED * WIDTH_PX))]
        image = np.asarray(cv2.resize(rows, size, interpolation=cv2.INTER_AREA), np.uint8)
    return grey(image)


def sharpness(small: Picture) -> float:
    """Energy of the Laplacian over energy of the gradient (central differences) of a picture H x W; 0 if flat."""
    flat = small.astype(np.float32)
    laplacian = cv2.Laplacian(flat, cv2.CV_32F)
    across, down = flat[:, 2:] - flat[:, :-2], flat[2:] - flat[:-2]
    gradient = float(np.square(across).mean() + np.square(down).mean())
    return float(np.square(laplacian).mean()) / gradient if gradient > 0 else 0.0
