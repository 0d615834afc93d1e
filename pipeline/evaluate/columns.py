"""The columns of every table of an evaluation: a title, and what stands in the cell of a group of clips."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeAlias

from pipeline.evaluate import measures
from pipeline.evaluate.measures import Interval, Measure, Scores, bootstrap
from pipeline.evaluate.score import Score

Cell: TypeAlias = Callable[[Scores], str]
EMPTY = "-"


def percent(value: float) -> str:
    return f"{100 * value:.1f}"


def frames(value: float) -> str:
    return "never" if math.isinf(value) else f"{value:.3f}"


def whole_frames(value: float) -> str:
    return "never" if math.isinf(value) else f"{value:g}"


def told(measure: Measure, write: Callable[[float], str], unit: str = "") -> Cell:
    """A measure, its unit, and in brackets its interval, unless that is missing or reads like the value itself."""

    def cell(scores: Scores) -> str:
        value = measure(scores)
        if value is None:
            return EMPTY
        return f"{write(value)}{unit}{_bracketed(bootstrap(scores, measure), write, write(value))}"

    return cell


def count(number: Callable[[Score], int]) -> Cell:
    return lambda scores: str(sum(map(number, scores)))


def _bracketed(interval: Interval | None, write: Callable[[float], str], value: str) -> str:
    if interval is None or write(interval.low) == write(interval.high) == value:
        return ""
    return f" ({write(interval.low)}..{write(interval.high)})"


def _steps(scores: Scores) -> str:
    return f"{sum(len(item.delays) for item in scores)} of {sum(item.steps for item in scores)}"


def _delays(scores: Scores) -> str:
    if measures.delay_median(scores) is None:
        return EMPTY
    median, late = (told(measure, whole_frames)(scores) for measure in (measures.delay_median, measures.delay_p95))
    return f"{median}, 95 % {late}"


COLUMNS: Mapping[str, Cell] = {
    "windows": count(lambda item: item.windows),
    "decided": told(measures.decided, percent, " %"),
    "whole frame": told(measures.whole_right, percent, " %"),
    "within 0.1": told(measures.small_error, percent, " %"),
    "error median": told(measures.error_median, frames),
    "error 95 %": told(measures.error_p95, frames),
    "in 2 sigma": told(measures.within_two_sigma, percent, " %"),
    "sigma": told(measures.sigma_median, frames),
    "false async": count(lambda item: item.false_async),
    "missed": count(lambda item: item.false_sync),
    "steps found": _steps,
    "after frames": _delays,
}


def cells(scores: Scores, titles: Iterable[str] = tuple(COLUMNS)) -> list[str]:
    """A row of a table."""
    return [COLUMNS[title](scores) for title in titles]


def by_manipulation(scores: Scores) -> dict[str, list[Score]]:
    return _grouped(scores, [item.manipulation for item in scores])


def by_recording(scores: Scores) -> dict[str, list[Score]]:
    return _grouped(scores, [item.recording for item in scores])


def _grouped(scores: Scores, names: Sequence[str]) -> dict[str, list[Score]]:
    groups: dict[str, list[Score]] = {}
    for name, item in zip(names, scores, strict=True):
        groups.setdefault(name, []).append(item)
    return groups
