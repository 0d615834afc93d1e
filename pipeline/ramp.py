"""Tells an offset that grows steadily from one that has jumped, within a second."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

LENGTHS = (40, 20, 10)
"""Samples that are looked at together: a fast ramp shows in few, a slow one under noise needs many."""

CLEAR = 8.0
"""Standard errors of a slope: it is asked with every frame, for days."""

GAIN = 2.0
"""How many times fewer squares a line must leave than a jump: a series with a jump in it leaves fewer to the jump."""


class Slope(NamedTuple):
    """Growth in ns a sample, and its standard error."""

    ns: float
    sigma_ns: float


class Ramp:
    """Straight line against a jump between two levels, both fitted by least squares to the last samples."""

    def __init__(self) -> None:
        self._samples: deque[float] = deque(maxlen=LENGTHS[0])

    def clear(self) -> None:
        self._samples.clear()

    def add(self, offset_ns: float) -> None:
        self._samples.append(offset_ns)

    def slope(self, least_ns: float) -> Slope | None:
        """The slope of the last samples if they rise, or fall, steadily by `least_ns` or more."""
        for length in LENGTHS:
            if len(self._samples) >= length:
                slope = _steady(np.array(self._samples)[-length:])
                if slope is not None and abs(slope.ns) * length >= least_ns:
                    return slope
        return None


def _steady(x: npt.NDArray[np.float64]) -> Slope | None:
    t = np.arange(len(x)) - (len(x) - 1) / 2
    slope = float(t @ x / (t @ t))
    rest = x - x.mean() - slope * t
    squares = float(rest @ rest)
    sigma = float(np.sqrt(squares / (len(x) - 2) / (t @ t)))
    return Slope(slope, sigma) if abs(slope) > CLEAR * sigma and GAIN * squares < _jump_squares(x) else None


def _jump_squares(x: npt.NDArray[np.float64]) -> float:
    """The least sum of squares that two levels leave."""
    count = len(x)
    head = np.arange(1, count)
    sums, squares = np.cumsum(x - x[0]), np.cumsum((x - x[0]) ** 2)
    before = squares[:-1] - sums[:-1] ** 2 / head
    after = squares[-1] - squares[:-1] - (sums[-1] - sums[:-1]) ** 2 / (count - head)
    return float((before + after).min())
