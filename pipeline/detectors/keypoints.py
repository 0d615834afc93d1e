"""Corners with binary descriptors, and which corners of two pictures are the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from pipeline.detectors.candidates import CandidateSettings
from pipeline.frame import Frame, Picture
from pipeline.pictures import grey, reduced

Points: TypeAlias = npt.NDArray[np.float32]
"""n x 2 image positions in working pixels, x then y."""

Places: TypeAlias = npt.NDArray[np.int64]
Mask: TypeAlias = npt.NDArray[np.bool_]

FAST_THRESHOLD = 7
"""Grey levels by which a corner's ring must differ: lower than OpenCV's 20, for dark and foggy pictures."""

ROOM_PX = 31
"""From the edges of a picture, where ORB seeks no corners."""

LEAST_MATCHES = 8
"""As many as a fundamental matrix takes that is fitted to more than it has unknowns."""

CONFIDENCE, ROUNDS = 0.99, 500
"""Of the search for one geometry: enough for half of the matches to be wrong."""


class KeypointSettings(CandidateSettings):
    """What methods on keypoints have in common.

    features: how many keypoints are sought in a picture.
    ratio: the nearest descriptor must be nearer than this times the second nearest.
    within_px: how far a match may lie from where the geometry of all has it, working pixels.
    working_width_px: pictures are reduced to this width first; never enlarged.
    """

    features: int = Field(default=500, ge=50, le=10_000)
    ratio: float = Field(default=0.8, gt=0, le=1)
    within_px: float = Field(default=1.0, gt=0, le=20)
    working_width_px: int = Field(default=640, ge=160, le=4096)


@dataclass(frozen=True, slots=True)
class Keypoints:
    """at: n x 2. descriptors: n x 32 bytes."""

    at: Points
    descriptors: Picture


def keypoints_of(frame: Frame, settings: KeypointSettings) -> Keypoints:
    return keypoints(reduced(grey(frame.image), settings.working_width_px), settings.features)


def keypoints(image: Picture, most: int) -> Keypoints:
    """The ORB keypoints of a grey picture (Rublee et al. 2011), whose smaller copies may not vanish."""
    if min(image.shape) <= 2 * ROOM_PX:
        return Keypoints(np.empty((0, 2), np.float32), np.empty((0, 32), np.uint8))
    found = cv2.ORB.create(most, edgeThreshold=ROOM_PX, fastThreshold=FAST_THRESHOLD).detectAndCompute(image, None)
    if not found[0]:
        return Keypoints(np.empty((0, 2), np.float32), np.empty((0, 32), np.uint8))
    return Keypoints(np.array([key.pt for key in found[0]], np.float32), np.asarray(found[1], np.uint8))


def same(first: Keypoints, second: Keypoints, ratio: float) -> tuple[Places, Places]:
    """Which keypoints match: their places in the first, ascending, and in the second.

    By Hamming distance: the nearest, which must be nearer than `ratio` times the second nearest (Lowe 2004), and whose
    own nearest must be the one it is matched with.
    """
    if min(len(first.at), len(second.at)) < 2:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    mine, theirs = first.descriptors, second.descriptors
    near, best = cv2.batchDistance(mine, theirs, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=2)
    _, back = cv2.batchDistance(theirs, mine, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=1)
    nearest = best[:, 0]
    here = np.flatnonzero((near[:, 0] < ratio * near[:, 1]) & (back[nearest, 0] == np.arange(len(nearest))))
    return here, np.asarray(nearest[here], np.int64)


def of_one_geometry(first: Points, second: Points, within_px: float) -> Mask:
    """Which matches (n x 2 each) agree on one fundamental matrix, as many as can be; none of too few.

    RANSAC with the scoring of MAGSAC++ (Barath et al. 2020). OpenCV draws from a fixed seed there, whatever its global
    generator has been set to: the same matches give the same answer.
    """
    nothing = np.zeros(len(first), bool)
    if len(first) < LEAST_MATCHES:
        return nothing
    try:
        found = cv2.findFundamentalMat(first, second, cv2.USAC_MAGSAC, within_px, CONFIDENCE, ROUNDS)
    except cv2.error:  # OpenCV 5.0 fails an assertion where no sample gives a model
        return nothing
    inliers: Any = found[1]  # None where there is none, which OpenCV's types do not say
    return nothing if inliers is None else np.asarray(inliers.ravel(), bool)
