"""Measures the offset between two cameras from how each one's whole picture moves, without matching any point."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.detectors.offset.arrays import Floats, median
from pipeline.detectors.offset.tracks import Flow
from pipeline.detectors.offset.working import Working

WINDOWS = 150
"""Five seconds at 30 Hz: several strokes of a hand, several steps of a walk."""

ENOUGH = 40
"""Fewer windows always correlate by chance somewhere: motions last about five, so these are eight."""

SEGMENTS = 8
"""Parts of the history that are left out in turn, to see how far the answer depends on any of them."""

CORRELATED, CLEARLY, SHARP = 0.5, 2.0, 0.2
"""Least correlation; standard errors (Fisher's z) above each lag two or more away; largest standard error, frames."""

A_MOTION = 4.0
"""Windows a motion lasts: so many times fewer are independent."""

VIEW_FRAMES, FLOOR_FRAMES = 0.5, 0.02
"""Error where views differ: what one camera sees more of may come earlier. A share of what does not correlate."""

LIVELY_PX = 0.15
"""A flow of the coarse picture below a sixth of its pixel is codec noise."""

JUMP = 2.5
"""A change of the picture so many times that before and that after it is a jump: motions start and end more slowly."""

GRAIN_LEVELS = 1.0
"""A cell of the coarse picture changes by that much from noise alone."""


@dataclass(frozen=True, slots=True)
class SignalFit:
    """tau and its standard error in frames; correlation of both cameras' signals at tau."""

    tau: float
    sigma: float
    correlation: float


class MotionSignal:
    """One camera's motion by slot: mean flow x and y, and the root of the mean change of brightness."""

    def __init__(self, remember: int) -> None:
        self._flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
        self.values: deque[tuple[int, Floats]] = deque(maxlen=WINDOWS + remember)

    def add(self, index: int, before: Working, now: Working) -> Flow | None:
        """The flow of the coarse picture (Kroeger et al. 2016) in working pixels; None for too small a picture."""
        if before.coarse.shape != now.coarse.shape or min(now.coarse.shape) < 16:
            return None
        flow = np.asarray(self._flow.calc(before.coarse, now.coarse, None))  # type: ignore[call-overload]
        cells = cv2.resize(flow, (20, 15), interpolation=cv2.INTER_AREA).reshape(-1, 2)
        cells[np.hypot(cells[:, 0], cells[:, 1]) < LIVELY_PX] = 0
        change = cv2.resize(cv2.absdiff(before.coarse, now.coarse), (20, 15), interpolation=cv2.INTER_AREA)
        levels = np.asarray(change, np.float64)
        beyond = np.maximum(levels - median(levels) - GRAIN_LEVELS, 0)
        self.values.append((index, np.array([*cells.mean(axis=0), np.sqrt(beyond.mean())], np.float64)))
        step = now.image.shape[1] / now.coarse.shape[1]
        return Flow(flow * np.float32(step), step)


def signal_offset(first: MotionSignal, second: MotionSignal, most: int) -> SignalFit | None:
    """The offset at which the cameras' signals correlate best, if it is clear; of flow and change the surer one."""
    a, b = dict(first.values), dict(second.values)
    slots = [slot for slot in a if all(slot - lag in b for lag in range(-most, most + 1))][-WINDOWS:]
    if len(slots) < ENOUGH:
        return None
    x = np.array([a[slot] for slot in slots])
    y = np.array([[b[slot - lag] for lag in range(-most, most + 1)] for slot in slots])
    x, y = _without_jumps(x), _without_jumps(y)
    fits = [fit for part in (slice(0, 2), slice(2, 3)) if (fit := _correlate(x[:, part], y[:, :, part], most))]
    return min(fits, key=lambda fit: fit.sigma, default=None)


def _without_jumps(values: Floats) -> Floats:
    """Values over time with every single jump smoothed away: a cut or a gap is no motion, and would drown all else."""
    moved = values.copy()
    change = moved[..., -1]
    before, now, after = change[:-2], change[1:-1], change[2:]
    jump = np.zeros(change.shape, np.bool_)
    jump[1:-1] = now**2 > JUMP * np.maximum(before, after) ** 2
    smooth = (np.roll(moved, 1, axis=0) + np.roll(moved, -1, axis=0)) / 2
    moved[jump] = smooth[jump]
    return moved


def _correlate(x: Floats, y: Floats, most: int) -> SignalFit | None:
    """X: n x k signals of one camera, y: n x lags x k of the other. Jackknife over segments (Efron 1982)."""
    edges = np.linspace(0, len(x), SEGMENTS + 1).astype(int)[:-1]

    def parts(values: Floats) -> Floats:
        return np.asarray(np.add.reduceat(values, edges, axis=0))

    xs = np.broadcast_to(x[:, None], y.shape)
    sums = [parts(v) for v in (np.ones(y.shape[:2]), xs, y, xs * xs, y * y, xs * y)]
    wholes = [s.sum(axis=0)[None] for s in sums]
    everything = _correlation(*wholes)[0]
    if not np.isfinite(everything).all():
        return None
    without = _correlation(*(whole - part for whole, part in zip(wholes, sums, strict=True)))
    best = _peak(everything)
    each = np.array([_peak(row) for row in without])
    error = float(np.sqrt((SEGMENTS - 1) / SEGMENTS * ((each - each.mean()) ** 2).sum()))
    place = round(best)
    rivals = np.delete(everything, np.arange(max(0, place - 1), min(len(everything), place + 2)))
    top, rival = (float(np.arctanh(np.clip(v, -0.999, 0.999))) for v in (everything[place], rivals.max(initial=-1.0)))
    clear = (top - rival) * np.sqrt(len(x) / A_MOTION)
    correlation = float(everything[place])
    if correlation < CORRELATED or clear < CLEARLY or error > SHARP or not 0 < place < 2 * most:
        return None
    return SignalFit(best - most, float(np.hypot(error, FLOOR_FRAMES + VIEW_FRAMES * (1 - correlation))), correlation)


def _correlation(n: Floats, x: Floats, y: Floats, xx: Floats, yy: Floats, xy: Floats) -> Floats:
    """Rows x lags: correlation over all signals together, each freed of its mean."""
    n = n[..., None]
    power = (xx - x * x / n).sum(axis=-1) * (yy - y * y / n).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((xy - x * y / n).sum(axis=-1) / np.sqrt(power))


def _peak(values: Floats) -> float:
    """Place of the largest value, by a parabola through it and its neighbours."""
    k = int(np.argmax(values))
    if not 0 < k < len(values) - 1:
        return float(k)
    before, top, after = values[k - 1 : k + 2].tolist()
    bend = before - 2 * top + after
    return k + (before - after) / (2 * bend) if bend < 0 else float(k)
