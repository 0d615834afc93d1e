"""Collects what a report is made of while a run goes on, in memory that does not grow with its length."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict

from pipeline.frame import NS_PER_MS, Camera, Frame, Pair, Rig, StampOrigin
from pipeline.report.moments import Moments, Recent
from pipeline.report.series import Series
from pipeline.tally import PairTally, Tally
from pipeline.timeline import Marks, Span, Timeline
from pipeline.verdict import Basis, CameraStatus, Cause, Evidence, Pace, Reason, Report, State, Status, Verdict

MOST_MARKS = 200
"""Events of a pair that are listed: more than anyone reads."""

VALUES = (
    *(state.value for state in State),
    "offset_ms",
    "sigma_ms",
    "stamps_ms",
    "pictures_ms",
    "differ",
    "drift_stamps_ppm",
    "drift_stamps_sigma_ppm",
    "drift_pictures_ppm",
    "drift_pictures_sigma_ppm",
)
"""What is kept of a verdict. sync, async, unknown: 1 or 0. differ: whether stamps contradict pictures."""

UNKNOWN_PACE = Pace()

SIGMAS = 2
"""Standard errors of the pictures allowed for where they are compared with stamps."""


class PairRecord:
    """What was said of one pair.

    period_ms: of its first camera, whose frames are counted. causes, bases: by frames that were decided. silences: why
    the pictures did not speak. drift: last seen. synthesised: stamps were made up. stamps_reason: why stamps could not
    be compared, where they could not.
    """

    def __init__(self, pair: Pair, rig: Rig) -> None:
        first, second = rig.camera(pair.first), rig.camera(pair.second)
        self.pair = pair
        self.fps = first.fps
        self.period_ms = first.period_ns / NS_PER_MS
        self.second_period_ns = second.period_ns
        self.tally = PairTally()
        self.series = Series(VALUES)
        self.causes: Counter[Cause] = Counter()
        self.bases: Counter[Basis] = Counter()
        self.silences: Counter[Reason] = Counter()
        self.drift = UNKNOWN_PACE
        self.marks = Marks(pair.name, first.fps, MOST_MARKS)
        self.moments = Moments(pair, first.period_ns)
        self.tolerance_ms = 0.0
        self.synthesised = False
        self.stamps_reason = ""

    @property
    def duration_s(self) -> float:
        return self.tally.total / self.fps

    @property
    def coverage(self) -> float:
        """The share of frames that could be decided."""
        return self.tally.decided / self.tally.total if self.tally.total else 0.0

    @property
    def timeline(self) -> Timeline:
        """The marks of the pair, with the time spent in each state."""
        spent = [(state.value, count) for state, count in self.tally.states.items() if state is not State.UNKNOWN]
        spent += [(f"{State.UNKNOWN.value} {reason.value}", count) for reason, count in self.tally.reasons.items()]
        said = [Span(0.0, count / self.fps, what) for what, count in spent]
        name = self.pair.name
        return Timeline(
            name, self.period_ms, self.duration_s, self.tolerance_ms, said=said, marks=list(self.marks.marks)
        )

    def add(self, verdict: Verdict, recent: Recent) -> None:
        at_s = self.series.count / self.fps
        self.tolerance_ms = verdict.tolerance_ns / NS_PER_MS
        if verdict.drift != UNKNOWN_PACE:
            self.drift = verdict.drift
        if verdict.cause is not None:
            self.causes[verdict.cause] += 1
        if verdict.state is not State.UNKNOWN:
            self.bases[verdict.basis] += 1
        if verdict.content is not None and verdict.content.silence is not None:
            self.silences[verdict.content.silence] += 1
        stamps = next((item for item in verdict.evidence if item.basis is Basis.TIMESTAMPS), None)
        if stamps is not None:
            self.synthesised |= stamps.synthesised
            self.stamps_reason = stamps.reason if stamps.offset_ns is None else self.stamps_reason
        self.series.add(self._values(verdict, stamps))
        self.moments.add(verdict, at_s, recent)

    def _values(self, verdict: Verdict, stamps: Evidence | None) -> dict[str, float]:
        pictures = verdict.content
        told_ns = {
            "offset_ms": verdict.offset_ns,
            "sigma_ms": verdict.sigma_ns,
            "stamps_ms": None if stamps is None or stamps.synthesised else stamps.offset_ns,
            "pictures_ms": None if pictures is None or pictures.state is State.UNKNOWN else pictures.offset_ns,
        }
        values = {name: value / NS_PER_MS for name, value in told_ns.items() if value is not None}
        values |= {state.value: float(verdict.state is state) for state in State}
        values |= {f"drift_{name}": value for name, value in asdict(verdict.drift).items() if value is not None}
        if pictures is not None and "stamps_ms" in values and "pictures_ms" in values:
            slack_ms = self.tolerance_ms + SIGMAS * (pictures.sigma_ns or 0) / NS_PER_MS
            values["differ"] = float(abs(values["stamps_ms"] - values["pictures_ms"]) > slack_ms)
        return values


class CameraRecord:
    """What was seen of one camera: the time between its frames, by its own stamps, and how it stood at the end.

    size: width and height of its pictures, px. synthesised: its stamps were made up, so that times tell nothing.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self.series = Series(["interval_ms"])
        self.size: tuple[int, int] | None = None
        self.synthesised = False
        self.status: CameraStatus | None = None
        self._last: tuple[int, int] | None = None

    def add(self, frame: Frame) -> None:
        self.size = (frame.image.shape[1], frame.image.shape[0])
        self.synthesised |= frame.stamp_origin is StampOrigin.SYNTHESISED
        last, self._last = self._last, (frame.epoch, frame.captured_ns)
        if last is None or last[0] != frame.epoch:
            self.series.add({})
        else:
            self.series.add({"interval_ms": (frame.captured_ns - last[1]) / NS_PER_MS})


class Recorder:
    """Implements Sink and FrameSink: keeps what a report needs of every pair and camera of the rig."""

    lossless = True
    wants_frames = True

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.tally = Tally()
        self.pairs = {pair.name: PairRecord(pair, rig) for pair in rig.pairs}
        self.cameras = {camera.name: CameraRecord(camera) for camera in rig.cameras}
        self.dropped_windows = 0
        self._recent = Recent()

    def start(self) -> None:
        pass

    def take_frame(self, frame: Frame) -> None:
        self._recent.add(frame)
        self.cameras[frame.camera].add(frame)

    def take(self, report: Report) -> None:
        for record in self.pairs.values():
            record.marks.add(report)
        if isinstance(report, Verdict):
            self.tally.add(report)
            record = self.pairs[report.pair]
            record.tally = self.tally.pairs[report.pair]
            record.add(report, self._recent)
        elif isinstance(report, Status):
            self.dropped_windows = report.dropped_windows
            for name, status in report.cameras.items():
                self.cameras[name].status = status

    def stop(self) -> None:
        pass
