"""Notices that the cameras of a pair were exchanged."""

from __future__ import annotations

from collections import deque
from typing import Literal

import numpy as np

from pipeline.geometry.look import LEAST_POINTS, Look

ALL = 0.95
"""Share of points that must lie on one side: a few matches are always wrong."""

LASTING = 4
"""Looks in a row that must agree."""

KNOWN = 8
"""Looks after which the side that points lie on is known."""

SURE_SIGMAS = 4.0
USUAL_SPREAD = 0.3
"""Standard errors of the mean correlation, and the least spread of single looks that is believed."""

LEAST_MOVED_PX = 0.5
LEAST_SPREAD_PX = 2.0
"""Motion, and range of disparities, without which near and far do not differ."""


class SwapWatch:
    """Asks two witnesses, for a rig may be built so that one of them misleads.

    Of parallel cameras, the first sees every point further right than the second; exchanged ones the other way round,
    but so do cameras that look towards each other, beyond where their views cross. And what is nearer moves more in the
    picture, whatever the cameras' angle; where it seems to move less, near and far were exchanged with the cameras.
    Or all points have changed sides during the run, which no scene does.
    """

    def __init__(self) -> None:
        self._sides: deque[int] = deque(maxlen=LASTING)
        self._usual: list[int] = []
        self._orders: deque[float] = deque(maxlen=4 * KNOWN)
        self.swapped = False

    def see(self, look: Look) -> None:
        """Takes the next look; `swapped` says what holds then."""
        side = _side(look)
        self._sides.append(side)
        if len(self._usual) < KNOWN and side:
            self._usual.append(side)
        order = _order(look)
        if order is not None:
            self._orders.append(order)
        if len(self._sides) < LASTING or len(set(self._sides)) > 1 or side == 0:
            return
        if side > 0:
            self.swapped = False
        elif not self.swapped:
            self.swapped = self._has_flipped() or self._reversed()

    def _has_flipped(self) -> bool:
        return len(self._usual) >= KNOWN and all(side > 0 for side in self._usual)

    def _reversed(self) -> bool:
        """Whether far points move more than near ones, look for look."""
        if len(self._orders) < LASTING:
            return False
        orders = np.array(self._orders)
        error = max(float(orders.std(ddof=1)), USUAL_SPREAD) / len(orders) ** 0.5
        return bool(float(orders.mean()) < -SURE_SIGMAS * error)


def _side(look: Look) -> Literal[-1, 0, 1]:
    """1: nearly all points lie further right in the first picture; -1: further left; 0: neither."""
    right = float((look.dx < 0).mean())
    return 1 if right >= ALL else -1 if right <= 1 - ALL else 0


def _order(look: Look) -> float | None:
    """Rank correlation (Spearman) of disparity and motion; None where nothing can be told from it."""
    if look.moved is None:
        return None
    known = ~np.isnan(look.moved)
    if known.sum() < LEAST_POINTS // 2 or float(np.median(look.moved[known])) < LEAST_MOVED_PX:
        return None
    disparity = -look.dx[known]
    if float(np.subtract(*np.percentile(disparity, [90, 10]))) < LEAST_SPREAD_PX:
        return None
    ranks = [values.argsort().argsort().astype(np.float64) for values in (disparity, look.moved[known])]
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])
