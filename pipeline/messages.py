"""The shape of every message that is published, from which its JSON schema is made."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field
from pydantic.json_schema import GenerateJsonSchema

from pipeline.terms import Basis, Cause, Level, Reason, State

NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]
WallClock = Annotated[int, Field(ge=0, description="nanoseconds since 1970, UTC")]


class Shape(BaseModel):
    """A JSON object, all of whose members are always there unless they have a default.

    Later versions may add members without a new schema name: readers ignore what they do not know.
    """

    model_config = ConfigDict(use_attribute_docstrings=True)


class PaceShape(Shape):
    """How fast the offset of a pair grows; positive: the second camera falls ever further behind."""

    stamps_ppm: float | None
    stamps_sigma_ppm: NonNegative | None
    pictures_ppm: float | None
    pictures_sigma_ppm: NonNegative | None


class RangeErrorShape(Shape):
    """Between which ranges an object at depth_m, moving sideways at speed_m_s, is seen."""

    depth_m: float
    speed_m_s: float
    low_m: float
    low_percent: float
    high_m: float | None
    """null: no range is too large."""
    high_percent: float | None
    disparity_px: float | None


class ContentShape(Shape):
    """The best evidence of the pictures."""

    detector: str
    state: State
    offset_frames: float | None
    sigma_frames: NonNegative | None
    motion_px: float | None
    reason: str


class EvidenceShape(Shape):
    """What one detector says."""

    state: State
    offset_ms: float | None
    sigma_ms: NonNegative | None
    offset_frames: float | None
    sigma_frames: NonNegative | None
    reason: str
    numbers: dict[str, float | None]


class ExposureShape(Shape):
    """What stamps say of the exposures, second camera less first."""

    start_ms: float | None
    middle_ms: float | None


class VerdictShape(Shape):
    """What the judge says of a pair at one frame of its first camera."""

    model_config = ConfigDict(title="syncwatch.verdict.v1")

    of: Literal["syncwatch.verdict.v1"] = Field(alias="schema")
    rig: str
    pair: str
    frame: Count | None
    """Counts the first camera's frames from 0; null while that camera is silent."""
    state: State
    cause: Cause | None
    """null unless async."""
    camera: str | None
    """The one that is frozen or missing."""
    since_frame: Count | None
    reason: Reason | None
    """null unless unknown."""
    basis: Basis
    offset_ms: float | None
    """Second camera against the first; positive: its picture shows a later moment."""
    offset_sigma_ms: NonNegative | None
    """One standard error."""
    offset_frames: float | None
    tolerance_ms: NonNegative
    drift: PaceShape
    range_error: RangeErrorShape | None = None
    """There if judge.range is set."""
    content: ContentShape | None
    evidence: dict[str, EvidenceShape]
    """By name of the detector."""
    sequence: dict[str, int | None]
    """Frame counters, by camera."""
    captured_ns: dict[str, int | None]
    """Stamps, by camera, each on its own clock."""
    interval_ms: NonNegative | None
    exposure: ExposureShape
    notes: list[str]


class EventShape(Shape):
    """Onset or end of a condition."""

    model_config = ConfigDict(title="syncwatch.event.v1")

    of: Literal["syncwatch.event.v1"] = Field(alias="schema")
    rig: str
    id: str
    """The same for an onset and its end."""
    kind: str
    """async, swapped, geometry_shift, dark, saturated, blurred, drop, restarted."""
    phase: Literal["onset", "end"]
    pair: str | None
    camera: str | None
    cause: Cause | None
    since_ns: WallClock
    until_ns: WallClock | None
    """null in an onset."""
    worst: dict[str, float | None]
    """The largest values so far, with the unit in the name."""
    text: str


class PairShape(Shape):
    """The current state of a pair."""

    state: State
    cause: Cause | None
    since_ns: WallClock
    offset_ms: float | None
    offset_sigma_ms: NonNegative | None
    coverage: Share
    """Share of its frames that could be decided."""
    drift: PaceShape
    skew_p50_ms: NonNegative | None
    """Median of the size of the offset over the last minute, to one percent."""
    skew_p99_ms: NonNegative | None


class CameraShape(Shape):
    """The current state of a camera; counts are since the monitor was started."""

    fps: NonNegative | None
    """Measured; null before stamps tell it or where they are made up."""
    expected_fps: NonNegative
    frames: Count
    drops: Count
    """Frames lost, by counter or by time."""
    overwritten: Count
    """Frames that came and gave way to newer ones before they were taken: the machine is too slow."""
    unpaired: Count
    duplicates: Count
    restarts: Count
    """How often device or clock came back with a new epoch."""
    stalls: Count
    """Silences of more than three periods."""
    jitter_p50_ms: NonNegative | None
    jitter_p99_ms: NonNegative | None
    frozen: bool
    conditions: list[str]
    """What lasts: jitter, frozen, dark, saturated, blurred, stalled, missing."""
    clock: str | None
    """Name of the clock of its stamps."""
    epoch: int | None
    """Rises when the device or its clock starts anew."""


class SinkShape(Shape):
    """What a sink could not take in time and lost."""

    dropped_reports: Count
    """Verdicts first; of events and statuses only where nothing else is left."""
    dropped_frames: Count


class MonitorShape(Shape):
    """The program that publishes."""

    version: str
    uptime_s: NonNegative
    dropped_windows: Count
    """Moments that were not judged for want of time."""
    latency_p99_ms: NonNegative | None
    """From the arrival of a frame to its verdict, over the last minute."""
    memory_bytes: Count | None
    """Resident; null where the system does not say."""
    sinks: dict[str, SinkShape]
    """By name."""


class StatusShape(Shape):
    """How a rig stands, once a second and on every change."""

    model_config = ConfigDict(title="syncwatch.status.v1")

    of: Literal["syncwatch.status.v1"] = Field(alias="schema")
    rig: str
    at_ns: WallClock
    level: Level
    reasons: list[str]
    pairs: dict[str, PairShape]
    cameras: dict[str, CameraShape]
    monitor: MonitorShape


class AlignedShape(Shape):
    """Two frames that belong together after whole frames were put right."""

    model_config = ConfigDict(title="syncwatch.aligned.v1")

    of: Literal["syncwatch.aligned.v1"] = Field(alias="schema")
    rig: str
    pair: str
    first: Count | None
    """What the first camera's frame counts, from 0."""
    second: Count | None
    shift_frames: int
    """How far the second camera's frame was moved."""
    residual_ms: float | None
    residual_sigma_ms: NonNegative | None
    sequence: dict[str, int | None]
    captured_ns: dict[str, int]


class FleetPairShape(Shape):
    """A pair as the rig's last status had it."""

    state: State
    cause: str | None
    since_ns: WallClock
    offset_ms: float | None
    offset_sigma_ms: NonNegative | None
    coverage: Share


class OpenShape(Shape):
    """A condition that has begun and not ended."""

    id: str
    kind: str
    pair: str | None
    camera: str | None
    cause: str | None
    since_ns: WallClock
    text: str


class FleetRigShape(Shape):
    """A rig as it was heard."""

    ok: bool
    """Heard just now, and its level is ok."""
    presence: Literal["alive", "stale", "gone", "unheard"]
    """stale: its monitor is there and says nothing; gone: it is not there; unheard: the listener itself is cut off."""
    headline: str
    silent_s: NonNegative
    """Since its last status, or since the rig was noticed."""
    level: Level | None
    """Of the last status, as are reasons and pairs; null before there was one."""
    reasons: list[str]
    pairs: dict[str, FleetPairShape]
    open: list[OpenShape]


class FleetShape(Shape):
    """All rigs that a listener hears (syncwatch watch --json)."""

    model_config = ConfigDict(title="syncwatch.fleet.v1")

    of: Literal["syncwatch.fleet.v1"] = Field(alias="schema")
    prefix: str
    at_ns: WallClock
    ok: bool
    """There are rigs, and all of them are ok."""
    problem: str | None
    """Why nothing can be heard; null while something can."""
    left_out: Count
    """Rigs there was no room for."""
    rigs: dict[str, FleetRigShape]
    """By name: the key below the prefix."""


class IncidentShape(Shape):
    """A condition from its onset to its end (syncwatch events --json)."""

    model_config = ConfigDict(title="syncwatch.incident.v1")

    of: Literal["syncwatch.incident.v1"] = Field(alias="schema")
    rig: str
    id: str
    kind: str
    pair: str | None
    camera: str | None
    cause: str | None
    since_ns: WallClock
    until_ns: WallClock | None
    """null: no end was told."""
    worst: dict[str, float | None]
    text: str


class SegmentShape(Shape):
    """Consecutive frames of a pair's first camera of which the same is said."""

    pair: str
    start_s: NonNegative
    """From the first frame of the pair's first camera, by its stamps."""
    stop_s: NonNegative
    first_frame: Count
    last_frame: Count
    """Belongs to the segment."""
    state: State
    cause: Cause | None
    offset_ms: float | None
    """Mean over the segment; null where it was not measured."""


class AuditPairShape(Shape):
    """What is said of a pair of a recording."""

    state: State
    frames: Count
    decided: Count
    """Frames that could be judged."""


class AuditShape(Shape):
    """What an audit says of one recording (syncwatch audit)."""

    model_config = ConfigDict(title="syncwatch.audit.v1", frozen=True)

    of: Literal["syncwatch.audit.v1"] = Field(alias="schema")
    path: str
    """Absolute, or a URL."""
    format: str | None
    """null where it is no recording of two or more cameras."""
    cameras: list[str]
    frames: Count
    """Of the first camera."""
    duration_s: NonNegative
    state: State
    cause: Cause | None
    """Of the longest segment out of sync, as is offset_ms; null unless async."""
    reason: Reason | None
    """Why most frames could not be judged, where most could not."""
    offset_ms: float | None
    coverage: Share
    """Share of the frames that could be judged, over all pairs."""
    pairs: dict[str, AuditPairShape]
    segments: list[SegmentShape]
    answer: str | None
    """What `syncwatch check` says; null where nothing could be judged."""
    error: str | None
    """Why it is broken, or cannot be judged to its end."""
    warnings: list[str]
    """What was said while it was read."""
    took_s: NonNegative
    version: str
    """Of syncwatch."""
    fingerprint: str
    """Of the names, sizes and times of its files."""
    settings: str
    """Fingerprint of how it was judged."""


SHAPES: dict[str, type[Shape]] = {
    "verdict": VerdictShape,
    "event": EventShape,
    "status": StatusShape,
    "aligned": AlignedShape,
    "fleet": FleetShape,
    "incident": IncidentShape,
    "audit": AuditShape,
}
"""What is published or printed, by the name of its schema."""


class _Untitled(GenerateJsonSchema):
    """A title that repeats a name helps nobody."""

    def field_title_should_be_set(self, schema: Any) -> bool:  # noqa: ARG002
        return False


def message_schema(name: str) -> dict[str, Any]:
    """The JSON schema (2020-12) of one kind of SHAPES."""
    made = SHAPES[name].model_json_schema(schema_generator=_Untitled)
    return {"$schema": GenerateJsonSchema.schema_dialect, **made}
