"""Solves for a rig's geometry and the time between its cameras together, from a few windows of matches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.detectors.offset.arrays import Floats, Ints, median
from pipeline.detectors.offset.blocks import CURVED, MOTION_SHARE, Block, Stack
from pipeline.detectors.offset.geometry import AHEAD, DISPARITY, TERMS, Memory, design

CAUCHY = 2.385
"""Tuning of Cauchy's weights: 95 % efficient for normal errors (Holland and Welsch 1977)."""

ROUNDS = 2
SMALLEST_PX = 0.03
"""No residual scale below the precision of Lucas-Kanade on 8-bit pictures."""

MOST_SHARE = 0.05
"""Faces and cloth deform as they move, but by more than a twentieth of the way in a frame they are not followed."""

ANYWHERE = 0.29
"""Standard deviation of a moment that may be anywhere between two frames: 1 / sqrt(12)."""

DILUTED = 0.5
"""Noise in a regressor draws the slope to zero by its share of the regressor's variance (Fuller 1987); up to a half,
the slope is corrected, and the correction counted as an error."""


@dataclass(frozen=True, slots=True)
class Fit:
    """tau and its standard error in frames; motion_px: how far points move a frame beyond noise and geometry.

    across_px, along_px: how far they move a frame at all. noise_share: part of the apparent motion that is tracking
    noise. moving: points that move beyond noise; regions: cells they are in. scale_px: robust residual of a point,
    steady_px: with what a track keeps removed. between: by how much the offset changes with the order of the
    interpolation between frames. terms: the geometry (8). track_ids, track_bias: by how much each track deviates from
    the geometry lastingly, px.
    """

    tau: float
    sigma: float
    motion_px: float
    noise_share: float
    across_px: float
    along_px: float
    moving: int
    regions: int
    matches: int
    scale_px: float
    steady_px: float
    between: float
    terms: Floats
    track_ids: Ints
    track_bias: Floats


@dataclass(frozen=True, slots=True)
class Lasting:
    """Weights that tell what a track keeps over time from what changes (random effects; Balestra and Nerlove 1966)."""

    of: Ints
    weight: Floats
    total: Floats
    theta: Floats

    def mean(self, values: Floats) -> Floats:
        """Weighted mean of each track, tracks x columns."""
        weighted = values * (self.weight if values.ndim == 1 else self.weight[:, None])
        if values.ndim == 1:
            return np.asarray(np.bincount(self.of, weighted, len(self.total)) / self.total)
        sums = [np.bincount(self.of, column, len(self.total)) / self.total for column in weighted.T]
        return np.stack(sums, axis=1)

    def steady(self, values: Floats) -> Floats:
        """Values with most of each track's mean removed: as much as tracks differ from one another lastingly."""
        share = self.theta if values.ndim == 1 else self.theta[:, None]
        return np.asarray(values - (share * self.mean(values))[self.of])


def solve(blocks: Sequence[Block], memory: Memory, tau: float, terms: Floats | None = None) -> Fit:
    """Gauss-Newton on geometry and offset with Cauchy weights; errors robust to clusters of points.

    The model is "dy = g(p, dx) + bias of the track + y(t + tau) - y(t)". The standard error is the largest that
    residuals grouped by cell, by track and by frame give (Liang and Zeger 1986), and not below the model's own.
    Sudden motion is first doubted alike at all offsets; only if a whole number of frames explains it, it is trusted.
    """
    s = Stack(blocks)
    terms = memory.terms if terms is None else terms
    fit = _descend(s, memory, tau, terms, anywhere=True)
    if abs(fit.tau - round(fit.tau)) < 2 * fit.sigma:
        return _descend(s, memory, fit.tau, fit.terms, anywhere=False)
    return fit


def _descend(s: Stack, memory: Memory, tau: float, terms: Floats, *, anywhere: bool) -> Fit:
    geometry = s.geometry(tau)
    residual = s.residual(tau, geometry, terms)
    weight: Floats = np.ones(len(residual))
    for _ in range(ROUNDS):
        error = s.error(tau, anywhere)
        scale, steady, lasting = _spreads(s, error, residual, weight)
        spread = np.hypot(steady, error)
        inner = lasting.steady(residual)
        s.share = _share(s.pace, inner)
        weight = 1 / (spread**2 * (1 + (inner / (CAUCHY * spread)) ** 2))
        columns = lasting.steady(np.column_stack([geometry, s.speed(tau)]))
        weighted = columns * weight[:, None]
        normal = columns.T @ weighted
        normal[:TERMS, :TERMS] += memory.information
        gradient = weighted.T @ inner
        gradient[:TERMS] += memory.vector - memory.information @ terms
        normal[TERMS, TERMS] += 1e-9
        change = np.linalg.solve(normal, gradient)
        terms = terms + change[:TERMS]
        tau = float(tau + np.clip(change[TERMS], -0.5, 0.5))
        geometry = s.geometry(tau)
        residual = s.residual(tau, geometry, terms)
    return _assess(s, normal, columns, weight, residual, scale, steady, lasting, tau, terms)


def _share(pace: Floats, residual: Floats) -> float:
    """Share of its own motion by which a point is off: what fast points scatter more than slow ones."""
    slow, fast = np.quantile(pace, [1 / 3, 2 / 3])
    scatter = [1.4826 * median(np.abs(residual[chosen])) for chosen in (pace <= slow, pace >= fast)]
    typical = max(median(pace[pace >= fast]), 1e-6)
    return float(np.clip(np.sqrt(max(scatter[1] ** 2 - scatter[0] ** 2, 0.0)) / typical, MOTION_SHARE, MOST_SHARE))


def _spreads(s: Stack, error: Floats, residual: Floats, weight: Floats) -> tuple[float, float, Lasting]:
    """Scale of a residual, scale with what tracks keep removed, and the weights of the tracks that follow from both."""
    scale = max(1.4826 * median(np.abs(residual)), SMALLEST_PX)
    count = np.bincount(s.track)
    middle = np.bincount(s.track, weight * residual) / np.maximum(np.bincount(s.track, weight), 1e-12)
    often = count[s.track] >= 4
    steady = scale
    if often.sum() >= 40:
        inner = (residual - middle[s.track])[often] * np.sqrt(count / np.maximum(count - 1, 1))[s.track][often]
        steady = min(max(1.4826 * median(np.abs(inner)), SMALLEST_PX), scale)
    lasting = scale**2 - steady**2
    spread = np.hypot(steady, error)
    precision = 1 / spread**2
    total = np.asarray(np.bincount(s.track, precision), np.float64)
    theta = 1 - np.sqrt(1 / (1 + lasting * total))
    return scale, steady, Lasting(s.track, precision, total, theta)


def _assess(
    s: Stack,
    normal: Floats,
    columns: Floats,
    weight: Floats,
    residual: Floats,
    scale: float,
    steady: float,
    lasting: Lasting,
    tau: float,
    terms: Floats,
) -> Fit:
    influence_row = np.linalg.inv(normal)[TERMS]
    inner = lasting.steady(residual)
    influence = weight * inner * (columns @ influence_row)
    variances = [influence_row[TERMS]]
    for group in (s.cell, s.track, s.frame):
        sums = np.bincount(group, influence)
        count = max(int((np.bincount(group) > 0).sum()), 2)
        variances.append(float((sums**2).sum()) * count / (count - 1))
    projection = np.linalg.solve(normal[:TERMS, :TERMS], normal[:TERMS, TERMS])
    own = columns[:, TERMS] - columns[:, :TERMS] @ projection
    total = max(float(weight.sum()), 1e-12)
    signal = float((weight * own**2).sum())
    noise = float((weight * s.speed_variance).sum())
    moves = np.abs(own) > 3 * np.sqrt(s.speed_variance)
    motion = np.sqrt(max(signal - noise, 0.0) / total)
    share = min(noise / max(signal, 1e-12), 1.0)
    diluted = tau
    if share < DILUTED:
        tau += share / (1 - share) * (tau - float(s.lag[-1]))
    step = tau - s.lag
    plain = step * (s.plain[:, 0] + step * s.plain[:, 1])
    between = abs(float((weight * own * (s.moved(tau) - plain)).sum())) / max(signal, 1e-12)
    sharp, even = (float((s.path[:, power] ** 2).sum()) for power in (1, 0))
    curved = sharp / max(4 * even, 1e-12)
    apart = abs(tau - round(tau))
    between = float(np.hypot(between, tau - diluted))
    between = max(between, 4 * apart * (1 - apart) * ANYWHERE * min(curved, 1.0) ** 2)
    bias = lasting.mean(residual) * (1 - (1 - lasting.theta) ** 2)
    return Fit(
        tau=tau,
        sigma=float(np.sqrt(max(variances))) * _students(int(s.frame[-1])),
        motion_px=float(motion),
        noise_share=share,
        across_px=float(np.sqrt((weight * s.path[:, 0] ** 2).sum() / total)),
        along_px=float(np.sqrt((weight * s.along**2).sum() / total)),
        moving=len(np.unique(s.track[moves])),
        regions=len(np.unique(s.cell[moves])),
        matches=len(s.u),
        scale_px=scale,
        steady_px=steady,
        between=between,
        terms=terms,
        track_ids=s.ids,
        track_bias=bias,
    )


def _students(freedom: int) -> float:
    """By how much two standard errors fall short of 95 % with few windows: Student's t over the normal's, nearly."""
    few = max(freedom, 1)
    return 1 + 1.3 / few + 2 / few**3


def learn(memory: Memory, block: Block, fit: Fit) -> None:
    """Adds a block to the memory, its own offset eliminated, each track counting once over its life."""
    step = fit.tau - block.lag
    geometry = design(block.u, block.v, (block.dx - step * block.along) / block.width) * block.width
    powers = step ** np.arange(1, 5)
    target = block.dy - block.path @ powers
    motion = block.path @ (np.arange(1, 5) * powers / step) if step else block.path[:, 0]
    residual = target - geometry @ fit.terms
    spread = np.hypot(fit.scale_px, MOTION_SHARE * block.pace)
    weight = 1 / (spread**2 * (1 + (residual / (CAUCHY * spread)) ** 2) * block.age)
    weighted = geometry * weight[:, None]
    across = weighted.T @ motion
    alone = float((weight * motion**2).sum()) + 1e-9
    information = weighted.T @ geometry - np.outer(across, across) / alone
    vector = weighted.T @ target - across * float((weight * motion * target).sum()) / alone
    memory.learn(information, vector)


def profile(block: Block, fit: Fit, taus: Floats) -> Floats:
    """Robust cost of a block at each offset in `taus`, geometry given: where is the least, whatever lies between?"""
    place = np.minimum(np.searchsorted(fit.track_ids, block.ids), len(fit.track_ids) - 1)
    known = fit.track_ids[place] == block.ids
    bias = np.where(known, fit.track_bias[place], 0)
    still = np.where(known, fit.steady_px, fit.scale_px)[:, None]
    step = taus - block.lag
    geometry = design(block.u, block.v, block.dx / block.width) * block.width
    nearer = block.along * (fit.terms[DISPARITY] + fit.terms[AHEAD] * block.v)
    rest = (block.dy - geometry @ fit.terms - bias)[:, None] + np.outer(nearer, step)
    rest -= block.path @ (step ** np.arange(1, 5)[:, None])
    between = np.outer(CURVED * block.path[:, 1], np.abs(step) * np.abs(1 - np.abs(step)))
    spread = np.sqrt(still**2 + (MOTION_SHARE * block.pace)[:, None] ** 2 + between**2)
    return np.asarray((np.log1p((rest / (CAUCHY * spread)) ** 2) + np.log(spread / still)).sum(axis=0))


def halves(blocks: Sequence[Block], memory: Memory, fit: Fit) -> dict[str, float]:
    """The offset by halves of the points, with random errors: a true one is common to all, leaked geometry is not."""
    s = Stack(blocks)
    speed, pace = s.speed(fit.tau), np.abs(s.speed(fit.tau))
    moving = pace > np.sqrt(s.speed_variance)
    middle = median(pace[moving]) if moving.any() else 0.0
    parts = {
        "odd": s.track % 2 == 1, "even": s.track % 2 == 0, "up": moving & (speed < 0), "down": moving & (speed > 0),
        "slow": pace <= middle, "fast": pace > middle, "near": s.dx < np.median(s.dx), "far": s.dx >= np.median(s.dx),
    }  # fmt: skip
    result: dict[str, float] = {}
    edges = np.cumsum([0, *(len(b.u) for b in blocks)])
    for name, part in parts.items():
        some = [block.only(part[a:b]) for block, a, b in zip(blocks, edges[:-1], edges[1:], strict=True)]
        some = [block for block in some if len(block.u)]
        if sum(len(block.u) for block in some) < 4 * TERMS:
            continue
        other = solve(some, memory, fit.tau, fit.terms)
        result[f"{name}_frames"], result[f"{name}_sigma_frames"] = other.tau, other.sigma
    return result
