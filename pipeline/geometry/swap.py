"""Notices that the cameras of a pair were exchanged."""

from __future__ import annotations

import math
from collections import deque
from typing import Literal

import numpy as np

from pipeline.detectors.offset.arrays import Floats
from pipeline.geometry.look import LEAST_POINTS, Look

ALL = 0.95
"""Share of points that must lie on one side: a few matches are always wrong."""

LASTING = 4
"""Looks in a row that must agree."""

KNOWN = 8
"""Looks after which the side that points lie on is known."""

SURE_SIGMAS = 4.0
LEANING_SIGMAS = 1.5
USUAL_SPREAD = 0.3
"""Standard errors of a mean correlation that prove and that support; and the least spread of looks that is believed."""

LEAST_MOVED_PX = 0.5
LEAST_SPREAD_PX = 2.0
"""Motion, and range of disparities, without which near and far do not differ."""


class SwapWatch:
    """Asks several witnesses, for a rig may be built so that one of them misleads.

    Of parallel cameras, the first sees every point further right than the second; exchanged ones the other way round,
    but so do cameras that look towards each other, beyond where their views cross. And what is nearer moves more in the
    picture, whatever the cameras' angle; where it seems to move less, near and far were exchanged with the cameras.
    Of cameras carried by hand that shows slowly, since they turn as well; then it is enough if it leans that way and
    what is lower in the picture seems farther, which floors and roads are not.
    Or all points have changed sides during the run, which no scene does.
    """

    def __init__(self) -> None:
        self._sides: deque[int] = deque(maxlen=LASTING)
        self._usual: list[int] = []
        self._motions: deque[float] = deque(maxlen=4 * KNOWN)
        self._heights: deque[float] = deque(maxlen=4 * KNOWN)
        self.swapped = False

    def see(self, look: Look) -> None:
        """Takes the next look; `swapped` says what holds then."""
        side = _side(look)
        self._sides.append(side)
        if len(self._usual) < KNOWN and side:
            self._usual.append(side)
        _remember(self._motions, _by_motion(look))
        _remember(self._heights, _by_height(look))
        if len(self._sides) < LASTING or len(set(self._sides)) > 1 or side == 0:
            return
        if side > 0:
            self.swapped = False
        elif not self.swapped:
            self.swapped = self._has_flipped() or self._reversed()

    def _has_flipped(self) -> bool:
        return len(self._usual) >= KNOWN and all(side > 0 for side in self._usual)

    def _reversed(self) -> bool:
        """Whether far points move more than near ones, look for look, or seem to while what is low seems far."""
        motion, height = _sigmas(self._motions), _sigmas(self._heights)
        return motion < -SURE_SIGMAS or (motion < -LEANING_SIGMAS and height < -SURE_SIGMAS)


def _side(look: Look) -> Literal[-1, 0, 1]:
    """1: nearly all points lie further right in the first picture; -1: further left; 0: neither."""
    right = float((look.dx < 0).mean())
    return 1 if right >= ALL else -1 if right <= 1 - ALL else 0


def _by_motion(look: Look) -> float | None:
    """Rank correlation (Spearman) of disparity and motion; None where nothing can be told from it."""
    if look.moved is None:
        return None
    known = ~np.isnan(look.moved)
    if known.sum() < LEAST_POINTS // 2 or float(np.median(look.moved[known])) < LEAST_MOVED_PX:
        return None
    return _rank_correlation(-look.dx[known], look.moved[known])


def _by_height(look: Look) -> float | None:
    """Rank correlation of disparity and place down the picture."""
    return _rank_correlation(-look.dx, look.v)


def _rank_correlation(disparity: Floats, other: Floats) -> float | None:
    """None where disparities are all alike."""
    if float(np.subtract(*np.percentile(disparity, [90, 10]))) < LEAST_SPREAD_PX:
        return None
    ranks = [values.argsort().argsort().astype(np.float64) for values in (disparity, other)]
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def _remember(looks: deque[float], value: float | None) -> None:
    if value is not None:
        looks.append(value)


def _sigmas(looks: deque[float]) -> float:
    """The mean of looks in its standard errors; 0 for too few."""
    if len(looks) < LASTING:
        return 0.0
    values = np.array(looks)
    error = max(float(values.std(ddof=1)), USUAL_SPREAD) / math.sqrt(len(values))
    return float(values.mean()) / error
