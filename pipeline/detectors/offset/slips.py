"""Notices slips: the latest windows, asked one by one which offset explains them."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from pipeline.detectors.offset.arrays import Floats, Mask
from pipeline.detectors.offset.blocks import Block
from pipeline.detectors.offset.regression import Fit, profile

RECENT = 3
"""Windows that must agree before a slip is believed: one may be a bad picture, two a coincidence."""

SLIP_FRAMES = 0.6
"""Rigs slip by whole frames; a smaller change is followed by the window itself, and between two frames the profile of
a few windows wanders by up to a half where motion is curved."""

GAIN = 20.0
"""Log likelihood by which a slip must fit better: twenty points' worth, which a handful of false tracks cannot give."""

GRID = np.arange(-1.5, 1.51, 0.5)
"""Offsets that are compared, in frames from the pairing: motion is known from a frame before to a frame after."""


class Slips:
    """The cost of each offset, window by window, since the pairing of pictures changed."""

    def __init__(self, remember: int) -> None:
        self._profiles: deque[tuple[int, Floats]] = deque(maxlen=remember)

    def clear(self) -> None:
        self._profiles.clear()

    def add(self, block: Block, fit: Fit) -> None:
        taus = np.append(block.lag + GRID, fit.tau)
        self._profiles.append((len(block.u), profile(block, fit, taus)))

    def margin(self, lag: int, fit: Fit) -> float:
        """Log likelihood by which the best offset elsewhere is worse than that of `fit`."""
        if len(self._profiles) < 2:
            return 0.0
        gains = np.sum([costs[:-1] - costs[-1] for _, costs in self._profiles], axis=0)
        return float(gains[_elsewhere(lag, fit)].min())

    def found(self, lag: int, fit: Fit) -> tuple[int, float] | None:
        """How many of the latest windows come after a slip, and to which offset; None if there was none.

        After a slip points fit as before it, or nearer to that than to the old offset; curved motion fits nowhere.
        """
        if len(self._profiles) < 2 * RECENT:
            return None
        seen = list(self._profiles)
        usual = sum(costs[-1] for _, costs in seen[:-RECENT]) / sum(points for points, _ in seen[:-RECENT])
        other = np.flatnonzero(_elsewhere(lag, fit))
        for recent in range(2, RECENT + 1):
            latest = seen[-recent:]
            points = sum(count for count, _ in latest)
            gains = np.array([costs[-1] - costs[:-1] for _, costs in latest])
            total = gains.sum(axis=0)
            best = int(other[total[other].argmax()])
            after = sum(costs[best] for _, costs in latest)
            each = bool((gains[:, best] > GAIN / 10).all())
            if total[best] > GAIN and each and after < usual * points + total[best]:
                return recent, float(lag + GRID[best])
        return None


def _elsewhere(lag: int, fit: Fit) -> Mask:
    return np.asarray(np.abs(lag + GRID - fit.tau) >= SLIP_FRAMES, np.bool_)


def refill(slips: Slips, blocks: Sequence[Block], fit: Fit) -> None:
    """Starts over with the windows after a slip."""
    slips.clear()
    for block in blocks:
        slips.add(block, fit)
