"""What every kind of sink promises."""

from __future__ import annotations

import io
import uuid

import pytest

from pipeline.verdict import AlignedPair, Basis, Cause, Event, FrameSink, Level, Sink, State, Status, Verdict
from sinks.console import ConsoleSettings, ConsoleSink
from sinks.events import EventsSettings, EventsSink
from sinks.jsonl import JsonlSettings, JsonlSink
from sinks.mcap.settings import McapSettings
from sinks.mcap.sink import McapSink
from sinks.pictures import PicturesSettings, PicturesSink
from sinks.prometheus import PrometheusSettings, PrometheusSink
from sinks.ros2.sink import Ros2Settings, Ros2Sink
from sinks.zenoh import ZenohSettings, ZenohSink
from syncwatch.testing import ListSink
from tests.frames import RIG, frame

REPORTS = [
    Verdict("bench", "left-right", 0, State.SYNC, Basis.CONTENT, captured_ns={"left": 0, "right": None}),
    Verdict("bench", "left-right", None, State.ASYNC, Basis.NONE, cause=Cause.MISSING),
    Event("bench", "a-1", "async", "onset", "left-right", "right", Cause.SLIP, 1, None, {"offset_ms": 33.0}, "late"),
    Event(
        "bench", "a-1", "async", "end", "left-right", "right", Cause.SLIP, 1, 2, {"offset_ms": 33.0}, "in sync again"
    ),
    Status("bench", 1, Level.ERROR, ("left-right: late",), {}, {}, "0", 1.0, 0),
    AlignedPair("bench", "left-right", 1, 0, 1, 0, 1000, (frame("left", 1), frame("right", 0))),
]


def make(kind: str, folder) -> Sink:
    if kind.startswith("console"):
        settings = ConsoleSettings.model_validate({"style": kind.partition("-")[2]})
        return ConsoleSink(settings, stream=io.StringIO(), rig=RIG, frame_count=10)
    if kind == "jsonl":
        return JsonlSink(JsonlSettings(path="out.jsonl", what=("verdict", "event", "status", "aligned")), base=folder)
    if kind.startswith("zenoh"):
        preview = {"every_s": 0.1} if kind == "zenoh-preview" else None
        return ZenohSink(ZenohSettings(prefix=f"test/{uuid.uuid4().hex[:8]}", preview=preview), rig="bench")
    if kind == "mcap":
        settings = McapSettings(path="out.mcap")
        return McapSink(settings, base=folder, rig=RIG, detectors=["offset"], version="0", live=False)
    if kind == "events":
        return EventsSink(EventsSettings(), base=folder, rig="bench")
    if kind == "pictures":
        return PicturesSink(PicturesSettings(), rig="bench")
    if kind == "prometheus":
        return PrometheusSink(PrometheusSettings(listen="127.0.0.1:0"), rig="bench", version="0")
    if kind == "ros2":
        return Ros2Sink(Ros2Settings(mode="peer", connect=(), domain_id=99), rig="bench")
    return ListSink()


KINDS = [
    "console-live",
    "console-classic",
    "console-progress",
    "jsonl",
    "mcap",
    "events",
    "zenoh",
    "zenoh-preview",
    "pictures",
    "prometheus",
    "ros2",
    "list",
]


@pytest.fixture(params=KINDS)
def sink(request, tmp_path) -> Sink:
    return make(request.param, tmp_path)


def test_it_takes_every_kind_of_report(sink):
    sink.start()
    for report in REPORTS * 3:
        sink.take(report)
        if isinstance(sink, FrameSink) and sink.wants_frames:
            sink.take_frame(frame("left", 1))
    sink.stop()


def test_it_can_stop_without_having_taken_anything(sink):
    sink.start()
    sink.stop()


def test_it_says_whether_a_recording_waits_for_it(sink):
    assert isinstance(sink.lossless, bool)
