"""Runs a pipeline: its threads, its queues, and an orderly end whatever happens."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

from pipeline.align import Aligner
from pipeline.buffer import WindowBuffer
from pipeline.conditions import Conditions
from pipeline.errors import RunError, SyncwatchError, explained
from pipeline.frame import NS_PER_S, Detector, Frame, Source, Window
from pipeline.geometry.rig import RigGeometry
from pipeline.health.observer import Observation, Observer
from pipeline.judge import Judge
from pipeline.queues import BoundedQueue, QueueClosedError
from pipeline.sink_thread import PATIENCE_S, SinkThread
from pipeline.status import StatusKeeper
from pipeline.verdict import Event, Evidence, Report, Sink, State, Verdict

log = logging.getLogger("syncwatch.run")

WINDOWS_AHEAD = 4
"""Windows that may wait for detection: a tenth of a second of jitter, without piling up latency."""

POLL_S = 0.1
"""How often an idle run looks whether it should end or a status is due. That of a live rig does so every period if that
is shorter: cameras are called missing within three periods and half a second of their last frame."""

LEAST_POLL_S = 0.01

STATUS_EVERY_NS = NS_PER_S


class Seen(NamedTuple):
    """A window and what is known of the cameras' health at it."""

    window: Window
    observation: Observation


@dataclass(slots=True)
class Parts:
    """Everything a run is made of, built by the assembly."""

    source: Source
    buffer: WindowBuffer
    observer: Observer
    detectors: Mapping[str, Detector]
    judge: Judge
    aligner: Aligner | None
    geometry: RigGeometry | None
    status: StatusKeeper
    conditions: Conditions
    sinks: Mapping[str, Sink]
    on_report: Callable[[Report], None] = field(default=lambda _: None)


class Run:
    """One run of a pipeline, from starting its sinks to stopping them.

    `stop` may be called from a signal handler or another thread: the source is stopped, what it had delivered is
    judged, and sinks get everything before they stop. It also stops by itself after `stop_after_s`.
    """

    def __init__(
        self,
        parts: Parts,
        *,
        stop_after_s: float | None = None,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._parts = parts
        self._monotonic_ns = monotonic_ns
        live = parts.source.live
        self._windows: BoundedQueue[Seen] = BoundedQueue(WINDOWS_AHEAD, wait=not live)
        self._sinks = [SinkThread(name, sink, wait=sink.lossless and not live) for name, sink in parts.sinks.items()]
        self._reader = threading.Thread(target=self._read, name="source", daemon=True)
        self._source_failure: SyncwatchError | None = None
        self._stopping = False  # a plain flag: a signal handler may set it at any moment
        self._status_due_ns = monotonic_ns()
        self._live = live
        self._poll_s = POLL_S
        if live:
            shortest_s = min((camera.period_ns for camera in parts.source.cameras), default=0) / NS_PER_S
            self._poll_s = min(POLL_S, max(LEAST_POLL_S, shortest_s))
        self._silence_due_ns = 0
        self._told_silent: set[tuple[str, str | None]] = set()
        self._stop_at_ns = None if stop_after_s is None else monotonic_ns() + round(stop_after_s * NS_PER_S)

    def stop(self) -> None:
        """Asks the run to end soon and in order."""
        self._stopping = True
        for sink in self._sinks:
            sink.hurry()

    def execute(self) -> None:
        """Runs until the source ends, `stop` is called or a part fails.

        Raises the first failure after everything else has been wound up: InputError for input that turned out bad,
        RunError for a part that failed.
        """
        failures: list[SyncwatchError] = []
        started: list[SinkThread] = []
        try:
            for sink in self._sinks:
                sink.start()
                started.append(sink)
            self._judge_everything()
        except KeyboardInterrupt:  # the run is abandoned
            raise
        except BaseException as error:  # whatever else it is, sinks and source are wound up first
            failures.append(explained("judging failed", error))
        failures += self._stop_source()
        for sink in started:
            sink.finish()
        failures += [sink.failure for sink in started if sink.failure is not None]
        for sink in started:
            if sink.dropped:
                log.warning("sink '%s' was too slow: %d reports dropped", sink.name, sink.dropped)
            if sink.dropped_frames:
                log.warning("sink '%s' was too slow: %d frames dropped", sink.name, sink.dropped_frames)
        self._say_what_was_left_out()
        for other in failures[1:]:
            if other is not failures[0]:
                log.error("%s", other)
        if failures:
            raise failures[0]

    def _say_what_was_left_out(self) -> None:
        counters = self._parts.buffer.counters
        for name, late in counters.late.items():
            if late or counters.duplicates[name]:
                log.warning("%s: %d late and %d repeated frames were left out", name, late, counters.duplicates[name])
        if self._windows.dropped:
            log.warning("detection was too slow: %d windows dropped", self._windows.dropped)

    def _judge_everything(self) -> None:
        self._reader.start()
        try:
            self._detect()
            self._close_detectors()
        finally:
            self._report_all(self._parts.conditions.finish())
            self._report_status()

    def _close_detectors(self) -> None:
        for name, detector in self._parts.detectors.items():
            close = getattr(detector, "close", None)
            if close is None:
                continue
            try:
                close()
            except Exception as error:  # a user's own detector may raise anything
                raise explained(f"detector '{name}' could not be closed", error) from error

    def _read(self) -> None:
        """The source's thread: frames in, windows out."""
        parts = self._parts
        try:
            for frame in parts.source.frames():
                self._show(frame)
                parts.observer.push(frame)
                self._hand_on(parts.buffer.push(frame))
            self._hand_on(parts.buffer.flush())
        except QueueClosedError:
            pass
        except BaseException as error:  # a user's own source may raise anything
            self._source_failure = explained("the source failed", error)
            self._flush_after_failure()
        finally:
            self._windows.close()

    def _show(self, frame: Frame) -> None:
        for sink in self._sinks:
            sink.put_frame(frame)

    def _hand_on(self, windows: Iterable[Window]) -> None:
        for window in windows:
            ended = getattr(self._parts.source, "ended", ())
            self._windows.put(Seen(window, self._parts.observer.see(window, ended)))

    def _flush_after_failure(self) -> None:
        """What was read before the failure is judged."""
        with suppress(QueueClosedError):
            self._hand_on(self._parts.buffer.flush())

    def _detect(self) -> None:
        """The detection loop. Raises RunError when a detector or sink fails."""
        stop_by: float | None = None
        while True:
            for sink in self._sinks:
                if sink.failure is not None:
                    return
            if self._stop_at_ns is not None and self._monotonic_ns() >= self._stop_at_ns:
                self._stopping = True
            if self._stopping and stop_by is None:
                stop_by = time.monotonic() + PATIENCE_S
                self._stop_reading()
            if stop_by is not None and time.monotonic() > stop_by and self._reader.is_alive():
                raise RunError(f"the source did not stop within {PATIENCE_S:.0f} s")
            try:
                seen = self._windows.get(timeout_s=self._poll_s)
            except TimeoutError:
                self._listen()
                self._report_status_if_due()
                continue
            except QueueClosedError:
                return
            self._handle(seen.window, seen.observation)

    def _listen(self) -> None:
        """No window has come: live cameras may be silent. Each is told of at once and, if first, once a second."""
        if not self._live:
            return
        now_ns = self._monotonic_ns()
        said = self._parts.judge.silence(Observation(lasting=self._parts.observer.tick(now_ns)))
        if now_ns >= self._silence_due_ns:
            self._silence_due_ns = now_ns + NS_PER_S
            self._told_silent.clear()
        said = [verdict for verdict in said if (verdict.pair, verdict.camera) not in self._told_silent]
        if said:
            self._told_silent |= {(verdict.pair, verdict.camera) for verdict in said}
            self._tell(said)

    def _handle(self, window: Window, observation: Observation) -> None:
        parts = self._parts
        parts.status.hear()
        evidence: list[Evidence] = []
        for name, detector in parts.detectors.items():
            try:
                evidence += detector.observe(window)
            except Exception as error:  # a user's own detector may raise anything
                raise explained(f"detector '{name}' failed at window {window.index}", error) from error
        verdicts = parts.judge.judge(window, evidence, observation)
        parts.status.judged(window)
        self._tell(verdicts, [*parts.conditions.observe(observation), *self._geometry_events(window, verdicts)])
        if parts.aligner is not None:
            self._report_all(parts.aligner.take(window, verdicts))

    def _geometry_events(self, window: Window, verdicts: Sequence[Verdict]) -> list[Event]:
        """What has become of the rig's geometry, looked at where pairs are not known to be out of sync."""
        parts = self._parts
        apart = {verdict.pair for verdict in verdicts if verdict.state is State.ASYNC}
        findings = parts.geometry.see(window, apart) if parts.geometry is not None else ()
        events = (parts.conditions.tell(one.kind, one.pair, one.phase, one.worst, one.text) for one in findings)
        return [event for event in events if event is not None]

    def _tell(self, verdicts: Sequence[Verdict], events: Sequence[Event] = ()) -> None:
        parts = self._parts
        changed = bool(events)
        for verdict in verdicts:
            changed |= parts.status.add(verdict)
            self._report_all([verdict, *parts.conditions.add(verdict)])
        self._report_all(events)
        if changed:
            self._report_status()
        else:
            self._report_status_if_due()

    def _report_all(self, reports: Sequence[Report]) -> None:
        for report in reports:
            self._parts.on_report(report)
            for sink in self._sinks:
                sink.put(report)

    def _report_status_if_due(self) -> None:
        if self._monotonic_ns() >= self._status_due_ns:
            self._report_status()

    def _report_status(self) -> None:
        self._status_due_ns = self._monotonic_ns() + STATUS_EVERY_NS
        parts = self._parts
        warnings = [event.text for event in parts.conditions.open if event.kind != "async"]
        status = parts.status.status(
            parts.buffer.counters,
            parts.observer.report(),
            warnings,
            dropped_windows=self._windows.dropped,
            overwritten=getattr(parts.source, "dropped", {}),
            sinks={sink.name: sink.status for sink in self._sinks},
        )
        self._report_all([status])

    def _stop_reading(self) -> list[SyncwatchError]:
        try:
            self._parts.source.stop()
        except Exception as error:  # a user's own source may raise anything
            return [explained("the source could not be stopped", error)]
        return []

    def _stop_source(self) -> list[SyncwatchError]:
        failures = self._stop_reading()
        self._windows.close()
        if self._reader.ident is not None:
            self._reader.join(PATIENCE_S)
        if self._source_failure is not None:
            failures.insert(0, self._source_failure)
        if self._reader.is_alive():
            return [*failures, RunError(f"the source did not stop within {PATIENCE_S:.0f} s")]
        try:
            self._parts.source.close()
        except Exception as error:  # as above
            failures.append(explained("the source could not be closed", error))
        return failures
