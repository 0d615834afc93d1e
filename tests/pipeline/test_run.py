"""The life cycle of a run: what ends it, what is kept, and that it never hangs."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import pipeline.run
import pipeline.sink_thread
from pipeline.buffer import BufferSettings, WindowBuffer
from pipeline.conditions import Conditions
from pipeline.detectors.timestamp import TimestampDetector, TimestampSettings
from pipeline.errors import InputError, RunError
from pipeline.frame import Detector, Frame, Window
from pipeline.health.observer import Observer
from pipeline.judge import Judge, JudgeSettings
from pipeline.run import Parts, Run
from pipeline.status import StatusKeeper
from pipeline.verdict import Cause, Event, Evidence, Level, Report, Sink, SinkStatus, State
from syncwatch.testing import ListSink, ScriptedSource, Step
from tests.frames import PERIOD_NS, RIG, frame


def frames(count: int, start: int = 0, right_ns: int = 0) -> list[Frame]:
    return [
        frame(name, n * PERIOD_NS + right_ns * (name == "right"), n, group=n)
        for n in range(start, start + count)
        for name in ("left", "right")
    ]


def run_of(
    steps: Iterable[Step], *sinks: Sink, live: bool = False, detector: Detector | None = None, **options: Any
) -> Run:
    timestamp = TimestampDetector(TimestampSettings(), name="timestamp", rig=RIG, classic=False)
    return Run(
        Parts(
            source=ScriptedSource(RIG.cameras, steps, live=live),
            buffer=WindowBuffer(RIG.cameras, BufferSettings()),
            observer=Observer(RIG.cameras),
            detectors={"timestamp": detector or timestamp},
            judge=Judge(JudgeSettings(), RIG),
            aligner=None,
            geometry=None,
            status=StatusKeeper(
                RIG, unknown_is=Level.OK, version="0", wall_ns=time.time_ns, monotonic_ns=time.monotonic_ns
            ),
            conditions=Conditions(RIG, time.time_ns),
            sinks={f"sink{index}": sink for index, sink in enumerate(sinks)},
        ),
        **options,
    )


SLOW_NS = 500_000_000
"""What a busy machine may be late by."""


@pytest.fixture
def _impatient(monkeypatch):
    monkeypatch.setattr(pipeline.run, "PATIENCE_S", 0.5)
    monkeypatch.setattr(pipeline.sink_thread, "PATIENCE_S", 0.5)


class Failing:
    def observe(self, window: Window) -> Sequence[Evidence]:
        if window.index == 5:
            raise ZeroDivisionError("division by zero")
        return []


class Slow:
    def __init__(self) -> None:
        self.seen: list[Window] = []
        self.go = threading.Event()

    def observe(self, window: Window) -> Sequence[Evidence]:
        self.seen.append(window)
        self.go.wait(5)
        return []


def test_every_frame_of_a_recording_is_judged_and_told_in_order():
    sink = ListSink()
    run_of(frames(3000), sink).execute()
    assert [verdict.frame for verdict in sink.verdicts] == list(range(3000))
    assert sink.calls == ["start", "stop"]


def test_onset_and_end_reach_the_sinks_and_status_follows_the_change():
    sink = ListSink()
    run_of([*frames(30), *frames(10, 30, PERIOD_NS), *frames(10, 40)], sink).execute()
    assert [(event.phase, event.pair) for event in sink.events] == [("onset", "left-right"), ("end", "left-right")]
    assert [status.level for status in sink.statuses].count(Level.ERROR) >= 1
    assert sink.statuses[-1].level is Level.OK
    assert sink.statuses[-1].cameras["right"].frames == 50


@pytest.mark.parametrize(
    ("error", "expected", "text"),
    [
        (InputError("left/7.png is truncated"), InputError, "left/7.png is truncated"),
        (ValueError("odd"), RunError, "the source failed: ValueError: odd"),
    ],
)
def test_a_source_that_raises_ends_the_run_and_what_it_delivered_is_judged(error, expected, text):
    sink = ListSink()
    with pytest.raises(expected, match=text):
        run_of([*frames(7), error], sink).execute()
    assert len(sink.verdicts) == 7
    assert sink.calls == ["start", "stop"]


def test_a_detector_that_raises_ends_the_run_and_names_itself():
    sink = ListSink()
    with pytest.raises(RunError, match="detector 'timestamp' failed at window 5: ZeroDivisionError: division by zero"):
        run_of(frames(100), sink, detector=Failing()).execute()
    assert len(sink.verdicts) == 5


def test_a_sink_that_raises_ends_the_run_and_the_others_finish():
    good, bad = ListSink(), ListSink(fail_at=3)
    with pytest.raises(RunError, match="sink 'sink1' failed: OSError: disk full"):
        run_of(frames(100_000), good, bad).execute()
    assert len(bad.reports) == 3
    assert good.calls == bad.calls == ["start", "stop"]


def test_a_sink_that_cannot_start_ends_the_run_before_the_source_is_read():
    class Broken(ListSink):
        def start(self) -> None:
            raise InputError("no such folder")

    run = run_of(frames(10), Broken())
    with pytest.raises(InputError, match="no such folder"):
        run.execute()


@pytest.mark.usefixtures("_impatient")
def test_a_sink_that_is_stuck_cannot_hang_the_end():
    hold = threading.Event()
    with pytest.raises(RunError, match=r"sink 'sink0' did not finish within .* reports lost"):
        run_of(frames(50), ListSink(lossless=False, hold=hold)).execute()
    hold.set()


@pytest.mark.usefixtures("_impatient")
def test_a_stuck_sink_does_not_falsify_what_the_others_are_told():
    hold = threading.Event()
    good = ListSink()
    with pytest.raises(RunError):
        run_of(frames(5000), good, ListSink(lossless=False, hold=hold)).execute()
    hold.set()
    assert [verdict.frame for verdict in good.verdicts] == list(range(5000))


def test_a_recording_waits_for_a_lossless_sink(monkeypatch):
    monkeypatch.setattr(pipeline.sink_thread, "REPORTS_AHEAD", 5)

    class Slowish(ListSink):
        def take(self, report):
            time.sleep(0.0005)
            super().take(report)

    sink = Slowish()
    run_of(frames(300), sink).execute()
    assert len(sink.verdicts) == 300


class FramesToo(ListSink):
    wants_frames = True

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.frames: list[Frame] = []

    def take_frame(self, frame: Frame) -> None:
        if self._hold is not None:
            self._hold.wait()
        self.frames.append(frame)


def test_a_sink_that_wants_frames_gets_every_one_before_it_is_judged():
    sink = FramesToo()
    given = frames(100)
    run_of(given, sink, ListSink()).execute()
    assert sink.frames == given
    assert [verdict.frame for verdict in sink.verdicts] == list(range(100))


def test_a_slow_sink_loses_the_oldest_frames_and_no_verdict(caplog):
    hold = threading.Event()
    sink = FramesToo(lossless=False, hold=hold)
    good = ListSink()
    given = frames(100)
    run = run_of([*given, hold], sink, good)
    threading.Timer(0.5, hold.set).start()
    run.execute()
    assert sink.frames[-32:] == given[-32:]
    assert len(sink.frames) < 50
    assert f"{len(given) - len(sink.frames)} frames dropped" in caplog.text
    assert len(sink.verdicts) == len(good.verdicts) == 100


def test_a_recording_waits_for_a_lossless_sink_of_frames(monkeypatch):
    monkeypatch.setattr(pipeline.sink_thread, "FRAMES_AHEAD", 2)
    sink = FramesToo()
    given = frames(100)
    run_of(given, sink).execute()
    assert sink.frames == given


def test_stopping_judges_what_was_delivered_and_ends_in_order():
    never = threading.Event()
    sink = ListSink()
    run = run_of([*frames(20), never], sink)
    threading.Timer(0.3, run.stop).start()
    run.execute()
    assert len(sink.verdicts) == 20
    assert sink.calls == ["start", "stop"]


def test_a_run_can_stop_by_itself_after_a_time():
    sink = ListSink()
    run_of([*frames(20), threading.Event()], sink, stop_after_s=0.2).execute()
    assert len(sink.verdicts) == 20


def test_stopping_before_starting_is_safe():
    sink = ListSink()
    run = run_of(frames(5), sink)
    run.stop()
    run.execute()
    assert sink.calls == ["start", "stop"]


@pytest.mark.usefixtures("_impatient")
def test_a_source_that_does_not_stop_is_given_up():
    class Stubborn(ScriptedSource):
        def stop(self) -> None:
            pass

    hold = threading.Event()
    run = run_of([], ListSink(), stop_after_s=0.1)
    run._parts.source = Stubborn(RIG.cameras, [*frames(3), hold])
    with pytest.raises(RunError, match="the source did not stop within"):
        run.execute()
    hold.set()


def test_a_slow_detector_drops_whole_windows_of_a_live_rig_oldest_first():
    slow, sink = Slow(), ListSink()
    more = threading.Event()
    run = run_of([*frames(50), more], sink, live=True, detector=slow)
    runner = threading.Thread(target=run.execute)
    runner.start()
    deadline = time.monotonic() + 5
    while run._windows.dropped < 40 and time.monotonic() < deadline:
        time.sleep(0.01)
    slow.go.set()
    more.set()
    runner.join(5)
    indices = [window.index for window in slow.seen]
    assert indices[-1] == 49
    assert indices == sorted(indices)
    assert all(len({triple.current.sequence for triple in window.cameras.values()}) == 1 for window in slow.seen)
    assert sink.statuses[-1].dropped_windows == 50 - len(indices)
    for seen in slow.seen:
        left, right = (seen.cameras[name].current for name in ("left", "right"))
        assert left.sequence == right.sequence


def test_what_a_stuck_sink_lost_is_told_by_the_others_and_costs_no_verdict():
    hold, listening = threading.Event(), ListSink()
    runner = threading.Thread(target=run_of(frames(2000), ListSink(lossless=False, hold=hold), listening).execute)
    runner.start()
    deadline = time.monotonic() + 20
    while len(listening.verdicts) < 2000 and time.monotonic() < deadline:
        time.sleep(0.01)
    hold.set()
    runner.join(10)
    assert [verdict.frame for verdict in listening.verdicts] == list(range(2000))
    lost = [status.sinks["sink0"].dropped_reports for status in listening.statuses]
    assert lost == sorted(lost)
    assert 900 <= lost[-1] <= 1100
    assert listening.statuses[-1].sinks["sink1"] == SinkStatus(0, 0)
    assert listening.statuses[-1].dropped_windows == 0


class Awkward(ScriptedSource):
    def __init__(self, fails: str) -> None:
        super().__init__(RIG.cameras, frames(5))
        self._fails = fails

    def stop(self) -> None:
        if self._fails == "stop":
            raise OSError("no such device")
        super().stop()

    def close(self) -> None:
        if self._fails == "close":
            raise OSError("no such device")


@pytest.mark.parametrize("method", ["stop", "close"])
def test_a_source_that_cannot_be_wound_up_is_an_error_after_everything_else_was(method):
    sink = ListSink()
    run = run_of([], sink)
    run._parts.source = Awkward(method)
    with pytest.raises(RunError, match=r"the source could not be .*: OSError: no such device"):
        run.execute()
    assert len(sink.verdicts) == 5
    assert sink.calls == ["start", "stop"]


class Quitting(ListSink):
    def take(self, report: Report) -> None:
        raise SystemExit(1)


def test_a_sink_that_calls_exit_ends_the_run_and_cannot_hang_it():
    with pytest.raises(RunError, match="sink 'sink0' failed: SystemExit"):
        run_of(frames(3000), Quitting()).execute()


def test_a_source_or_detector_that_calls_exit_is_an_error():
    sink = ListSink()
    with pytest.raises(RunError, match="the source failed: SystemExit"):
        run_of([*frames(3), SystemExit(0)], sink).execute()
    assert len(sink.verdicts) == 3


def test_late_and_repeated_frames_are_said_at_the_end(caplog):
    delivered = frames(6)
    run_of([*delivered, delivered[2], delivered[2], delivered[11]], ListSink()).execute()
    said = [record.getMessage() for record in caplog.records]
    assert said == [
        "left: 2 late and 0 repeated frames were left out",
        "right: 0 late and 1 repeated frames were left out",
    ]


def test_the_source_is_closed_after_the_run():
    run = run_of(frames(3), ListSink())
    run.execute()
    assert run._parts.source.calls[-1] == "close"


def test_a_partner_that_dies_is_told_in_place_of_the_alarm():
    left = [item for item in frames(20, 30) if item.camera == "left"]
    sink = ListSink()
    run_of([*frames(10), *frames(20, 10, PERIOD_NS), *left], sink).execute()
    assert sink.statuses[-1].level is Level.ERROR
    assert sink.statuses[-1].reasons == ("left-right: right delivers nothing (missing)",)


def test_live_cameras_that_all_fall_silent_are_told_by_the_clock_and_once_a_second():
    now_ns = time.monotonic_ns()
    sink = ListSink()
    stream = [replace(item, arrived_ns=now_ns) for item in frames(20)]
    run_of([*stream, threading.Event()], sink, live=True, stop_after_s=2.5).execute()
    silent = [verdict for verdict in sink.verdicts if verdict.frame is None]
    assert 1 <= len(silent) <= 3
    assert {(one.state, one.cause, one.camera) for one in silent} == {(State.ASYNC, Cause.MISSING, "left")}
    assert [(event.phase, event.cause, event.camera) for event in sink.events] == [
        ("onset", Cause.MISSING, "left"),
        ("end", Cause.MISSING, "left"),
    ]
    assert sink.statuses[-1].level is Level.ERROR


@pytest.mark.parametrize(("silent", "other"), [("left", "right"), ("right", "left")])
def test_one_live_camera_that_falls_silent_is_told_of_alone_and_within_its_time(silent, other):
    def stream():
        """Ten frames a second, of both cameras for a second, then of one."""
        for n in range(25):
            time.sleep(0.1)
            for name in (silent, other) if n < 10 else (other,):
                now_ns = time.monotonic_ns()
                last_ns[name] = now_ns
                yield frame(name, n * PERIOD_NS, n, arrived_ns=now_ns)

    last_ns: dict[str, int] = {}
    told_ns: list[int] = []
    sink = ListSink()
    run = run_of(stream(), sink, live=True)
    run._parts.on_report = lambda report: told_ns.append(time.monotonic_ns()) if isinstance(report, Event) else None
    run.execute()
    assert [(event.phase, event.cause, event.camera) for event in sink.events] == [
        ("onset", Cause.MISSING, silent),
        ("end", Cause.MISSING, silent),
    ]
    assert told_ns[0] - last_ns[silent] <= 3 * PERIOD_NS + 500_000_000 + SLOW_NS


def test_a_recording_that_is_read_slowly_is_not_a_silent_rig():
    sink = ListSink()
    run_of([*frames(20), threading.Event()], sink, stop_after_s=1.2).execute()
    assert sink.events == []


def test_what_is_amiss_with_a_camera_is_a_warning():
    dark = [replace(item, image=np.zeros((2, 2), np.uint8)) if item.camera == "right" else item for item in frames(20)]
    sink = ListSink()
    run_of(dark, sink).execute()
    assert [(event.kind, event.phase, event.camera) for event in sink.events] == [
        ("dark", "onset", "right"),
        ("dark", "end", "right"),
    ]
    warned = [status for status in sink.statuses if status.level is Level.WARN]
    assert warned
    assert warned[0].reasons == ("right sees nothing: its pictures are dark",)
    assert warned[0].to_message()["cameras"]["right"]["conditions"] == ["dark"]


def test_an_abandoned_run_is_not_an_error_of_a_part():
    class Impatient:
        def observe(self, window: Window) -> Sequence[Evidence]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_of(frames(5), ListSink(), detector=Impatient()).execute()


def test_a_silent_rig_becomes_stale():
    sink = ListSink()
    clock = iter(range(0, 10**15, 10**9))
    run = run_of([*frames(5), threading.Event()], sink, stop_after_s=30, monotonic_ns=lambda: next(clock))
    run._parts.status._monotonic_ns = lambda: next(clock)
    run.execute()
    assert sink.statuses[-1].level is Level.STALE
