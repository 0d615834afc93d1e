"""The report's Algorithm 3: which right frame do the left picture's edges match best, t, t-1 or t+1?"""

from __future__ import annotations

from typing import ClassVar, Literal

import cv2
import numpy as np

from pipeline.detectors.candidates import CandidateDetector, Candidates, CandidateSettings, Floats, Parts, Scores
from pipeline.detectors.offset.silence import Silence
from pipeline.frame import Frame, Pair, Rig, Window
from pipeline.pictures import Memo, gradient_magnitude, grey
from pipeline.verdict import Reason

BANDS = 24
"""Bands of rows whose correlations tell how far chance moves a correlation: 20 rows each in a VGA picture."""


class SpatialSettings(CandidateSettings):
    """The report's spatial test; what can be set is what the report leaves open or decides otherwise.

    picture: what is correlated, the gradient as in the report, or the plain grey picture.
    correlation: `plain` is the report's equation 3.1; `zero_mean` takes the means off first, so that two bright
    pictures are not alike for being bright.
    always_answer: as the report does; false abstains where the choice would be chance.
    """

    type: Literal["spatial"] = "spatial"
    picture: Literal["gradient", "grey"] = "gradient"
    correlation: Literal["plain", "zero_mean"] = "plain"
    always_answer: bool = True


class SpatialDetector(CandidateDetector):
    """Sync if the second camera's frame t correlates best with the first camera's frame t.

    The centre half (full height) of the first gradient is slid horizontally over the second camera's gradients of t,
    t-1 and t+1; the largest normalised cross-correlation wins (the report's equation 3.1), a tie goes to t. At the ends
    of a stream and beside holes the candidates are those that exist. It abstains only when it cannot compare: a frame
    of t is missing, sizes differ, or there is no edge at all to correlate.

    Source: the report, section 3.1.2 and Algorithm 3 (docs/classic-algorithm.md). Filled in: plain grey, zero-mean
    correlation, and what chance amounts to (the scatter of the correlation over bands of rows), all off by default.
    """

    measure: ClassVar[str] = "correlation"

    def __init__(self, settings: SpatialSettings, *, name: str, rig: Rig) -> None:
        super().__init__(settings, name=name, rig=rig)
        self._zero_mean = settings.correlation == "zero_mean"
        self._method = cv2.TM_CCOEFF_NORMED if self._zero_mean else cv2.TM_CCORR_NORMED
        self._what = "edges" if settings.picture == "gradient" else "contrast"
        gradient = settings.picture == "gradient"
        self._pictures: Memo[Floats] = Memo(
            lambda frame: gradient_magnitude(frame.image) if gradient else np.asarray(grey(frame.image), np.float32)
        )

    def enter(self, window: Window) -> None:
        self._pictures.enter(window)

    def compare(self, pair: Pair, first: Frame, candidates: Candidates) -> Scores | Silence:  # noqa: ARG002
        template = centre_half(self._pictures[first])
        width = template.shape[1]
        found = {
            offset: best_place(template, self._pictures[each], self._method) for offset, each in candidates.items()
        }
        if not any(score for score, _ in found.values()):
            return Silence(f"no {self._what} in the pictures", Reason.NO_TEXTURE)
        parts = (
            {}
            if self._always
            else {
                offset: by_bands(
                    template, self._pictures[candidates[offset]][:, x : x + width], zero_mean=self._zero_mean
                )
                for offset, (_, x) in found.items()
            }
        )
        return Scores({offset: score for offset, (score, _) in found.items()}, parts)


def centre_half(picture: Floats) -> Floats:
    """H x W/2: the middle columns, so that the template can slide a quarter of the width either way; one at least."""
    width = picture.shape[1]
    half = max(1, width // 2)
    start = (width - half) // 2
    return picture[:, start : start + half]


def best_place(template: Floats, picture: Floats, method: int) -> tuple[float, int]:
    """The best normalised cross-correlation over all horizontal positions, 0 where all is alike, and its column."""
    if method == cv2.TM_CCOEFF_NORMED and np.ptp(template) == 0:
        return 0.0, 0
    scores = np.asarray(cv2.matchTemplate(picture, template, method))
    best = float(scores.max())
    return (best, int(scores.argmax())) if np.isfinite(best) else (0.0, 0)


def by_bands(template: Floats, region: Floats, *, zero_mean: bool) -> Parts:
    """What each of BANDS bands of rows adds to the correlation of two pictures of a size, which is their mean."""
    if zero_mean:
        template, region = template - template.mean(), region - region.mean()
    energy = float(cv2.norm(template, cv2.NORM_L2)) * float(cv2.norm(region, cv2.NORM_L2))
    rows = (template * region).mean(axis=1, dtype=np.float64) * (template.size / max(energy, 1e-9))
    return np.array([band.mean() for band in np.array_split(rows, min(BANDS, len(rows)))])
