"""Compares what was said of one clip with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from statistics import median
from typing import Any

from pipeline.frame import NS_PER_S
from pipeline.verdict import State, Verdict

SMALL_ERROR = 0.10
"""Frames: what published methods count as right (MSU 2018)."""

ROUNDED = 4
"""Digits of a frame that are told: a ten-thousandth is finer than anything that is measured."""


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
    """Counts and errors of one clip; `windows` are those after the warm-up whose truth is known.

    decided:  the pictures said sync or async. measured: they also gave an offset.
    errors, sigmas: |offset - truth| of what was measured, and its standard error, in frames.
    steps, delays:  how often the pair went out of sync, and after how many frames, counted from the first changed one,
                    the pictures said so; a step that was not found has no delay.
    verdicts: how often the judge said what.
    """

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
    sigmas: list[float] = field(default_factory=list)
    delays: list[int] = field(default_factory=list)
    steps: int = 0
    verdicts: dict[str, int] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Everything but the errors and sigmas themselves, of which quantiles are told."""
        told = asdict(self)
        errors, sigmas = sorted(told.pop("errors")), told.pop("sigmas")
        told["error_median_frames"] = round(median(errors), ROUNDED) if errors else None
        told["error_p95_frames"] = round(quantile(errors, 0.95), ROUNDED) if errors else None
        told["sigma_median_frames"] = round(median(sigmas), ROUNDED) if sigmas else None
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


def score(empty: Score, rows: Sequence[Row], *, fps: float, warm_up_s: float, warm_up_frames: int) -> Score:
    """Fills in the score of one clip and pair; the longer warm-up counts, but never more than a third of the clip."""
    result = replace(empty, errors=[], sigmas=[], delays=[], verdicts={})
    skipped = round(min(max(warm_up_s * fps, warm_up_frames), len(rows) / 3))
    for item in rows[skipped:]:
        _add(result, item)
    _find_steps(result, rows, skipped)
    return result


def _add(result: Score, item: Row) -> None:
    result.windows += 1
    result.verdicts[item.verdict.value] = result.verdicts.get(item.verdict.value, 0) + 1
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
        result.sigmas.append(item.sigma_frames)
        result.within_two_sigma += error <= 2 * item.sigma_frames


def _find_steps(result: Score, rows: Sequence[Row], skipped: int) -> None:
    """How many frames after the pair went out of sync the pictures said so; saying it beforehand finds nothing."""
    for index in range(max(skipped, 1), len(rows)):
        if rows[index].truth is State.ASYNC and rows[index - 1].truth is State.SYNC:
            result.steps += 1
            found = next((k for k, item in enumerate(rows[index:]) if item.content is State.ASYNC), None)
            beforehand = rows[index - 1].content is State.ASYNC
            if found is None or beforehand:
                continue
            if all(item.truth is State.ASYNC for item in rows[index : index + found]):
                result.delays.append(found)


def quantile(ordered: Sequence[float], share: float) -> float:
    """The value below which `share` of the ordered values lie, by the nearest rank."""
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def period_of(fps: float) -> int:
    return round(NS_PER_S / fps)
