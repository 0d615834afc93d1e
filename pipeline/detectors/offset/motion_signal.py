"""Finds the lag between two cameras from how each one's whole picture moves, without matching any point."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.detectors.offset.arrays import Floats
from pipeline.detectors.offset.working import Working

WINDOWS = 90
"""Three seconds at 30 Hz: a few strokes of a hand, a few steps of a walk."""

ENOUGH = 20
"""Fewer windows always correlate by chance somewhere."""

LIVELY_PX = 0.15
"""A flow of the coarse picture below a sixth of its pixel is codec noise."""


@dataclass(frozen=True, slots=True)
class Lag:
    """Whole frames by which the second camera is later; correlation there and at the best lag two or more away."""

    frames: int
    correlation: float
    runner_up: float
    windows: int

    @property
    def sure(self) -> bool:
        """Fisher's z of the peak stands three standard errors above the best rival."""
        rise = np.arctanh(min(self.correlation, 0.999)) - np.arctanh(np.clip(self.runner_up, -0.999, 0.999))
        effective = max(self.windows / 4, 4.0)  # neighbours are not independent: motions last several frames
        return bool(self.correlation > 0.7 and rise * np.sqrt(effective) > 3)


class MotionSignal:
    """The mean flow of one camera, x and y, by slot."""

    def __init__(self, remember: int) -> None:
        self._flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
        self.values: deque[tuple[int, Floats]] = deque(maxlen=WINDOWS + remember)

    def add(self, index: int, before: Working, now: Working) -> None:
        """Flow of the coarse picture, averaged where it exceeds codec noise (Kroeger et al. 2016)."""
        if before.coarse.shape != now.coarse.shape or min(now.coarse.shape) < 16:
            return
        flow = np.asarray(self._flow.calc(before.coarse, now.coarse, None))  # type: ignore[call-overload]
        small = cv2.resize(flow, (20, 15), interpolation=cv2.INTER_AREA).reshape(-1, 2)
        small[np.hypot(small[:, 0], small[:, 1]) < LIVELY_PX] = 0
        self.values.append((index, small.mean(axis=0).astype(np.float64)))


def best_lag(first: MotionSignal, second: MotionSignal, most: int) -> Lag | None:
    """The lag at which the flows of both cameras agree best; None where there is too little motion or history."""
    a, b = dict(first.values), dict(second.values)
    scores: dict[int, tuple[float, int]] = {}
    for lag in range(-most, most + 1):
        slots = [slot for slot in a if slot - lag in b]
        if len(slots) < ENOUGH:
            continue
        x, y = np.array([a[slot] for slot in slots]), np.array([b[slot - lag] for slot in slots])
        x, y = x - x.mean(axis=0), y - y.mean(axis=0)
        power = float(np.sqrt((x**2).sum() * (y**2).sum()))
        if power / len(slots) < 1e-4:
            continue
        scores[lag] = float((x * y).sum()) / power, len(slots)
    if not scores:
        return None
    lag = max(scores, key=lambda k: scores[k][0])
    rivals = [score for other, (score, _) in scores.items() if abs(other - lag) >= 2]
    return Lag(lag, scores[lag][0], max(rivals, default=0.0), scores[lag][1])
