"""What the messages of a recording are called and how they look: topics, names of schemas, and JSON schemas.

JSON messages leave out what is null elsewhere, and each field has one type, because Foxglove's reader of JSON schemas
knows single types only and plots no field that its schema does not list.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

from pipeline.verdict import (
    ALIGNED_SCHEMA,
    EVENT_SCHEMA,
    STATUS_SCHEMA,
    VERDICT_SCHEMA,
    AlignedPair,
    Event,
    Report,
    Status,
)

FRAME_SCHEMA = "syncwatch.frame.v1"
RECORDING_METADATA = "syncwatch.recording.v1"
REPAIR_METADATA = "syncwatch.repair.v1"

JsonSchema: TypeAlias = dict[str, Any]

BOOLEAN: JsonSchema = {"type": "boolean"}
INTEGER: JsonSchema = {"type": "integer"}
NUMBER: JsonSchema = {"type": "number"}
TEXT: JsonSchema = {"type": "string"}
TEXTS: JsonSchema = {"type": "array", "items": TEXT}


def image_topic(camera: str) -> str:
    return f"/{camera}/image"


def frame_topic(camera: str) -> str:
    return f"/{camera}/frame"


def report_topic(report: Report) -> str:
    if isinstance(report, Event):
        return "/syncwatch/event"
    if isinstance(report, Status):
        return "/syncwatch/status"
    if isinstance(report, AlignedPair):
        return f"/syncwatch/aligned/{report.pair}"
    return f"/syncwatch/verdict/{report.pair}"


def json_schemas(cameras: Iterable[str], pairs: Iterable[str], detectors: Iterable[str]) -> Mapping[str, JsonSchema]:
    """The JSON schema of every kind of message, by name, with a field for each camera, pair and detector."""
    cameras, pairs = list(cameras), list(pairs)
    made = {
        FRAME_SCHEMA: _frame(),
        VERDICT_SCHEMA: _verdict(cameras, detectors),
        EVENT_SCHEMA: _event(),
        STATUS_SCHEMA: _status(cameras, pairs),
        ALIGNED_SCHEMA: _aligned(cameras),
    }
    return {name: {"title": name, **schema} for name, schema in made.items()}


def _object(always: Mapping[str, JsonSchema], sometimes: Mapping[str, JsonSchema] | None = None) -> JsonSchema:
    return {"type": "object", "properties": {**always, **(sometimes or {})}, "required": list(always)}


def _each(names: Iterable[str], schema: JsonSchema) -> JsonSchema:
    return _object({}, dict.fromkeys(names, schema))


def _all(schema: JsonSchema, *names: str) -> dict[str, JsonSchema]:
    return dict.fromkeys(names, schema)


def _frame() -> JsonSchema:
    return _object(
        {
            **_all(TEXT, "schema", "camera", "clock", "stamp_reference", "stamp_origin"),
            **_all(INTEGER, "captured_ns", "arrived_ns", "epoch", "width", "height", "channels"),
        },
        {
            **_all(INTEGER, "sequence", "group", "exposure_ns"),
            "truth": _object({"shown_ns": INTEGER, "faults": TEXTS, "assumed": BOOLEAN}),
        },
    )


def _drift() -> JsonSchema:
    return _object({}, _all(NUMBER, "stamps_ppm", "stamps_sigma_ppm", "pictures_ppm", "pictures_sigma_ppm"))


def _verdict(cameras: Iterable[str], detectors: Iterable[str]) -> JsonSchema:
    evidence = _object(
        {"state": TEXT, "reason": TEXT, "numbers": _object({})},
        _all(NUMBER, "offset_ms", "sigma_ms", "offset_frames", "sigma_frames"),
    )
    content = _object(
        {"detector": TEXT, "state": TEXT, "reason": TEXT}, _all(NUMBER, "offset_frames", "sigma_frames", "motion_px")
    )
    return _object(
        {
            **_all(TEXT, "schema", "rig", "pair", "state", "basis"),
            "tolerance_ms": NUMBER,
            "drift": _drift(),
            "evidence": _each(detectors, evidence),
            **_all(_each(cameras, INTEGER), "sequence", "captured_ns"),
            "exposure": _object({}, _all(NUMBER, "start_ms", "middle_ms")),
            "notes": TEXTS,
        },
        {
            **_all(INTEGER, "frame", "since_frame"),
            **_all(TEXT, "cause", "camera", "reason"),
            **_all(NUMBER, "offset_ms", "offset_sigma_ms", "offset_frames", "interval_ms"),
            "content": content,
            "range_error": _object({}),
        },
    )


def _event() -> JsonSchema:
    return _object(
        {
            **_all(TEXT, "schema", "rig", "id", "kind", "phase", "text"),
            "since_ns": INTEGER,
            "worst": _object({}, _all(NUMBER, "offset_ms", "drift_ppm")),
        },
        {**_all(TEXT, "pair", "camera", "cause"), "until_ns": INTEGER},
    )


def _status(cameras: Iterable[str], pairs: Iterable[str]) -> JsonSchema:
    pair = _object(
        {"state": TEXT, "since_ns": INTEGER, "coverage": NUMBER, "drift": _drift()},
        {"cause": TEXT, **_all(NUMBER, "offset_ms", "offset_sigma_ms")},
    )
    camera = _object(
        {
            "expected_fps": NUMBER,
            **_all(INTEGER, "frames", "drops", "overwritten", "unpaired", "duplicates", "restarts"),
            "conditions": TEXTS,
        },
        _all(NUMBER, "fps", "jitter_p50_ms", "jitter_p99_ms"),
    )
    return _object(
        {
            **_all(TEXT, "schema", "rig", "level"),
            "at_ns": INTEGER,
            "reasons": TEXTS,
            "pairs": _each(pairs, pair),
            "cameras": _each(cameras, camera),
            "monitor": _object({"version": TEXT, "uptime_s": NUMBER, "dropped_windows": INTEGER}),
        }
    )


def _aligned(cameras: Iterable[str]) -> JsonSchema:
    return _object(
        {
            **_all(TEXT, "schema", "rig", "pair"),
            "shift_frames": INTEGER,
            **_all(_each(cameras, INTEGER), "sequence", "captured_ns"),
        },
        {**_all(INTEGER, "first", "second"), **_all(NUMBER, "residual_ms", "residual_sigma_ms")},
    )
