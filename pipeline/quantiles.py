"""Quantiles of the last minute, in bounded memory whatever the rate."""

from __future__ import annotations

import math
from collections import Counter, deque

from pipeline.frame import NS_PER_S

SLICE_NS = 5 * NS_PER_S
SLICES = 12
"""A minute, forgotten in steps of five seconds."""

GAMMA = 1.02
"""Ratio of the bounds of a bin: a quantile is known to one percent."""

LEAST_NS = 1_000
MOST_NS = 10**15
"""Below the microsecond in which messages are written is zero; above is told as eleven days."""


class LastMinute:
    """Counts durations in bins of equal ratio, a set of bins a slice of time (DDSketch, Masson et al. 2019).

    At most 1400 bins in each of 12 slices are held. No clock of its own; `now_ns` must not go back.
    """

    def __init__(self) -> None:
        self._slices: deque[tuple[int, Counter[int]]] = deque()

    def add(self, value_ns: int, now_ns: int) -> None:
        """Takes a duration of zero or more."""
        self._forget(now_ns)
        number = now_ns // SLICE_NS
        if not self._slices or self._slices[-1][0] != number:
            self._slices.append((number, Counter()))
        self._slices[-1][1][_bin(value_ns)] += 1

    def quantile(self, share: float, now_ns: int) -> int | None:
        """The least of the durations that at least `share` (0 to 1) of them do not exceed; None if there are none."""
        self._forget(now_ns)
        bins: Counter[int] = Counter()
        for _, counted in self._slices:
            bins.update(counted)
        left = max(1, math.ceil(share * bins.total()))
        for place in sorted(bins):
            left -= bins[place]
            if left <= 0:
                return _middle_ns(place)
        return None

    def _forget(self, now_ns: int) -> None:
        while self._slices and self._slices[0][0] <= now_ns // SLICE_NS - SLICES:
            self._slices.popleft()


def _bin(value_ns: int) -> int:
    if value_ns < LEAST_NS:
        return 0
    return 1 + math.floor(math.log(min(value_ns, MOST_NS) / LEAST_NS) / math.log(GAMMA))


def _middle_ns(place: int) -> int:
    """Within one percent of everything in the bin."""
    return round(LEAST_NS * GAMMA ** (place - 1) * 2 * GAMMA / (1 + GAMMA)) if place else 0
