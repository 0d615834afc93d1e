"""ORB: which right frame do the left picture's corners match most consistently, t, t-1 or t+1?"""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from pipeline.detectors.candidates import CandidateDetector, Candidates, Parts, Scores
from pipeline.detectors.keypoints import Keypoints, KeypointSettings, Mask, Points, keypoints_of, of_one_geometry, same
from pipeline.detectors.offset.silence import Silence
from pipeline.frame import Frame, Pair, Rig, Window
from pipeline.pictures import Memo
from pipeline.verdict import Reason

FEW = 20
"""Consistent matches that at least one candidate must have: a dozen of any two pictures are so by chance."""


class OrbSettings(KeypointSettings):
    """ORB matching.

    geometry: what matches must agree on. `rows`: on how many rows the second camera sees everything higher or lower,
    as cameras do that stand side by side. `epipolar`: on any one epipolar geometry, for cameras turned towards each
    other; more can be explained by it, wrong candidates too.
    """

    type: Literal["orb"] = "orb"
    geometry: Literal["rows", "epipolar"] = "rows"


class OrbDetector(CandidateDetector):
    """Sync if the first camera's frame t has the most consistent matches with the second camera's frame t.

    The report (section 1.4.4): oriented FAST keypoints with rotated BRIEF descriptors, matched by Hamming distance, as
    a cheap alternative to SIFT and SURF. It says nothing of synchronization.

    Filled in: ratio test and cross check; a match counts if it agrees with the others of its candidate on one geometry
    of the two cameras; the candidate with the largest share of the first's keypoints so matched wins. All three
    geometries are sought anew in every window, so that what moves the whole picture at once is explained away.
    """

    measure: ClassVar[str] = "consistent"

    def __init__(self, settings: OrbSettings, *, name: str, rig: Rig) -> None:
        super().__init__(settings, name=name, rig=rig)
        self._settings = settings
        self._keypoints: Memo[Keypoints] = Memo(lambda frame: keypoints_of(frame, settings))

    def enter(self, window: Window) -> None:
        self._keypoints.enter(window)

    def compare(self, pair: Pair, first: Frame, candidates: Candidates) -> Scores | Silence:
        mine, least = self._keypoints[first], self._settings.least(FEW)
        if len(mine.at) < least:
            return Silence(f"{len(mine.at)} corners in {pair.first}, fewer than {least}", Reason.NO_TEXTURE)
        parts = {offset: self._consistent(mine, self._keypoints[each]) for offset, each in candidates.items()}
        most = max(int(each.sum()) for each in parts.values())
        if most < least:
            return Silence(f"at most {most} corners match, fewer than {least}", Reason.NO_OVERLAP)
        return Scores.of_parts(parts)

    def _consistent(self, mine: Keypoints, theirs: Keypoints) -> Parts:
        """A number for every keypoint of the first: 1 where it has a match that agrees with the others."""
        here, there = same(mine, theirs, self._settings.ratio)
        agree = in_rows if self._settings.geometry == "rows" else of_one_geometry
        consistent = np.zeros(len(mine.at))
        consistent[here[agree(mine.at[here], theirs.at[there], self._settings.within_px)]] = 1.0
        return consistent


def in_rows(first: Points, second: Points, within_px: float) -> Mask:
    """Which matches (n x 2 each) lie as many rows apart as most do."""
    if not len(first):
        return np.zeros(0, bool)
    apart = second[:, 1] - first[:, 1]
    return np.asarray(np.abs(apart - np.median(apart)) <= within_px, bool)
