"""The judging part of a pipeline, fed frame by frame."""

from __future__ import annotations

from typing import Any

from pipeline.buffer import BufferSettings, WindowBuffer
from pipeline.detectors.timestamp import TimestampDetector, TimestampSettings
from pipeline.frame import Frame
from pipeline.health.observer import Observer
from pipeline.judge import Judge, JudgeSettings
from pipeline.status import StatusKeeper
from pipeline.verdict import Level, Status
from tests.frames import PERIOD_NS, RIG, frame

LATENCY_NS = 7_000_000


class Monitor:
    """Takes frames as they arrive, on their clock; a verdict takes LATENCY_NS."""

    def __init__(self) -> None:
        self.now_ns = 0
        self._buffer = WindowBuffer(RIG.cameras, BufferSettings())
        self._observer = Observer(RIG.cameras)
        self._detector = TimestampDetector(TimestampSettings(), name="timestamp", rig=RIG, classic=False)
        self._judge = Judge(JudgeSettings(), RIG)
        self.keeper = StatusKeeper(
            RIG, unknown_is=Level.OK, version="1.2", wall_ns=lambda: self.now_ns, monotonic_ns=lambda: self.now_ns
        )

    def take(self, item: Frame) -> None:
        self.now_ns = item.arrived_ns + LATENCY_NS
        self._observer.push(item)
        for window in self._buffer.push(item):
            seen = self._observer.see(window)
            self.keeper.hear()
            verdicts = self._judge.judge(window, self._detector.observe(window), seen)
            self.keeper.judged(window)
            for verdict in verdicts:
                self.keeper.add(verdict)

    def status(self) -> Status:
        return self.keeper.status(self._buffer.counters, self._observer.report())


def stereo(count: int, start: int = 0, *, right_ns: int = 0, **fields: Any) -> list[Frame]:
    return [
        frame(name, n * PERIOD_NS + right_ns * (name == "right"), n, group=n, arrived_ns=n * PERIOD_NS, **fields)
        for n in range(start, start + count)
        for name in ("left", "right")
    ]
