"""Compares what was said with the truth: of one clip, and of many with an interval."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from statistics import median
from typing import Any

from pipeline.frame import NS_PER_S
from pipeline.verdict import State, Verdict

WARM_UP_FRAMES = 20
SMALL_ERROR = 0.10
"""Frames: what published methods count as right (MSU 2018)."""

RESAMPLES = 1000
TAIL = 0.025


@dataclass(frozen=True, slots=True)
class Row:
    """What the pictures said of one frame, and the truth in frames of the first camera's period."""

    frame: int
    truth_frames: float
    truth: State
    content: State
    offset_frames: float | None
    sigma_frames: float | None
    verdict: State


@dataclass(slots=True)
class Score:
    """Counts and errors of one clip; `windows` are those after the warm-up whose truth is known."""

    recording: str
    manipulation: str
    seed: int
    pair: str = ""
    windows: int = 0
    decided: int = 0
    whole_right: int = 0
    small_error: int = 0
    measured: int = 0
    within_two_sigma: int = 0
    with_sigma: int = 0
    false_async: int = 0
    false_sync: int = 0
    errors: list[float] = field(default_factory=list)
    delays: list[int] = field(default_factory=list)
    steps: int = 0

    def to_json(self) -> dict[str, Any]:
        told = asdict(self)
        errors = sorted(told.pop("errors"))
        told["error_median_frames"] = round(median(errors), 4) if errors else None
        told["error_p95_frames"] = round(quantile(errors, 0.95), 4) if errors else None
        return told


def row(verdict: Verdict, period_ns: int) -> Row | None:
    """A verdict as a row; None where the truth is not known."""
    if verdict.truth is None or verdict.frame is None:
        return None
    best = verdict.content
    return Row(
        frame=verdict.frame,
        truth_frames=verdict.truth.offset_ns / period_ns,
        truth=verdict.truth.state,
        content=best.state if best else State.UNKNOWN,
        offset_frames=best.offset_frames if best else None,
        sigma_frames=best.sigma_frames if best else None,
        verdict=verdict.state,
    )


def score(empty: Score, rows: Sequence[Row], *, fps: float, warm_up_s: float) -> Score:
    """Fills in the score of one clip and pair."""
    result = replace(empty, errors=[], delays=[])
    skipped = round(min(max(warm_up_s * fps, WARM_UP_FRAMES), len(rows) / 3))
    for item in rows[skipped:]:
        _add(result, item)
    _find_steps(result, rows, skipped)
    return result


def _add(result: Score, item: Row) -> None:
    result.windows += 1
    if item.content is State.UNKNOWN:
        return
    result.decided += 1
    result.false_async += item.content is State.ASYNC and item.truth is State.SYNC
    result.false_sync += item.content is State.SYNC and item.truth is State.ASYNC
    if item.offset_frames is None:
        return
    error = abs(item.offset_frames - item.truth_frames)
    result.measured += 1
    result.errors.append(error)
    result.whole_right += round(item.offset_frames) == round(item.truth_frames)
    result.small_error += error <= SMALL_ERROR
    if item.sigma_frames is not None:
        result.with_sigma += 1
        result.within_two_sigma += error <= 2 * item.sigma_frames


def _find_steps(result: Score, rows: Sequence[Row], skipped: int) -> None:
    """How many frames after the pair went out of sync the pictures said so."""
    for index in range(max(skipped, 1), len(rows)):
        if rows[index].truth is State.ASYNC and rows[index - 1].truth is State.SYNC:
            result.steps += 1
            found = next((k for k, item in enumerate(rows[index:]) if item.content is State.ASYNC), None)
            if found is not None and all(item.truth is State.ASYNC for item in rows[index : index + found]):
                result.delays.append(found)


def quantile(ordered: Sequence[float], share: float) -> float:
    """The value below which `share` of the ordered values lie, by the nearest rank."""
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


@dataclass(frozen=True, slots=True)
class Share:
    """A share over clips, with a 95 % interval by bootstrap over clips, as frames of one clip are not independent."""

    hits: int
    total: int
    low: float | None
    high: float | None

    def __str__(self) -> str:
        if not self.total:
            return "-"
        share = f"{100 * self.hits / self.total:.1f} %"
        return (
            share if self.low is None or self.high is None else f"{share} ({100 * self.low:.1f}..{100 * self.high:.1f})"
        )


def share(scores: Sequence[Score], hits: Callable[[Score], int], total: Callable[[Score], int]) -> Share:
    """Hits / total, summed over clips; without an interval for a single clip."""
    counted = [(hits(item), total(item)) for item in scores if total(item)]
    summed = sum(hit for hit, _ in counted), sum(count for _, count in counted)
    if len(counted) < 2:
        return Share(*summed, None, None)
    chance = random.Random(0)
    drawn = []
    for _ in range(RESAMPLES):
        sample = chance.choices(counted, k=len(counted))
        drawn.append(sum(hit for hit, _ in sample) / sum(count for _, count in sample))
    drawn.sort()
    return Share(*summed, quantile(drawn, TAIL), quantile(drawn, 1 - TAIL))


def period_of(fps: float) -> int:
    return round(NS_PER_S / fps)
