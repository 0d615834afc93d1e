"""What was said of a rig during one run, in sentences for somebody who sees the product for the first time."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping

from pipeline.notes import Note
from pipeline.timeline import Mark, Timeline
from pipeline.verdict import Cause, Reason
from pipeline.words import REASON_WORDS

MOST_EVENTS = 4
"""More are counted, not told: who reads that far looks at the drawing."""

WHOLE = 0.1
"""An offset this close to whole frames, in frames, is told in frames."""

SILENT_S = 1.0
"""What goes on to the end is told with when it was last seen, where nothing could be judged for so long since."""

NOTE_WORDS: Mapping[str, str] = {
    Note.SEQUENCE_OFFSET: "the cameras count their frames from different numbers",
    Note.DROP: "frames were lost",
    Note.DUPLICATE_TIMESTAMP: "a stamp came twice",
    Note.BACKWARD_TIMESTAMP: "stamps went backward",
    Note.DUPLICATE_FRAME: "a frame was delivered twice",
    Note.COUNTER_RESET: "a counter of frames began anew",
    Note.RESTARTED: "a camera was started anew, or its clock was set",
    Note.JITTER: "stamps are noisy",
    Note.CLOCK_EPOCH: "the cameras' clocks count from different moments",
    Note.CLOCK_DRIFT: "the cameras' clocks run at different rates",
    Note.STAMP_REFERENCE: "stamps differ by a constant part of a frame that the pictures do not show",
    Note.UNPAIRED: "frames had no partner",
    Note.FROZEN: "a camera showed the same picture again and again",
    Note.DARK: "a camera saw nothing",
    Note.SATURATED: "a camera was dazzled",
    Note.BLURRED: "a camera became blurred",
    Note.STALLED: "a camera delivered nothing for a while",
    Note.MISSING: "a camera delivered nothing any more",
}


def said(timeline: Timeline) -> str:
    """What is wrong, since when, and what was noticed besides."""
    words = happened(timeline) or [_nothing(timeline)]
    notes = noticed(timeline)
    if notes:
        words.append(f"Noticed besides: {'; '.join(notes)}.")
    return " ".join(words)


def happened(timeline: Timeline) -> list[str]:
    """A sentence for each of the first events, with the time, the camera and the amount; empty where none began."""
    begun = [mark for mark in timeline.marks if mark.kind.endswith(" onset")]
    words = [f"{capital(_told(mark, timeline))}." for mark in begun[:MOST_EVENTS]]
    more = len(begun) - MOST_EVENTS
    if more > 0:
        words.append("One more event follows." if more == 1 else f"{more} more events follow.")
    return words


def noticed(timeline: Timeline) -> list[str]:
    """What is remarkable and makes no pair out of sync by itself, in words without an end."""
    return [NOTE_WORDS.get(mark.text, mark.text) for mark in timeline.marks if mark.kind == "note"]


def capital(text: str) -> str:
    """The text with a capital in front."""
    return text[:1].upper() + text[1:]


def _nothing(timeline: Timeline) -> str:
    """Where no event began."""
    states: defaultdict[str, float] = defaultdict(float)
    reasons: defaultdict[str, float] = defaultdict(float)
    for span in timeline.said:
        state, _, reason = span.what.partition(" ")
        states[state] += span.to_s - span.from_s
        if state == "unknown" and reason:
            reasons[reason] += span.to_s - span.from_s
    if states["async"]:
        return f"Nothing lasting is wrong, but for {states['async']:.2f} s the cameras were called out of sync."
    if states["sync"] and states["sync"] >= states["unknown"]:
        return "Nothing is wrong with this rig."
    why = f": {REASON_WORDS[Reason(max(reasons, key=reasons.__getitem__))]}" if reasons else ""
    return f"Nothing can be said of this rig{why}."


def _told(mark: Mark, timeline: Timeline) -> str:
    when = _when(mark, timeline)
    tell = _OF_CAUSE.get(mark.cause or "")
    return f"{when}: {mark.text}" if tell is None else f"{when} {tell(mark, timeline)}"


def _when(mark: Mark, timeline: Timeline) -> str:
    kind = mark.kind.partition(" ")[0]
    alike = [other for other in timeline.marks if other.kind.startswith(f"{kind} ") and other.camera == mark.camera]
    at = next(place for place, other in enumerate(alike) if other is mark)
    end = next((other for other in alike[at:] if other.kind.endswith(" end")), None)
    # One event may follow upon another, and what is wrong with the pair then goes back further than what is new.
    last_s = alike[at - 1].at_s if at else 0.0
    begun_s = mark.at_s if mark.since_s is None or mark.since_s < last_s else mark.since_s
    lasting = end is None or end.text.startswith("to the end")
    if lasting and (seen_s := _last_seen_s(timeline)) < timeline.duration_s - SILENT_S:
        return f"from {begun_s:.1f} s on, as last seen at {seen_s:.1f} s,"
    if begun_s * 1000 < 2 * timeline.period_ms and lasting:
        return "all the time"
    return f"from {begun_s:.1f} s on" if lasting or end is None else f"from {begun_s:.1f} s to {end.at_s:.1f} s"


def _last_seen_s(timeline: Timeline) -> float:
    """Until when something was said of the pair; to its end where nothing ever was."""
    return max(
        (span.to_s for span in timeline.said if not span.what.startswith("unknown")), default=timeline.duration_s
    )


def _amount(mark: Mark, timeline: Timeline) -> str:
    """How far apart: whole frames as such, always in milliseconds."""
    offset_ms = abs(mark.offset_ms or 0.0)
    frames = offset_ms / timeline.period_ms
    if round(frames) == 0 or abs(frames - round(frames)) > WHOLE:
        return f"{offset_ms:.1f} ms"
    count = "a frame" if round(frames) == 1 else f"{round(frames)} frames"
    return f"{count} ({offset_ms:.1f} ms)"


def _two(timeline: Timeline) -> tuple[str, str]:
    first, _, second = timeline.pair.rpartition("-")
    return first, second


def _stamps_lie(mark: Mark, timeline: Timeline) -> str:
    first, second = _two(timeline)
    hidden = mark.stamps_ms is not None and mark.stamps_ms <= timeline.tolerance_ms
    stamps = "its stamps say that nothing is wrong" if hidden else "its stamps say otherwise"
    if mark.offset_ms is None:
        return f"the pictures of {first} and {second} are apart, although {stamps}"
    order = "old beside" if mark.offset_ms < 0 else "newer than"
    return f"{second} shows pictures that are {_amount(mark, timeline)} {order} {first}'s, although {stamps}"


def _slip(mark: Mark, timeline: Timeline) -> str:
    first, second = _two(timeline)
    if mark.offset_ms is None:
        return f"{first} and {second} are out of sync by whole frames, as stamps and pictures say alike"
    order = "behind" if mark.offset_ms < 0 else "ahead of"
    return f"{second} is {_amount(mark, timeline)} {order} {first}: frames are paired with the wrong partners"


def _phase(mark: Mark, timeline: Timeline) -> str:
    first, second = _two(timeline)
    if mark.offset_ms is None:
        return f"{first} and {second} are out of sync by a part of a frame"
    order = "before" if mark.offset_ms < 0 else "after"
    return (
        f"{second} takes its pictures {_amount(mark, timeline)} {order} {first}: the cameras are not triggered together"
    )


def _free_run(mark: Mark, timeline: Timeline) -> str:
    first, second = _two(timeline)
    pace = ""
    if mark.drift_ppm:
        pace = f" by {abs(mark.drift_ppm):.0f} ppm, a frame in {1000 * timeline.period_ms / abs(mark.drift_ppm):.0f} s"
    return f"{second} drifts away from {first}{pace}: it runs at a rate of its own"


def _frozen(mark: Mark, timeline: Timeline) -> str:
    other = next((name for name in _two(timeline) if name != mark.camera), "the other camera")
    return f"{mark.camera} shows the same picture again and again while {other} sees things move"


def _missing(mark: Mark, timeline: Timeline) -> str:  # noqa: ARG001 - told like all others
    return f"{mark.camera} delivers nothing"


_OF_CAUSE: Mapping[str, Callable[[Mark, Timeline], str]] = {
    Cause.STAMPS_LIE.value: _stamps_lie,
    Cause.SLIP.value: _slip,
    Cause.PHASE.value: _phase,
    Cause.FREE_RUN.value: _free_run,
    Cause.FROZEN.value: _frozen,
    Cause.MISSING.value: _missing,
}
