"""Stand-ins for cameras and consumers, for tests of one's own pipeline."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Sequence
from typing import TypeAlias

from pipeline.frame import Camera, Frame
from pipeline.verdict import Event, Report, Status, Verdict

Step: TypeAlias = Frame | BaseException | threading.Event
"""What a scripted source does next: deliver a frame, raise, or wait until something is set (or it is stopped)."""

LOOK_S = 0.01


class ScriptedSource:
    """Delivers exactly what the script says: late, lost, doubled or frozen frames, errors and silences."""

    def __init__(self, cameras: Sequence[Camera], steps: Iterable[Step], *, live: bool = False) -> None:
        self.cameras = tuple(cameras)
        self.live = live
        self.frame_count: int | None = None
        self.calls: list[str] = []
        self._steps = steps
        self._stopped = threading.Event()

    def open(self) -> None:
        self.calls.append("open")

    def frames(self) -> Iterator[Frame]:
        self.calls.append("frames")
        for step in self._steps:
            if self._stopped.is_set():
                return
            if isinstance(step, BaseException):
                raise step
            if isinstance(step, threading.Event):
                while not step.wait(LOOK_S) and not self._stopped.is_set():
                    pass
            else:
                yield step

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self.calls.append("close")


class ListSink:
    """Keeps every report. `hold`, while it is clear, keeps `take` from returning: a sink that is stuck."""

    def __init__(
        self, *, lossless: bool = True, fail_at: int | None = None, hold: threading.Event | None = None
    ) -> None:
        self.lossless = lossless
        self.reports: list[Report] = []
        self.calls: list[str] = []
        self._fail_at = fail_at
        self._hold = hold

    def start(self) -> None:
        self.calls.append("start")

    def take(self, report: Report) -> None:
        if self._hold is not None:
            self._hold.wait()
        if self._fail_at is not None and len(self.reports) >= self._fail_at:
            raise OSError("disk full")
        self.reports.append(report)

    def stop(self) -> None:
        self.calls.append("stop")

    @property
    def verdicts(self) -> list[Verdict]:
        return [report for report in self.reports if isinstance(report, Verdict)]

    @property
    def events(self) -> list[Event]:
        return [report for report in self.reports if isinstance(report, Event)]

    @property
    def statuses(self) -> list[Status]:
        return [report for report in self.reports if isinstance(report, Status)]
