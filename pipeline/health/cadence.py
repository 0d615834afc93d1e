"""Follows the rhythm of a camera's stamps: its period, its jitter, and the frames that are missing from it."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from statistics import median

import numpy as np

from pipeline.frame import NS_PER_S

LEARNING = 16
"""Stamps before the period counts as known: noise of a quarter of a period still gives it to a fiftieth."""

RECENT = 64
"""Stamps by which the period is measured: two seconds at 30 fps, so that a slowly changing rate is followed."""

REMEMBERED = 1000
"""Intervals over which jitter is stated: ten beyond the 99th percentile."""

FALSE_ALARM = 1e-8
"""Chance a frame that jitter is taken for a loss: one in a month at 30 fps."""

MOST_FRAMES = 8
"""Frames after a gap that may be waited for. Jitter that would need more hides lost frames."""

FLAT = 0.05
"""How far, in periods, the frames after a loss may be apart in phase before jitter is added: a clock keeps its pace
within a fraction of a percent, a changed frame rate does not."""

FOLLOWING = 1 / 8
"""Share of each difference by which the phase follows the stamps; FLAT / FOLLOWING stays below half a period, so that
a slow change of the rate that looks flat never adds up to a loss."""

SIGMA_MARGIN = 1.3
"""The scatter is known to a fifth from so few intervals, and the phase that follows them is noisy itself."""

LONGEST_GAP_NS = 10 * NS_PER_S
"""A longer gap is an outage or a clock that was set, and not counted in frames."""

MAD_TO_SIGMA = 1.4826


class Cadence:
    """Finds lost frames as a lasting shift of phase by whole periods, which jitter is not.

    After a lost frame, stamps stay a period late; a late stamp is followed by one in time. Frames more than half a
    period late in a row, as many as jitter makes improbable (its robust sigma, normal tail), and level among each other
    are a loss. Lateness that grows with every frame is a changed frame rate: it is then learned anew.
    The period is the median slope between stamps half the memory apart, each with the number of its frame (Theil-Sen
    with one distance): jitter hardly touches it and lost frames, once found, do not either.
    """

    def __init__(self) -> None:
        self._stamps: deque[tuple[int, int]] = deque(maxlen=RECENT)
        self._remembered: deque[float] = deque(maxlen=REMEMBERED)
        self._phase_ns = 0.0
        self._jump_ns = 0.0
        self._late: list[float] = []
        self.period_ns: float | None = None
        """None while it is being learned, and where stamps do not rise."""
        self.sigma_ns = 0.0
        """Robust standard deviation of one stamp, from the scatter of intervals."""

    def restart(self) -> None:
        """The clock has started anew; the period is kept until it is learned again."""
        self._stamps.clear()
        self._phase_ns = 0.0
        self._late.clear()

    def see(self, stamp_ns: int, frames: int) -> int:
        """Takes the next stamp, and how many frames after the last the counter says it is (1: the next one).

        Returns how many frames more must have been lost, told up to eight frames late.
        """
        if not self._stamps:
            self._stamps.append((0, stamp_ns))
            return 0
        number, before_ns = self._stamps[-1]
        self._stamps.append((number + frames, stamp_ns))
        interval_ns = stamp_ns - before_ns
        lost = 0
        if self.period_ns is not None:
            lost = self._lost(interval_ns - frames * self.period_ns)
            self._remembered.append(self._deviation_ns(interval_ns / frames, self.period_ns))
        if len(self._stamps) >= LEARNING:
            first = self.period_ns is None
            lost += self._sort_out() if first else 0
            self._learn()
            if first:
                self._anchor()
        return lost

    def jitter_ns(self, percent: float) -> int | None:
        """The percentile of how far intervals are off the period, over the last thousand."""
        if not self._remembered:
            return None
        return round(float(np.percentile(np.abs(self._remembered), percent)))

    def _learn(self) -> None:
        stamps = list(self._stamps)
        half = len(stamps) // 2
        period = median((late - early) / (m - n) for (n, early), (m, late) in zip(stamps, stamps[half:], strict=False))
        self.period_ns = period if period > 0 else None
        off = [abs((late - early) / (m - n) - period) for (n, early), (m, late) in pairwise(stamps)]
        self.sigma_ns = MAD_TO_SIGMA * median(off) / math.sqrt(2)

    def _sort_out(self) -> int:
        """How many frames are missing from the first stamps, where these are exact enough to say so at once."""
        stamps = list(self._stamps)
        intervals = [(late - early) / (m - n) for (n, early), (m, late) in pairwise(stamps)]
        usual = median(intervals)
        if usual <= 0 or any(abs(each / usual - round(each / usual)) > FLAT or each < usual / 2 for each in intervals):
            return 0
        lost = 0
        for place, each in enumerate(intervals, start=1):
            lost += round(each / usual) - 1
            self._stamps[place] = (stamps[place][0] + lost, stamps[place][1])
        return lost if lost * usual <= LONGEST_GAP_NS else 0

    def _deviation_ns(self, interval_ns: float, period_ns: float) -> float:
        """How far an interval is off the period; where gaps stand out, off the whole periods nearest to it."""
        clear = self._frames_needed() == 2
        return interval_ns - period_ns * (max(1, round(interval_ns / period_ns)) if clear else 1)

    def _lost(self, late_ns: float) -> int:
        assert self.period_ns is not None
        before_ns = self._phase_ns
        self._phase_ns += late_ns
        if abs(self._phase_ns) < self.period_ns / 2:
            self._late.clear()
            self._phase_ns *= 1 - FOLLOWING
            return 0
        if not self._late or self._late[-1] * self._phase_ns < 0:
            self._late.clear()
            self._jump_ns = self._phase_ns - before_ns
        self._late.append(self._phase_ns)
        needed = self._frames_needed()
        lost = self._level(self._late[-needed:]) if needed is not None and len(self._late) >= needed else None
        if lost is not None:
            return self._account_for(lost)
        if len(self._late) >= 2 * MOST_FRAMES:
            self._learn_anew()
        return 0

    def _account_for(self, lost: int) -> int:
        """The late frames get the numbers they would have without the loss."""
        assert self.period_ns is not None
        if not 0 < lost * self.period_ns <= LONGEST_GAP_NS:
            self._learn_anew()
            return 0
        for place in range(max(0, len(self._stamps) - len(self._late)), len(self._stamps)):
            number, stamp_ns = self._stamps[place]
            self._stamps[place] = (number + lost, stamp_ns)
        self._late.clear()
        self._phase_ns -= lost * self.period_ns
        return lost

    def _learn_anew(self) -> None:
        """What came before the late frames does not count any more."""
        late = list(self._stamps)[-len(self._late) :]
        self._stamps.clear()
        self._stamps.extend(late)
        self._late.clear()
        if len(late) >= LEARNING:
            self._learn()
        self._anchor()

    def _anchor(self) -> None:
        """The phase of the last stamp is that against the median of all: a single one may be far off."""
        if self.period_ns is None:
            return
        last, stamp_ns = self._stamps[-1]
        offs = [stamp - stamp_ns + (last - number) * self.period_ns for number, stamp in self._stamps]
        self._phase_ns = -median(offs)

    def _level(self, late: list[float]) -> int | None:
        """By how many periods all of these are late; None when they do not agree."""
        assert self.period_ns is not None
        half = len(late) // 2
        apart = abs(median(late[:half]) - median(late[half:]))
        grown = abs(self._jump_ns) < self.period_ns / 2 - 3 * self.sigma_ns
        if grown or apart > FLAT * self.period_ns + 3 * self.sigma_ns:
            return None
        return round(median(late) / self.period_ns)

    def _frames_needed(self) -> int | None:
        """Frames in a row that are late by more than half a period only once in 1 / FALSE_ALARM by jitter."""
        if not self.sigma_ns or not self.period_ns:
            return 2
        tail = math.erfc(self.period_ns / 2 / (SIGMA_MARGIN * self.sigma_ns) / math.sqrt(2)) / 2
        needed = max(2, math.ceil(math.log(FALSE_ALARM) / math.log(tail))) if tail > 0 else 2
        return needed if needed <= MOST_FRAMES else None
