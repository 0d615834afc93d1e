"""What monitors publish, as a listener reads it: checked, since anything may come over a network."""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from pipeline.printable import printable
from pipeline.verdict import Level, State

MAX_MESSAGE_BYTES = 256 * 1024
"""A status of a rig of eight cameras has about 2 KB."""

Words = Annotated[str, AfterValidator(printable)]
"""A text for people, which may be shown in a terminal."""


class Heard(BaseModel):
    """A message, or a part of one; members that are not known here are of a newer monitor and left out."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class HeardPace(Heard):
    """How fast an offset grows, in ppm (see pipeline.verdict.Pace)."""

    stamps_ppm: float | None = None
    pictures_ppm: float | None = None


class HeardPair(Heard):
    """The state of a pair. since_ns: wall-clock time of the monitor."""

    state: State
    cause: Words | None = None
    since_ns: int
    offset_ms: float | None = None
    offset_sigma_ms: float | None = None
    coverage: float = 0.0
    skew_p99_ms: float | None = None
    drift: HeardPace = HeardPace()


class HeardCamera(Heard):
    """The state of a camera (see pipeline.verdict.CameraStatus)."""

    fps: float | None = None
    expected_fps: float
    frames: int
    drops: int
    overwritten: int = 0
    unpaired: int = 0
    duplicates: int = 0
    restarts: int = 0
    stalls: int = 0
    jitter_p50_ms: float | None = None
    jitter_p99_ms: float | None = None
    conditions: tuple[Words, ...] = ()


class HeardMonitor(Heard):
    """The program that publishes the rig."""

    version: Words
    uptime_s: float
    dropped_windows: int = 0
    latency_p99_ms: float | None = None
    memory_bytes: int | None = None


class HeardStatus(Heard):
    """How a rig stands. at_ns: wall-clock time of the monitor."""

    of: Literal["syncwatch.status.v1"] = Field(alias="schema")
    at_ns: int
    level: Level
    reasons: tuple[Words, ...]
    pairs: dict[Words, HeardPair]
    cameras: dict[Words, HeardCamera]
    monitor: HeardMonitor


class HeardEvent(Heard):
    """Onset or end of a condition. since_ns, until_ns: wall-clock time of the monitor."""

    of: Literal["syncwatch.event.v1"] = Field(alias="schema")
    id: Words
    kind: Words
    phase: Literal["onset", "end"]
    pair: Words | None = None
    camera: Words | None = None
    cause: Words | None = None
    since_ns: int
    until_ns: int | None = None
    worst: dict[str, float | None] = Field(default_factory=dict)
    text: Words


class HeardVerdict(Heard):
    """What the judge says of a pair at one frame."""

    of: Literal["syncwatch.verdict.v1"] = Field(alias="schema")
    state: State
    offset_ms: float | None = None
    offset_sigma_ms: float | None = None
    tolerance_ms: float | None = None


AnyHeard = TypeVar("AnyHeard", bound=Heard)


def read(payload: bytes, kind: type[AnyHeard]) -> AnyHeard:
    """The message in a payload. Raises ValueError for one that is too long, no JSON or not what it should be."""
    if len(payload) > MAX_MESSAGE_BYTES:
        raise ValueError(f"{len(payload)} bytes are too many for a message")
    return kind.model_validate_json(payload)
