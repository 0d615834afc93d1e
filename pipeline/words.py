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

CAUSE_ADVICE = {
    Cause.SLIP: "A frame was lost on one side, or the cameras were not started together. Pair frames by their stamps "
    "and not by order of arrival, or have them paired anew: `align` in the configuration, `syncwatch repair` for a "
    "recording.",
    Cause.PHASE: "Trigger both cameras together: a hardware trigger or a sync cable, one camera the master. If they "
    "are apart on purpose, say so: `expected_offset_ms` of the pair in the configuration.",
    Cause.STAMPS_LIE: "Do not pair by these stamps. Look for an old picture in a buffer, for stamps copied from "
    "the other camera, and for a driver that stamps late: empty the queue before reading, and stamp at the exposure. "
    "`syncwatch repair --restamp` corrects a recording.",
    Cause.FREE_RUN: "Each camera runs at a rate of its own. Check the trigger line and its settings, or the sync "
    "cable: a camera that misses its trigger often falls back to running free.",
    Cause.FROZEN: "Look at the encoder, the driver and full queues: something hands on one picture again and again.",
    Cause.MISSING: "Check the camera's cable, its power and its driver.",
}

CONTRADICTORY_ADVICE = (
    "What is said changes from frame to frame. Run `syncwatch selftest` on this recording or rig: it tells whether the "
    "detector can be believed on this footage."
)

REASON_ADVICE = {
    Reason.NO_MOTION: "Let something move, live or in a new recording, for ten seconds or more: the rig by hand, up "
    "and down as well as sideways, or somebody who waves in front of both cameras.",
    Reason.NO_OVERLAP: "Show both cameras the same thing, or move both of them alike: turn the rig by hand.",
    Reason.NO_TEXTURE: "Show the cameras edges and patterns instead of bare walls or sky.",
    Reason.DARK: "Give the cameras light, or take the lens cap off; a longer exposure helps as well.",
    Reason.WARMING_UP: "Take more time, or a longer recording: ten seconds with motion are enough for most rigs.",
    Reason.UNPAIRED: "Frames of one camera have no partner: look whether one of them loses frames, or runs at another "
    "rate.",
    Reason.WIDE_ERROR: "Move the rig faster, or for longer: the less things move between two frames, the less exactly "
    "they tell the time.",
    Reason.STAMPS_DISPROVED: "Do not rely on the stamps, and show the cameras something that moves, so that the "
    "pictures can tell.",
    Reason.NO_EVIDENCE: "Show the cameras something that moves, so that the pictures can tell, or give the frames "
    "timestamps of their cameras. A detector that is held to `every` or `cpu_percent` has to look more often.",
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
