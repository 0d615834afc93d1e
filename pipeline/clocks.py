"""What the stamps of two cameras say of their clocks: offset, drift, jitter, steps, and which moment they mark."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from statistics import median
from typing import TypeAlias

from pipeline.clock_alignment import SAME_EPOCH_NS
from pipeline.drift import Drift, DriftEstimator
from pipeline.frame import Frame, StampOrigin, StampReference
from pipeline.notes import Note

HALF = 12
"""Pairs before and after a step that are compared: their medians are three times as exact as one stamp, and the step
is known 0.4 s later at 30 fps."""

NOISE_PAIRS = 63
"""Pairs over which jitter is measured: two seconds at 30 fps."""

LEAST_STEP = 0.1
"""Periods from which a jump counts as a step: the widest tolerance of synchronization."""

STEP_SIGMAS = 3
"""Jitters from which a jump counts as a step: six standard errors of the difference of two medians of 12."""

NOISY = 0.1
"""Jitter in periods from which stamps cannot tell whether a pair is in sync: the widest tolerance."""

LEAST_CORRECTION = 0.03
"""Correction in periods from which the moment that stamps mark matters: the narrowest tolerance."""

MAD_TO_SIGMA = 1.4826
MEDIAN_SIGMA = 1.2533
"""Standard error of a median of n normal values, in standard deviations over the root of n."""

Sample: TypeAlias = tuple[int, float, int]
"""Time on the first camera's clock, difference of the stamps less the epoch, number of the pair."""


@dataclass(frozen=True, slots=True)
class Step:
    """A jump of the difference of two clocks. pair: the first pair after it, counted from 0; at_ns: its stamp."""

    pair: int
    at_ns: int
    size_ns: int


@dataclass(frozen=True, slots=True)
class ClockReading:
    """What stamps say at one pair; differences are second less first.

    interval_ns: of the stamps as they are. start_ns, middle_ns: of the start and middle of exposure, where references
    and exposures are known. corrected: what follows rests on `middle_ns`, else on `interval_ns`.
    epoch_ns: the constant by which the clocks differ and which says nothing of the frames; 0 where they can be
    compared, else only changes count. offset_ns: recent median, brought to this pair by the drift, less the epoch.
    jitter_ns: robust standard deviation of one difference around it. step: found at this pair, its onset lies back.
    offset_sigma_ns is one standard error. None: too little is known, or stamps are synthesised.
    """

    interval_ns: int
    start_ns: int | None = None
    middle_ns: int | None = None
    corrected: bool = False
    epoch_ns: int = 0
    offset_ns: int | None = None
    offset_sigma_ns: int | None = None
    drift: Drift | None = None
    jitter_ns: int | None = None
    step: Step | None = None
    notes: tuple[Note, ...] = ()


class PairClock:
    """Follows the stamps of paired frames in bounded memory. No clock and no thread of its own.

    Jumps that last are steps: medians of 12 pairs before and after, each level in itself (a ramp is not), differ by
    more than jitter explains. Drift is measured between steps, whose size it therefore does not depend on.
    Pairing may itself step by a period where cameras run free. A jump of more than two seconds is a new epoch.
    """

    def __init__(self, first_period_ns: int, second_period_ns: int) -> None:
        self._period_ns = min(first_period_ns, second_period_ns)
        self._pairs = 0
        self._epochs: tuple[int, int] | None = None
        self._corrected = False
        self._restart()

    def _restart(self) -> None:
        self._epoch_ns: int | None = None
        self._zero_ns = 0.0
        self._early: list[float] = []
        self._recent: deque[Sample] = deque(maxlen=2 * HALF)
        self._fed = self._pairs
        self._off: deque[float] = deque(maxlen=NOISE_PAIRS)
        self._drift = DriftEstimator()

    @property
    def held(self) -> int:
        """Values held in memory."""
        return len(self._early) + len(self._recent) + len(self._off) + self._drift.held

    def see(self, first: Frame, second: Frame) -> ClockReading:
        """Takes two frames that were paired, in order of time."""
        reading = _exposures(first, second)
        if StampOrigin.SYNTHESISED in (first.stamp_origin, second.stamp_origin):
            return reading
        epochs = (first.epoch, second.epoch)
        if epochs != self._epochs or reading.corrected != self._corrected:
            self._epochs, self._corrected = epochs, reading.corrected
            self._restart()
        difference_ns = reading.interval_ns if reading.middle_ns is None else reading.middle_ns
        self._add(first, second, difference_ns)
        step = self._find_step()
        if step is not None and abs(step.size_ns) > SAME_EPOCH_NS:
            self._start_again_after(step, first, second, difference_ns)
        self._pairs += 1
        return self._read(reading, step)

    def _add(self, first: Frame, second: Frame, difference_ns: int) -> None:
        if self._epoch_ns is None:
            comparable = first.clock == second.clock and abs(difference_ns) <= SAME_EPOCH_NS
            self._epoch_ns = 0 if comparable else difference_ns
            self._relative = not comparable
        off = float(difference_ns - self._epoch_ns)
        if self._relative and len(self._early) < HALF:
            self._early.append(off)
            self._zero_ns = median(self._early)
        if len(self._recent) >= HALF:
            self._feed(self._recent[len(self._recent) - HALF][2])
        self._recent.append((first.captured_ns, off, self._pairs))

    def _feed(self, until_pair: int) -> None:
        """Lets the regression have the recent samples up to a pair, except those it has."""
        for t_ns, off, pair in self._recent:
            if self._fed <= pair < until_pair:
                self._drift.add(t_ns, off)
                self._fed = pair + 1

    def _find_step(self) -> Step | None:
        if len(self._recent) < 2 * HALF:
            return None
        offs = [off for _, off, _ in self._recent]
        size = median(offs[HALF:]) - median(offs[:HALF])
        least = max(
            LEAST_STEP * self._period_ns, STEP_SIGMAS * self._sigma_ns, 2 * STEP_SIGMAS * self._drift.scatter_ns
        )
        if abs(size) <= least:
            return None
        quarter = HALF // 2
        for part in (offs[:HALF], offs[HALF:]):
            if abs(median(part[quarter:]) - median(part[:quarter])) > abs(size) / 4:
                return None
        return self._step_at(_boundary(offs))

    def _step_at(self, boundary: int) -> Step:
        samples = list(self._recent)
        before, after = samples[:boundary], samples[boundary:]
        slope = self._drift.drift.ppm * 1e-6 if self._drift.drift else 0.0
        apart_ns = median(t for t, *_ in after) - median(t for t, *_ in before)
        size = median(off for _, off, _ in after) - median(off for _, off, _ in before) - slope * apart_ns
        at_ns, _, pair = after[0]
        self._feed(pair)
        self._drift.interrupt()
        self._recent = deque(after, maxlen=2 * HALF)
        return Step(pair, at_ns, round(size))

    def _start_again_after(self, step: Step, first: Frame, second: Frame, difference_ns: int) -> None:
        """One of the clocks was set."""
        assert self._epoch_ns is not None
        epoch_ns = self._epoch_ns + step.size_ns + round(self._zero_ns)
        comparable = first.clock == second.clock and abs(epoch_ns) <= SAME_EPOCH_NS
        self._restart()
        self._epoch_ns, self._relative = (0 if comparable else epoch_ns), not comparable
        self._add(first, second, difference_ns)

    @property
    def _sigma_ns(self) -> float:
        return MAD_TO_SIGMA * median(abs(off) for off in self._off) if self._off else 0.0

    def _read(self, reading: ClockReading, step: Step | None) -> ClockReading:
        drift = self._drift.drift
        slope = drift.ppm * 1e-6 if drift else 0.0
        now_ns = self._recent[-1][0]
        levelled = [off - slope * (t_ns - now_ns) for t_ns, off, _ in self._recent]
        level = median(levelled)
        self._off.append(levelled[-1] - level)
        scatter = MAD_TO_SIGMA * median(abs(each - level) for each in levelled)
        sigma = max(MEDIAN_SIGMA * scatter / len(levelled) ** 0.5, self._drift.scatter_ns)
        assert self._epoch_ns is not None
        known = len(levelled) >= HALF // 2
        read = replace(
            reading,
            epoch_ns=self._epoch_ns + round(self._zero_ns) if self._relative else 0,
            offset_ns=round(level - self._zero_ns) if known else None,
            offset_sigma_ns=round(sigma) if known else None,
            drift=drift,
            jitter_ns=round(self._sigma_ns) if len(self._off) >= HALF else None,
            step=step,
        )
        return replace(read, notes=(*reading.notes, *self._notes(read)))

    def _notes(self, reading: ClockReading) -> tuple[Note, ...]:
        holds = {
            Note.CLOCK_EPOCH: 2 * abs(reading.epoch_ns) > self._period_ns,
            Note.CLOCK_DRIFT: reading.drift is not None and reading.drift.sure,
            Note.JITTER: (reading.jitter_ns or 0) > NOISY * self._period_ns,
            Note.STAMP_REFERENCE: reading.middle_ns is not None
            and abs(reading.middle_ns - reading.interval_ns) > LEAST_CORRECTION * self._period_ns,
        }
        return tuple(note for note, held in holds.items() if held and note not in reading.notes)


def middle_of_exposure_ns(frame: Frame) -> int | None:
    """The stamp moved to the middle of the exposure; None where reference or exposure are unknown.

    Stamps of arrival and synthesised ones mark no moment of an exposure.
    """
    return _moment_ns(frame, {StampReference.START: 1, StampReference.MIDDLE: 0, StampReference.END: -1})


def start_of_exposure_ns(frame: Frame) -> int | None:
    """The stamp moved to the start of the exposure; None as in `middle_of_exposure_ns`."""
    return _moment_ns(frame, {StampReference.START: 0, StampReference.MIDDLE: -1, StampReference.END: -2})


def _moment_ns(frame: Frame, halves: dict[StampReference, int]) -> int | None:
    """The stamp and so many half exposures."""
    half = halves.get(frame.stamp_reference)
    if half is None or frame.stamp_origin in (StampOrigin.ARRIVAL, StampOrigin.SYNTHESISED):
        return None
    if half == 0:
        return frame.captured_ns
    return None if frame.exposure_ns is None else frame.captured_ns + half * frame.exposure_ns // 2


def _exposures(first: Frame, second: Frame) -> ClockReading:
    """The parts of a reading that two frames tell alone."""
    starts = start_of_exposure_ns(first), start_of_exposure_ns(second)
    middles = middle_of_exposure_ns(first), middle_of_exposure_ns(second)
    start_ns = None if starts[0] is None or starts[1] is None else starts[1] - starts[0]
    middle_ns = None if middles[0] is None or middles[1] is None else middles[1] - middles[0]
    references = {first.stamp_reference, second.stamp_reference} - {StampReference.UNKNOWN}
    return ClockReading(
        interval_ns=second.captured_ns - first.captured_ns,
        start_ns=start_ns,
        middle_ns=middle_ns,
        corrected=middle_ns is not None,
        notes=(Note.STAMP_REFERENCE,) if len(references) == 2 else (),
    )


def _boundary(offs: list[float]) -> int:
    """Where two levels meet: the split with the least sum of absolute deviations."""

    def deviations(part: list[float]) -> float:
        middle = median(part)
        return sum(abs(each - middle) for each in part)

    quarter = HALF // 2
    return min(range(quarter, len(offs) - quarter + 1), key=lambda at: deviations(offs[:at]) + deviations(offs[at:]))
