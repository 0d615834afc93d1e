"""One sink on a thread of its own, behind bounded queues: however slow it is, detection goes on."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import TypeAlias

from pipeline.errors import RunError, SyncwatchError, explained
from pipeline.frame import Frame
from pipeline.queues import BoundedQueue, QueueClosedError
from pipeline.verdict import FrameSink, Report, Sink, SinkStatus, Verdict

REPORTS_AHEAD = 1000
"""Reports that may wait for a sink: half a minute of a stereo rig at 30 fps."""

FRAMES_AHEAD = 32
"""Frames that may wait for a sink: half a second of a stereo rig at 30 fps."""

PATIENCE_S = 10.0
"""How long a sink may take to start or to finish, and a source to stop, before it is given up."""

NextFrame: TypeAlias = type[Frame]
"""Stands in the queue of reports where a frame is due, so that a sink has both in order."""


class SinkThread:
    """Starts, feeds and stops one sink. wait: reports and frames wait for room instead of giving way to newer ones."""

    def __init__(self, name: str, sink: Sink, *, wait: bool) -> None:
        self.name = name
        self.failure: SyncwatchError | None = None
        self._sink = sink
        self._take_frame: Callable[[Frame], None] | None = None
        if isinstance(sink, FrameSink) and sink.wants_frames:
            self._take_frame = sink.take_frame
        self._queue: BoundedQueue[Report | NextFrame] = BoundedQueue(
            REPORTS_AHEAD, wait=wait, expendable=lambda report: isinstance(report, Verdict)
        )
        self._frames: BoundedQueue[Frame] = BoundedQueue(FRAMES_AHEAD, wait=wait)
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._work, name=f"sink-{name}", daemon=True)

    @property
    def dropped(self) -> int:
        return self._queue.dropped

    @property
    def dropped_frames(self) -> int:
        return self._frames.dropped

    @property
    def status(self) -> SinkStatus:
        """What was lost on the way to the sink, and what it says itself that it has lost (`dropped`)."""
        return SinkStatus(self.dropped + int(getattr(self._sink, "dropped", 0)), self.dropped_frames)

    def start(self) -> None:
        """Starts the sink and waits until it is ready. Raises what kept it from starting."""
        self._thread.start()
        if not self._started.wait(PATIENCE_S):
            self.failure = RunError(f"sink '{self.name}' did not start within {PATIENCE_S:.0f} s")
        if self.failure is not None:
            raise self.failure

    def put(self, report: Report) -> None:
        with suppress(QueueClosedError):
            self._queue.put(report)

    def put_frame(self, frame: Frame) -> None:
        """Frames are handed to sinks that want them, and held for no other."""
        if self._take_frame is None:
            return
        with suppress(QueueClosedError):
            dropped_before = self._frames.dropped
            self._frames.put(frame)
            if self._frames.dropped == dropped_before:  # else the place of the frame that gave way is free
                self._queue.put(Frame)

    def hurry(self) -> None:
        self._frames.hurry(PATIENCE_S)
        self._queue.hurry(PATIENCE_S)

    def finish(self) -> None:
        """Lets the sink have what is left, for a while, then stops it."""
        self._close()
        self._thread.join(PATIENCE_S)
        if self._thread.is_alive() and self.failure is None:
            self.failure = RunError(
                f"sink '{self.name}' did not finish within {PATIENCE_S:.0f} s: {len(self._queue)} reports lost"
            )

    def _work(self) -> None:
        try:
            self._sink.start()
        except BaseException as error:  # a user's own sink may raise anything, or call sys.exit
            self._fail("could not start", error)
            self._started.set()
            return
        self._started.set()
        try:
            try:
                while True:
                    self._take(self._queue.get())
            except QueueClosedError:
                pass
            finally:
                self._sink.stop()
        except BaseException as error:  # as above
            self._fail("failed", error)

    def _take(self, item: Report | NextFrame) -> None:
        if not isinstance(item, type):
            self._sink.take(item)
        elif self._take_frame is not None:
            self._take_frame(self._frames.get())

    def _fail(self, what: str, error: BaseException) -> None:
        self.failure = explained(f"sink '{self.name}' {what}", error)
        self._close()

    def _close(self) -> None:
        self._frames.close()
        self._queue.close()
