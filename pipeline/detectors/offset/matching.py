"""Finds the points of one camera in the picture of another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from pipeline.detectors.keypoints import keypoints, same
from pipeline.detectors.offset.arrays import Ints, Points
from pipeline.detectors.offset.tracks import follow
from pipeline.detectors.offset.working import Working
from pipeline.frame import Picture

FEW = 12
"""Fewer matches cannot fix eight terms of geometry and still tell a time from it."""

NEIGHBOURS = 3
"""The median of three neighbours' disparities survives one of them being wrong or on another surface."""

SEARCH_EVERY = 10
"""Windows between two searches by descriptors while they fail: they cost as much as several ordinary windows."""

FEATURES = 700
"""Descriptors a picture for a search: enough that a fifth of overlap leaves the FEW."""

RATIO = 0.85
"""A descriptor match must beat the second best by this factor (Lowe 2004 uses 0.8; wrong ones fall to the model)."""

EPIPOLAR_PX = 2.0
"""Distance to the epipolar line within which a descriptor match counts: corners are found to about a pixel, and the
pictures may be a frame apart."""


@dataclass(frozen=True, slots=True)
class Matches:
    """Which tracks were found in the other picture, and by how much they are displaced there.

    rows: n indices into the tracks. displacement: n x 2, pixels of the common working scale.
    """

    rows: Ints
    displacement: Points


NOTHING = Matches(np.empty(0, np.int64), np.empty((0, 2), np.float32))


class Matcher:
    """Lucas-Kanade across the cameras, started from remembered disparities; by ORB where there are none."""

    def __init__(self) -> None:
        self._remember(np.empty(0, np.int64), np.empty((0, 2), np.float32), np.empty((0, 2), np.float32))
        self._wait = 0
        self.overlap = True

    def match(self, ids: Ints, at: Points, first: Working, second: Working) -> Matches:
        """Points `at` of `first` in `second`, forth and back."""
        image, other = of_one_size(first.image, equalised(second, first))
        matches = self._track(ids, at, image, other)
        self._wait -= 1
        if len(matches.rows) < max(FEW, 0.3 * len(ids)) and self._wait < 0:
            self._wait = SEARCH_EVERY
            found = search(image, other)
            self.overlap = len(found[0]) >= FEW
            if self.overlap:
                self._remember(np.full(len(found[0]), -1, np.int64), *found)
                again = self._track(ids, at, image, other)
                matches = max(matches, again, key=lambda m: len(m.rows))
        if len(matches.rows) >= FEW:
            self._remember(ids[matches.rows], at[matches.rows], matches.displacement)
            self.overlap = True
        return matches

    def start_from(self, other: Matcher) -> None:
        """Takes over another's disparities, if it has none of its own: near enough to spare a search."""
        if len(self._ids) < NEIGHBOURS:
            self._remember(other._ids, other._at, other._displacement)

    def _track(self, ids: Ints, at: Points, first: Picture, second: Picture) -> Matches:
        if len(ids) == 0 or len(self._ids) < NEIGHBOURS:
            return NOTHING
        there, found = follow(first, second, at, at + self._guess(ids, at))
        rows = np.flatnonzero(found)
        return Matches(rows, there[rows] - at[rows])

    def _guess(self, ids: Ints, at: Points) -> Points:
        """N x 2: each point's own last displacement, or the median of its nearest neighbours'."""
        guess = np.empty_like(at)
        place = np.minimum(np.searchsorted(self._sorted, ids), len(self._ids) - 1)
        remembered = self._order[place]
        mine = self._ids[remembered] == ids
        guess[mine] = self._displacement[remembered[mine]]
        new = np.flatnonzero(~mine)
        if len(new):
            squared = ((at[new, None] - self._at[None]) ** 2).sum(axis=2)
            nearest = np.argpartition(squared, NEIGHBOURS - 1, axis=1)[:, :NEIGHBOURS]
            guess[new] = np.median(self._displacement[nearest], axis=1)
        return guess

    def _remember(self, ids: Ints, at: Points, displacement: Points) -> None:
        self._ids, self._at, self._displacement = ids, at, displacement
        self._order = np.argsort(ids, kind="stable")
        self._sorted = ids[self._order]


def of_one_size(first: Picture, second: Picture) -> tuple[Picture, Picture]:
    """Both pictures as large as the larger of them, continued at the right and at the bottom; points stay in place."""
    height, width = max(first.shape[0], second.shape[0]), max(first.shape[1], second.shape[1])
    return _continued(first, height, width), _continued(second, height, width)


def _continued(picture: Picture, height: int, width: int) -> Picture:
    below, beside = height - picture.shape[0], width - picture.shape[1]
    if not below and not beside:
        return picture
    return np.asarray(cv2.copyMakeBorder(picture, 0, below, 0, beside, cv2.BORDER_REPLICATE), np.uint8)


def equalised(picture: Working, like: Working) -> Picture:
    """The picture with the brightness and contrast of another: exposures of two cameras need not agree."""
    gain = float(np.clip(like.deviation / max(picture.deviation, 1.0), 0.25, 4.0))
    if abs(gain - 1) < 0.02 and abs(picture.mean - like.mean) < 2:
        return picture.image
    return np.asarray(
        cv2.addWeighted(picture.image, gain, picture.image, 0.0, like.mean - gain * picture.mean), np.uint8
    )


def search(first: Picture, second: Picture) -> tuple[Points, Points]:
    """Positions and displacements (n x 2 each) of corners seen in both pictures, whatever the cameras' poses.

    ORB descriptors (Rublee et al. 2011), mutual best matches with a ratio test, kept where they agree on one epipolar
    geometry (RANSAC with the seven-point model).
    """
    mine, theirs = keypoints(first, FEATURES), keypoints(second, FEATURES)
    here, there = same(mine, theirs, RATIO)
    source, target = mine.at[here], theirs.at[there]
    empty = np.empty((0, 2), np.float32)
    if len(source) < FEW:
        return empty, empty
    inliers: Any = cv2.findFundamentalMat(source, target, cv2.FM_RANSAC, EPIPOLAR_PX, 0.99, 500)[1]
    if inliers is None:
        return empty, empty
    kept = inliers.ravel().astype(bool)
    if kept.sum() < 0.3 * len(kept):
        return empty, empty
    return source[kept], target[kept] - source[kept]
