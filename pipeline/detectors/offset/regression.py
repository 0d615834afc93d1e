"""Solves for a rig's geometry and the time between its cameras together, from a few windows of matches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.detectors.offset.arrays import Floats, Ints
from pipeline.detectors.offset.geometry import TERMS, Memory, design

CAUCHY = 2.385
"""Tuning of Cauchy's weights: 95 % efficient for normal errors (Holland and Welsch 1977)."""

ROUNDS = 4
SMALLEST_PX = 0.03
"""No residual scale below the precision of Lucas-Kanade on 8-bit pictures."""

MOTION_SHARE = 0.05
"""A point's error grows with its own motion, by blur, deformation and interpolation between frames."""

CELLS = 4
"""The picture is cut into 4 x 4 cells: points of one cell may share their errors."""


@dataclass(frozen=True, slots=True)
class Block:
    """The matches of one pairing of pictures: n points, in working pixels unless said otherwise.

    lag: whole frames between the paired pictures. u, v: positions in widths. dx, dy: displacements to the other
    picture. mx, my, ay: motion and acceleration across a frame. age: frames a point has been followed.
    """

    index: int
    lag: int
    width: float
    ids: Ints
    age: Ints
    u: Floats
    v: Floats
    dx: Floats
    dy: Floats
    mx: Floats
    my: Floats
    ay: Floats


@dataclass(frozen=True, slots=True)
class Fit:
    """tau and its standard error in frames; motion_px: how far points move a frame beyond noise and geometry.

    noise_share: part of the apparent motion that is tracking noise. moving: points that move beyond noise; regions:
    cells they are in. scale_px: robust residual. terms: the geometry (8).
    """

    tau: float
    sigma: float
    motion_px: float
    noise_share: float
    moving: int
    regions: int
    matches: int
    scale_px: float
    terms: Floats


class Stack:
    """The points of several blocks, one after the other."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        def join(name: str) -> Floats:
            return np.asarray(np.concatenate([getattr(b, name) for b in blocks]), np.float64)

        sizes = [len(b.u) for b in blocks]
        self.width = blocks[0].width
        self.u, self.v, self.dx, self.dy = join("u"), join("v"), join("dx"), join("dy")
        self.mx, self.my, self.ay, self.age = join("mx"), join("my"), join("ay"), join("age")
        self.lag = np.repeat([float(b.lag) for b in blocks], sizes)
        self.frame = np.repeat(np.arange(len(blocks)), sizes)
        self.track = np.unique(np.concatenate([b.ids for b in blocks]), return_inverse=True)[1]
        column = np.clip(((self.u + 0.5) * CELLS).astype(int), 0, CELLS - 1)
        row = np.clip(((self.v / max(2 * np.abs(self.v).max(), 1e-9) + 0.5) * CELLS).astype(int), 0, CELLS - 1)
        self.cell = row * CELLS + column

    def geometry(self, tau: float) -> Floats:
        """N x 8: pixels by which each term displaces each point, at equal times."""
        d = (self.dx - (tau - self.lag) * self.mx) / self.width
        return np.asarray(design(self.u, self.v, d) * self.width, np.float64)

    def residual(self, tau: float, geometry: Floats, terms: Floats) -> Floats:
        step = tau - self.lag
        return self.dy - geometry @ terms - step * self.my - step * step / 2 * self.ay


def solve(blocks: Sequence[Block], memory: Memory, tau: float, terms: Floats | None = None) -> Fit:
    """Gauss-Newton on geometry and offset with Cauchy weights; errors robust to clusters of points.

    The model is that of "dy = g(p, dx) + tau m + tau^2 / 2 a". The standard error is the largest that residuals
    grouped by cell, by track and by frame give (Liang and Zeger 1986), and not below the model's own.
    """
    s = Stack(blocks)
    terms = memory.terms if terms is None else terms
    speed = MOTION_SHARE * np.hypot(s.mx, s.my)
    geometry = s.geometry(tau)
    residual = s.residual(tau, geometry, terms)
    for _ in range(ROUNDS):
        scale = max(1.4826 * float(np.median(np.abs(residual))), SMALLEST_PX)
        spread = np.hypot(scale, speed)
        weight = 1 / (spread**2 * (1 + (residual / (CAUCHY * spread)) ** 2))
        step = tau - s.lag
        columns = np.column_stack([geometry, s.my + step * s.ay])
        weighted = columns * weight[:, None]
        normal = columns.T @ weighted
        normal[:TERMS, :TERMS] += memory.information
        gradient = weighted.T @ residual
        gradient[:TERMS] += memory.vector - memory.information @ terms
        normal[TERMS, TERMS] += 1e-9
        change = np.linalg.solve(normal, gradient)
        terms = terms + change[:TERMS]
        tau = float(tau + np.clip(change[TERMS], -0.5, 0.5))
        geometry = s.geometry(tau)
        residual = s.residual(tau, geometry, terms)
    return _assess(s, normal, columns, weight, residual, scale, tau, terms)


def _assess(
    s: Stack, normal: Floats, columns: Floats, weight: Floats, residual: Floats, scale: float, tau: float, terms: Floats
) -> Fit:
    influence_row = np.linalg.inv(normal)[TERMS]
    influence = weight * residual * (columns @ influence_row)
    variances = [influence_row[TERMS]]
    for group in (s.cell, s.track, s.frame):
        sums = np.bincount(group, influence)
        count = max(int((np.bincount(group) > 0).sum()), 2)
        variances.append(float((sums**2).sum()) * count / (count - 1))
    projection = np.linalg.solve(normal[:TERMS, :TERMS], normal[:TERMS, TERMS])
    own = columns[:, TERMS] - columns[:, :TERMS] @ projection
    noise = min(motion_noise(s), scale / np.sqrt(2))
    signal = float((weight * own**2).sum())
    share = min(float(weight.sum()) * noise**2 / max(signal, 1e-12), 1.0)
    moves = np.abs(own) > 3 * noise
    motion = np.sqrt(max(signal / max(float(weight.sum()), 1e-12) - noise**2, 0.0))
    tracks = len(np.unique(s.track[moves]))
    regions = len(np.unique(s.cell[moves]))
    sigma = float(np.sqrt(max(variances)))
    return Fit(tau, sigma, float(motion), share, tracks, regions, len(s.u), scale, terms)


def motion_noise(s: Stack) -> float:
    """Tracking noise of a central difference, px: half that of a second difference, smooth acceleration removed."""
    basis = np.column_stack([np.ones_like(s.u), s.u, s.v, s.dx / s.width])
    residual = s.ay - basis @ np.linalg.lstsq(basis, s.ay, rcond=None)[0]
    return max(1.4826 * float(np.median(np.abs(residual))) / 2, 0.01)


def learn(memory: Memory, block: Block, fit: Fit) -> None:
    """Adds a block to the memory, its own offset eliminated, each track counting once over its life."""
    s = Stack([block])
    geometry = s.geometry(fit.tau)
    residual = s.residual(fit.tau, geometry, fit.terms)
    spread = np.hypot(fit.scale_px, MOTION_SHARE * np.hypot(s.mx, s.my))
    weight = 1 / (spread**2 * (1 + (residual / (CAUCHY * spread)) ** 2) * s.age)
    motion = s.my + (fit.tau - s.lag) * s.ay
    target = s.dy - (fit.tau - s.lag) * s.my - (fit.tau - s.lag) ** 2 / 2 * s.ay
    weighted = geometry * weight[:, None]
    across = weighted.T @ motion
    alone = float((weight * motion**2).sum()) + 1e-9
    information = weighted.T @ geometry - np.outer(across, across) / alone
    vector = weighted.T @ target - across * float((weight * motion * target).sum()) / alone
    memory.learn(information, vector)


def profile(blocks: Sequence[Block], terms: Floats, taus: Floats, scale: float) -> Floats:
    """Robust cost of each offset in `taus`, the geometry given: where is the least, whatever lies between?"""
    s = Stack(blocks)
    spread = np.hypot(scale, MOTION_SHARE * np.hypot(s.mx, s.my))
    costs = [
        float(np.log1p((s.residual(tau, s.geometry(tau), terms) / (CAUCHY * spread)) ** 2).sum())
        for tau in taus.tolist()
    ]
    return np.array(costs)
