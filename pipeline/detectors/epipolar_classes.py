"""Classes of epipolar geometry: with which right frame is the geometry what it was before, t, t-1 or t+1?"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from functools import reduce
from typing import ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import Field

from pipeline.detectors.candidates import CandidateDetector, Candidates, Parts, Scores
from pipeline.detectors.keypoints import Keypoints, KeypointSettings, Places, keypoints_of, of_one_geometry, same
from pipeline.detectors.offset.silence import Silence
from pipeline.frame import Frame, Pair, Rig, Window
from pipeline.pictures import Memo
from pipeline.verdict import Reason

FEW = 24
"""Three times the matches that fix a fundamental matrix."""

WARM = 10
"""Windows of a class that must have gone by before their geometry counts."""

FARTHEST_PX = 3.0
"""Distance from its epipolar line beyond which a match is wrong anyway, and how wrong does not matter."""

FULL_RANK, EVEN, INFINITE, TIGHT_PX = 0.05, 0.5, 3.0, 0.5
"""Where classes part: the smallest singular value beside the largest; the second beside the largest; half widths from
the centre to an epipole; the median distance of matches from their epipolar lines."""

LEAST_ERROR_PX = 0.02
"""No mean over matches is known better: in a scene where nothing moves, corners go astray alike in all windows."""

Matrix: TypeAlias = npt.NDArray[np.float64]
Rays: TypeAlias = npt.NDArray[np.float64]
"""n x 3: homogeneous image positions, from the centre, in half widths."""


class EpipolarClassesSettings(KeypointSettings):
    """Classes of epipolar geometry. history: how many windows are remembered."""

    type: Literal["epipolar_classes"] = "epipolar_classes"
    history: int = Field(default=60, ge=2 * WARM, le=1000)


class GeometryClass(NamedTuple):
    """The class of a fundamental matrix.

    full_rank: it has no epipole, so no rigid scene explains the matches. even: its two singular values are of a size.
    first_infinite, second_infinite: the epipole of that picture is at infinity, the cameras are side by side.
    tight: matches lie tightly on their epipolar lines.
    """

    full_rank: bool
    even: bool
    first_infinite: bool
    second_infinite: bool
    tight: bool


class Geometry(NamedTuple):
    """What is kept of a candidate. moments: 9 x 9, of the epipolar constraint over its matches."""

    kind: GeometryClass
    moments: Matrix


class Matched(NamedTuple):
    """A candidate's matches: which keypoints of the first (n), and the rays to them in both pictures."""

    here: Places
    first: Rays
    second: Rays
    geometry: Geometry


class EpipolarClassesDetector(CandidateDetector):
    """Sync if the matches with frame t lie best on the epipolar lines that frames t have had before.

    The report (section 1.4.1): fundamental matrix, epipoles and epipolar lines are extracted from stereo pictures and
    classified, the matrix by its rank or singular values for instance; a frame is in sync if its parameters, compared
    with those of the preceding frame, say so. It names neither the other classes nor the comparison.

    Filled in: matches are ORB's; the matrix is fitted to those that agree on one, without forcing its rank. Classes are
    those of `GeometryClass`. Each candidate, t-1, t and t+1, has a history of its own, for a rig has the same geometry
    in every frame only where its pictures are of the same moment: the wrong candidates' changes with whatever moves.
    The epipolar lines are those of one matrix for all windows of the class that is the most frequent in it; of matches
    that all candidates share, the mean distance to them, told as a negative fit in working pixels, decides. Its chance
    includes how far two halves of the history disagree. Of which class the candidate itself is in this window does not
    decide: by the matches of one window, wrong candidates are of their usual class nearly as often as the right one.
    Abstains while that class has been seen in fewer than WARM windows. Set to answer always, it takes what there is: in
    the first window each candidate's own geometry, and only the candidates that have one.
    """

    measure: ClassVar[str] = "fit"

    def __init__(self, settings: EpipolarClassesSettings, *, name: str, rig: Rig) -> None:
        super().__init__(settings, name=name, rig=rig)
        self._settings, self._few = settings, settings.least(FEW)
        self._keypoints: Memo[Keypoints] = Memo(lambda frame: keypoints_of(frame, settings))
        self._histories: dict[tuple[str, int], deque[Geometry]] = {
            (pair.name, offset): deque(maxlen=settings.history) for pair in rig.pairs for offset in (0, 1, -1)
        }

    def enter(self, window: Window) -> None:
        self._keypoints.enter(window)

    def compare(self, pair: Pair, first: Frame, candidates: Candidates) -> Scores | Silence:
        corners = len(self._keypoints[first].at)
        if corners < self._few:
            return Silence(f"{corners} corners in {pair.first}, fewer than {self._few}", Reason.NO_TEXTURE)
        half_px = min(first.image.shape[1], self._settings.working_width_px) / 2
        found = {offset: self._match(first, each, half_px) for offset, each in candidates.items()}
        matched = {offset: each for offset, each in found.items() if each is not None}
        histories = {offset: self._histories[pair.name, offset] for offset in matched}
        said: Scores | Silence = Silence(f"fewer than {self._few} corners match in one geometry", Reason.NO_OVERLAP)
        if len(matched) == len(candidates) or (matched and self._always):
            said = self._compare(matched, histories, half_px)
        for offset, each in matched.items():
            histories[offset].append(each.geometry)
        return said

    def _match(self, first: Frame, second: Frame, half_px: float) -> Matched | None:
        mine, theirs = self._keypoints[first], self._keypoints[second]
        here, there = same(mine, theirs, self._settings.ratio)
        agree = of_one_geometry(mine.at[here], theirs.at[there], self._settings.within_px)
        if int(agree.sum()) < self._few:
            return None
        height, width = first.image.shape[:2]
        centre = np.array([1.0, height / width])
        one, other = (
            np.column_stack([keys.at[places] / half_px - centre, np.ones(len(places))])
            for keys, places in ((mine, here), (theirs, there))
        )
        moments = moments_of(one[agree], other[agree])
        kind = classify(fitted([moments]), one[agree], other[agree], half_px)
        return Matched(here, one, other, Geometry(kind, moments))

    def _compare(
        self, matched: Mapping[int, Matched], histories: Mapping[int, Sequence[Geometry]], half_px: float
    ) -> Scores | Silence:
        shared = reduce(np.intersect1d, [each.here for each in matched.values()])
        if len(shared) < self._few:
            return Silence(f"{len(shared)} corners match in all candidates, fewer than {self._few}", Reason.NO_OVERLAP)
        parts, errors = {}, {}
        for offset, each in matched.items():
            kinds = Counter(one.kind for one in histories[offset])
            usual, count = kinds.most_common(1)[0] if kinds else (each.geometry.kind, 0)
            if count < WARM and not self._always:
                return Silence(f"{count} windows seen of one class of geometry, {WARM} needed", Reason.WARMING_UP)
            past = [one.moments for one in histories[offset] if one.kind == usual] or [each.geometry.moments]
            rows = np.searchsorted(each.here, shared)
            whole, *halves = (
                np.minimum(distances(fitted(of), each.first[rows], each.second[rows]) * half_px, FARTHEST_PX)
                for of in (past, past[::2], past[1::2] or past)
            )
            parts[offset] = -whole
            errors[offset] = max(abs(float(halves[0].mean() - halves[1].mean())) / 2, LEAST_ERROR_PX)
        return Scores.of_parts(parts, errors)


def moments_of(first: Rays, second: Rays) -> Matrix:
    """9 x 9: of the terms of second' F first = 0 over all matches."""
    terms = (second[:, :, None] * first[:, None, :]).reshape(-1, 9)
    return np.asarray(terms.T @ terms)


def fitted(moments: Sequence[Matrix]) -> Matrix:
    """3 x 3: the F of the least sum of squares of second' F first over the matches of some windows, of any rank."""
    return np.asarray(np.linalg.eigh(np.sum(moments, axis=0))[1][:, 0].reshape(3, 3))


def distances(matrix: Matrix, first: Rays, second: Rays) -> Parts:
    """N: how far matches lie from their epipolar lines in both pictures, to first order (Sampson 1982)."""
    lines, lines_back = first @ matrix.T, second @ matrix
    steepness = (lines[:, :2] ** 2).sum(axis=1) + (lines_back[:, :2] ** 2).sum(axis=1)
    return np.asarray(np.abs((second * lines).sum(axis=1)) / np.sqrt(np.maximum(steepness / 2, 1e-12)))


def classify(matrix: Matrix, first: Rays, second: Rays, half_px: float) -> GeometryClass:
    left, values, right = np.linalg.svd(matrix)
    return GeometryClass(
        full_rank=bool(values[2] > FULL_RANK * values[0]),
        even=bool(values[1] > EVEN * values[0]),
        first_infinite=_is_infinite(right[2]),
        second_infinite=_is_infinite(left[:, 2]),
        tight=bool(np.median(distances(matrix, first, second)) * half_px < TIGHT_PX),
    )


def _is_infinite(epipole: Matrix) -> bool:
    return bool(np.hypot(epipole[0], epipole[1]) > INFINITE * abs(epipole[2]))
