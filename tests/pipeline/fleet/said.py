"""Messages as monitors publish them."""

from __future__ import annotations

from typing import Any

from pipeline.fleet.messages import HeardEvent, HeardStatus, HeardVerdict


def status_message(
    level: str = "ok", *, offset_ms: float | None = 0.1, at_s: float = 50, uptime_s: float = 9, **more: Any
) -> dict[str, Any]:
    pair = {"state": "sync", "cause": None, "since_ns": 0, "offset_ms": offset_ms, "offset_sigma_ms": 0.2}
    cameras = {name: {"fps": 30.0, "expected_fps": 30, "frames": 9, "drops": 0} for name in ("left", "right")}
    return {
        "schema": "syncwatch.status.v1",
        "rig": "cart",
        "at_ns": round(at_s * 1e9),
        "level": level,
        "reasons": [],
        "pairs": {"left-right": pair},
        "cameras": cameras,
        "monitor": {"version": "0.1.0", "uptime_s": uptime_s, "dropped_windows": 0},
        **more,
    }


def status(level: str = "ok", **values: Any) -> HeardStatus:
    return HeardStatus.model_validate(status_message(level, **values))


def event(number: int, phase: str = "onset", since_ns: int | None = None) -> HeardEvent:
    return HeardEvent.model_validate(
        {
            "schema": "syncwatch.event.v1",
            "id": f"x-{number}",
            "kind": "async",
            "phase": phase,
            "pair": "left-right",
            "camera": "right",
            "cause": "slip",
            "since_ns": number if since_ns is None else since_ns,
            "until_ns": number + 1 if phase == "end" else None,
            "worst": {"offset_ms": 33.3},
            "text": f"{phase} {number}",
        }
    )


def verdict(offset_ms: float | None, state: str = "sync") -> HeardVerdict:
    return HeardVerdict.model_validate(
        {"schema": "syncwatch.verdict.v1", "state": state, "offset_ms": offset_ms, "tolerance_ms": 3.3}
    )
