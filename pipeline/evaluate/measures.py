"""What is told of many clips together: shares, quantiles of errors and delays, each with an interval over clips."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from pipeline.evaluate.score import Score, quantile

Scores: TypeAlias = Sequence[Score]
Measure: TypeAlias = Callable[[Scores], float | None]
"""A number of many clips; None where there is nothing to measure."""

RESAMPLES = 1000
TAIL = 0.025
"""Draws, and what is cut off at either end, of a 95 % interval."""


def ratio(hits: Callable[[Score], int], total: Callable[[Score], int]) -> Measure:
    """Hits / total, both summed over clips."""

    def measure(scores: Scores) -> float | None:
        whole = sum(map(total, scores))
        return sum(map(hits, scores)) / whole if whole else None

    return measure


def quantile_of(values: Callable[[Score], Sequence[float]], share: float) -> Measure:
    """The value below which `share` of the values of all clips lie."""

    def measure(scores: Scores) -> float | None:
        ordered = sorted(value for item in scores for value in values(item))
        return quantile(ordered, share) if ordered else None

    return measure


def delays(score: Score) -> Sequence[float]:
    """A delay for every step, in frames: infinite where it was not found."""
    return [*score.delays, *[math.inf] * (score.steps - len(score.delays))]


decided = ratio(lambda item: item.decided, lambda item: item.windows)
whole_right = ratio(lambda item: item.whole_right, lambda item: item.measured)
small_error = ratio(lambda item: item.small_error, lambda item: item.measured)
within_two_sigma = ratio(lambda item: item.within_two_sigma, lambda item: item.with_sigma)
steps_found = ratio(lambda item: len(item.delays), lambda item: item.steps)
error_median = quantile_of(lambda item: item.errors, 0.5)
error_p95 = quantile_of(lambda item: item.errors, 0.95)
sigma_median = quantile_of(lambda item: item.sigmas, 0.5)
delay_median = quantile_of(delays, 0.5)
delay_p95 = quantile_of(delays, 0.95)


def false_async(scores: Scores) -> float | None:
    """Windows in which the pictures said async of a pair that was in sync."""
    return sum(item.false_async for item in scores)


def false_sync(scores: Scores) -> float | None:
    """Windows in which the pictures said sync of a pair that was out of sync."""
    return sum(item.false_sync for item in scores)


@dataclass(frozen=True, slots=True)
class Interval:
    """Where a measure lies with 95 % confidence."""

    low: float
    high: float


def bootstrap(scores: Scores, measure: Measure) -> Interval | None:
    """The percentile bootstrap over clips, as frames of one clip are not independent; None for fewer than two clips.

    Clips in which there is nothing to measure are left out. Source: B. Efron, Bootstrap Methods: Another Look at the
    Jackknife, Annals of Statistics 7 (1979).
    """
    counted = [item for item in scores if measure([item]) is not None]
    if len(counted) < 2:
        return None
    chance = random.Random(0)
    drawn = [measure(chance.choices(counted, k=len(counted))) for _ in range(RESAMPLES)]
    ordered = sorted(value for value in drawn if value is not None)
    return Interval(quantile(ordered, TAIL), quantile(ordered, 1 - TAIL))
