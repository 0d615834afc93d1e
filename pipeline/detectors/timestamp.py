"""The report's Algorithm 2: stamps closer than half a period, and equal frame ids."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from pipeline.frame import NS_PER_MS, NS_PER_S, Frame, Pair, Rig, StampOrigin, Window
from pipeline.settings import Settings
from pipeline.verdict import Basis, Evidence, State

PROVES_NOTHING = frozenset({StampOrigin.SYNTHESISED, StampOrigin.ARRIVAL})
"""Made up from a frame rate, or taken when the host got the picture, seconds after the exposure for all it knows."""

ID_HISTORY = 31
"""Pairs over which a constant difference of ids is learned: about a second at 30 fps, odd so that a majority exists."""


class TimestampSettings(Settings):
    """The report's timestamp test.

    threshold_ms: how far apart stamps may be (auto: 1 / (2 fps), the report's figure 3.1).
    ids: `equal` compares frame ids literally, `learn` allows a constant difference, `ignore` leaves them out;
         unset, it is `equal` under `judge.combine: classic` and `learn` otherwise.
    """

    type: Literal["timestamp"] = "timestamp"
    threshold_ms: Annotated[float, Field(gt=0, le=1e9)] | Literal["auto"] = "auto"
    ids: Literal["equal", "learn", "ignore"] | None = None


class TimestampDetector:
    """|first - second| <= threshold and equal ids: sync.

    Abstains where a frame is missing and, outside the classic rule, where the two stamps are not of one clock.

    Source: the report, sections 2.1, 3.1.1 and Algorithm 2 (docs/classic-algorithm.md).
    """

    def __init__(self, settings: TimestampSettings, *, name: str, rig: Rig, classic: bool) -> None:
        self._name = name
        self._rig = rig
        self._classic = classic
        self._threshold_ms = settings.threshold_ms
        self._ids = settings.ids or ("equal" if classic else "learn")
        self._differences: dict[str, deque[int]] = {pair.name: deque(maxlen=ID_HISTORY) for pair in rig.pairs}

    def observe(self, window: Window) -> Sequence[Evidence]:
        return [self._judge(pair, window) for pair in self._rig.pairs]

    def _judge(self, pair: Pair, window: Window) -> Evidence:
        first, second = (window.cameras[name].current for name in (pair.first, pair.second))
        if first is None or second is None:
            return self._evidence(pair, State.UNKNOWN, f"no frame of {pair.first if first is None else pair.second}")
        if first.clock != second.clock and not self._classic:
            return self._evidence(pair, State.UNKNOWN, f"stamps of different clocks: {first.clock} and {second.clock}")
        period_ns = self._rig.camera(pair.first).period_ns
        difference_ns = second.captured_ns - first.captured_ns
        off_ns = abs(difference_ns - pair.expected_offset_ns)
        threshold_ns = self._threshold_ns(pair)
        complaint, notes = self._compare_ids(pair, first, second)
        apart = f"stamps {abs(difference_ns) / NS_PER_MS:.3f} ms apart"
        if pair.expected_offset_ns:
            apart += f", {off_ns / NS_PER_MS:.3f} ms off what is expected"
        if off_ns > threshold_ns:
            state, reason = State.ASYNC, f"{apart}, more than {threshold_ns / NS_PER_MS:.3f} ms"
        elif complaint:
            state, reason = State.ASYNC, complaint
        else:
            state, reason = State.SYNC, apart
        return Evidence(
            pair=pair.name,
            detector=self._name,
            basis=Basis.TIMESTAMPS,
            state=state,
            reason=reason,
            offset_ns=difference_ns,
            offset_frames=difference_ns / period_ns,
            numbers={"threshold_ms": threshold_ns / NS_PER_MS},
            notes=notes,
            synthesised=not PROVES_NOTHING.isdisjoint((first.stamp_origin, second.stamp_origin)),
        )

    def _threshold_ns(self, pair: Pair) -> int:
        if self._threshold_ms == "auto":
            return round(NS_PER_S / (2 * self._rig.camera(pair.first).fps))
        return round(self._threshold_ms * NS_PER_MS)

    def _compare_ids(self, pair: Pair, first: Frame, second: Frame) -> tuple[str, tuple[str, ...]]:
        """A complaint in words ('' for none) and the notes to make."""
        if self._ids == "ignore" or first.sequence is None or second.sequence is None:
            return "", ()
        difference = second.sequence - first.sequence
        expected = 0
        if self._ids == "learn":
            history = self._differences[pair.name]
            history.append(difference)
            expected = Counter(history).most_common(1)[0][0]
        notes = ("sequence_offset",) if expected else ()
        if difference == expected:
            return "", notes
        usual = f", usually {expected}" if expected else ""
        return f"frame ids differ by {difference}{usual} ({first.sequence} and {second.sequence})", notes

    def _evidence(self, pair: Pair, state: State, reason: str) -> Evidence:
        return Evidence(pair=pair.name, detector=self._name, basis=Basis.TIMESTAMPS, state=state, reason=reason)
