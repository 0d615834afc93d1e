"""Learns how far the error of an estimate is underrated, from how the estimate wanders while a rig does not change."""

from __future__ import annotations

from collections import deque

import numpy as np

ENOUGH = 6
"""Independent estimates before their scatter says anything: a line through them leaves four."""

REMEMBERED = 40
"""Independent estimates remembered: about half a minute at 30 Hz, as long as the geometry."""


class Drift:
    """Scatter of estimates around a straight line (a free-running camera drifts, that is no error), in their errors."""

    def __init__(self, apart: int) -> None:
        self._apart = apart
        self._seen: deque[tuple[int, float, float]] = deque(maxlen=REMEMBERED)
        self.factor = 1.0

    @property
    def calibrated(self) -> bool:
        return len(self._seen) >= ENOUGH

    def add(self, index: int, tau: float, sigma: float) -> None:
        """An estimate at a window; only those `apart` windows or more from the last share no pictures with it."""
        if self._seen and index - self._seen[-1][0] < self._apart:
            return
        if self._seen and abs(tau - self._seen[-1][1]) > 0.5:
            self._seen.clear()
        self._seen.append((index, tau, sigma))
        if not self.calibrated:
            return
        at, taus, sigmas = np.array(self._seen).T
        columns = np.column_stack([np.ones_like(at), at - at.mean()]) / sigmas[:, None]
        rest = taus / sigmas - columns @ np.linalg.lstsq(columns, taus / sigmas, rcond=None)[0]
        usual = 1.4826 * float(np.median(np.abs(rest))) * np.sqrt(len(at) / (len(at) - 2))
        self.factor = max(1.0, float(usual))
