"""What stamps and pictures testify of a pair, and whether they have agreed so far."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from pipeline.belief import SURE, support
from pipeline.clock_alignment import SAME_EPOCH_NS
from pipeline.clocks import MAD_TO_SIGMA, MEDIAN_SIGMA, NOISY, ClockReading, PairClock
from pipeline.drift import Drift, DriftEstimator
from pipeline.frame import NS_PER_S, Frame, Pair, Rig
from pipeline.ramp import Ramp, Slope
from pipeline.verdict import Basis, Evidence, Reason, State

COMPARED = 31
"""Frames over which stamps and pictures are compared: more than twice as many as it takes to notice a slip in pictures,
so that the median does not take the delay for a disagreement."""

LEAST_COMPARED = 9

LEAST_STEPS, FEW_STEPS = 5, 20
"""Changes from frame to frame that tell roughly how noisy stamps are, and well: before, they accuse nobody."""

DOUBT = 2.0
"""Times the largest of a few changes that noise may still be: the largest of five is below half of it once in sixty."""

RECENT = 3
"""Stamps that are smoothed where they are set against pictures: one may be wrong."""

STRANGE_SIGMAS = 3
"""Joint standard errors beyond which stamps and pictures differ."""

STEP_FRAMES = 0.3
"""A change of the offset from one picture to the next that is no drift."""

UNSIGNED_SUPPORT = SURE / 2
"""Support of evidence that comes without an error: one frame decides where nothing was known, four make a change."""

LEAST_SUPPORT = 1.9
"""Support of pictures below which they decide nothing: that of two standard errors is 2."""

FIRST_SIGMA, LEAST_SIGMA = 0.25, 0.05
"""Error of stamps, in tolerances, before their jitter is known, and at least afterwards, for clocks tick in steps."""

FARTHEST = 10
"""Frames beyond which, and beyond two seconds, stamps are of clocks that were set, not of frames that were lost."""

DRIFTED = 0.5
"""Tolerances that a drift must have added up to, before it is called the cause."""


@dataclass(frozen=True, slots=True)
class Testimony:
    """What one witness says at one frame. support: log likelihood ratio, positive for out of sync."""

    evidence: Evidence
    support: float
    offset_ns: float
    sigma_ns: float | None


class StampWitness:
    """Follows the stamps of one pair: what they say, and whether pictures have borne them out.

    Abstains where stamps are synthesised (unless trusted), noisier than any tolerance, of clocks that cannot be
    compared, or disproved by pictures.
    """

    def __init__(self, pair: Pair, rig: Rig, tolerance_ns: int, *, trust_synthesised: bool) -> None:
        self._expected_ns = pair.expected_offset_ns
        self._tolerance_ns = tolerance_ns
        self._period_ns = rig.camera(pair.first).period_ns
        self._trust_synthesised = trust_synthesised
        self._clock = PairClock(self._period_ns, rig.camera(pair.second).period_ns)
        self._epochs: tuple[int, int] | None = None
        self._differences: deque[float] = deque(maxlen=COMPARED)
        self._recent: deque[float] = deque(maxlen=RECENT)
        self._steps: deque[float] = deque(maxlen=COMPARED)
        self._ramp = Ramp()
        self._slope: Slope | None = None
        self.reading: ClockReading | None = None
        self.usable = False
        """Whether there are stamps that count."""

    def see(self, first: Frame, second: Frame, evidence: Sequence[Evidence]) -> Testimony | Reason:
        """Takes two frames that were paired, and what detectors of stamps said of them."""
        epochs = (first.epoch, second.epoch)
        if epochs != self._epochs:
            self._epochs = epochs
            self._differences.clear()
        reading = self._clock.see(first, second)
        if self.reading is not None and reading.epoch_ns != self.reading.epoch_ns:
            self._recent.clear()
            self._ramp.clear()
        self.reading = reading
        said = next((item for item in evidence if item.offset_ns is not None), None)
        self.usable = said is not None and (self._trust_synthesised or not said.synthesised)
        if said is None or not self.usable:
            return Reason.NO_EVIDENCE
        offset_ns = float(reading.interval_ns if reading.middle_ns is None else reading.middle_ns) - reading.epoch_ns
        if self._recent:
            self._steps.append(offset_ns - self._recent[-1])
        self._recent.append(offset_ns)
        self._ramp.add(offset_ns)
        self._slope = self._ramp.slope(self._tolerance_ns / 4)
        if self._noisy or abs(offset_ns) > max(SAME_EPOCH_NS, FARTHEST * self._period_ns):
            return Reason.NO_EVIDENCE
        if self.disproved:
            return Reason.STAMPS_DISPROVED
        if reading.epoch_ns and len(self._differences) < LEAST_COMPARED:
            return Reason.NO_EVIDENCE
        supported = support(offset_ns - self._expected_ns, self.sigma_ns, self._tolerance_ns)
        if supported > 0 and len(self._steps) < LEAST_STEPS:
            return Reason.WARMING_UP
        return Testimony(said, supported, offset_ns, self.sigma_ns)

    @property
    def sigma_ns(self) -> float:
        """One standard error of a single difference of stamps."""
        least = LEAST_SIGMA if len(self._steps) >= LEAST_COMPARED else FIRST_SIGMA
        return max(least * self._tolerance_ns, self._jitter_ns)

    @property
    def _jitter_ns(self) -> float:
        """Robust standard deviation of one difference, from the changes between neighbours: no drift or jump adds.

        While they are few, the largest counts, but for two that a jump may have made: a few small ones prove no quiet.
        """
        usual = median(self._steps) if self._steps else 0.0
        off = sorted(abs(step - usual) for step in self._steps)
        if len(off) < FEW_STEPS:
            return DOUBT * off[-1] / 2**0.5 if off else 0.0
        if len(off) < COMPARED:
            return off[-3] / 2**0.5
        return MAD_TO_SIGMA * off[len(off) // 2] / 2**0.5

    @property
    def _noisy(self) -> bool:
        return self._jitter_ns > NOISY * self._period_ns

    def compare(self, pictures: Testimony) -> None:
        """Takes what pictures say of the frames seen last."""
        if self._recent and self.usable:
            self._differences.append(self._recent[-1] - pictures.offset_ns)

    @property
    def disproved(self) -> bool:
        """Whether pictures have shown of late that stamps are off by more than the tolerance."""
        if len(self._differences) < LEAST_COMPARED:
            return False
        middle = median(self._differences)
        scatter = MAD_TO_SIGMA * median(abs(each - middle) for each in self._differences)
        error = MEDIAN_SIGMA * scatter / len(self._differences) ** 0.5
        return bool(abs(middle) > self._tolerance_ns + STRANGE_SIGMAS * error)

    @property
    def biased(self) -> bool:
        """Whether they are off by a constant part of a frame: such stamps mark another moment of the exposure."""
        if not self.disproved or self._noisy or (self.drift is not None and self.drift.sure):
            return False
        return 2 * abs(median(self._differences)) < self._period_ns

    def differ_from(self, pictures: Testimony, lag_ns: float) -> bool:
        """Whether stamps that count tell of another offset than pictures. lag_ns: what these may lag behind."""
        if not self.usable or not self._recent or (self.reading is not None and self.reading.epoch_ns):
            return False
        error = (self.sigma_ns**2 / len(self._recent) + (pictures.sigma_ns or 0.0) ** 2) ** 0.5
        apart = abs(median(self._recent) - pictures.offset_ns)
        return bool(apart > self._tolerance_ns + lag_ns + STRANGE_SIGMAS * error)

    @property
    def drift(self) -> Drift | None:
        """Over the long run, else, where stamps ramp so that it shows within a second, over that."""
        drift = None if self.reading is None else self.reading.drift
        if self._slope is None or (drift is not None and drift.sure):
            return drift
        ppm = 1e6 / self._period_ns
        return Drift(self._slope.ns * ppm, self._slope.sigma_ns * ppm, round(NS_PER_S))

    @property
    def drifting(self) -> bool:
        """Whether stamps grow apart steadily, enough to matter."""
        return self._slope is not None or (self.usable and _adds_up(self.drift, self._tolerance_ns))

    @property
    def slope(self) -> float:
        """How fast stamps grow apart now, ns a ns; 0 where they do not do so steadily."""
        return 0.0 if self._slope is None else self._slope.ns / self._period_ns


class PictureWitness:
    """Follows what detectors of content say of one pair."""

    def __init__(self, pair: Pair, rig: Rig, tolerance_ns: int) -> None:
        self._expected_ns = pair.expected_offset_ns
        self._tolerance_ns = tolerance_ns
        self._period_ns = rig.camera(pair.first).period_ns
        self._estimator = DriftEstimator()
        self._last: float | None = None
        self._ramp = Ramp()

    def see(self, first: Frame, best: Evidence | None, lag_ns: float) -> Testimony | Reason:
        """Takes the best evidence of content at a frame. lag_ns: by how much the offset may have grown since."""
        if best is None:
            return Reason.NO_EVIDENCE
        if best.state is State.UNKNOWN or best.offset_ns is None:
            return best.silence or Reason.NO_EVIDENCE
        offset_ns = float(best.offset_ns)
        self._follow(first.captured_ns, offset_ns, best.sigma_ns)
        if best.sigma_ns is None:
            sign = 1 if best.state is State.ASYNC else -1
            return Testimony(best, sign * UNSIGNED_SUPPORT, offset_ns, None)
        sigma_ns = (best.sigma_ns**2 + lag_ns**2) ** 0.5
        supported = support(offset_ns - self._expected_ns, sigma_ns, self._tolerance_ns)
        return Testimony(best, supported, offset_ns, sigma_ns) if abs(supported) >= LEAST_SUPPORT else Reason.WIDE_ERROR

    def _follow(self, at_ns: int, offset_ns: float, sigma_ns: int | None) -> None:
        if self._last is not None and abs(offset_ns - self._last) > STEP_FRAMES * self._period_ns:
            self._estimator.interrupt()
            self._ramp.clear()
        self._last = offset_ns
        if sigma_ns is not None:
            self._estimator.add(at_ns, offset_ns, float(sigma_ns))
            self._ramp.add(offset_ns)

    @property
    def drift(self) -> Drift | None:
        return self._estimator.drift

    @property
    def drifting(self) -> bool:
        """Whether pictures grow apart steadily."""
        return self._ramp.slope(self._tolerance_ns) is not None or _adds_up(self.drift, self._tolerance_ns)


def _adds_up(drift: Drift | None, tolerance_ns: int) -> bool:
    """Whether a drift is sure and has come to a share of the tolerance by now."""
    return drift is not None and drift.sure and abs(drift.ppm) * 1e-6 * drift.span_ns > DRIFTED * tolerance_ns


def best_of(items: Sequence[Evidence]) -> Evidence | None:
    """The decided item with the smallest standard error; an undecided one only if there is no other."""

    def rank(item: Evidence) -> tuple[bool, float]:
        return item.state is State.UNKNOWN, float("inf") if item.sigma_frames is None else item.sigma_frames

    return min(items, key=rank, default=None)


def of_basis(evidence: Sequence[Evidence], basis: Basis) -> list[Evidence]:
    return [item for item in evidence if item.basis is basis]
