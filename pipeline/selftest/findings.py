"""Judges what the detector said of the same footage in several trials: does it agree with itself?

Neighbouring windows share pictures, so they are not independent: a median over windows is held against the median of
the standard errors that were reported, and that error is never divided by the root of their number.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import hypot, isnan, nan
from statistics import median
from typing import Any

from pipeline.verdict import State

SIGMAS = 2.0
"""Standard errors within which two numbers agree: what the detector itself asks for before it decides."""

FEWEST, FEWEST_SHARE = 10, 0.1
"""Windows, and share of all windows, that a test must rest on: fewer are an anecdote, not a recording."""

NOTICED_FRAMES = 0.5
"""A change of the offset past which the slip of one frame is nearer than none."""

STALE_WINDOWS = 20
"""Decided windows after a slip that may still tell the old offset: the detector averages over 16 and asks for three
that agree before it believes a slip; later than this, nothing from before the slip is left to excuse it."""


class Outcome(str, Enum):
    """What a test came to; `not shown` where the footage decides too little for it."""

    PASSED = "pass"
    FAILED = "fail"
    NOT_SHOWN = "not shown"


@dataclass(frozen=True, slots=True)
class Row:
    """What the detector said of a pair in one window.

    at_ns, partner_ns: the stamps of the pair's first and second camera, the same in all trials. offset, sigma: in
    frames of the rig's first camera, nan where not measured; sigma is one standard error. truth: in frames; only its
    change from trial to trial is known. numbers: what else the detector measured; those whose names end in `_frames` in
    the same frames.
    """

    at_ns: int
    frame: int
    state: State
    offset: float = nan
    sigma: float = nan
    truth: float = 0.0
    partner_ns: int | None = None
    reason: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)

    @property
    def decided(self) -> bool:
        return self.state is not State.UNKNOWN and not isnan(self.offset) and not isnan(self.sigma)


@dataclass(frozen=True, slots=True)
class Finding:
    """The outcome of one test of one pair or loop, with a sentence and the numbers it rests on."""

    test: str
    subject: str
    outcome: Outcome
    text: str
    numbers: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        return {
            "test": self.test,
            "subject": self.subject,
            "outcome": self.outcome.value,
            "text": self.text,
            "numbers": {name: round(value, 6) for name, value in self.numbers.items()},
        }


@dataclass(frozen=True, slots=True)
class Sample:
    """What one window says of a quantity whose value is known beforehand, with its standard error."""

    value: float
    sigma: float


def too_few(count: int, windows: int) -> bool:
    """Whether `count` windows out of `windows` are too few to rest anything on."""
    return count < max(FEWEST, FEWEST_SHARE * windows)


def shifted(pair: str, plain: Sequence[Row], moved: Sequence[Row], frames: float) -> Finding:
    """Moving the second camera's pictures by `frames` against the first's must change the offset by as much."""
    samples = [Sample(b.offset - a.offset, hypot(a.sigma, b.sigma)) for a, b in _together(plain, moved)]
    return _judged(f"shift by {frames:+g}", pair, samples, len(plain), frames, "the offset changed by {value} frames")


def swapped(pair: str, plain: Sequence[Row], reverse: Sequence[Row]) -> Finding:
    """Seen from the other camera, the offset must be negated: `reverse` tells the pair with its cameras swapped."""
    both = list(_together(plain, reverse))
    samples = [Sample(a.offset + b.offset, hypot(a.sigma, b.sigma)) for a, b in both]
    ways = _medians([(a.offset, b.offset) for a, b in both])
    return _judged("swap", pair, samples, len(plain), 0.0, f"{ways} frames the other way round, together {{value}}")


def halves(pair: str, plain: Sequence[Row], one: str, other: str, *, alike: bool = False) -> Finding:
    """Two halves of the points must tell the same offset.

    alike: the halves differ in nothing but chance and share every systematic error, so that their random errors alone
    may part them; other halves may be apart by the systematic error that is reported, too.
    """
    test, names = f"{one} / {other} points", (f"{one}_frames", f"{other}_frames")
    errors = (f"{one}_sigma_frames", f"{other}_sigma_frames")
    rows = [row for row in plain if row.decided and all(name in row.numbers for name in (*names, *errors))]
    if not rows:
        return Finding(test, pair, Outcome.NOT_SHOWN, "not measured")
    told = [(row.numbers[names[0]], row.numbers[names[1]]) for row in rows]
    shared = [0.0 if alike else row.numbers.get("sigma_systematic_frames", 0.0) for row in rows]
    samples = [
        Sample(a - b, hypot(*(row.numbers[name] for name in errors), floor))
        for row, (a, b), floor in zip(rows, told, shared, strict=True)
    ]
    return _judged(test, pair, samples, len(plain), 0.0, f"{_medians(told)} frames, apart by {{value}}")


def loop(names: Sequence[str], first: Sequence[Row], second: Sequence[Row], across: Sequence[Row]) -> Finding:
    """Round three cameras a, b, c the offsets must close: a-b and b-c add up to a-c.

    Each pair must have been measured by itself: in a rig of three cameras the detector makes its loops close.
    """
    a, b, c = names
    later: dict[int | None, Row] = {row.at_ns: row for row in second if row.decided}
    closing = [(ab, later[ab.partner_ns], ac) for ab, ac in _together(first, across) if ab.partner_ns in later]
    samples = [Sample(ab.offset + bc.offset - ac.offset, hypot(ab.sigma, bc.sigma, ac.sigma)) for ab, bc, ac in closing]
    text = f"{a}-{b} and {b}-{c} less {a}-{c} leave {{value}} frames"
    return _judged("loop", f"{a}-{b}-{c}", samples, len(first), 0.0, text)


def slip(pair: str, plain: Sequence[Row], slipped: Sequence[Row], period_ms: float) -> Finding:
    """A change of the true offset amid the footage must be told, and soon.

    Found: a decided window whose offset has changed by more than half a frame, or gone from sync to async, on the side
    the slip is on. Windows that are not decided are no excuse and no fault: only those that tell the old offset are.
    """
    test = "slip of one frame"
    before = {row.at_ns: row for row in plain}
    after = [row for row in slipped if row.at_ns in before and row.truth != before[row.at_ns].truth]
    usual = next((row for row in reversed(plain) if row.decided and after and row.at_ns <= after[0].at_ns), None)
    if usual is None:
        return Finding(test, pair, Outcome.NOT_SHOWN, "nothing is decided before it")
    later = after[0].truth > before[after[0].at_ns].truth
    stale = 0
    for delay, row in enumerate(after):
        usual = before[row.at_ns] if before[row.at_ns].decided else usual
        if row.decided and _noticed(row, usual, 1 if later else -1):
            text = f"found {delay} frames ({delay * period_ms:.0f} ms) after it began at frame {after[0].frame}"
            numbers = {"at_frame": after[0].frame, "delay_frames": delay, "stale_windows": stale}
            if stale <= STALE_WINDOWS:
                return Finding(test, pair, Outcome.PASSED, text, numbers)
            text = f"{text}; until then {stale} windows told the old offset, {STALE_WINDOWS} are allowed"
            return Finding(test, pair, Outcome.FAILED, text, numbers)
        stale += row.decided
    outcome = Outcome.FAILED if stale > STALE_WINDOWS else Outcome.NOT_SHOWN
    text = f"not found in the {stale} windows decided after it began at frame {after[0].frame}"
    return Finding(test, pair, outcome, text, {"at_frame": after[0].frame, "stale_windows": stale})


def _noticed(row: Row, usual: Row, side: int) -> bool:
    moved = (row.offset - usual.offset) * side
    turned = usual.state is State.SYNC and row.state is State.ASYNC
    return moved > NOTICED_FRAMES or (moved > 0 and turned)


def _together(one: Sequence[Row], other: Sequence[Row]) -> Iterator[tuple[Row, Row]]:
    """The windows that were decided in both trials."""
    known = {row.at_ns: row for row in other if row.decided}
    return ((row, known[row.at_ns]) for row in one if row.decided and row.at_ns in known)


def _medians(pairs: Sequence[tuple[float, float]]) -> str:
    return " and ".join(f"{median(side):+.3f}" for side in zip(*pairs, strict=True))


def _judged(test: str, subject: str, samples: Sequence[Sample], windows: int, expected: float, text: str) -> Finding:
    """Holds the samples' median against what is expected; `text` names it as {value}."""
    count = len(samples)
    if too_few(count, windows):
        return Finding(test, subject, Outcome.NOT_SHOWN, f"only {count} of {windows} windows could be compared")
    value, error = median(s.value for s in samples), SIGMAS * median(s.sigma for s in samples)
    within = abs(value - expected) <= error
    said = f"{text.format(value=f'{value:+.3f}')} (2 sigma {error:.3f}, {count} windows)"
    numbers = {"value_frames": value, "expected_frames": expected, "error_frames": error, "windows": count}
    return Finding(test, subject, Outcome.PASSED if within else Outcome.FAILED, said, numbers)
