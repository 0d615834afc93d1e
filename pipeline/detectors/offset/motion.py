"""How points move across the rows around one moment, freed from tracking noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.detectors.offset.arrays import Floats, Ints, Mask, median
from pipeline.detectors.offset.tracks import Tracks

NODES = (-2, -1, 1, 2)
"""Frames around t at which positions are used, where a point was followed so far."""

SURELY_NOISE, SURELY_MOTION = 2.0, 4.0
"""Standard errors: apparent motion below the one is taken for noise, above the other for a point's own motion; of a
hundred still points four exceed the first by chance and none the second."""

COMPANY, ALIKE = 2, 0.5
"""A point moves by itself if one of its two nearest neighbours moves as it does, to a half."""

CUT, CUT_PX = 2.5, 1.0
"""A step so many times as long as its neighbours, and that long, is no motion: things start and stop, they do not do
both at once. Shaking by less than a pixel may look like it."""

LEAST_NOISE_PX = 1e-3
"""A camera that repeats its picture has no tracking noise at all; positions are not known better than this."""

COMMON = 5
"""Terms of the motion that points of a rigid scene share: 1, u, v, disparity d and, driving forward, v d."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Paths of n points across the rows, in px, with time in frames from t.

    path: n x 4, coefficients of s, s^2, s^3, s^4. inner: n x 2, the steps to t-1 and t+1 alone. along: n, px a frame
    along the rows. noise_px: standard error of one point's speed. own: n in 0..1, how surely a point moves in its own
    way. cut_px: length of a single step beside which those before and after are nothing, else 0: a cut, a gap, a knock.
    """

    path: Floats
    inner: Floats
    along: Floats
    noise_px: float
    own: Floats
    cut_px: float

    @property
    def speed(self) -> Floats:
        return np.asarray(self.path[:, 0], np.float64)

    @property
    def speed_variance(self) -> Floats:
        """N: squared standard errors of `speed`: what points share is known from all of them."""
        return np.asarray(self.noise_px**2 * (COMMON / max(len(self.own), 1) + self.own**2), np.float64)


def glance(tracks: Tracks, rows: Ints) -> Motion:
    """Motion of the points `rows` as tracked, before it is known what comes after: noise and all."""
    back, forth = ((end[rows] - tracks.at[rows]).astype(np.float64) for end in (tracks.before, tracks.after))
    inner = np.stack([back[:, 1], forth[:, 1]], axis=1)
    path = np.zeros((len(rows), len(NODES)))
    path[:, 0], path[:, 1] = (inner[:, 1] - inner[:, 0]) / 2, inner.sum(axis=1) / 2
    return Motion(path, inner, (forth - back)[:, 0] / 2, 0.0, np.ones(len(rows)), 0.0)


def measure(tracks: Tracks, rows: Ints, earlier: Tracks | None, later: Tracks | None, basis: Floats) -> Motion:
    """Motion of the points `rows` of `tracks`; `earlier` and `later` are the tracks one frame before and after.

    basis: n x 5, the terms of a rigid scene's common motion. What a point does beyond the common motion is kept only if
    it exceeds the noise of tracking, judged from second differences; so still points carry no noise into the offset.
    """
    at = tracks.at[rows].astype(np.float64)
    steps = np.full((len(rows), len(NODES)), np.nan)
    steps[:, 1] = tracks.before[rows, 1] - at[:, 1]
    steps[:, 2] = tracks.after[rows, 1] - at[:, 1]
    ids = tracks.ids[rows]
    if earlier is not None:
        mine, theirs = _common_ids(ids, earlier.ids)
        steps[mine, 0] = earlier.before[theirs, 1] - at[mine, 1]
    if later is not None:
        mine, theirs = _common_ids(ids, later.ids)
        steps[mine, 3] = later.after[theirs, 1] - at[mine, 1]
    along = ((tracks.after - tracks.before)[rows, 0] / 2).astype(np.float64)
    common = _common(steps, basis)
    rest = steps - common
    second = rest[:, 1] + rest[:, 2]
    scale = max(1.4826 * median(np.abs(second)), 0.02)
    weight = 1 / (1 + (second / (2.385 * scale)) ** 2)
    noise = max(float(np.sqrt((weight * second**2).sum() / weight.sum())) / 2, LEAST_NOISE_PX)
    excess = np.sqrt((rest[:, 1] ** 2 + rest[:, 2] ** 2) / 2) / (np.sqrt(2) * noise)
    own = np.clip((excess - SURELY_NOISE) / (SURELY_MOTION - SURELY_NOISE), 0, 1)
    own *= _accompanied(at, rest, own > 0)
    clean = common + own[:, None] * rest
    return Motion(_paths(clean), clean[:, 1:3], along, noise, own, _cut(clean, noise))


def _cut(steps: Floats, noise: float) -> float:
    """Px of an inner step CUT times as long as every other, all points together; 0 if there is none."""
    ways = np.insert(steps, 2, 0.0, axis=1)
    known = ~np.isnan(ways).any(axis=1)
    if known.sum() < COMMON:
        return 0.0
    first, before, after, last = np.sqrt((np.diff(ways[known], axis=1) ** 2).mean(axis=0)).tolist()
    longest = max(before, after)
    others = max(first, last, min(before, after), noise)
    return float(longest) if longest > max(CUT * others, CUT_PX) else 0.0


def _common_ids(ids: Ints, others: Ints) -> tuple[Ints, Ints]:
    """Places of the ids that are in both; both ascend, as tracks number their points."""
    if not len(others):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    place = np.minimum(np.searchsorted(others, ids), len(others) - 1)
    mine = np.flatnonzero(others[place] == ids)
    return mine, place[mine]


def _accompanied(at: Floats, rest: Floats, moves: Mask) -> Mask:
    """Which points have a neighbour that moves alike: things are larger than a point, false tracks are alone."""
    company = np.zeros(len(at), np.bool_)
    movers = np.flatnonzero(moves)
    if len(at) <= COMPANY or len(movers) < 2:
        return company
    squared = ((at[movers, None] - at[None]) ** 2).sum(axis=2)
    squared[np.arange(len(movers)), movers] = np.inf
    near = np.argpartition(squared, COMPANY - 1, axis=1)[:, :COMPANY]
    speed = (rest[:, 2] - rest[:, 1]) / 2
    alike = np.abs(speed[near] - speed[movers, None]) < ALIKE * np.abs(speed[movers, None])
    company[movers] = (alike & moves[near]).any(axis=1)
    return company


def _common(steps: Floats, basis: Floats) -> Floats:
    """N x 4: the part of the steps that the basis explains, by most points (Cauchy weights on the inner steps)."""
    filled = np.nan_to_num(steps)
    known = ~np.isnan(steps)
    inner = filled[:, 1:3]
    weight = np.ones(len(basis))
    coefficients = np.zeros((basis.shape[1], 2))
    for _ in range(3):
        weighted = basis * weight[:, None]
        coefficients[:] = np.linalg.solve(weighted.T @ basis + 1e-9 * np.eye(COMMON), weighted.T @ inner)
        rest = np.hypot(*(inner - basis @ coefficients).T)
        scale = max(median(rest), 0.01)
        weight = 1 / (1 + (rest / (2.385 * scale)) ** 2)
    fitted = np.empty_like(steps)
    fitted[:, 1:3] = basis @ coefficients
    for column in (0, 3):
        weighted = basis * (weight * known[:, column])[:, None]
        solution = np.linalg.solve(weighted.T @ basis + 1e-6 * np.eye(COMMON), weighted.T @ filled[:, column])
        fitted[:, column] = np.where(known[:, column], basis @ solution, np.nan)
    return fitted


def _paths(steps: Floats) -> Floats:
    """N x 4: polynomials through 0 and the known steps."""
    paths = np.zeros((len(steps), len(NODES)))
    known = ~np.isnan(steps)
    for first, last in ((False, False), (True, False), (False, True), (True, True)):
        chosen = (known[:, 0] == first) & (known[:, 3] == last)
        if not chosen.any():
            continue
        used = [k for k in range(len(NODES)) if (k not in (0, 3)) or (k == 0 and first) or (k == 3 and last)]
        powers = np.array([[float(NODES[k]) ** p for p in range(1, len(used) + 1)] for k in used])
        paths[np.ix_(chosen, range(len(used)))] = steps[np.ix_(chosen, used)] @ np.linalg.inv(powers).T
    return paths
