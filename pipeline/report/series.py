"""Values over time in constant memory: bins that are joined in twos whenever there are too many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.detectors.offset.arrays import Floats

MOST_BINS = 1024
"""Bins of a curve: about as many as a screen has columns."""


class Series:
    """Named values a step, as mean, least and most of bins of one, two, four, ... steps.

    ::

        steps   0 1 2 3 4 5 6 7        MOST_BINS = 4
        bins    0 1 2 3
        then    0   1   2   3          from the fifth step on

    `bin_steps` is how many steps a bin holds, `count` how many steps there were.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._columns = {name: column for column, name in enumerate(names)}
        shape = (MOST_BINS, len(names))
        self._sum = np.zeros(shape)
        self._known = np.zeros(shape)
        self._least = np.full(shape, np.inf)
        self._most = np.full(shape, -np.inf)
        self.bin_steps = 1
        self.count = 0

    def add(self, values: Mapping[str, float]) -> None:
        """Takes the values of the next step; what is not among them is not known there."""
        if self.count == MOST_BINS * self.bin_steps:
            self._join()
        row = self.count // self.bin_steps
        for name, value in values.items():
            column = self._columns[name]
            self._sum[row, column] += value
            self._known[row, column] += 1
            self._least[row, column] = min(self._least[row, column], value)
            self._most[row, column] = max(self._most[row, column], value)
        self.count += 1

    @property
    def bins(self) -> int:
        return -(-self.count // self.bin_steps)

    def edges(self) -> Floats:
        """Bins + 1 steps at which bins begin and end; the last one may be short."""
        edges = np.minimum(np.arange(self.bins + 1) * self.bin_steps, self.count)
        return np.asarray(edges, np.float64)

    def mean(self, name: str) -> Floats:
        """A value a bin, NaN where nothing was known."""
        known = self.known(name)
        mean = np.divide(self.sums(name), known, out=np.full(self.bins, np.nan), where=known > 0)
        return np.asarray(mean, np.float64)

    def least(self, name: str) -> Floats:
        return self._extreme(self._least, name)

    def most(self, name: str) -> Floats:
        return self._extreme(self._most, name)

    def known(self, name: str) -> Floats:
        """How many steps of each bin have a value."""
        return self._of(self._known, name)

    def sums(self, name: str) -> Floats:
        """The sum of each bin's values."""
        return self._of(self._sum, name)

    def summary(self, name: str) -> dict[str, float] | None:
        """Mean, least and most of all values; None where there are none."""
        known = float(self.known(name).sum())
        if not known:
            return None
        return {
            "mean": float(self.sums(name).sum()) / known,
            "min": float(self._of(self._least, name).min()),
            "max": float(self._of(self._most, name).max()),
        }

    def _extreme(self, values: Floats, name: str) -> Floats:
        return np.where(self.known(name) > 0, self._of(values, name), np.nan)

    def _of(self, values: Floats, name: str) -> Floats:
        return np.asarray(values[: self.bins, self._columns[name]], np.float64)

    def _join(self) -> None:
        half = MOST_BINS // 2
        for values, join, nothing in (
            (self._sum, np.add, 0.0),
            (self._known, np.add, 0.0),
            (self._least, np.minimum, np.inf),
            (self._most, np.maximum, -np.inf),
        ):
            values[:half] = join(values[0::2], values[1::2])
            values[half:] = nothing
        self.bin_steps *= 2
