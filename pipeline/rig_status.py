"""How a rig, its pairs and its cameras stand, rolled up into one message."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pipeline.terms import STATUS_SCHEMA, Cause, Level, Message, Pace, State, ms, rounded


@dataclass(frozen=True, slots=True)
class PairStatus:
    """The current state of a pair.

    coverage: the share of its frames that could be decided. skew_*: quantiles of |offset| over the last minute, None
    while nothing has been decided.
    """

    state: State
    cause: Cause | None
    since_ns: int
    offset_ns: int | None
    sigma_ns: int | None
    coverage: float
    drift: Pace = field(default_factory=Pace)
    skew_p50_ns: int | None = None
    skew_p99_ns: int | None = None

    def to_json(self) -> Message:
        return {
            "state": self.state.value,
            "cause": self.cause and self.cause.value,
            "since_ns": self.since_ns,
            "offset_ms": ms(self.offset_ns),
            "offset_sigma_ms": ms(self.sigma_ns),
            "coverage": rounded(self.coverage),
            "drift": self.drift.to_json(),
            "skew_p50_ms": ms(self.skew_p50_ns),
            "skew_p99_ms": ms(self.skew_p99_ns),
        }


@dataclass(frozen=True, slots=True)
class CameraStatus:
    """The current state of a camera.

    fps: measured on its stamps, None before these tell it or where they are made up. drops: frames lost, by counter or
    by time. overwritten: frames that came and gave way to newer ones before this program took them. unpaired: slots it
    did not fill. restarts: how often device or clock came back with a new epoch. stalls: how often it fell silent for
    more than three periods. jitter: how far intervals are off the period. conditions: that last. clock: the name of the
    clock of its stamps, None before the first frame.
    """

    fps: float | None
    expected_fps: float
    frames: int
    drops: int
    overwritten: int = 0
    unpaired: int = 0
    duplicates: int = 0
    restarts: int = 0
    jitter_p50_ns: int | None = None
    jitter_p99_ns: int | None = None
    conditions: tuple[str, ...] = ()
    stalls: int = 0
    frozen: bool = False
    clock: str | None = None
    epoch: int | None = None

    def to_json(self) -> Message:
        return {
            "fps": rounded(self.fps, 3),
            "expected_fps": self.expected_fps,
            "frames": self.frames,
            "drops": self.drops,
            "overwritten": self.overwritten,
            "unpaired": self.unpaired,
            "duplicates": self.duplicates,
            "restarts": self.restarts,
            "stalls": self.stalls,
            "jitter_p50_ms": ms(self.jitter_p50_ns),
            "jitter_p99_ms": ms(self.jitter_p99_ns),
            "frozen": self.frozen,
            "conditions": list(self.conditions),
            "clock": self.clock,
            "epoch": self.epoch,
        }


@dataclass(frozen=True, slots=True)
class SinkStatus:
    """What a sink could not take in time and lost, of what was reported and of frames."""

    dropped_reports: int = 0
    dropped_frames: int = 0

    def to_json(self) -> Message:
        return {"dropped_reports": self.dropped_reports, "dropped_frames": self.dropped_frames}


@dataclass(frozen=True, slots=True)
class Status:
    """The rolled-up state of a rig, once a second and on every change of state.

    latency_p99_ns: from the arrival of a frame to its verdict, over the last minute. memory_bytes: of the monitor's
    process, resident; None where the system does not say. sinks: by name.
    """

    rig: str
    at_ns: int
    level: Level
    reasons: tuple[str, ...]
    pairs: Mapping[str, PairStatus]
    cameras: Mapping[str, CameraStatus]
    version: str
    uptime_s: float
    dropped_windows: int
    latency_p99_ns: int | None = None
    memory_bytes: int | None = None
    sinks: Mapping[str, SinkStatus] = field(default_factory=dict)

    def to_message(self) -> Message:
        return {
            "schema": STATUS_SCHEMA,
            "rig": self.rig,
            "at_ns": self.at_ns,
            "level": self.level.value,
            "reasons": list(self.reasons),
            "pairs": {name: pair.to_json() for name, pair in self.pairs.items()},
            "cameras": {name: camera.to_json() for name, camera in self.cameras.items()},
            "monitor": {
                "version": self.version,
                "uptime_s": rounded(self.uptime_s, 3),
                "dropped_windows": self.dropped_windows,
                "latency_p99_ms": ms(self.latency_p99_ns),
                "memory_bytes": self.memory_bytes,
                "sinks": {name: sink.to_json() for name, sink in self.sinks.items()},
            },
        }
