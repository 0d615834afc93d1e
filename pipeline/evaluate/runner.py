"""Runs the clips of a suite in parallel processes and scores each."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context

import cv2

from pipeline.assemble import KINDS, assemble, build_source
from pipeline.errors import InputError, RunError
from pipeline.evaluate.score import Row, Score, period_of, row, score
from pipeline.evaluate.subsample import SubsampledSource
from pipeline.evaluate.suite import Clip
from pipeline.frame import Source
from pipeline.run import Run
from pipeline.verdict import Report, Verdict


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


def evaluate(clips: Sequence[Clip], jobs: int) -> Iterator[tuple[int, list[Score]]]:
    """The place of each clip and its scores, one a pair, as clips get done; `check` comes first.

    Raises InputError or RunError for a clip that cannot be run.
    """
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        pending = {pool.submit(evaluate_clip, clip): place for place, clip in enumerate(clips)}
        try:
            for future in as_completed(pending):
                yield pending[future], future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def evaluate_clip(clip: Clip) -> list[Score]:
    """Runs one clip on one thread of OpenCV's. Raises InputError or RunError that names it."""
    cv2.setNumThreads(1)
    source = _opened(clip)
    fps = source.cameras[0].fps
    period_ns = period_of(fps)
    rows: dict[str, list[Row]] = {}

    def collect(verdict: Report) -> None:
        if not isinstance(verdict, Verdict):
            return
        known = row(verdict, period_ns)
        if known is not None:
            rows.setdefault(verdict.pair, []).append(known)

    try:
        Run(assemble(clip.plan(KINDS), source, console=io.StringIO(), on_report=collect)).execute()
    except RunError as error:
        raise RunError(f"{clip.label}: {error}") from None
    return [
        score(
            Score(clip.recording, clip.manipulation, clip.seed, pair),
            of_pair,
            fps=fps,
            warm_up_s=clip.warm_up_s,
            warm_up_frames=clip.warm_up_frames,
        )
        for pair, of_pair in rows.items()
    ]


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
