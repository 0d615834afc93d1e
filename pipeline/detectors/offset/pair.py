"""Follows the offset of one pair of cameras: pairs pictures, remembers the rig, notices slips."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.detectors.offset.blocks import MOTION_SHARE, Block, block_of
from pipeline.detectors.offset.drift import Drift
from pipeline.detectors.offset.geometry import Memory
from pipeline.detectors.offset.matching import FEW, Matcher, Matches
from pipeline.detectors.offset.motion_signal import MotionSignal, SignalFit, signal_offset
from pipeline.detectors.offset.regression import Fit, halves, learn, solve
from pipeline.detectors.offset.silence import Silence
from pipeline.detectors.offset.slips import RECENT, SLIP_FRAMES, Slips, refill
from pipeline.detectors.offset.sweep import Sweep
from pipeline.detectors.offset.tracks import Tracks
from pipeline.detectors.offset.working import Working
from pipeline.verdict import Reason

BLOCKS = 16
"""Windows an offset is averaged over: long enough for motion to vary, short enough to see a slip soon."""


SOLVE_EVERY = 8
"""Windows between two solutions once there are BLOCKS windows: half of them are then new. Slips are looked for in
every window."""

LISTEN_EVERY = 10
"""Windows between two looks at the motion of whole pictures: a fifteenth of their history is then new."""

HALF = 0.6
"""Beyond it another pairing is nearer; a little over a half, so that an offset of a half does not flap."""

STALE_WINDOWS = 3
"""A pairing that is older than its lag and this is not of now: windows or pictures are missing."""

WARM = 8
"""Windows of a new rig before anything is said: each of the eight terms has then been seen at several positions."""


STRAY = 2.5
"""Residuals this many times the usual ones come from wrong pairings, not from a change of scene."""


FLOOR_FRAMES = 0.001
FLOOR_PX = 0.002
"""Systematic error of a moment (unequal shutters, rows read in turn) and of a place (lens, pixel grid)."""


@dataclass(frozen=True, slots=True)
class View:
    """What one camera offers: working pictures, tracks and motion by slot."""

    pictures: Mapping[int, Working]
    tracks: Mapping[int, Tracks]
    signal: MotionSignal


@dataclass(frozen=True, slots=True)
class Estimate:
    fit: Fit
    sigma: float
    lag: int
    blocks: int
    margin: float
    calibrated: bool
    halves: Mapping[str, float]


class PairEstimator:
    """One pair. `update` takes the state of both cameras at a slot and returns an estimate, or why there is none."""

    def __init__(self, most: int, memory: Memory, *, with_halves: bool = False) -> None:
        self._most = most
        self._with_halves = with_halves
        self._matcher = Matcher()
        self.memory = memory
        self._blocks: deque[Block] = deque()
        self._lag = 0
        self._told = False
        self.signal: SignalFit | None = None
        self._seen = 0
        self._fit: Fit | None = None
        self._sweep: Sweep | None = Sweep(most)
        self._usual_px: float | None = None
        self.drift = Drift(BLOCKS)
        self._slips = Slips(BLOCKS)
        self._newest: tuple[tuple[int, int], Matches, int] | None = None

    def update(self, index: int, first: View, second: View) -> Estimate | Silence:
        estimate = self._update(index, first, second)
        self._told = not isinstance(estimate, Silence) and estimate.sigma < SLIP_FRAMES / 3
        return estimate

    def _update(self, index: int, first: View, second: View) -> Estimate | Silence:
        self._acquire(index, first, second)
        sweeping = self._sweeping(index, first, second)
        self._complete(first)
        block = self._block(index, first, second, self._lag, self._matcher)
        if isinstance(block, Silence):
            self._blocks.clear()
            self._slips.clear()
            return block
        if not self._blocks or (block.index, block.lag) != (self._blocks[-1].index, self._blocks[-1].lag):
            self._add(block)
        fit = self._solved(index)
        self._relock(fit)
        if sweeping:
            return Silence("searching for the lag", Reason.WARMING_UP)
        self._check(fit)
        if self._seen < WARM or len(self._blocks) < 2:
            return Silence("warming up", Reason.WARMING_UP)
        floor = _floor(fit, self._lag)
        sigma = float(np.hypot(fit.sigma, floor))
        if len(self._blocks) > BLOCKS // 2 and sigma < 0.2:
            self.drift.add(index, fit.tau, sigma)
        sigma *= self.drift.factor
        return Estimate(
            fit,
            sigma,
            self._lag,
            len(self._blocks),
            self._slips.margin(self._lag, fit),
            self.drift.calibrated,
            halves(self._blocks, self.memory, fit) if self._with_halves else {},
        )

    def _add(self, block: Block) -> None:
        """Takes in a new pairing: the oldest is learned and let go, and slips are looked for."""
        self._blocks.append(block)
        self._seen += 1
        while self._blocks[0].index <= block.index - BLOCKS:
            old = self._blocks.popleft()
            if self._fit is not None:
                learn(self.memory, old, self._fit)
        if self._fit is None:
            return
        self._slips.add(block, self._fit)
        slip = self._slips.found(self._lag, self._fit)
        if slip is not None:
            self._restart(*slip)

    def _solved(self, index: int) -> Fit:
        """The fit of all complete blocks, made anew every few windows and while it is young."""
        if self._fit is None or self._seen <= BLOCKS or len(self._blocks) < BLOCKS or index % SOLVE_EVERY == 0:
            terms = None if self._fit is None else self._fit.terms
            complete = list(self._blocks)[:-1] if len(self._blocks) > RECENT else self._blocks
            self._fit = solve(complete, self.memory, self._start(), terms)
        return self._fit

    def _start(self) -> float:
        return float(self._lag) if self._fit is None else float(np.clip(self._fit.tau, self._lag - 1, self._lag + 1))

    def _sweeping(self, index: int, first: View, second: View) -> bool:
        """Goes on with a search for the lag, if one is under way; at its end, moves to what it found."""
        if self._sweep is None:
            return False
        pairing = lambda lag, matcher: self._block(index, first, second, lag, matcher)  # noqa: E731
        self._sweep.visit(pairing, self._matcher, self.memory)
        if self._sweep.done:
            best = self._sweep.best(self._lag)
            self._sweep = None
            if best != self._lag:
                self._jump(best)
        return self._sweep is not None

    def _check(self, fit: Fit) -> None:
        """A residual far above the usual one means that pictures of different moments are paired: search again."""
        if len(self._blocks) < BLOCKS // 2:
            return
        if self._usual_px is not None and fit.scale_px > STRAY * self._usual_px:
            self._sweep, self._usual_px = Sweep(self._most), None
        else:
            self._usual_px = fit.scale_px if self._usual_px is None else 0.98 * self._usual_px + 0.02 * fit.scale_px

    def _jump(self, lag: int) -> None:
        """Starts afresh at another lag: what was learned at the wrong one is void."""
        self._lag = lag
        self._blocks.clear()
        self._slips.clear()
        self._fit = None
        self._seen = 0
        self._matcher = Matcher()
        self.memory.forget()

    def _block(self, index: int, first: View, second: View, lag: int, matcher: Matcher) -> Block | Silence:
        """The latest pairing of first t with second t - lag whose pictures are all there."""
        here = max((slot for slot in first.tracks if slot - lag in second.pictures), default=None)
        if here is None or here <= index - abs(lag) - STALE_WINDOWS or here not in first.pictures:
            return Silence("too short a history", Reason.WARMING_UP)
        tracks, there = first.tracks[here], here - lag
        if len(tracks.ids) < FEW:
            return Silence(f"too few corners: {len(tracks.ids)}", Reason.NO_TEXTURE)
        image = first.pictures[here]
        matches = matcher.match(tracks.ids, tracks.at, image, second.pictures[there])
        if len(matches.rows) < FEW:
            why = f"too few matches: {len(matches.rows)}" if matcher.overlap else "views do not overlap"
            return Silence(why, Reason.NO_OVERLAP)
        height, width = image.image.shape
        if matcher is self._matcher:
            self._newest = (width, height), matches, here
        return block_of(lag, (width, height), matches, first.tracks, here, known=False)

    def _complete(self, first: View) -> None:
        """Measures the motion of the latest block again, now that one more picture is known."""
        if self._blocks and self._newest is not None:
            last = self._blocks[-1]
            size, matches, here = self._newest
            if here in first.tracks and here + 1 in first.tracks:
                self._blocks[-1] = block_of(last.lag, size, matches, first.tracks, here, known=True)

    def _restart(self, recent: int, tau: float) -> None:
        """Keeps the windows after a slip only."""
        assert self._fit is not None
        self._blocks = deque(list(self._blocks)[-recent:])
        self._fit = solve(self._blocks, self.memory, tau, self._fit.terms)
        refill(self._slips, self._blocks, self._fit)
        self._usual_px = None

    def _relock(self, fit: Fit) -> None:
        if abs(fit.tau - self._lag) > HALF and 3 * fit.sigma < 0.5 and fit.noise_share < 0.3:
            self._lag = int(np.clip(round(fit.tau), -self._most, self._most))
            self._slips.clear()

    def _acquire(self, index: int, first: View, second: View) -> None:
        """Listens to the motion of the whole pictures; while points tell nothing, goes to the lag that it shows."""
        if index % LISTEN_EVERY == 0:
            self.signal = signal_offset(first.signal, second.signal, self._most)
            if self.signal is not None and abs(self.signal.tau - self._lag) >= 1.5 and not self._told:
                self._jump(round(self.signal.tau))


def _floor(fit: Fit, lag: int) -> float:
    """Systematic error in frames: tracks are off by a share of all their motion, of which only some tells time."""
    telling = max(fit.motion_px, 1e-3)
    shared = (FLOOR_FRAMES + MOTION_SHARE * abs(fit.tau - lag)) * max(fit.across_px / telling, 1.0)
    return shared + FLOOR_PX / telling + fit.between
