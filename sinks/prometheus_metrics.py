"""What Prometheus is told of a rig, in base units."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

from pipeline.frame import NS_PER_S
from pipeline.notes import Note
from pipeline.verdict import CameraStatus, Cause, Event, Level, PairStatus, Report, State, Status, Verdict

LASTING = (Note.JITTER, Note.FROZEN, Note.DARK, Note.SATURATED, Note.BLURRED, Note.STALLED, Note.MISSING)
"""What may last of a camera."""

PPM = 1e-6


class Family(NamedTuple):
    """A metric `syncwatch_<name>` (counters end in `_total`), what it says, and its labels besides `rig`."""

    name: str
    says: str
    labels: tuple[str, ...] = ()


GAUGES = (
    Family("level", "1 for the level of the rig, 0 for the others.", ("level",)),
    Family("status_timestamp_seconds", "When the rig's state was last said, seconds since 1970."),
    Family("uptime_seconds", "Since the monitor was started."),
    Family("resident_memory_bytes", "Memory that the monitor holds."),
    Family("verdict_latency_p99_seconds", "From the arrival of a frame to its verdict, last minute."),
    Family("state", "1 for the state of the pair, 0 for the others.", ("pair", "state")),
    Family("cause", "1 for the cause of a pair being out of sync, 0 for the others.", ("pair", "cause")),
    Family("state_since_timestamp_seconds", "Since when the pair is in its state, seconds since 1970.", ("pair",)),
    Family("offset_seconds", "Second camera against the first; positive: a later moment.", ("pair",)),
    Family("offset_sigma_seconds", "Standard error of the offset.", ("pair",)),
    Family("skew_p50_seconds", "Size of the offset, median of the last minute.", ("pair",)),
    Family("skew_p99_seconds", "Size of the offset, 99th percentile of the last minute.", ("pair",)),
    Family("coverage_ratio", "Share of frames that could be decided.", ("pair",)),
    Family("drift_ratio", "How fast the offset grows, seconds a second.", ("pair", "witness")),
    Family("drift_sigma_ratio", "Standard error of the drift.", ("pair", "witness")),
    Family("frame_rate_hertz", "Measured on the stamps of the camera.", ("camera",)),
    Family("expected_frame_rate_hertz", "What the camera is set to.", ("camera",)),
    Family("jitter_p50_seconds", "How far intervals of stamps are off the period, median.", ("camera",)),
    Family("jitter_p99_seconds", "How far intervals of stamps are off the period, 99th percentile.", ("camera",)),
    Family("camera_condition", "1 for what lasts of the camera, 0 for the others.", ("camera", "condition")),
    Family("camera_epoch", "Rises when the device or its clock starts anew.", ("camera",)),
)

COUNTERS = (
    Family("verdicts", "Frames judged, by state.", ("pair", "state")),
    Family("events", "Conditions that began; of pairs out of sync with the cause.", ("kind", "cause")),
    Family("dropped_windows", "Moments that were not judged for want of time."),
    Family("sink_dropped_reports", "Reports that a sink could not take in time.", ("sink",)),
    Family("sink_dropped_frames", "Frames that a sink could not take in time.", ("sink",)),
    Family("frames", "Frames delivered.", ("camera",)),
    Family("drops", "Frames lost, by counter or by time.", ("camera",)),
    Family("overwritten_frames", "Frames that gave way to newer ones before they were taken.", ("camera",)),
    Family("unpaired_frames", "Moments that the camera had no frame of.", ("camera",)),
    Family("duplicate_frames", "Frames delivered twice.", ("camera",)),
    Family("restarts", "Times that the device or its clock started anew.", ("camera",)),
    Family("stalls", "Silences of more than three periods.", ("camera",)),
)


class RigCollector(Collector):
    """Metrics of one rig, made anew at each scrape from the last status and from counts of verdicts and events.

    Counters only grow while the monitor runs, whatever cameras do. Scrapes come on threads of their own.
    """

    def __init__(self, rig: str, version: str) -> None:
        self._rig = rig
        self._version = version
        self._lock = threading.Lock()
        self._status: Status | None = None
        self._verdicts: Counter[tuple[str, str]] = Counter()
        self._events: Counter[tuple[str, str]] = Counter()

    def take(self, report: Report) -> None:
        with self._lock:
            if isinstance(report, Status):
                self._status = report
            elif isinstance(report, Verdict):
                self._verdicts[report.pair, report.state.value] += 1
            elif isinstance(report, Event) and report.phase == "onset":
                self._events[report.kind, report.cause.value if report.cause else ""] += 1

    def collect(self) -> Iterator[Metric]:
        with self._lock:
            status, verdicts, events = self._status, dict(self._verdicts), dict(self._events)
        yield InfoMetricFamily("syncwatch_build", "The monitor.", value={"version": self._version})
        page = _Page(self._rig)
        for labels, number in verdicts.items():
            page.put("verdicts", number, *labels)
        for labels, number in events.items():
            page.put("events", number, *labels)
        if status is not None:
            _put_rig(page, status)
            for name, pair in status.pairs.items():
                _put_pair(page, name, pair)
            for name, camera in status.cameras.items():
                _put_camera(page, name, camera)
        yield from page.families.values()


class _Page:
    """What one scrape is answered."""

    def __init__(self, rig: str) -> None:
        self._rig = rig
        self.families: dict[str, GaugeMetricFamily | CounterMetricFamily] = {
            **{one.name: GaugeMetricFamily(*_header(one)) for one in GAUGES},
            **{one.name: CounterMetricFamily(*_header(one)) for one in COUNTERS},
        }

    def put(self, name: str, value: float | None, *labels: str) -> None:
        """Leaves out what is not known."""
        if value is not None:
            self.families[name].add_metric([self._rig, *labels], value)

    def choose(self, name: str, kinds: type[Enum], chosen: Enum | None, *labels: str) -> None:
        """One series a kind: 1 for the one that holds."""
        for kind in kinds:
            self.put(name, float(kind is chosen), *labels, kind.value)


def _header(family: Family) -> tuple[str, str, None, tuple[str, ...]]:
    return f"syncwatch_{family.name}", family.says, None, ("rig", *family.labels)


def _put_rig(page: _Page, status: Status) -> None:
    page.choose("level", Level, status.level)
    page.put("status_timestamp_seconds", _seconds(status.at_ns))
    page.put("uptime_seconds", status.uptime_s)
    page.put("resident_memory_bytes", status.memory_bytes)
    page.put("verdict_latency_p99_seconds", _seconds(status.latency_p99_ns))
    page.put("dropped_windows", status.dropped_windows)
    for name, sink in status.sinks.items():
        page.put("sink_dropped_reports", sink.dropped_reports, name)
        page.put("sink_dropped_frames", sink.dropped_frames, name)


def _put_pair(page: _Page, name: str, pair: PairStatus) -> None:
    page.choose("state", State, pair.state, name)
    page.choose("cause", Cause, pair.cause, name)
    page.put("state_since_timestamp_seconds", _seconds(pair.since_ns), name)
    page.put("offset_seconds", _seconds(pair.offset_ns), name)
    page.put("offset_sigma_seconds", _seconds(pair.sigma_ns), name)
    page.put("skew_p50_seconds", _seconds(pair.skew_p50_ns), name)
    page.put("skew_p99_seconds", _seconds(pair.skew_p99_ns), name)
    page.put("coverage_ratio", pair.coverage, name)
    page.put("drift_ratio", _ratio(pair.drift.stamps_ppm), name, "stamps")
    page.put("drift_ratio", _ratio(pair.drift.pictures_ppm), name, "pictures")
    page.put("drift_sigma_ratio", _ratio(pair.drift.stamps_sigma_ppm), name, "stamps")
    page.put("drift_sigma_ratio", _ratio(pair.drift.pictures_sigma_ppm), name, "pictures")


def _put_camera(page: _Page, name: str, camera: CameraStatus) -> None:
    page.put("frames", camera.frames, name)
    page.put("drops", camera.drops, name)
    page.put("overwritten_frames", camera.overwritten, name)
    page.put("unpaired_frames", camera.unpaired, name)
    page.put("duplicate_frames", camera.duplicates, name)
    page.put("restarts", camera.restarts, name)
    page.put("stalls", camera.stalls, name)
    page.put("frame_rate_hertz", camera.fps, name)
    page.put("expected_frame_rate_hertz", camera.expected_fps, name)
    page.put("jitter_p50_seconds", _seconds(camera.jitter_p50_ns), name)
    page.put("jitter_p99_seconds", _seconds(camera.jitter_p99_ns), name)
    page.put("camera_epoch", camera.epoch, name)
    for note in LASTING:
        page.put("camera_condition", float(note.value in camera.conditions), name, note.value)


def _seconds(value_ns: int | None) -> float | None:
    return None if value_ns is None else value_ns / NS_PER_S


def _ratio(ppm: float | None) -> float | None:
    return None if ppm is None else ppm * PPM
