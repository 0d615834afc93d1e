"""Tries every lag in turn to find the one at which two cameras' pictures fit one rigid geometry best."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.detectors.offset.blocks import Block
from pipeline.detectors.offset.geometry import Memory, design
from pipeline.detectors.offset.matching import FEW, Matcher

A_WINDOW = 3
"""Lags tried in a window: +-10 frames are then seen twice within half a second at 30 Hz."""

VISITS = 2
"""One visit may fall on a moment without motion."""

WITHIN_PX = 0.3
"""Matches of the same moment lie this near to their epipolar line; motion takes the others away from it."""

BETTER = 1.15
"""Another lag must fit this much better: in a still scene all fit alike, and none may be preferred."""

Pairing = Callable[[int, Matcher], "Block | str"]


class Sweep:
    """Visits lags 0, 1, -1, 2, ... A lag's score is how many points agree with the rig's geometry at no offset."""

    def __init__(self, most: int) -> None:
        self._lags = sorted(range(-most, most + 1), key=lambda lag: (abs(lag), -lag))
        self._matchers = {lag: Matcher() for lag in self._lags}
        self._scores: dict[int, list[float]] = {lag: [] for lag in self._lags}

    @property
    def done(self) -> bool:
        return all(len(scores) >= VISITS for scores in self._scores.values())

    def visit(self, pairing: Pairing, known: Matcher, memory: Memory) -> None:
        """Tries the lags that were seen least among those that can be paired yet, from the disparities `known`."""
        tried = 0
        for lag in sorted(self._lags, key=lambda lag: len(self._scores[lag])):
            if tried == A_WINDOW or len(self._scores[lag]) >= VISITS:
                return
            self._matchers[lag].start_from(known)
            block = pairing(lag, self._matchers[lag])
            if block == "too short a history":
                continue
            tried += 1
            self._scores[lag].append(0.0 if isinstance(block, str) else agreement(block, memory))

    def best(self, lag: int) -> int:
        """The lag that fits clearly better than `lag`, or `lag` itself."""
        scores = {k: float(np.mean(v)) for k, v in self._scores.items()}
        top = max(scores, key=lambda k: (scores[k], -abs(k)))
        return top if scores[top] >= BETTER * scores[lag] + FEW / 2 else lag


def agreement(block: Block, memory: Memory) -> float:
    """How many of a block's points lie on one geometry, without any offset beyond the block's lag."""
    matrix = design(block.u, block.v, block.dx / block.width) * block.width
    terms = memory.terms
    residual = block.dy - matrix @ terms
    if memory.windows == 0:
        residual -= np.median(residual)
    for _ in range(6):
        spread = max(1.4826 * float(np.median(np.abs(residual))), WITHIN_PX)
        weight = 1 / (1 + (residual / spread) ** 2) / spread**2
        weighted = matrix * weight[:, None]
        normal = weighted.T @ matrix + memory.information
        terms = np.asarray(np.linalg.solve(normal, weighted.T @ block.dy + memory.vector), np.float64)
        residual = block.dy - matrix @ terms
    return float((1 / (1 + (residual / WITHIN_PX) ** 2)).sum())
