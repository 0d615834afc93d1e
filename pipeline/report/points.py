"""Points that both cameras see at one moment, and where they would be had the second picture been taken in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.detectors.offset.arrays import Points
from pipeline.detectors.offset.tracks import corners, follow, spacing, uncrowded
from pipeline.detectors.offset.working import Working, work_on
from pipeline.frame import Picture
from pipeline.geometry.look import seen_by_both
from pipeline.report.moments import WIDTH_PX, Moment

MOVING_PX = 1.0
"""Points of the second camera alone are drawn where they moved that far during the offset."""

SHOWN_POINTS = 45
"""Points that are drawn: enough to see a pattern, few enough to tell apart."""


@dataclass(frozen=True, slots=True)
class Compared:
    """Points, px of the pictures that are kept.

    first: n x 2, in the first picture. second: m x 2, in the second; its first n are the same points, the others were
    seen to move there. moved: m x 2, where they would be in the second picture had it been taken at the first one's
    moment: each moved back by its own speed times the offset; NaN where its speed is not known.
    """

    first: Points
    second: Points
    moved: Points

    @property
    def lengths(self) -> Points:
        """How far the points moved during the offset, px, of those whose speed is known."""
        length = _length(self.second - self.moved)
        return np.asarray(length[np.isfinite(length)], np.float32)


def compare(moment: Moment, period_ns: int) -> Compared:
    """The points of a moment. period_ns: the second camera's."""
    here, there = work_on(moment.first, WIDTH_PX), work_on(moment.second, WIDTH_PX)
    first, second = seen_by_both(here, there)
    keep = uncrowded(first, spacing(here.image, SHOWN_POINTS))
    first, second = first[keep], second[keep]
    frames = np.float32((moment.verdict.offset_ns or 0) / period_ns)
    moved = second - _speed(moment, there, second) * frames
    if moment.before is None or moment.before.shape != moment.second.shape:
        return Compared(first, second, moved)
    others = corners(there.image, work_on(moment.before, WIDTH_PX).image, second, SHOWN_POINTS)
    back = others - _speed(moment, there, others) * frames
    mover = _length(others - back) >= MOVING_PX
    return Compared(first, np.concatenate([second, others[mover]]), np.concatenate([moved, back[mover]]))


def _length(steps: Points) -> Points:
    return np.asarray(np.hypot(steps[:, 0], steps[:, 1]), np.float32)


def _speed(moment: Moment, now: Working, at: Points) -> Points:
    """N x 2: px a frame, by central difference where both neighbours know the point."""
    past, future = _steps(moment.before, now, at), _steps(moment.after, now, at)
    known = np.isfinite(past).astype(np.float32) + np.isfinite(future)
    total = np.nan_to_num(future) - np.nan_to_num(past)
    return np.asarray(np.divide(total, known, out=np.full_like(total, np.nan), where=known > 0), np.float32)


def _steps(neighbour: Picture | None, now: Working, at: Points) -> Points:
    """N x 2: how far each point is from its place in a neighbouring frame; NaN where it is not found there."""
    if neighbour is None or neighbour.shape[:2] != now.image.shape or not len(at):
        return np.full_like(at, np.nan)
    there, found = follow(now.image, work_on(neighbour, WIDTH_PX).image, at, at)
    steps: Points = there - at
    steps[~found] = np.nan
    return steps
