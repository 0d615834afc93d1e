"""What to do about what was found, for whoever looks after the rig."""

from __future__ import annotations

from pipeline.answer import Answer
from pipeline.notes import Note
from pipeline.report.recorder import PairRecord, Recorder
from pipeline.tally import ENOUGH
from pipeline.verdict import Basis, Cause, Reason, State

CAUSE_ADVICE = {
    Cause.SLIP: "A frame was lost on one side, or the cameras were not started together. Pair frames by their stamps "
    "and not by order of arrival, or have them paired anew: `align` in the configuration.",
    Cause.PHASE: "Trigger both cameras together: a hardware trigger or a sync cable, one camera the master. If they "
    "are apart on purpose, say so: `expected_offset_ms` of the pair in the configuration.",
    Cause.STAMPS_LIE: "Do not pair by these stamps. Look for an old picture in a buffer, for stamps copied from "
    "the other camera, and for a driver that stamps late: empty the queue before reading, and stamp at the exposure.",
    Cause.FREE_RUN: "Each camera runs at a rate of its own. Check the trigger line and its settings, or the sync "
    "cable: a camera that misses its trigger often falls back to running free.",
    Cause.FROZEN: "Look at the encoder, the driver and full queues: something hands on one picture again and again.",
    Cause.MISSING: "Check the camera's cable, its power and its driver.",
}

REASON_ADVICE = {
    Reason.NO_MOTION: "Record again while the rig is moved by hand, up and down as well as sideways, or while somebody "
    "waves in front of both cameras, for ten seconds or more.",
    Reason.NO_OVERLAP: "Record something that both cameras see, or moves both of them alike: turn the rig by hand.",
    Reason.NO_TEXTURE: "Record a scene with edges and patterns instead of bare walls or sky.",
    Reason.DARK: "Give the cameras light, or take the lens cap off; a longer exposure helps as well.",
    Reason.WARMING_UP: "Record for longer: ten seconds with motion are enough for most rigs.",
    Reason.UNPAIRED: "Frames of one camera have no partner. Look at the table of cameras: does one of them lose "
    "frames, or run at another rate?",
    Reason.WIDE_ERROR: "Record faster or longer motion: the less things move between two frames, the less exactly "
    "they tell the time.",
    Reason.STAMPS_DISPROVED: "Do not rely on the stamps, and record a part with motion, so that the pictures can tell.",
    Reason.NO_EVIDENCE: "Give the recording timestamps, or a part with motion, so that something can be judged.",
}

CONTRADICTORY = (
    "What is said changes from frame to frame. Run `syncwatch selftest` on this recording: it tells whether "
    "the detector can be believed on this footage."
)

STAMPS_ALONE = "Only the timestamps say so. To have the pictures confirm it:"

NOTE_ADVICE = {
    Note.DROP: "Frames are lost: look at the load of the bus and of the disk.",
    Note.JITTER: "Stamps are noisy: have the device stamp frames, not the program that receives them.",
    Note.CLOCK_DRIFT: "The cameras' clocks drift apart although the pictures do not: synchronize the clocks (PTP), or "
    "do not compare their stamps over long times.",
    Note.CLOCK_EPOCH: "The cameras' clocks count from different moments: do not compare their stamps as they are.",
    Note.STAMP_REFERENCE: "Stamps mark different moments of the exposure: take that difference off.",
    Note.DARK: "A camera saw nothing for a while: light, or the lens cap.",
    Note.SATURATED: "A camera was dazzled: shorten its exposure.",
    Note.BLURRED: "A camera became blurred: clean or focus its lens.",
}

GEOMETRY_ADVICE = {
    "geometry_shift": "A camera does not look where it did at first: fasten it, and calibrate the rig anew.",
    "swapped": "The cameras are exchanged: swap their names, or their cables.",
}

NOTHING = "Nothing has to be done."


MOSTLY_JUDGED = 0.5

TOLD = 0.1
"""Stretches out of sync shorter than this share of the longest are not worth advice of their own."""


def advice(recorder: Recorder, answer: Answer) -> list[str]:
    """What to do, the most important first, over all pairs of the rig, each once; names of commands in backticks."""
    told: dict[str, None] = {}
    for name, record in recorder.pairs.items():
        told |= dict.fromkeys(_of_pair(record, answer.pairs[name].state if name in answer.pairs else State.UNKNOWN))
    return list(told) or [NOTHING]


def _of_pair(record: PairRecord, state: State) -> list[str]:
    tally = record.tally
    made = []
    if state is State.ASYNC:
        longest = sorted(tally.stretches, key=lambda stretch: -stretch.frames)
        told = [stretch for stretch in longest if stretch.frames >= TOLD * longest[0].frames]
        made += [CAUSE_ADVICE[stretch.first.cause] for stretch in told if stretch.first.cause is not None]
    elif state is State.UNKNOWN and tally.decided >= ENOUGH:
        made.append(CONTRADICTORY)
    elif record.coverage < MOSTLY_JUDGED and tally.reasons:
        more = "" if state is State.UNKNOWN else "Most frames could not be judged. To have more of them: "
        made.append(more + REASON_ADVICE[tally.reasons.most_common(1)[0][0]])
    elif not record.bases[Basis.CONTENT] and record.silences:
        made.append(f"{STAMPS_ALONE} {REASON_ADVICE[record.silences.most_common(1)[0][0]]}")
    kinds = [mark.kind.removesuffix(" onset") for mark in record.marks.marks]
    made += [words for kind, words in GEOMETRY_ADVICE.items() if kind in kinds]
    noticed = {mark.text for mark in record.marks.marks if mark.kind == "note"}
    if Cause.FREE_RUN in record.causes:
        noticed.discard(Note.CLOCK_DRIFT.value)  # before the pictures could tell, only the clocks were known to drift
    return made + [words for note, words in NOTE_ADVICE.items() if note.value in noticed]
