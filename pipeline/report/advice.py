"""What to do about what was found, for whoever looks after the rig."""

from __future__ import annotations

from pipeline.answer import Answer
from pipeline.notes import Note
from pipeline.report.recorder import PairRecord, Recorder
from pipeline.tally import ENOUGH
from pipeline.verdict import Basis, Cause, State
from pipeline.words import CAUSE_ADVICE, CONTRADICTORY_ADVICE, REASON_ADVICE

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
        made.append(CONTRADICTORY_ADVICE)
    elif record.coverage < MOSTLY_JUDGED and tally.main_reason is not None:
        more = "" if state is State.UNKNOWN else "Most frames could not be judged. To have more of them: "
        made.append(more + REASON_ADVICE[tally.main_reason])
    elif not record.bases[Basis.CONTENT] and record.silences:
        made.append(f"{STAMPS_ALONE} {REASON_ADVICE[record.silences.most_common(1)[0][0]]}")
    kinds = [mark.kind.removesuffix(" onset") for mark in record.marks.marks]
    made += [words for kind, words in GEOMETRY_ADVICE.items() if kind in kinds]
    noticed = {mark.text for mark in record.marks.marks if mark.kind == "note"}
    if Cause.FREE_RUN in record.causes:
        noticed.discard(Note.CLOCK_DRIFT.value)  # before the pictures could tell, only the clocks were known to drift
    return made + [words for note, words in NOTE_ADVICE.items() if note.value in noticed]
