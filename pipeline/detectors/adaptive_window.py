"""Stereo matching with windows that adapt to the gradient: which right frame fits the left one, t, t-1 or t+1?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from pipeline.detectors.candidates import CandidateDetector, Candidates, CandidateSettings, Floats, Scores
from pipeline.detectors.offset.silence import Silence
from pipeline.frame import Frame, Pair, Picture, Rig, Window
from pipeline.pictures import Memo, gradient_magnitude, grey, reduced
from pipeline.verdict import Reason

LOW, HIGH = 0.5, 1.5
"""Times the mean gradient of a picture, below and above which a pixel is of low and of high texture."""

MOST_LEVEL, MOST_SLOPE = 1.0, 0.5
"""Standard deviations of the picture beyond which a difference of brightness, or of its slope along the row, costs no
more: what one camera does not see at all should not outweigh everything that both see."""

FLAT = 2.0
"""Grey levels of contrast below which a picture shows nothing but noise."""

WINDOWS = 2
"""How often a window is built about the same pixel, each time with shorter arms."""

EVERY_ROW = 4
"""Only every fourth row is matched, with windows over all rows: neighbouring rows share most of their windows."""

REDUCED_BY = 3
"""Times that any picture is reduced at least: it takes out the noise of sensors and codecs, and keeps matching small
pictures affordable beside `spatial`."""

AGREED_PX = 1
"""By how much the disparity may differ that is found from the other picture."""

TILES = (6, 8)
LEAST_PIXELS = 10
"""Rows and columns of tiles over whose agreement chance is told, and the pixels that a tile needs to count."""

Volume: TypeAlias = npt.NDArray[np.float32]
"""h x w x (2 reach + 1): what each disparity costs each pixel."""

Places: TypeAlias = npt.NDArray[np.int64]
Arm: TypeAlias = Annotated[int, Field(ge=0, le=100)]


class AdaptiveWindowSettings(CandidateSettings):
    """Adaptive-window stereo matching.

    working_width_px: pictures are reduced to this width first, and to a third of their own; CPU grows with its cube.
    reach: the largest disparity either way, as a share of the width.
    arms_px: how far a window may reach in high, medium and low texture, working pixels.
    colour_threshold: grey levels, of the colour that differs most, by which a pixel of a window may differ from its
    centre.
    """

    type: Literal["adaptive_window"] = "adaptive_window"
    working_width_px: int = Field(default=160, ge=32, le=640)
    reach: float = Field(default=0.15, gt=0, le=0.5)
    arms_px: tuple[Arm, Arm, Arm] = (3, 6, 10)
    colour_threshold: int = Field(default=20, ge=0, le=255)


@dataclass(frozen=True, slots=True)
class Small:
    """level: h x w, brightness less its mean, over its standard deviation, `contrast` grey levels.

    slope: its Sobel derivative along the row.
    """

    level: Floats
    slope: Floats
    contrast: float


@dataclass(frozen=True, slots=True)
class Windows:
    """The windows about every pixel: how far each arm reaches, h x w working pixels."""

    left: Places
    right: Places
    up: Places
    down: Places

    def shorter(self, times: int, of: int) -> Windows:
        """With arms of times / of the length, rounded up."""
        return Windows(*(-(-arm * times // of) for arm in (self.left, self.right, self.up, self.down)))


class AdaptiveWindowDetector(CandidateDetector):
    """Sync if the first camera's frame t can be matched to the second camera's frame t at the lowest cost.

    The report (sections 1.4.3 and 2.3): the Sobel operator gives the gradient of each pixel, which splits pixels into
    high, medium and low texture; matching windows are formed by arm length and colour threshold, arms by texture; by
    building windows repeatedly, pixels nearer to the centre get a higher weight. It speaks of matching two pictures and
    leaves open what is matched by which cost, every number, and how a frame is chosen.

    Filled in: a window is a cross whose vertical arm carries horizontal ones (Zhang, Lu, Lafruit 2009), built WINDOWS
    times with ever shorter arms; the cost is the truncated difference of brightness and of its slope, both free of
    exposure; a disparity, along the row only, is the one of lowest mean cost over the window; a pixel counts if for
    any candidate the same disparity is found from the other picture; the candidate of lowest mean cost wins, told as
    agreement (1 is no cost). Cameras are taken to stand side by side, rows to correspond, as in `spatial`.
    """

    measure: ClassVar[str] = "agreement"

    def __init__(self, settings: AdaptiveWindowSettings, *, name: str, rig: Rig) -> None:
        super().__init__(settings, name=name, rig=rig)
        self._settings = settings
        self._small: Memo[Small] = Memo(lambda frame: small(self._reduced(frame.image)))

    def enter(self, window: Window) -> None:
        self._small.enter(window)

    def compare(self, pair: Pair, first: Frame, candidates: Candidates) -> Scores | Silence:
        mine = self._small[first]
        if mine.contrast < FLAT:
            return Silence(f"a contrast of {mine.contrast:.1f} grey levels in {pair.first}", Reason.NO_TEXTURE)
        height, width = mine.level.shape
        slide = max(1, round(self._settings.reach * width))
        windows = grow(self._reduced(first.image), self._settings.arms_px, self._settings.colour_threshold)
        rows = np.arange(min(EVERY_ROW // 2, height - 1), height, EVERY_ROW)
        matched = {
            offset: match(aggregate(costs(mine, self._small[each], slide), windows, rows), slide)
            for offset, each in candidates.items()
        }
        confirmed = np.logical_or.reduce([both for _, both in matched.values()])
        tiles = TILES[0] * np.arange(len(rows))[:, None] // max(len(rows), 1) * TILES[1]
        tiles = (tiles + TILES[1] * np.arange(width) // width)[confirmed]
        count = np.bincount(tiles)
        counted = np.flatnonzero(count >= self._settings.least(LEAST_PIXELS))
        if not len(counted):
            return Silence("hardly a pixel finds the same match from both sides", Reason.NO_TEXTURE)
        return Scores.of_parts(
            {
                offset: 1 - np.bincount(tiles, cost[confirmed])[counted] / count[counted] / (MOST_LEVEL + MOST_SLOPE)
                for offset, (cost, _) in matched.items()
            }
        )

    def _reduced(self, image: Picture) -> Picture:
        return reduced(image, max(1, min(self._settings.working_width_px, image.shape[1] // REDUCED_BY)))


def small(image: Picture) -> Small:
    level = grey(image).astype(np.float32)
    mean, deviation = (float(value[0, 0]) for value in cv2.meanStdDev(level))
    level = (level - np.float32(mean)) / np.float32(max(deviation, FLAT))
    slope = cv2.Sobel(level, cv2.CV_32F, 1, 0, ksize=3, scale=0.25)
    return Small(level, np.asarray(slope, np.float32), deviation)


def grow(image: Picture, arms_px: Sequence[int], threshold: int) -> Windows:
    """The cross about every pixel of a grey or colour picture. arms_px: the longest for high, medium, low texture."""
    gradient = gradient_magnitude(image)
    mean = float(gradient.mean())
    texture = np.digitize(gradient, [LOW * mean, HIGH * mean])
    longest = np.asarray(arms_px[::-1])[texture]
    levels = np.atleast_3d(image).astype(np.int16)
    return Windows(
        left=_arm(levels[:, ::-1], longest[:, ::-1], threshold)[:, ::-1],
        right=_arm(levels, longest, threshold),
        up=_arm(levels.transpose(1, 0, 2)[:, ::-1], longest.T[:, ::-1], threshold)[:, ::-1].T,
        down=_arm(levels.transpose(1, 0, 2), longest.T, threshold).T,
    )


def _arm(levels: npt.NDArray[np.int16], longest: Places, threshold: int) -> Places:
    """How far each pixel's arm grows along its row."""
    length = np.zeros(longest.shape, np.int64)
    growing = np.ones(longest.shape, bool)
    for step in range(1, min(int(longest.max()), longest.shape[1] - 1) + 1):
        alike = np.abs(levels[:, step:] - levels[:, :-step]).max(axis=2) <= threshold
        growing[:, :-step] &= alike & (longest[:, :-step] >= step)
        growing[:, -step:] = False
        length += growing
    return length


def costs(first: Small, second: Small, slide: int) -> Volume:
    """What it costs to match the pixel x of `first` with x - d of `second`, for d from -slide to slide."""
    cost = _difference(first.level, second.level, slide, MOST_LEVEL)
    cost += _difference(first.slope, second.slope, slide, MOST_SLOPE)
    return cost


def _difference(first: Floats, second: Floats, slide: int, most: float) -> Volume:
    padded = np.pad(second, ((0, 0), (slide, slide)), constant_values=np.inf)
    views = np.lib.stride_tricks.sliding_window_view(padded, 2 * slide + 1, axis=1)[:, :, ::-1]
    difference = first[:, :, None] - views
    np.abs(difference, out=difference)
    return np.asarray(np.minimum(difference, np.float32(most), out=difference), np.float32)


def aggregate(cost: Volume, windows: Windows, rows: Places) -> Volume:
    """The mean cost over the windows about the pixels of some rows, pixels near the centre counting for more."""
    height, width, depth = cost.shape
    across = np.zeros((width + 1, height, depth), np.float32)
    for column in range(width):
        np.add(across[column], cost[:, column], out=across[column + 1])
    flat = across.reshape(-1, depth)
    x, down = np.arange(width), np.zeros((height + 1, width, depth), np.float32)
    top, total = rows[:, None], np.zeros((len(rows), width, depth), np.float32)
    for times in range(1, WINDOWS + 1):
        arms = windows.shorter(times, WINDOWS)
        area = np.zeros((height + 1, width), np.float32)
        np.cumsum(arms.left + arms.right + 1, axis=0, out=area[1:])
        for row in range(height):
            along = flat[(x + arms.right[row] + 1) * height + row]
            along -= flat[(x - arms.left[row]) * height + row]
            np.add(down[row], along, out=down[row + 1])
        above, below = top - arms.up[rows], top + arms.down[rows] + 1
        total += (down[below, x] - down[above, x]) / (area[below, x] - area[above, x])[:, :, None]
    total /= WINDOWS
    return total


def match(cost: Volume, slide: int) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """The lowest cost of each pixel, and whether the other picture's pixel finds its way back."""
    width = cost.shape[1]
    best = cost.argmin(axis=2)
    lowest = np.take_along_axis(cost, best[:, :, None], axis=2)[:, :, 0]
    steps = np.arange(2 * slide + 1)
    from_other = np.arange(width)[:, None] + steps - slide
    inside = (from_other >= 0) & (from_other < width)
    seen_from_other = np.where(inside, cost[:, np.clip(from_other, 0, width - 1), steps], np.inf)
    back = seen_from_other.argmin(axis=2)
    there = np.arange(width) - (best - slide)
    returned = np.take_along_axis(back, np.clip(there, 0, width - 1), axis=1)
    return lowest, (there >= 0) & (there < width) & (np.abs(returned - best) <= AGREED_PX)
