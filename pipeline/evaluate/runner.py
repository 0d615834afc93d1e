"""Runs the clips of a suite in parallel processes and scores each."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field, replace
from functools import partial

from pipeline.assemble import KINDS, assemble, build_rig, build_source
from pipeline.errors import InputError, RunError
from pipeline.evaluate.outcome import Outcome, outcome_of
from pipeline.evaluate.score import Row, Score, period_of, row, score
from pipeline.evaluate.subsample import SubsampledSource
from pipeline.evaluate.suite import Clip
from pipeline.evaluate.timeline import Timeline, timeline_of
from pipeline.frame import Source
from pipeline.run import Run
from pipeline.verdict import Event, Report, Verdict
from pipeline.workers import workers


def check(clips: Sequence[Clip]) -> None:
    """Reads what is cheap to read before anything runs: every plan, and the first picture of every recording.

    Raises InputError, which names the clip.
    """
    for clip in clips:
        clip.plan(KINDS)
    seen: set[tuple[str, str]] = set()
    for clip in clips:
        place = (str(clip.base), repr(clip.config["source"]))
        if place not in seen:
            seen.add(place)
            _opened(clip).close()


@dataclass(slots=True)
class Result:
    """What one clip came to: a score, an outcome and a timeline for each of its pairs."""

    scores: list[Score] = field(default_factory=list)
    outcomes: list[Outcome] = field(default_factory=list)
    timelines: list[Timeline] = field(default_factory=list)


def evaluate(clips: Sequence[Clip], jobs: int) -> Iterator[tuple[int, Result]]:
    """The place of each clip and its result, as clips get done; `check` comes first.

    Raises InputError or RunError for a clip that cannot be run.
    """
    with workers(jobs) as pool:
        pending = {pool.submit(evaluate_clip, clip): place for place, clip in enumerate(clips)}
        try:
            for future in as_completed(pending):
                yield pending[future], future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def evaluate_clip(clip: Clip) -> Result:
    """Runs one clip. Raises InputError or RunError that names it."""
    source = _opened(clip)
    fps = source.cameras[0].fps
    period_ns = period_of(fps)
    rows: dict[str, list[Row]] = {}
    reports: list[Report] = []

    def collect(report: Report) -> None:
        if isinstance(report, Event):
            reports.append(report)
        elif isinstance(report, Verdict):
            known = row(report, period_ns)
            if known is not None:
                rows.setdefault(report.pair, []).append(known)
            reports.append(replace(report, evidence=(), content=None))

    try:
        parts = assemble(clip.plan(KINDS), source, console=io.StringIO(), on_report=collect)
        pairs = [pair.name for pair in build_rig(clip.plan(KINDS), source.cameras).pairs]
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
        result.timelines.append(timeline_of(reports, pair, fps))
    return result


def _opened(clip: Clip) -> Source:
    source = build_source(clip.plan(KINDS), wrap=partial(_subsampled, clip), know_truth=True)
    try:
        source.open()
    except InputError as error:
        raise InputError(f"{clip.label}: {error}") from None
    return source


def _subsampled(clip: Clip, source: Source) -> Source:
    sampling = clip.subsample
    return source if sampling is None else SubsampledSource(source, every=sampling.every, plus=sampling.plus)
