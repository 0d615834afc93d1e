"""Template matching of corners with a weight a pixel: which right frame fits the left one, t, t-1 or t+1?"""

from __future__ import annotations

from typing import ClassVar, Literal, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from pipeline.detectors.candidates import CandidateDetector, Candidates, CandidateSettings, Floats, Parts, Scores
from pipeline.detectors.offset.silence import Silence
from pipeline.frame import Frame, Pair, Picture, Rig, Window
from pipeline.pictures import Memo, grey, reduced
from pipeline.verdict import Reason

RADIUS_PX = 5
"""Templates are 11 x 11 working pixels."""

QUALITY, SPACING_PX = 0.01, 8
"""A corner is at least this strong beside the strongest, and this far from the next."""

FEW = 12
"""Corners, fewer of which tell nothing."""

SOFT = 0.5
"""Difference of a pixel, in standard deviations of its template, at which its weight is a half."""

FLAT = 2.0
"""Grey levels: the contrast of a patch counts as at least this much, or noise would be blown up to a pattern."""

NEIGHBOURS, ASTRAY_PX = 5, 3.0
"""A match is astray whose disparity is further than this from the median of its nearest neighbours'."""

Places: TypeAlias = npt.NDArray[np.int64]
Mask: TypeAlias = npt.NDArray[np.bool_]


class WeightedTemplateSettings(CandidateSettings):
    """Weighted template matching.

    working_width_px: pictures are reduced to this width first; never enlarged.
    points: how many corners are matched at most; CPU grows with it.
    reach: the largest disparity either way, as a share of the width.
    """

    type: Literal["weighted_template"] = "weighted_template"
    working_width_px: int = Field(default=320, ge=80, le=1280)
    points: int = Field(default=100, ge=20, le=1000)
    reach: float = Field(default=0.15, gt=0, le=0.5)


class WeightedTemplateDetector(CandidateDetector):
    """Sync if templates about corners of the first camera's frame t fit the second camera's frame t best.

    The report (section 1.4.2): feature points are matched by templates, with an adaptive weighting factor that accounts
    for differences of intensity between template and target; matched points are triangulated, and outliers, points of
    mismatched coordinates, are removed. It gives no formula, and does not speak of synchronization.

    Filled in: patches are compared less their mean and over their deviation, so that exposure falls out; of what then
    differs, each pixel weighs 1 / (1 + (difference / SOFT)^2) (Cauchy), the similarity being the weighted correlation
    times the mean weight. A template slides along its row. In place of coordinates in space, whose calibration is not
    known, disparities are held against those of neighbours; a point that goes astray in every candidate is removed, as
    one that goes astray in some speaks against them. The candidate of the largest mean similarity wins. Rows are taken
    to correspond, as in `spatial`.
    """

    measure: ClassVar[str] = "similarity"

    def __init__(self, settings: WeightedTemplateSettings, *, name: str, rig: Rig) -> None:
        super().__init__(settings, name=name, rig=rig)
        self._points, self._reach, self._least = settings.points, settings.reach, settings.least(FEW)
        self._small: Memo[Picture] = Memo(lambda frame: reduced(grey(frame.image), settings.working_width_px))

    def enter(self, window: Window) -> None:
        self._small.enter(window)

    def compare(self, pair: Pair, first: Frame, candidates: Candidates) -> Scores | Silence:
        picture = self._small[first]
        at = corners(picture, self._points)
        if len(at) < self._least:
            return Silence(f"{len(at)} corners in {pair.first}, fewer than {self._least}", Reason.NO_TEXTURE)
        slide = max(1, round(self._reach * picture.shape[1]))
        templates = normalised(patches(picture, at, 0))
        matched = {
            offset: best_of(similarity(templates, normalised(patches(self._small[each], at, slide))))
            for offset, each in candidates.items()
        }
        kept = ~np.logical_and.reduce([astray(at, places) for _, places in matched.values()])
        if int(kept.sum()) < self._least:
            return Silence(f"{int(kept.sum())} corners are found again, fewer than {self._least}", Reason.NO_OVERLAP)
        return Scores.of_parts({offset: values[kept] for offset, (values, _) in matched.items()})


def corners(picture: Picture, most: int) -> Places:
    """N x 2, x then y: the strongest corners about which a template has room."""
    inner = np.zeros_like(picture)
    inner[RADIUS_PX:-RADIUS_PX, RADIUS_PX:-RADIUS_PX] = 255
    found = cv2.goodFeaturesToTrack(picture, most, QUALITY, SPACING_PX, mask=inner)
    return np.empty((0, 2), np.int64) if found is None else np.asarray(found.reshape(-1, 2), np.int64)


def patches(picture: Picture, at: Places, slide: int) -> Floats:
    """N x (2 slide + 1) x 121: the patches about n points, and about their neighbours along the row."""
    side = slide + RADIUS_PX
    padded = cv2.copyMakeBorder(picture, 0, 0, side, side, cv2.BORDER_REPLICATE)
    rows = at[:, 1, None] + np.arange(-RADIUS_PX, RADIUS_PX + 1)
    columns = at[:, 0, None] + np.arange(2 * side + 1)
    strips = padded[rows[:, :, None], columns[:, None, :]]
    views = np.lib.stride_tricks.sliding_window_view(strips, 2 * RADIUS_PX + 1, axis=2)
    return np.ascontiguousarray(views.transpose(0, 2, 1, 3), np.float32).reshape(len(at), 2 * slide + 1, -1)


def normalised(of_patches: Floats) -> Floats:
    """Less the mean of each patch, over its standard deviation."""
    centred = of_patches - of_patches.mean(axis=-1, keepdims=True)
    deviation = np.sqrt((centred * centred).mean(axis=-1, keepdims=True))
    return np.asarray(centred / np.maximum(deviation, FLAT), np.float32)


def similarity(templates: Floats, targets: Floats) -> Floats:
    """N x m for n templates (n x 1 x 121) and m targets of each (n x m x 121): 1 where they are the same."""
    weights = 1 / (1 + ((templates - targets) / SOFT) ** 2)
    weighted = weights * templates
    cross = (weighted * targets).sum(axis=-1)
    energies = (weighted * templates).sum(axis=-1) * (weights * targets * targets).sum(axis=-1)
    return np.asarray(cross / np.sqrt(np.maximum(energies, 1e-9)) * weights.mean(axis=-1), np.float32)


def best_of(similarities: Floats) -> tuple[Parts, Places]:
    """N: the largest similarity of each template, and at which of its targets."""
    places = similarities.argmax(axis=1)
    return np.take_along_axis(similarities, places[:, None], axis=1)[:, 0].astype(np.float64), places


def astray(at: Places, places: Places) -> Mask:
    """N: which points are displaced otherwise than their neighbours; a point without any is not."""
    if len(at) < 2:
        return np.zeros(len(at), bool)
    squared = ((at[:, None] - at[None]) ** 2).sum(axis=2)
    near = np.argsort(squared, axis=1, kind="stable")[:, 1 : NEIGHBOURS + 1]
    return np.asarray(np.abs(places - np.median(places[near], axis=1)) > ASTRAY_PX, bool)
