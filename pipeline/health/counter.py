"""Follows a device's frame counter through losses, wraps and resets."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from statistics import median, mode
from typing import NamedTuple

USUAL_STEPS = 31
"""Steps by which it is learned how far the counter moves a frame: a second at 30 fps."""

WIDTHS_BITS = (8, 16, 24, 32, 64)
"""Widths of counters in whole bytes, tried besides the width that the largest value seen needs."""

LONG_PERIODS = 300
"""Without usable stamps a larger jump is a counter that was set: ten seconds of lost frames at 30 fps, long enough to
have been noticed as silence."""


class Advance(NamedTuple):
    """frames: how many frames the counter went on by, 1 where it says nothing. reset: it wrapped, or was set."""

    frames: int = 1
    reset: bool = False


class FrameCounter:
    """Turns counter values into frames, checked against elapsed time where there is any.

    A counter may move by more than one a frame (a sensor that runs faster than its camera delivers): the usual step is
    learned, and bounded by the nominal frame rate so that every second frame lost is not taken for a step of two.
    A jump that time contradicts is a reset and no loss.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._largest = 0
        self._steps: deque[tuple[int, float | None]] = deque(maxlen=USUAL_STEPS)
        self.moves = False
        """Whether the counter was ever seen to change; one that stands still says nothing."""

    def restart(self) -> None:
        """The device has started anew: the next value is not compared with the last."""
        self._last = None

    def step(self, sequence: int | None) -> int | None:
        """The difference to the last value, or None where there is none to compare with."""
        return None if sequence is None or self._last is None else sequence - self._last

    def advance(
        self, sequence: int | None, *, nominal_periods: float | None, periods: float | None, slack: float
    ) -> Advance:
        """Takes the next value.

        nominal_periods, periods: time since the last frame in nominal and in measured periods; None where stamps are
        no evidence or, for the latter, while it is being learned. slack: how far off noise may put the latter.
        """
        step, self._last = self.step(sequence), sequence
        if sequence is not None:
            self._largest = max(self._largest, sequence)
        if not step:
            return Advance()
        self.moves = True
        elapsed = nominal_periods if periods is None else periods
        if step > 0:
            self._steps.append((step, nominal_periods))
            frames = max(1, round(step / self._usual_step()))
            if frames == 1 or self._plausible(frames, elapsed, slack):
                return Advance(frames)
            return Advance(reset=True)
        for frames in self._wrapped(step) if elapsed is not None else ():
            if self._plausible(frames, elapsed, slack):
                return Advance(frames, reset=True)
        return Advance(reset=True)

    def _usual_step(self) -> int:
        usual = mode(step for step, _ in self._steps)
        paces = [step / periods for step, periods in self._steps if periods is not None and periods > 0]
        return min(usual, max(1, round(median(paces)))) if paces else usual

    def _wrapped(self, step: int) -> Iterator[int]:
        """The frames that a fall may stand for, by every width the counter may have."""
        for bits in (max(1, self._largest.bit_length()), *WIDTHS_BITS):
            if step + (1 << bits) > 0 and (1 << bits) > self._largest:
                yield max(1, round((step + (1 << bits)) / (self._usual_step() if self._steps else 1)))

    @staticmethod
    def _plausible(frames: int, elapsed: float | None, slack: float) -> bool:
        """Whether so many frames fit into the elapsed time; over long gaps, the rate need not have been constant."""
        if elapsed is None:
            return frames <= LONG_PERIODS
        return abs(frames - elapsed) <= 0.5 + slack + frames / 20
