"""One look at a pair: points that both cameras see, how they are displaced, and how they move."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.detectors.offset.arrays import Floats, Points
from pipeline.detectors.offset.matching import equalised, search
from pipeline.detectors.offset.tracks import follow
from pipeline.detectors.offset.working import Working, work_on
from pipeline.frame import Frame, Picture

WIDTH_PX = 640
"""Width of the pictures that are compared: a tenth of a degree of roll moves their edges by half a pixel."""

LEAST_POINTS = 20
"""Points below which a look tells nothing: four terms of a displacement field, five times over."""


@dataclass(frozen=True, slots=True)
class Look:
    """n points of the first camera.

    u, v: n, place across and down from the middle, in half widths. dx, dy: n, displacement to the second camera's
    picture, px. moved: n, px to where the point was a frame before, NaN where it was lost; or None. half_px: half width
    of the pictures compared; scale: recorded pixels in one of theirs.
    """

    u: Floats
    v: Floats
    dx: Floats
    dy: Floats
    moved: Floats | None
    half_px: float
    scale: float


def look_at(first: Frame, second: Frame, before: Frame | None) -> Look | None:
    """A look, or None where too few points are seen by both. before: the first camera's frame before."""
    here, there = work_on(first.image, WIDTH_PX), work_on(second.image, WIDTH_PX)
    at, found = seen_by_both(here, there)
    if len(at) < LEAST_POINTS:
        return None
    height, width = here.image.shape
    half_px = width / 2
    middle = np.array([width - 1, height - 1]) / 2
    place = (at - middle) / half_px
    displacement = (found - at).astype(np.float64)
    return Look(
        u=place[:, 0].astype(np.float64),
        v=place[:, 1].astype(np.float64),
        dx=displacement[:, 0],
        dy=displacement[:, 1],
        moved=None if before is None else _moved(here, work_on(before.image, WIDTH_PX), at),
        half_px=half_px,
        scale=first.image.shape[1] / width,
    )


def seen_by_both(first: Working, second: Working) -> tuple[Points, Points]:
    """Places (n x 2 each) of corners in the first picture and in the second, whatever the cameras' poses."""
    image, other = _of_one_size(first.image, equalised(second, first))
    at, guess = search(image, other)
    found, kept = follow(image, other, at, at + guess)
    return at[kept], found[kept]


def _of_one_size(first: Picture, second: Picture) -> tuple[Picture, Picture]:
    """Both, the smaller one continued at its lower and right edges: points are followed in pictures of one size."""
    height, width = (max(one, other) for one, other in zip(first.shape, second.shape, strict=True))

    def grown(image: Picture) -> Picture:
        down, right = height - image.shape[0], width - image.shape[1]
        return np.asarray(cv2.copyMakeBorder(image, 0, down, 0, right, cv2.BORDER_REPLICATE), np.uint8)

    return (first, second) if first.shape == second.shape else (grown(first), grown(second))


def _moved(here: Working, before: Working, at: Points) -> Floats | None:
    if before.image.shape != here.image.shape:
        return None
    there, kept = follow(here.image, before.image, at, at)
    moved: Floats = np.hypot(*(there - at).T.astype(np.float64))
    moved[~kept] = np.nan
    return moved
