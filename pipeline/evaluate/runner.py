"""Runs the clips of a suite in parallel processes and scores each."""

from __future__ import annotations

import io
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import get_context
from typing import TYPE_CHECKING

from pipeline.assemble import KINDS, assemble, build_rig, build_source
from pipeline.configtext.document import ConfigError
from pipeline.errors import InputError, RunError
from pipeline.evaluate.outcome import Outcome, outcome_of
from pipeline.evaluate.score import Row, Score, period_of, row, score
from pipeline.evaluate.subsample import SubsampledSource
from pipeline.evaluate.suite import Clip
from pipeline.frame import Source
from pipeline.run import Run
from pipeline.timeline import Timeline, timeline_of
from pipeline.verdict import Event, Report, Verdict
from pipeline.workers import workers

if TYPE_CHECKING:
    from multiprocessing.sharedctypes import Synchronized

POLL_S = 0.5
"""How often is asked how far the clips have come."""


def check(clips: Sequence[Clip]) -> list[int | None]:
    """Reads what is cheap to read before anything runs: every plan, and the first picture of every recording.

    Returns how many verdicts each clip will come to, about; None where its source does not say. Raises InputError,
    which names the clip.
    """
    for clip in clips:
        clip.plan(KINDS)
    seen: dict[str, int | None] = {}
    counts = []
    for clip in clips:
        place = repr((clip.base, clip.config["source"], clip.config["faults"], clip.subsample))
        if place not in seen:
            seen[place] = _checked(clip)
        counts.append(seen[place])
    return counts


def _checked(clip: Clip) -> int | None:
    source = opened(clip)
    try:
        names = [camera.name for camera in source.cameras]
        clip.check_cameras(names)
        count = source.frame_count
        return None if count is None else count * (len(names) - 1)
    finally:
        source.close()


@dataclass(slots=True)
class Result:
    """What one clip came to: a score, an outcome and a timeline for each of its pairs."""

    scores: list[Score] = field(default_factory=list)
    outcomes: list[Outcome] = field(default_factory=list)
    timelines: list[Timeline] = field(default_factory=list)


def evaluate(
    clips: Sequence[Clip], jobs: int, on_verdicts: Callable[[int], None] = lambda _: None
) -> Generator[tuple[int, Result], None, None]:
    """The place of each clip and its result, as clips get done; `check` comes first.

    on_verdicts: hears twice a second how many verdicts all clips together have come to. Raises InputError or RunError
    for a clip that cannot be run.
    """
    counter = get_context("spawn").Value("q", 0)
    with workers(jobs, _count_in, counter) as pool:
        pending = {pool.submit(evaluate_clip, clip): place for place, clip in enumerate(clips)}
        while pending:
            done, _ = wait(pending, timeout=POLL_S, return_when=FIRST_COMPLETED)
            on_verdicts(counter.value)
            for future in done:
                try:
                    yield pending.pop(future), future.result()
                except BrokenProcessPool as error:
                    raise RunError("a process that ran clips has ended: is there enough memory?") from error


def _uncounted() -> None:
    """What is done for each verdict where nobody counts."""


_count: Callable[[], None] = _uncounted


def _count_in(counter: Synchronized[int]) -> None:
    """From now on this process adds each verdict to a number that is shared."""

    def add() -> None:
        with counter.get_lock():
            counter.value += 1

    global _count  # noqa: PLW0603 - a worker process has no other place that lasts from clip to clip
    _count = add


def evaluate_clip(clip: Clip) -> Result:
    """Runs one clip. Raises InputError or RunError that names it."""
    source = opened(clip)
    fps = source.cameras[0].fps
    period_ns = period_of(fps)
    rows: dict[str, list[Row]] = {}
    reports: list[Report] = []

    def collect(report: Report) -> None:
        if isinstance(report, Event):
            reports.append(report)
        elif isinstance(report, Verdict):
            _count()
            known = row(report, period_ns)
            if known is not None:
                rows.setdefault(report.pair, []).append(known)
            reports.append(replace(report, evidence=(), content=None))

    try:
        parts = assemble(clip.plan(KINDS), source, console=io.StringIO(), on_report=collect)
        pairs = [pair.name for pair in build_rig(clip.plan(KINDS), source).pairs]
        Run(parts).execute()
    except RunError as error:
        raise RunError(f"{clip.label}: {error}") from None
    result = Result()
    for pair in pairs:
        empty = Score(clip.recording, clip.manipulation, clip.seed, pair)
        of_pair = rows.get(pair, [])
        told = score(empty, of_pair, fps=fps, warm_up_s=clip.warm_up_s, warm_up_frames=clip.warm_up_frames)
        result.scores.append(told)
        result.outcomes.append(outcome_of(clip, pair, fps, reports))
        result.timelines.append(timeline_of(reports, pair, fps, truth_known=clip.truth_known))
    return result


def opened(clip: Clip) -> Source:
    """The clip's source, open, with all that is done to it. Raises InputError that names the clip."""
    source = build_source(clip.plan(KINDS), wrap=partial(_subsampled, clip), know_truth=True)
    try:
        source.open()
    except ConfigError:
        raise
    except InputError as error:
        raise InputError(f"{clip.label}: {error}") from None
    return source


def _subsampled(clip: Clip, source: Source) -> Source:
    sampling = clip.subsample
    return source if sampling is None else SubsampledSource(source, every=sampling.every, plus=sampling.plus)
