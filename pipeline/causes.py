"""Why a pair is out of sync: a table, read from the top; the first line that fits names the cause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pipeline.verdict import Cause

WHOLE_FRAME = 0.1
"""An offset this close to a whole number of frames, in frames, is called whole: timing jitter of real rigs is below."""

WIDEST_WHOLE = 0.25
"""The same where the offset is not known so well: half-way between whole and half."""

SETTLED = 5
"""Verdicts in a row after which another cause replaces the one that was named: a sixth of a second at 30 fps."""


@dataclass(frozen=True, slots=True)
class Situation:
    """What is known of a pair that is out of sync.

    missing, frozen: the camera, if one is. by_pictures: the pictures decided. stamps_differ: stamps that count tell
    of another offset than pictures. drifting: the offset has grown or shrunk steadily to what it is.
    frames, sigma_frames: off what is expected, in frames of the first camera.
    """

    missing: str | None = None
    frozen: str | None = None
    by_pictures: bool = False
    stamps_differ: bool = False
    drifting: bool = False
    frames: float = 0.0
    sigma_frames: float = 0.0

    @property
    def whole(self) -> bool:
        slack = min(max(WHOLE_FRAME, 2 * self.sigma_frames), WIDEST_WHOLE)
        return round(self.frames) != 0 and abs(self.frames - round(self.frames)) <= slack


CAUSES: tuple[tuple[Cause, Callable[[Situation], bool]], ...] = (
    (Cause.MISSING, lambda it: it.missing is not None),
    (Cause.FROZEN, lambda it: it.frozen is not None),
    (Cause.STAMPS_LIE, lambda it: it.by_pictures and it.stamps_differ),
    (Cause.FREE_RUN, lambda it: it.drifting),
    (Cause.SLIP, lambda it: it.whole),
    (Cause.PHASE, lambda _: True),
)


def cause_of(situation: Situation) -> Cause:
    return next(cause for cause, fits in CAUSES if fits(situation))


class SteadyCause:
    """The cause of one stretch out of sync without flicker: replaced by another that lasts."""

    def __init__(self) -> None:
        self._named: Cause | None = None
        self._other: Cause | None = None
        self._count = 0

    def clear(self) -> None:
        """The stretch is over."""
        self._named = None

    def add(self, cause: Cause) -> Cause:
        if self._named is None or cause is self._named:
            self._named, self._count = cause, 0
            return cause
        self._count = self._count + 1 if cause is self._other else 1
        self._other = cause
        if self._count >= SETTLED:
            self._named, self._count = cause, 0
        return self._named
