"""Assertions about recordings, in the words of `syncwatch check`."""

from __future__ import annotations

import io
from collections.abc import Sequence
from os import PathLike, fspath

from pipeline.answer import Answer, answer
from pipeline.assemble import assemble, build_source
from pipeline.cli.recording import RecordingOptions, recording_plan
from pipeline.run import Run
from pipeline.tally import Tally
from pipeline.verdict import Cause, State

Paths = str | PathLike[str] | Sequence[str | PathLike[str]]


def assert_in_sync(recording: Paths, *, fps: float | None = None, topics: str | None = None) -> None:
    """Judges every frame of a recording. `fps` and `topics` are those of `syncwatch check`.

    Raises AssertionError, with its answer, unless all pairs are in sync; InputError for what is no recording.
    """
    result, _ = _judged(recording, fps, topics)
    assert result.state is State.SYNC, result.text


def assert_out_of_sync(
    recording: Paths, *, cause: str | Cause | None = None, fps: float | None = None, topics: str | None = None
) -> None:
    """The contrary, for tests that inject a fault. cause: `slip`, `phase`, `stamps_lie` ... must have been named.

    Raises AssertionError with the answer; InputError for what is no recording.
    """
    result, tally = _judged(recording, fps, topics)
    assert result.state is State.ASYNC, result.text
    named = {one.first.cause for pair in tally.pairs.values() for one in pair.stretches}
    assert cause is None or Cause(cause) in named, result.text


def _judged(recording: Paths, fps: float | None, topics: str | None) -> tuple[Answer, Tally]:
    several = [recording] if isinstance(recording, (str, PathLike)) else recording
    plan = recording_plan([fspath(path) for path in several], RecordingOptions(fps=fps, topics=topics))
    tally = Tally()
    source = build_source(plan)
    source.open()
    Run(assemble(plan, source, console=io.StringIO(), on_report=tally.take)).execute()
    return answer(tally), tally
