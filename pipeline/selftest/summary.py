"""What the footage itself shows, as recorded: in sync, out of sync by how much, or changing; and how finely."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from statistics import median
from typing import Any

from pipeline.selftest.findings import SIGMAS, Row, too_few
from pipeline.verdict import State

CONFIRM = 5
"""Decided windows in a row that must tell another offset before it counts as a change: as many as raise an alarm."""

CLEAR = 0.9
"""Share of the decided windows that must agree for a word about all of them."""

MOST_STRETCHES = 6
"""Stretches that are told one by one; an offset that changes more often is told as a range."""


@dataclass(slots=True)
class Stretch:
    """Windows in a row whose offset is the same within its error; offset in frames."""

    rows: list[Row]

    @property
    def offset(self) -> float:
        return median(row.offset for row in self.rows)

    def differs(self, row: Row) -> bool:
        sigma = hypot(median(r.sigma for r in self.rows), row.sigma)
        return abs(row.offset - self.offset) > SIGMAS * sigma


@dataclass(frozen=True, slots=True)
class Summary:
    """One pair, as recorded. smallest: the smallest offset that could be told from none, in frames."""

    pair: str
    windows: int
    states: Counter[State]
    offset: float | None
    smallest: float | None
    stretches: tuple[Stretch, ...]
    mostly: str

    @property
    def decided(self) -> int:
        return self.states[State.SYNC] + self.states[State.ASYNC]

    @property
    def can_prove(self) -> bool:
        return not too_few(self.decided, self.windows)

    def sentences(self, period_ms: float) -> str:
        """For people: what was found, and what is the least that could have been."""
        counts = f"{self.decided} of {self.windows} windows could be decided"
        if not self.can_prove or self.offset is None or self.smallest is None:
            few = f" Those few, too few to rest on, say {self._parts()}." if self.stretches else ""
            why = f"; what kept most of the others: {self.mostly}" if self.mostly else ""
            return f"cannot tell: {counts}{why}.{few}"
        found = self._found(self.offset, self.smallest / SIGMAS, period_ms)
        return (
            f"{found} {counts}. The smallest offset that this footage can show is "
            f"{self.smallest * period_ms:.2g} ms ({self.smallest:.3f} frames)."
        )

    def _found(self, offset: float, sigma: float, period_ms: float) -> str:
        size = f"{offset:+.3f} ± {sigma:.3f} frames, {offset * period_ms:+.1f} ± {sigma * period_ms:.1f} ms"
        in_sync = self.states[State.SYNC] >= CLEAR * self.decided
        if len(self.stretches) > 1:
            return f"{'in sync, but' if in_sync else 'OUT OF SYNC, and'} the offset changes: {self._changes()}."
        if in_sync:
            return f"in sync (offset {size})."
        if self.states[State.ASYNC] >= CLEAR * self.decided:
            return f"OUT OF SYNC by {size}."
        return f"neither clearly in sync ({self.states[State.SYNC]} windows) nor out of it (offset {size})."

    def _changes(self) -> str:
        if len(self.stretches) > MOST_STRETCHES:
            ends = sorted(part.offset for part in self.stretches)
            return f"{len(self.stretches) - 1} times, between {ends[0]:+.2f} and {ends[-1]:+.2f} frames"
        return self._parts()

    def _parts(self) -> str:
        return ", ".join(
            f"{part.offset:+.2f} frames at frame {part.rows[0].frame} to {part.rows[-1].frame}"
            for part in self.stretches[:MOST_STRETCHES]
        )

    def to_json(self, period_ms: float) -> dict[str, Any]:
        return {
            "pair": self.pair,
            "windows": self.windows,
            "sync": self.states[State.SYNC],
            "async": self.states[State.ASYNC],
            "offset_frames": self.offset,
            "sigma_frames": None if self.smallest is None else self.smallest / SIGMAS,
            "smallest_offset_frames": self.smallest,
            "smallest_offset_ms": None if self.smallest is None else self.smallest * period_ms,
            "stretches": [
                {"from_frame": part.rows[0].frame, "to_frame": part.rows[-1].frame, "offset_frames": part.offset}
                for part in self.stretches
            ],
            "text": self.sentences(period_ms),
        }


def summary(pair: str, rows: Sequence[Row]) -> Summary:
    decided = [row for row in rows if row.decided]
    reasons = Counter(row.reason.partition(":")[0] for row in rows if not row.decided and row.reason)
    return Summary(
        pair=pair,
        windows=len(rows),
        states=Counter(row.state for row in decided),
        offset=median(row.offset for row in decided) if decided else None,
        smallest=SIGMAS * median(row.sigma for row in decided) if decided else None,
        stretches=tuple(stretches(decided, 1 if too_few(len(decided), len(rows)) else CONFIRM)),
        mostly=reasons.most_common(1)[0][0] if reasons else "",
    )


def stretches(decided: Sequence[Row], confirm: int) -> list[Stretch]:
    """Parts the decided windows where the offset changes by more than its error, for `confirm` windows or longer."""
    found: list[Stretch] = []
    pending: list[Row] = []
    for row in decided:
        pending.append(row)
        if found and not found[-1].differs(row):
            found[-1].rows += pending
            pending = []
        elif len(pending) == confirm:
            found.append(Stretch(pending))
            pending = []
    return found
