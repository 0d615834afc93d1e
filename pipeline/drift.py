"""The drift of an offset over time with an honest error, for stamps and for pictures alike."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from pipeline.frame import NS_PER_S
from pipeline.notes import Note
from pipeline.verdict import Cause

Floats: TypeAlias = npt.NDArray[np.float64]

BLOCK_NS = NS_PER_S // 2
BLOCK_SAMPLES = 8
"""A block takes this long and this many samples: enough for a robust mean, short enough for a kink to show soon."""

MOST_BLOCKS = 120
"""Blocks kept; beyond, neighbours are merged, so that memory is bounded while a minute grows to `WINDOW_NS`."""

WINDOW_NS = 600 * NS_PER_S
"""Time over which drift is stated: crystals change their rate with temperature, over tens of minutes."""

FEWEST_BLOCKS = 12
"""Blocks before a drift is stated: a line through them leaves ten to tell its error, so that four times the error is
rare (Student's t)."""

DEPARTING = 4
"""Blocks in a row off the line by which the past is found not to hold any more: two seconds."""

TICK_NS = 1000.0
"""Stamps of many clocks are whole microseconds: nothing smaller is a departure."""

STRAIGHT = 8
BENT = 8.0
"""Blocks that show a line of their own, and how many times nearer to it than to the line through all they must lie: by
chance in less than one series of ten million (F distribution with 6 degrees of freedom), and still rarely where noise
has a memory."""

SURE_SIGMAS = 4
"""Standard errors by which a drift is told from none: it is asked twice a second, for days."""

LEAST_PPM = 1.0
"""Below, it takes an hour to drift 3.6 ms, about a tolerance; no crystal is that exact, so it would always be noted."""

HUBER = 1.345
"""Robust standard deviations beyond which a sample counts less: 95 % efficient on normal noise (Huber 1964)."""

LARGEST_CORRELATION = 0.95


@dataclass(frozen=True, slots=True)
class Drift:
    """How fast an offset grows: 1 ppm is 1 µs a second. sigma_ppm: one standard error. span_ns: time it rests on.

    freedom: how many independent residuals tell the error. `sure`: not chance, by Student's t, whose quantile is that
    of the normal z plus (z^3 + z) / (4 freedom) (Abramowitz and Stegun 26.7.5); and large enough to matter.
    """

    ppm: float
    sigma_ppm: float
    span_ns: int
    freedom: float = math.inf

    @property
    def sure(self) -> bool:
        sigmas = SURE_SIGMAS + (SURE_SIGMAS**3 + SURE_SIGMAS) / (4 * self.freedom)
        return abs(self.ppm) >= max(LEAST_PPM, sigmas * self.sigma_ppm)


@dataclass(frozen=True, slots=True)
class _Line:
    """Slopes are ns per ns. scatter: standard deviation of a block. centre: mean time of the blocks behind it."""

    slope: float
    slope_sigma: float
    intercept: float
    scatter: float
    centre: float
    span: float
    freedom: float

    def at(self, t: float) -> float:
        return self.intercept + self.slope * t


class _Block(NamedTuple):
    """Mean time, location and weight of some samples, and which stretch between steps they are of."""

    t: float
    x: float
    weight: float
    stretch: int


class DriftEstimator:
    """Robust regression of a series of (time, offset) in bounded memory.

    Samples are averaged in blocks (Huber's location); the slope is the median of the slopes between all blocks,
    weighted by their distance (Theil 1950, Sen 1968; weights: Sievers 1978), within stretches that no step interrupts.
    Its standard error is that of least squares on the blocks, over 0.95 for efficiency, times the inflation
    (1 + r) / (1 - r) of the variance for a correlation r of neighbouring blocks, corrected for its bias in short
    series (Kendall 1954): noise need not be independent. What no longer fits is forgotten.
    """

    def __init__(self) -> None:
        self._zero_ns: int | None = None
        self.restart()

    def restart(self) -> None:
        """Forgets everything."""
        self._pending: list[tuple[float, float, float]] = []
        self._stretch = 0
        self._block_ns = BLOCK_NS
        self._blocks: list[_Block] = []
        self._lines: deque[_Line | None] = deque(maxlen=DEPARTING)

    @property
    def drift(self) -> Drift | None:
        """The drift so far, None while too little is known."""
        line = self._line
        if line is None:
            return None
        return Drift(line.slope * 1e6, line.slope_sigma * 1e6, round(line.span), line.freedom)

    @property
    def scatter_ns(self) -> float:
        """Standard deviation of a block around the line: what wanders more slowly than half a second. 0 if unknown."""
        return self._line.scatter if self._line else 0.0

    @property
    def held(self) -> int:
        """Samples and blocks held in memory."""
        return len(self._pending) + len(self._blocks)

    def add(self, t_ns: int, offset_ns: float, sigma_ns: float = 1.0) -> None:
        """Takes an offset at a time, later than those before, and its standard error (or any constant)."""
        if self._zero_ns is None:
            self._zero_ns = t_ns
        t = float(t_ns - self._zero_ns)
        long = bool(self._pending) and t - self._pending[0][0] >= self._block_ns
        if long and len(self._pending) >= BLOCK_SAMPLES:
            self._close_block()
        self._pending.append((t, offset_ns, 1 / max(sigma_ns, 1.0) ** 2))
        if len(self._pending) > MOST_BLOCKS * BLOCK_SAMPLES:
            self._close_block()

    def interrupt(self) -> None:
        """The offset has stepped: the level starts anew, the slope is kept."""
        if len(self._pending) >= BLOCK_SAMPLES // 2:
            self._close_block()
        self._pending.clear()
        self._stretch += 1

    @property
    def _line(self) -> _Line | None:
        return self._lines[-1] if self._lines else None

    def _close_block(self) -> None:
        self._blocks.append(_Block(*_location(np.array(self._pending)), self._stretch))
        self._pending.clear()
        kept = DEPARTING if self._departed() else STRAIGHT if self._bent() else 0
        if kept:
            self._blocks = self._blocks[-kept:]
            self._block_ns = BLOCK_NS
            self._lines.clear()
        self._make_room()
        self._lines.append(_fit(np.array(self._blocks)))

    def _departed(self) -> bool:
        """Whether the last blocks lie on one side of the line that was fitted before them."""
        old = self._lines[0] if len(self._lines) == DEPARTING else None
        if old is None or len({block.stretch for block in self._blocks[-DEPARTING - 1 :]}) > 1:
            return False
        last = self._blocks[-DEPARTING:]
        off = np.array([block.x - old.at(block.t) for block in last])
        reach = np.hypot(old.scatter, old.slope_sigma * (last[-1].t - old.centre))
        one_side = bool((off > 0).all() or (off < 0).all())
        return one_side and float(np.abs(off).min()) > max(SURE_SIGMAS * float(reach), TICK_NS)

    def _bent(self) -> bool:
        """Whether the last blocks lie on a line of their own, which all blocks together are far off."""
        last = np.array(self._blocks[-STRAIGHT:])
        if len(self._blocks) < STRAIGHT + DEPARTING or len(set(last[:, 3])) > 1:
            return False
        own = np.polyfit(last[:, 0] - last[0, 0], last[:, 1], 1, full=True)[1]
        own_scatter = float(np.sqrt(own[0] / (STRAIGHT - 2))) if len(own) else 0.0
        line = _fit(np.array(self._blocks))
        return line is not None and line.scatter > max(BENT * own_scatter, TICK_NS)

    def _make_room(self) -> None:
        if len(self._blocks) <= MOST_BLOCKS:
            return
        if self._block_ns * MOST_BLOCKS < WINDOW_NS:
            self._block_ns *= 2
            self._blocks = _merged(self._blocks, self._block_ns)
            self._lines.clear()
        del self._blocks[:-MOST_BLOCKS]


def tell_drift(stamps: Drift | None, pictures: Drift | None) -> Cause | Note | None:
    """What drifts, by the drift of stamps and of pictures; None where nothing drifts for sure, or it cannot be told.

    Both alike: the camera (`free_run`). Stamps alone: their clock (`clock_drift`). Pictures otherwise than stamps:
    `stamps_lie`.
    """
    if pictures is None:
        return None
    if pictures.sure:
        if stamps is None:
            return Cause.FREE_RUN
        apart = abs(stamps.ppm - pictures.ppm)
        both = float(np.hypot(stamps.sigma_ppm, pictures.sigma_ppm))
        return Cause.STAMPS_LIE if apart > max(SURE_SIGMAS * both, abs(pictures.ppm) / 2) else Cause.FREE_RUN
    if stamps is None or not stamps.sure:
        return None
    stands = abs(pictures.ppm) + SURE_SIGMAS / 2 * pictures.sigma_ppm < abs(stamps.ppm) / 2
    return Note.CLOCK_DRIFT if stands else None


def _location(samples: Floats) -> tuple[float, float, float]:
    """Mean time, Huber's location and weight of N x 3 samples (time, offset, weight)."""
    t, x, weight = samples.T
    centre = float(np.median(x))
    for _ in range(2):
        off = np.abs(x - centre) * np.sqrt(weight)
        limit = HUBER * 1.4826 * float(np.median(off))
        robust = weight * np.minimum(1.0, limit / np.maximum(off, limit)) if limit > 0 else weight
        centre = float(np.average(x, weights=robust))
    return float(np.average(t, weights=robust)), centre, float(weight.sum())


def _merged(blocks: list[_Block], length_ns: int) -> list[_Block]:
    """Neighbours that lie within one block of the new length, joined two by two."""
    merged: list[_Block] = []
    alone = False
    for block in blocks:
        last = merged[-1] if alone else None
        if last is not None and last.stretch == block.stretch and block.t - last.t < length_ns:
            share = block.weight / (last.weight + block.weight)
            t, x = last.t + share * (block.t - last.t), last.x + share * (block.x - last.x)
            merged[-1] = _Block(t, x, last.weight + block.weight, block.stretch)
            alone = False
        else:
            merged.append(block)
            alone = True
    return merged


def _fit(blocks: Floats) -> _Line | None:
    """The line through N x 4 blocks (time, offset, weight, stretch), or None when they are too few."""
    t, x, weight, stretch = blocks.T
    levels = np.unique(stretch)
    free = len(t) - len(levels) - 1
    if len(t) < FEWEST_BLOCKS or free < FEWEST_BLOCKS - 4:
        return None
    first, second = np.triu_indices(len(t), 1)
    together = stretch[first] == stretch[second]
    first, second = first[together], second[together]
    apart = t[second] - t[first]
    precision = np.sqrt(weight[first] * weight[second] / (weight[first] + weight[second]))
    slope = _weighted_median((x[second] - x[first]) / apart, apart * precision)
    rest, spread = np.empty_like(x), 0.0
    intercept = 0.0
    for level in levels:
        mine = stretch == level
        intercept = float(np.median(x[mine] - slope * t[mine]))
        rest[mine] = x[mine] - slope * t[mine] - intercept
        spread += float(np.square(t[mine] - t[mine].mean()).sum())
    usual = 1.4826 * float(np.median(np.abs(rest)))
    rest = np.clip(rest, -3 * usual, 3 * usual) if usual > 0 else rest
    scatter = float(np.sqrt(np.square(rest).sum() / (free - 2)))
    correlation = _correlation(rest, stretch)
    inflation = (1 + correlation) / (1 - correlation)
    slope_sigma = float(scatter * np.sqrt(inflation / (0.95 * spread)))
    return _Line(slope, slope_sigma, intercept, scatter, float(t.mean()), float(t[-1] - t[0]), free / inflation)


def _weighted_median(values: Floats, weights: Floats) -> float:
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, reached[-1] / 2)])


def _correlation(rest: Floats, stretch: Floats) -> float:
    """Correlation of neighbouring residuals of a line, corrected for its bias, 0 to `LARGEST_CORRELATION`."""
    neighbours = stretch[1:] == stretch[:-1]
    power = float(np.square(rest).mean())
    if power <= 0 or not neighbours.any():
        return 0.0
    r = float((rest[1:] * rest[:-1])[neighbours].mean()) / power
    return float(np.clip(r + (1 + 4 * max(r, 0.0)) / len(rest), 0.0, LARGEST_CORRELATION))
