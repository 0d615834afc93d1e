"""What is said of a pair of cameras: evidence, verdicts, events and the status of a rig, and their JSON messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, TypeAlias, runtime_checkable

from pipeline.rig_status import CameraStatus, PairStatus, SinkStatus, Status
from pipeline.terms import (
    ALIGNED_SCHEMA,
    EVENT_SCHEMA,
    STATUS_SCHEMA,
    VERDICT_SCHEMA,
    Basis,
    Cause,
    Level,
    Message,
    Pace,
    Reason,
    State,
    ms,
    rounded,
)

if TYPE_CHECKING:
    from pipeline.frame import Frame

__all__ = [
    "ALIGNED_SCHEMA",
    "EVENT_SCHEMA",
    "STATUS_SCHEMA",
    "VERDICT_SCHEMA",
    "AlignedPair",
    "Basis",
    "CameraStatus",
    "Cause",
    "Event",
    "Evidence",
    "Level",
    "Message",
    "Pace",
    "PairStatus",
    "PairTruth",
    "RangeError",
    "Reason",
    "Report",
    "Sink",
    "SinkStatus",
    "State",
    "Status",
    "Verdict",
    "ms",
    "rounded",
]


@dataclass(frozen=True, slots=True)
class Evidence:
    """What one detector says of one pair at one t.

    offset_ns and offset_frames: the second camera against the first, positive = a later moment; None where not
    measured. sigma_*: one standard error. reason: a sentence for people. numbers: what the sentence rests on.
    synthesised: the stamps it rests on were made up by the source or tell of arrival, so it proves nothing. silence:
    why it abstains.
    """

    pair: str
    detector: str
    basis: Basis
    state: State
    reason: str
    offset_ns: int | None = None
    sigma_ns: int | None = None
    offset_frames: float | None = None
    sigma_frames: float | None = None
    motion_px: float | None = None
    numbers: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    synthesised: bool = False
    silence: Reason | None = None

    def to_json(self) -> Message:
        return {
            "state": self.state.value,
            "offset_ms": ms(self.offset_ns),
            "sigma_ms": ms(self.sigma_ns),
            "offset_frames": rounded(self.offset_frames),
            "sigma_frames": rounded(self.sigma_frames),
            "reason": self.reason,
            "numbers": {name: rounded(value, 6) for name, value in self.numbers.items()},
        }


@dataclass(frozen=True, slots=True)
class PairTruth:
    """The true offset of a pair, known only for rendered footage and, as far as `assumed`, for injected faults."""

    offset_ns: int
    state: State
    faults: tuple[str, ...] = ()
    assumed: bool = False


class RangeError(Protocol):
    """What the offset does to a range measured by stereo."""

    def to_json(self) -> Message: ...


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the judge says of one pair at one frame of its first camera.

    frame: counts the first camera's frames from 0; None while that camera is silent.
    cause: None unless async. reason: None unless unknown.
    camera: the one that is frozen or missing; None where only the pair can be blamed. since_frame: the first frame that
    spoke for the state that is believed now; None where nothing is. exposure_*: what stamps say of the start and of the
    middle of exposures, second less first, where exposures are known.
    sequence, captured_ns: by camera, None for a missing partner or counter.
    """

    rig: str
    pair: str
    frame: int | None
    state: State
    basis: Basis
    cause: Cause | None = None
    reason: Reason | None = None
    offset_ns: int | None = None
    sigma_ns: int | None = None
    offset_frames: float | None = None
    camera: str | None = None
    since_frame: int | None = None
    exposure_start_ns: int | None = None
    exposure_middle_ns: int | None = None
    tolerance_ns: int = 0
    drift: Pace = field(default_factory=Pace)
    range_error: RangeError | None = None
    content: Evidence | None = None
    evidence: tuple[Evidence, ...] = ()
    sequence: Mapping[str, int | None] = field(default_factory=dict)
    captured_ns: Mapping[str, int | None] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    truth: PairTruth | None = None

    @property
    def interval_ns(self) -> int | None:
        """|second - first| of the stamps, or None where one is missing."""
        stamps = list(self.captured_ns.values())
        if len(stamps) != 2 or stamps[0] is None or stamps[1] is None:
            return None
        return abs(stamps[1] - stamps[0])

    def to_message(self) -> Message:
        best = self.content
        return {
            "schema": VERDICT_SCHEMA,
            "rig": self.rig,
            "pair": self.pair,
            "frame": self.frame,
            "state": self.state.value,
            "cause": self.cause and self.cause.value,
            "camera": self.camera,
            "since_frame": self.since_frame,
            "reason": self.reason and self.reason.value,
            "basis": self.basis.value,
            "offset_ms": ms(self.offset_ns),
            "offset_sigma_ms": ms(self.sigma_ns),
            "offset_frames": rounded(self.offset_frames),
            "tolerance_ms": ms(self.tolerance_ns),
            "drift": self.drift.to_json(),
            **({} if self.range_error is None else {"range_error": self.range_error.to_json()}),
            "content": best
            and {
                "detector": best.detector,
                "state": best.state.value,
                "offset_frames": rounded(best.offset_frames),
                "sigma_frames": rounded(best.sigma_frames),
                "motion_px": rounded(best.motion_px),
                "reason": best.reason,
            },
            "evidence": {item.detector: item.to_json() for item in self.evidence},
            "sequence": dict(self.sequence),
            "captured_ns": dict(self.captured_ns),
            "interval_ms": ms(self.interval_ns),
            "exposure": {"start_ms": ms(self.exposure_start_ns), "middle_ms": ms(self.exposure_middle_ns)},
            "notes": list(self.notes),
        }


@dataclass(frozen=True, slots=True)
class Event:
    """Onset or end of a condition: a pair out of sync (`async`, with a cause), or a kind named by what was noticed.

    `since_ns` and `until_ns` are wall-clock time. worst: the largest values so far, by name with the unit in it
    (`offset_ms`, `drift_ppm`, `shift_px`, ...).
    """

    rig: str
    id: str
    kind: str
    phase: str
    pair: str | None
    camera: str | None
    cause: Cause | None
    since_ns: int
    until_ns: int | None
    worst: Mapping[str, float | None]
    text: str

    def to_message(self) -> Message:
        return {
            "schema": EVENT_SCHEMA,
            "rig": self.rig,
            "id": self.id,
            "kind": self.kind,
            "phase": self.phase,
            "pair": self.pair,
            "camera": self.camera,
            "cause": self.cause and self.cause.value,
            "since_ns": self.since_ns,
            "until_ns": self.until_ns,
            "worst": {name: rounded(value) for name, value in self.worst.items()},
            "text": self.text,
        }


@dataclass(frozen=True, slots=True)
class AlignedPair:
    """Two frames that belong together after whole frames were put right.

    first, second: what the cameras' frames count, from 0. shift_frames: how far the second camera's frame was moved.
    residual_ns: what is left between the two, sigma_ns its standard error; None while the offset is not known.
    frames: themselves.
    """

    rig: str
    pair: str
    first: int | None
    second: int | None
    shift_frames: int
    residual_ns: int | None
    sigma_ns: int | None
    frames: tuple[Frame, Frame] = field(repr=False)

    def to_message(self) -> Message:
        return {
            "schema": ALIGNED_SCHEMA,
            "rig": self.rig,
            "pair": self.pair,
            "first": self.first,
            "second": self.second,
            "shift_frames": self.shift_frames,
            "residual_ms": ms(self.residual_ns),
            "residual_sigma_ms": ms(self.sigma_ns),
            "sequence": {frame.camera: frame.sequence for frame in self.frames},
            "captured_ns": {frame.camera: frame.captured_ns for frame in self.frames},
        }


Report: TypeAlias = Verdict | Event | Status | AlignedPair
"""Anything the pipeline tells its sinks."""


class Sink(Protocol):
    """Takes reports to people, files or other programs.

    `start`, `take` and `stop` are all called from one thread that belongs to this sink alone, fed by a bounded queue:
    it may block without harm to detection. `start` comes first; `stop` last, once, also after a failed `take` but not
    after a failed `start`. An exception from any of them ends the run with status 1.

    A `lossless` sink makes a recording wait for it; any other, and every sink of a live rig, loses the oldest verdicts
    when its queue is full (counted, and said at the end). Events are never given up for verdicts.
    """

    @property
    def lossless(self) -> bool: ...

    def start(self) -> None: ...

    def take(self, report: Report) -> None: ...

    def stop(self) -> None: ...


@runtime_checkable
class FrameSink(Protocol):
    """A sink that takes frames as well as reports.

    While `wants_frames` is true, `take_frame` is called with every frame of the source, after faults and before it is
    judged, on the sink's thread and in order with its reports. A few frames may wait; for a sink that is not
    `lossless`, and on a live rig, the oldest gives way (counted, and said at the end).
    """

    @property
    def wants_frames(self) -> bool: ...

    def take_frame(self, frame: Frame) -> None: ...
