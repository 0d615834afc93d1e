"""One run as stretches of time, small enough to be drawn: what was true, what was said, and when events began."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from pipeline.frame import NS_PER_MS
from pipeline.verdict import Event, Report, Verdict

MOST_POINTS = 1000
"""Points of a curve: as many as a screen has columns."""


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch in seconds, with what held meanwhile."""

    from_s: float
    to_s: float
    what: str


@dataclass(frozen=True, slots=True)
class Point:
    """An offset and its standard error, None where nothing was told. true_ms: what it really was, where it is known."""

    at_s: float
    true_ms: float | None
    told_ms: float | None
    sigma_ms: float | None


@dataclass(frozen=True, slots=True)
class Mark:
    """An event, or a note that is seen for the first time, in words.

    at_s: when it was said. since_s: since when it has been so, where that is known. cause, camera: of an event.
    offset_ms, drift_ppm: what was told when it began. stamps_ms: what the stamps said then.
    """

    at_s: float
    kind: str
    text: str
    since_s: float | None = None
    cause: str | None = None
    camera: str | None = None
    offset_ms: float | None = None
    drift_ppm: float | None = None
    stamps_ms: float | None = None


@dataclass(slots=True)
class Timeline:
    """truth: sync, async or unknown. said: a state, with its cause or reason after a space."""

    pair: str
    period_ms: float
    duration_s: float
    tolerance_ms: float
    truth: list[Span] = field(default_factory=list)
    said: list[Span] = field(default_factory=list)
    points: list[Point] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)


def timeline_of(reports: Sequence[Report], pair: str, fps: float, *, truth_known: bool = True) -> Timeline:
    """The timeline of one pair; without truth, where nobody knows it."""
    verdicts = [item for item in reports if isinstance(item, Verdict) and item.pair == pair]
    if not truth_known:
        verdicts = [replace(verdict, truth=None) for verdict in verdicts]
    tolerance_ms = verdicts[0].tolerance_ns / NS_PER_MS if verdicts else 0.0
    made = Timeline(pair, 1000 / fps, len(verdicts) / fps, tolerance_ms)
    made.truth = _spans(verdicts, fps, lambda one: one.truth.state.value if one.truth else "unknown")
    made.said = _spans(verdicts, fps, _said)
    every = max(1, len(verdicts) // MOST_POINTS)
    made.points = [_point(n / fps, verdict) for n, verdict in enumerate(verdicts) if n % every == 0]
    marks = Marks(pair, fps)
    for report in reports:
        marks.add(report)
    made.marks = marks.marks
    return made


def _said(verdict: Verdict) -> str:
    why = verdict.cause or verdict.reason
    return f"{verdict.state.value} {why.value}" if why else verdict.state.value


def _spans(verdicts: Sequence[Verdict], fps: float, what: Callable[[Verdict], str]) -> list[Span]:
    spans: list[Span] = []
    for n, verdict in enumerate(verdicts):
        held, end_s = what(verdict), (n + 1) / fps
        if spans and spans[-1].what == held:
            spans[-1] = Span(spans[-1].from_s, end_s, held)
        else:
            spans.append(Span(n / fps, end_s, held))
    return spans


def _point(at_s: float, verdict: Verdict) -> Point:
    true_ns = None if verdict.truth is None else verdict.truth.offset_ns
    return Point(at_s, _ms(true_ns), _ms(verdict.offset_ns), _ms(verdict.sigma_ns))


def _ms(value_ns: int | None) -> float | None:
    return None if value_ns is None else value_ns / NS_PER_MS


class Marks:
    """Collects the marks of one pair from reports as they come: each note when it is seen for the first time.

    most: what comes after as many is not kept; `left_out` counts such events.
    """

    def __init__(self, pair: str, fps: float, most: int | None = None) -> None:
        self.marks: list[Mark] = []
        self.left_out = 0
        self._pair = pair
        self._fps = fps
        self._most = most
        self._seen: set[str] = set()
        self._count = 0
        self._last: Verdict | None = None

    def add(self, report: Report) -> None:
        if isinstance(report, Verdict) and report.pair == self._pair:
            self._count, self._last = self._count + 1, report
            for note in report.notes:
                if note not in self._seen and self._room():
                    self._seen.add(note)
                    self.marks.append(Mark(self._at_s, "note", note))
        elif isinstance(report, Event) and report.pair in {self._pair, None}:
            if self._room():
                self.marks.append(_event(report, self._at_s, self._last, self._fps))
            else:
                self.left_out += 1

    def _room(self) -> bool:
        return self._most is None or len(self.marks) < self._most

    @property
    def _at_s(self) -> float:
        return max(self._count - 1, 0) / self._fps


def _event(event: Event, at_s: float, verdict: Verdict | None, fps: float) -> Mark:
    of_pair = verdict is not None and event.kind == "async"
    return Mark(
        at_s,
        f"{event.kind} {event.phase}",
        event.text,
        since_s=verdict.since_frame / fps if of_pair and verdict and verdict.since_frame is not None else None,
        cause=event.cause and event.cause.value,
        camera=event.camera,
        offset_ms=event.worst.get("offset_ms"),
        drift_ppm=event.worst.get("drift_ppm"),
        stamps_ms=_ms(verdict.interval_ns) if verdict else None,
    )
