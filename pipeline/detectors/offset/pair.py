"""Follows the offset of one pair of cameras: pairs pictures, remembers the rig, notices slips."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.detectors.offset.geometry import Memory
from pipeline.detectors.offset.matching import FEW, Matcher
from pipeline.detectors.offset.motion_signal import MotionSignal, best_lag
from pipeline.detectors.offset.regression import Block, Fit, learn, profile, solve
from pipeline.detectors.offset.sweep import Sweep
from pipeline.detectors.offset.tracks import Tracks
from pipeline.detectors.offset.working import Working

BLOCKS = 16
"""Windows an offset is averaged over: long enough for motion to vary, short enough to see a slip soon."""

RECENT = 3
"""Windows that must agree before a slip is believed: one may be a bad picture, two a coincidence."""

SLIP_FRAMES = 0.6
"""Rigs slip by whole frames; a smaller change is followed by the window itself, and between two frames the profile of
a few windows wanders by up to a half where motion is curved."""

GAIN = 20.0
"""Log likelihood by which a slip must fit better: twenty points' worth, which a handful of false tracks cannot give."""

AS_GOOD = 1.5
"""Cost a point after a slip, against before it: three windows have half the points of six, and scatter more. The slip
must also save two fifths of the whole cost, or curved motion passes for one."""

HALF = 0.6
"""Beyond it another pairing is nearer; a little over a half, so that an offset of a half does not flap."""

WARM = 8
"""Windows of a new rig before anything is said: each of the eight terms has then been seen at several positions."""


STRAY = 2.5
"""Residuals this many times the usual ones come from wrong pairings, not from a change of scene."""


@dataclass(frozen=True, slots=True)
class View:
    """What one camera offers: working pictures, tracks and motion by slot."""

    pictures: Mapping[int, Working]
    tracks: Mapping[int, Tracks]
    signal: MotionSignal


@dataclass(frozen=True, slots=True)
class Estimate:
    fit: Fit
    lag: int
    blocks: int


class PairEstimator:
    """One pair. `update` takes the state of both cameras at a slot and returns an estimate, or why there is none."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._matcher = Matcher()
        self.memory = Memory()
        self._blocks: deque[Block] = deque()
        self._lag = 0
        self._seen = 0
        self._fit: Fit | None = None
        self._sweep: Sweep | None = Sweep(most)
        self._usual_px: float | None = None

    def update(self, index: int, first: View, second: View) -> Estimate | str:
        self._acquire(index, first, second)
        sweeping = self._sweeping(index, first, second)
        block = self._block(index, first, second, self._lag, self._matcher)
        if isinstance(block, str):
            self._blocks.clear()
            return block
        self._blocks.append(block)
        self._seen += 1
        while self._blocks and self._blocks[0].index <= index - BLOCKS:
            old = self._blocks.popleft()
            if self._fit is not None:
                learn(self.memory, old, self._fit)
        self._notice_slip()
        terms = None if self._fit is None else self._fit.terms
        fit = self._fit = solve(self._blocks, self.memory, self._start(), terms)
        self._relock(fit)
        if sweeping:
            return "searching for the lag"
        self._check(fit)
        if self._seen < WARM or len(self._blocks) < RECENT:
            return "warming up"
        return Estimate(fit, self._lag, len(self._blocks))

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
        if self._usual_px is not None and fit.scale_px > STRAY * self._usual_px:
            self._sweep, self._usual_px = Sweep(self._most), None
        else:
            self._usual_px = fit.scale_px if self._usual_px is None else 0.98 * self._usual_px + 0.02 * fit.scale_px

    def _jump(self, lag: int) -> None:
        """Starts afresh at another lag: what was learned at the wrong one is void."""
        self._lag = lag
        self._blocks.clear()
        self._fit = None
        self._seen = 0
        self._matcher = Matcher()
        self.memory.forget()

    def _block(self, index: int, first: View, second: View, lag: int, matcher: Matcher) -> Block | str:
        """The latest pairing of first t with second t - lag whose pictures are all there."""
        here, there = (index, index - lag) if lag >= 0 else (index + lag, index)
        tracks = first.tracks.get(here)
        if tracks is None or here not in first.pictures or there not in second.pictures:
            return "too short a history"
        if len(tracks.ids) < FEW:
            return f"too few corners: {len(tracks.ids)}"
        image = first.pictures[here]
        matches = matcher.match(tracks.ids, tracks.at, image, second.pictures[there])
        if len(matches.rows) < FEW:
            return f"too few matches: {len(matches.rows)}" if matcher.overlap else "views do not overlap"
        rows = matches.rows
        height, width = image.image.shape
        at, motion, change = (a[rows].astype(np.float64) for a in (tracks.at, tracks.motion, tracks.acceleration))
        u, v = ((at - [width / 2, height / 2]) / width).T
        dx, dy = matches.displacement.astype(np.float64).T
        mx, my = motion.T
        return Block(index, lag, float(width), tracks.ids[rows], tracks.age[rows], u, v, dx, dy, mx, my, change[:, 1])

    def _notice_slip(self) -> None:
        """Compares the latest windows with those before; on a slip only the latest are kept."""
        fit = self._fit
        between = fit is not None and abs(fit.tau - round(fit.tau)) > 0.2
        count = 2 * RECENT if between else RECENT  # between two frames, curved motion looks like a slip for longer
        if fit is None or len(self._blocks) < 2 * count:
            return
        recent = list(self._blocks)[-count:]
        taus = np.asarray(self._lag + np.arange(-1.5, 1.51, 0.25), np.float64)
        costs = profile(recent, fit.terms, taus, fit.scale_px)
        best = float(taus[costs.argmin()])
        nearest = costs[np.abs(taus - fit.tau).argmin()]
        if abs(best - fit.tau) < SLIP_FRAMES or nearest - costs.min() < max(GAIN, 0.4 * nearest):
            return
        earlier = list(self._blocks)[:-count]
        usual = profile(earlier, fit.terms, np.array([fit.tau]), fit.scale_px)[0] / sum(len(b.u) for b in earlier)
        # After a true slip the points fit as well as before it; where motion is curved they fit nowhere.
        as_good = costs.min() / sum(len(b.u) for b in recent) < AS_GOOD * usual
        if as_good and self._agreed(recent, fit, best):
            self._restart(recent, best)

    @staticmethod
    def _agreed(recent: list[Block], fit: Fit, best: float) -> bool:
        """Each of the latest windows by itself prefers the new offset to the old one."""
        both = np.array([fit.tau, best])
        costs = [profile([block], fit.terms, both, fit.scale_px) for block in recent]
        return all(new < old - 2 for old, new in costs)

    def _restart(self, blocks: list[Block], tau: float) -> None:
        assert self._fit is not None
        self._blocks = deque(blocks)
        self._fit = solve(blocks, self.memory, tau, self._fit.terms)

    def _relock(self, fit: Fit) -> None:
        if abs(fit.tau - self._lag) > HALF and 3 * fit.sigma < 0.5 and fit.noise_share < 0.3:
            self._lag = int(np.clip(round(fit.tau), -self._most, self._most))

    def _acquire(self, index: int, first: View, second: View) -> None:
        """Jumps to the lag that the cameras' motion as a whole shows, when it is clear and far from here."""
        if index % 3:
            return
        lag = best_lag(first.signal, second.signal, self._most)
        if lag is not None and lag.sure and abs(lag.frames - self._lag) >= 2:
            self._jump(lag.frames)
