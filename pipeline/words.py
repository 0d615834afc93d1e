"""Says to people what is wrong with a pair."""

from __future__ import annotations

from pipeline.verdict import Cause, Verdict, ms


def describe(verdict: Verdict) -> str:
    """What is wrong, in a sentence without its end: which camera, by how much, and how that contradicts the stamps."""
    first, _, second = verdict.pair.rpartition("-")
    if verdict.cause is Cause.MISSING:
        return f"{verdict.camera} delivers nothing"
    if verdict.cause is Cause.FROZEN:
        return f"{verdict.camera} shows the same picture again and again while the other camera sees things move"
    offset = ms(verdict.offset_ns)
    if not offset:
        return f"{first} and {second} are out of sync"
    apart = f"{second} is {abs(offset):.1f} ms {'later' if offset > 0 else 'earlier'} than {first}"
    if verdict.cause is Cause.STAMPS_LIE:
        return f"{apart} by the pictures, although the stamps say otherwise"
    if verdict.cause is Cause.FREE_RUN:
        ppm = drift_ppm(verdict)
        return f"{apart} and drifting" + ("" if ppm is None else f" by {ppm:+.0f} ppm")
    return apart


def drift_ppm(verdict: Verdict) -> float | None:
    """How fast the offset grows: by the stamps where they count, else by the pictures."""
    pace = verdict.drift
    return pace.pictures_ppm if pace.stamps_ppm is None or verdict.cause is Cause.STAMPS_LIE else pace.stamps_ppm
