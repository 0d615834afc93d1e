"""The report's Algorithm 3: which right frame do the left picture's edges match best, t, t-1 or t+1?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.frame import Frame, Pair, Rig, Triple, Window
from pipeline.pictures import Memo, gradient_magnitude
from pipeline.settings import Settings
from pipeline.verdict import Basis, Evidence, State

BETWEEN_FRAMES = 0.25
"""An expected offset further than this from a whole number of frames cannot be judged in whole frames."""

Gradient = npt.NDArray[np.float32]


class SpatialSettings(Settings):
    """The report's spatial test has nothing to set."""

    type: Literal["spatial"] = "spatial"


class SpatialDetector:
    """Sync if the second camera's frame t correlates best with the first camera's frame t.

    For a staggered pair, the frame that it is expected to match takes the place of t.

    The centre half (full height) of the first gradient is slid horizontally over the second camera's gradients of t,
    t-1 and t+1; the largest normalised cross-correlation wins (the report's equation 3.1), a tie goes to t. At the ends
    of a stream and beside holes the candidates are those that exist. It abstains only when it cannot compare: a frame
    of t is missing, sizes differ, or there is no edge at all to correlate.

    Source: the report, section 3.1.2 and Algorithm 3 (docs/classic-algorithm.md).
    """

    def __init__(self, _: SpatialSettings, *, name: str, rig: Rig) -> None:
        self._name = name
        self._rig = rig
        self._gradients: Memo[Gradient] = Memo(lambda frame: gradient_magnitude(frame.image))

    def observe(self, window: Window) -> Sequence[Evidence]:
        self._gradients.enter(window)
        return [self._judge(pair, window) for pair in self._rig.pairs]

    def _judge(self, pair: Pair, window: Window) -> Evidence:
        first, triple = window.cameras[pair.first].current, window.cameras[pair.second]
        if first is None or triple.current is None:
            return self._abstain(pair, f"no frame of {pair.first if first is None else pair.second}")
        period_ns = self._rig.camera(pair.second).period_ns
        expected = pair.expected_offset_ns / period_ns
        if abs(expected - round(expected)) > BETWEEN_FRAMES:
            return self._abstain(pair, f"an expected offset of {expected:.2f} frames lies between whole frames")
        if first.image.shape[:2] != triple.current.image.shape[:2]:
            return self._abstain(pair, f"picture sizes differ: {_size(first)}, {_size(triple.current)}")
        template = centre_half(self._gradients[first])
        scores = self._scores(template, triple)
        if not any(scores.values()):
            return self._abstain(pair, "no edges in the pictures")
        winner = max(scores, key=lambda offset: (scores[offset], offset == 0))
        others = max((score for offset, score in scores.items() if offset != winner), default=None)
        margin = "" if others is None else f", next best {others:.4f}"
        return Evidence(
            pair=pair.name,
            detector=self._name,
            basis=Basis.CONTENT,
            state=State.SYNC if winner == round(expected) else State.ASYNC,
            reason=f"{pair.second} {MOMENT[winner]} matches best: {scores[winner]:.4f}{margin}",
            offset_ns=winner * period_ns,
            offset_frames=float(winner),
            numbers={f"correlation_{MOMENT[offset]}": score for offset, score in scores.items()},
        )

    def _scores(self, template: Gradient, triple: Triple) -> dict[int, float]:
        """Correlation by the offset each candidate would prove: if t-1 matches, the camera is a frame ahead."""
        candidates = {0: triple.current, 1: triple.previous, -1: triple.following}
        return {
            offset: correlation(template, self._gradients[frame])
            for offset, frame in candidates.items()
            if frame is not None
        }

    def _abstain(self, pair: Pair, reason: str) -> Evidence:
        return Evidence(pair=pair.name, detector=self._name, basis=Basis.CONTENT, state=State.UNKNOWN, reason=reason)


MOMENT = {0: "t", 1: "t-1", -1: "t+1"}


def _size(frame: Frame) -> str:
    height, width = frame.image.shape[:2]
    return f"{frame.camera} {width}x{height}"


def centre_half(gradient: Gradient) -> Gradient:
    """H x W/2: the middle columns, so that the template can slide a quarter of the width either way."""
    width = gradient.shape[1]
    start = (width - width // 2) // 2
    return gradient[:, start : start + width // 2]


def correlation(template: Gradient, gradient: Gradient) -> float:
    """The best normalised cross-correlation (equation 3.1) over all horizontal positions, 0 where there is no edge."""
    scores = np.asarray(cv2.matchTemplate(gradient, template, cv2.TM_CCORR_NORMED))
    best = float(scores.max())
    return best if np.isfinite(best) else 0.0
