"""How a rig stands, in a word or two that can be read from across a room."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from pipeline.fleet.messages import HeardStatus
from pipeline.fleet.table import Presence, RigView
from pipeline.frame import NS_PER_S
from pipeline.verdict import Level, State


class Tone(str, Enum):
    """How urgent it is; from the worst on."""

    BAD = "bad"
    AWAY = "away"  # nothing is known of now
    WARN = "warn"
    UNSURE = "unsure"
    GOOD = "good"


WORST_FIRST = tuple(Tone)
"""The order in which tones are written down."""


@dataclass(frozen=True, slots=True)
class Headline:
    """word: a word or two; detail: a sentence without its end, or nothing."""

    tone: Tone
    word: str
    detail: str


def headline(rig: RigView) -> Headline:
    if rig.presence is Presence.UNHEARD:
        return Headline(Tone.AWAY, "Cut off", f"nothing can be heard of any rig; {_last(rig)}")
    if rig.presence is Presence.GONE:
        return Headline(Tone.AWAY, "Monitor gone", f"its program has ended, or cannot be reached; {_last(rig)}")
    if rig.presence is Presence.STALE:
        return Headline(Tone.AWAY, "Stale", f"its program is there, but does not say how the rig stands; {_last(rig)}")
    if rig.status is None:
        return Headline(Tone.UNSURE, "Starting", "no status yet")
    return _stands(rig.status)


def ago(silent_ns: int) -> str:
    """`12 s`, `5 min`, `3 h` or `2 days`."""
    seconds = silent_ns // NS_PER_S
    for unit, length in (("days", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds // length} {unit}"
    return f"{seconds} s"


def _stands(status: HeardStatus) -> Headline:
    reasons = "; ".join(status.reasons)
    if status.level is Level.STALE:
        return Headline(Tone.BAD, "No frames", reasons)
    if status.level is Level.ERROR:
        return Headline(Tone.BAD, "Out of sync", reasons)
    if status.level is Level.WARN:
        return Headline(Tone.WARN, "Warning", reasons)
    unsure = [name for name, pair in status.pairs.items() if pair.state is State.UNKNOWN]
    if unsure or not status.pairs:
        return Headline(Tone.UNSURE, "Cannot tell", ", ".join(unsure) if len(status.pairs) > 1 else "")
    return Headline(Tone.GOOD, "In sync", "")


def _last(rig: RigView) -> str:
    said = "nothing was ever heard of it" if rig.status is None else f"last heard {ago(rig.silent_ns)} ago"
    return said if rig.status is None else f"{said}: {_stands(rig.status).word.lower()}"
