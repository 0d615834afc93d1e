"""Says to people what is wrong with a pair."""

from __future__ import annotations

from pipeline.verdict import Cause, Reason, Verdict, ms

CAUSE_WORDS = {
    Cause.SLIP: "whole frames apart: stamps and pictures say so alike",
    Cause.PHASE: "a constant part of a frame apart: the cameras are not triggered together",
    Cause.STAMPS_LIE: "the pictures are apart although the stamps say otherwise",
    Cause.FREE_RUN: "the cameras run at different rates and drift apart",
    Cause.FROZEN: "one camera shows the same picture again and again while another sees things move",
    Cause.MISSING: "a camera delivers nothing any more",
}

REASON_WORDS = {
    Reason.NO_MOTION: "nothing moves in a way that tells time",
    Reason.NO_OVERLAP: "the cameras do not see the same things",
    Reason.NO_TEXTURE: "there is nothing in the pictures to hold on to",
    Reason.DARK: "a camera sees nothing",
    Reason.WARMING_UP: "too little has been seen so far",
    Reason.UNPAIRED: "the other camera's frame is missing",
    Reason.WIDE_ERROR: "the pictures tell the offset too inexactly",
    Reason.STAMPS_DISPROVED: "the pictures cannot tell, and they have shown before that the stamps are wrong",
    Reason.NO_EVIDENCE: "there is no evidence that counts",
}


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
