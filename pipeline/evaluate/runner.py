"""Runs the clips of a suite in parallel processes and scores each."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context

import cv2

from pipeline.assemble import KINDS, assemble, build_source
from pipeline.errors import InputError
from pipeline.evaluate.score import Row, Score, period_of, row, score
from pipeline.evaluate.subsample import SubsampledSource
from pipeline.evaluate.suite import Clip
from pipeline.frame import Source
from pipeline.run import Run
from pipeline.verdict import Verdict


def evaluate(clips: Sequence[Clip], jobs: int) -> Iterator[list[Score]]:
    """The scores of each clip, a pair each, as clips get done. Raises InputError for a clip that cannot be run."""
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        pending = [pool.submit(evaluate_clip, clip) for clip in clips]
        try:
            for future in as_completed(pending):
                yield future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _subsampled(clip: Clip, source: Source) -> Source:
    sampling = clip.subsample
    return source if sampling is None else SubsampledSource(source, every=sampling.every, plus=sampling.plus)


def evaluate_clip(clip: Clip) -> list[Score]:
    """Runs one clip on one thread of OpenCV's. Raises InputError that names it."""
    cv2.setNumThreads(1)
    plan = clip.plan(KINDS)
    source = build_source(plan, wrap=partial(_subsampled, clip), know_truth=True)
    try:
        source.open()
    except InputError as error:
        raise InputError(f"recording '{clip.recording}', manipulation '{clip.manipulation}': {error}") from None
    rows: dict[str, list[Row]] = {}
    period_ns = period_of(source.cameras[0].fps)

    def collect(verdict: Verdict) -> None:
        known = row(verdict, period_ns)
        if known is not None:
            rows.setdefault(verdict.pair, []).append(known)

    fps = source.cameras[0].fps
    Run(assemble(plan, source, console=io.StringIO(), on_verdict=collect)).execute()
    return [
        score(Score(clip.recording, clip.manipulation, clip.seed, pair), of_pair, fps=fps, warm_up_s=clip.warm_up_s)
        for pair, of_pair in rows.items()
    ]
