"""Judges one recording, every frame of it, in whatever process this is called."""

from __future__ import annotations

import io
import logging
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pipeline.answer import OF_PART, answer
from pipeline.assemble import assemble, build_rig, build_source
from pipeline.audit.segments import Segments
from pipeline.audit.task import MakePlan, Task
from pipeline.errors import explained
from pipeline.frame import Rig
from pipeline.messages import AuditPairShape, AuditShape, SegmentShape
from pipeline.plan import Plan
from pipeline.run import Run
from pipeline.tally import Tally
from pipeline.verdict import Reason, Report, State, Verdict

MOST_WARNINGS = 20


def judge(task: Task, make_plan: MakePlan, path: str | None = None) -> AuditShape:
    """What is said of the recording; why it is broken, where it is. Raises nothing.

    path: where it lies on this machine, if elsewhere.
    """
    begun_s = time.monotonic()
    heard = _Heard()
    error = None
    with _warnings() as warnings:
        try:
            heard.listen(make_plan(path or task.path))
        except Exception as failure:  # a damaged recording may raise anything: the audit goes on
            error = " ".join(str(explained("it cannot be judged", failure)).split())
    if error is not None and path is not None:
        error = error.replace(path, task.path)
    took_s = round(time.monotonic() - begun_s, 3)
    return task.record(**heard.said(broken=error is not None), error=error, warnings=warnings, took_s=took_s)


class _Heard:
    """What the run of a recording has told so far."""

    def __init__(self) -> None:
        self._rig: Rig | None = None
        self._tally = Tally()
        self._segments: dict[str, Segments] = {}

    def listen(self, plan: Plan) -> None:
        """Runs the plan to its end. Raises whatever keeps it from that."""
        source = build_source(plan)
        source.open()
        try:
            self._rig = build_rig(plan, source)
            for pair in self._rig.pairs:
                self._segments[pair.name] = Segments(pair, self._rig.camera(pair.first).fps)
            parts = assemble(plan, source, console=io.StringIO(), on_report=self._take)
        except BaseException:
            source.close()
            raise
        Run(parts).execute()

    def _take(self, report: Report) -> None:
        if isinstance(report, Verdict):
            self._tally.add(report)
            self._segments[report.pair].add(report)

    def said(self, *, broken: bool) -> dict[str, Any]:
        """The same as members of a record. A broken recording is never in sync: nobody knows the rest of it."""
        if self._rig is None:
            return {}
        cameras = [camera.name for camera in self._rig.cameras]
        pairs = self._tally.pairs
        if not pairs:
            return {"cameras": cameras}
        result = answer(self._tally)
        state = State.UNKNOWN if broken and result.state is State.SYNC else result.state
        first = self._segments[self._rig.pairs[0].name]
        segments = [segment for one in self._segments.values() for segment in one.all()]
        bad = {name for name, one in result.pairs.items() if one.state is State.ASYNC}
        worst = _longest([one for one in segments if one.state is State.ASYNC and one.pair in bad])
        total, decided = sum(one.total for one in pairs.values()), sum(one.decided for one in pairs.values())
        return {
            "cameras": cameras,
            "frames": first.frames,
            "duration_s": round(first.duration_s, 6),
            "state": state,
            "cause": worst and worst.cause,
            "reason": _most_common_reason(self._tally) if 2 * decided < total else None,
            "offset_ms": worst and worst.offset_ms,
            "coverage": round(decided / total, 4),
            "pairs": {
                name: AuditPairShape(state=result.pairs[name].state, frames=one.total, decided=one.decided)
                for name, one in pairs.items()
            },
            "segments": segments,
            "answer": result.text + (OF_PART if broken else ""),
        }


def _longest(segments: list[SegmentShape]) -> SegmentShape | None:
    return max(segments, key=lambda one: one.last_frame - one.first_frame, default=None)


def _most_common_reason(tally: Tally) -> Reason | None:
    reasons: Counter[Reason] = Counter()
    for pair in tally.pairs.values():
        reasons += pair.reasons
    return reasons.most_common(1)[0][0] if reasons else None


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """What is logged as a warning meanwhile, each once."""
    told: dict[str, None] = {}

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if len(told) < MOST_WARNINGS:
                told[record.getMessage()] = None

    logger = logging.getLogger("syncwatch")
    before = logger.level
    collector = Collector(logging.WARNING)
    logger.addHandler(collector)
    logger.setLevel(logging.WARNING)
    collected: list[str] = []
    try:
        yield collected
    finally:
        collected += told
        logger.removeHandler(collector)
        logger.setLevel(before)
