"""The last minutes: of one pair's offset, at a few points a second, and of a rig's state."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

from pipeline.fleet.messages import HeardPair, HeardVerdict
from pipeline.frame import NS_PER_MS, NS_PER_S
from pipeline.verdict import State

STEP_NS = 500 * NS_PER_MS
KEPT_NS = 300 * NS_PER_S
SPARSE_NS = 3 * STEP_NS
"""Without verdicts for this long (they may be thinned, or not published at all), statuses tell the offset."""


@dataclass(frozen=True, slots=True)
class Point:
    """What was said of a pair within one step of time.

    at_ns: where the step begins, on the listener's monotonic clock. state, offset_ms, sigma_ms, tolerance_ms: what was
    said last. low_ms, high_ms: the smallest and the largest offset of the step.
    """

    at_ns: int
    state: State
    offset_ms: float | None
    sigma_ms: float | None
    tolerance_ms: float | None
    low_ms: float | None
    high_ms: float | None


class Offsets:
    """Points in order of time, KEPT_NS of them at most."""

    def __init__(self) -> None:
        self._points: deque[Point] = deque(maxlen=KEPT_NS // STEP_NS)

    def add(self, said: HeardVerdict, now_ns: int) -> None:
        self._put(
            Point(
                at_ns=now_ns - now_ns % STEP_NS,
                state=said.state,
                offset_ms=said.offset_ms,
                sigma_ms=said.offset_sigma_ms,
                tolerance_ms=said.tolerance_ms,
                low_ms=said.offset_ms,
                high_ms=said.offset_ms,
            )
        )

    def fill(self, said: HeardPair, now_ns: int) -> None:
        """Takes the offset from a status where no verdicts come."""
        step_ns = now_ns - now_ns % STEP_NS
        if self._points and step_ns - self._points[-1].at_ns < SPARSE_NS and self._points[-1].tolerance_ms is not None:
            return
        offset_ms = said.offset_ms
        self._put(Point(step_ns, said.state, offset_ms, said.offset_sigma_ms, None, offset_ms, offset_ms))

    def since(self, at_ns: int, now_ns: int) -> tuple[Point, ...]:
        """The points that begin at `at_ns` or later and are not too old."""
        first_ns = max(at_ns, now_ns - KEPT_NS)
        return tuple(point for point in self._points if point.at_ns >= first_ns)

    def _put(self, point: Point) -> None:
        if self._points and self._points[-1].at_ns == point.at_ns:
            before = self._points.pop()
            known = [v for v in (before.low_ms, before.high_ms, point.offset_ms) if v is not None]
            point = replace(point, low_ms=min(known, default=None), high_ms=max(known, default=None))
        self._points.append(point)


SLOT_NS = 5 * NS_PER_S
WORST_FIRST = (State.ASYNC, State.UNKNOWN, State.SYNC)


class Trail:
    """The worst state of any pair of a rig in each SLOT_NS of the last KEPT_NS."""

    def __init__(self) -> None:
        self._slots: deque[tuple[int, State]] = deque(maxlen=KEPT_NS // SLOT_NS)

    def add(self, states: Iterable[State], now_ns: int) -> None:
        slot = now_ns // SLOT_NS
        before = [self._slots.pop()[1]] if self._slots and self._slots[-1][0] == slot else []
        seen = {*states, *before}
        worst = next((state for state in WORST_FIRST if state in seen), None)
        if worst is not None:
            self._slots.append((slot, worst))

    def until(self, now_ns: int) -> tuple[State | None, ...]:
        """A state for each slot, oldest first; None where nothing was heard."""
        known = dict(self._slots)
        last = now_ns // SLOT_NS
        return tuple(known.get(slot) for slot in range(last - KEPT_NS // SLOT_NS + 1, last + 1))
