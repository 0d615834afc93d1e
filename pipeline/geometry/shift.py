"""Notices that one camera of a pair looks elsewhere than it did: knocked at once, or creeping."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.detectors.offset.arrays import Floats
from pipeline.geometry.look import LEAST_POINTS, Look

LEARNING = 8
"""Looks by which the rig's own geometry is learned: four seconds."""

LASTING = 4
"""Looks in a row that must agree on a shift, or on its end: two seconds."""

LEAST_PX = 0.75
"""Shift in the pictures compared, 640 px wide, below which nothing is said: corners are matched to a tenth of a pixel,
but what depth and lenses add differs from scene to scene. A roll of 0.14 degrees shifts the edges by as much."""

TURNS, SLOPE_DOWN = [0, 1, 3], 2
"""Terms that a rotation changes, and the one that it does not: that is where scenes unlike those learned show."""

ALIKE, STRANGE_SIGMAS = 0.3, 3.0
"""Share of the largest other term, or standard errors, that the slope down may come to."""

SURE_SIGMAS = 6.0
"""Usual deviations of a look by which a shift must stand out: looks are taken twice a second, for days."""

REMEMBERED = 32
MEDIAN_CHANGE = 0.954
"""Looks whose changes from one to the next tell how far a look is usually off, whatever the scene does to it; a knock
is one change. The median of |a - b| is 0.954 standard deviations of a and of b."""

BEYOND = 0.2
"""How far, in ranges of the disparities learned from, others may lie: what they do to displacements was not learned."""

OVER = 0.67
"""Share of the least shift below which it has gone: hysteresis."""

HUBER = 1.5


@dataclass(frozen=True, slots=True)
class Shift:
    """How the second camera's picture is shifted against what was learned.

    shift_px: the most at any edge, in recorded pixels, across the direction of the baseline. roll_deg: of the camera
    about its viewing axis, clockwise positive.
    """

    shift_px: float
    roll_deg: float


class _Field(NamedTuple):
    """4 each: constant, slope across, slope down and product of a field of displacements, px at the edge; errors."""

    terms: Floats
    errors: Floats


class ShiftWatch:
    """Compares the vertical displacement of points with what was learned from the first looks.

    What a small rotation of one camera does to it is a constant (pitch), a slope across (roll) and a product of both
    places (yaw); focal lengths add a slope down (Hartley and Zisserman 2004, 8.4.2, for small angles). How the rest
    depends on depth is learned with it. The reference is kept, so that a creep adds up to a shift.
    """

    def __init__(self) -> None:
        self._learning: list[Look] = []
        self._reference: Floats | None = None
        self._depths = (0.0, 0.0)
        self._recent: deque[_Field] = deque(maxlen=LASTING)
        self._changes: deque[Floats] = deque(maxlen=REMEMBERED)
        self.shifted: Shift | None = None

    def see(self, look: Look) -> None:
        """Takes the next look; `shifted` says what holds then."""
        if self._reference is None:
            self._learn(look)
            return
        seen = self._field(look)
        if seen is None:
            return
        if self._recent:
            self._changes.append(np.abs(seen.terms - self._recent[-1].terms))
        self._recent.append(seen)
        if len(self._recent) == LASTING:
            self._judge(look)

    def _judge(self, look: Look) -> None:
        usual = np.median(np.array(self._changes), axis=0) / MEDIAN_CHANGE
        terms, errors = (np.array([getattr(one, name) for one in self._recent]) for name in ("terms", "errors"))
        limits = np.maximum(LEAST_PX, SURE_SIGMAS * np.maximum(usual, errors))
        middle = np.median(terms, axis=0)
        over = (np.abs(terms) > limits).all(axis=0) & (np.sign(terms) == np.sign(middle)).all(axis=0)
        if over[TURNS].any() and self._is_a_turn(middle, errors.max(axis=0)):
            self.shifted = _shift(middle, look)
        elif (np.abs(terms) < OVER * LEAST_PX)[:, TURNS].all():
            self.shifted = None

    @staticmethod
    def _is_a_turn(terms: Floats, errors: Floats) -> bool:
        """Whether it looks like a rotation: no camera that is knocked sees things taller than before."""
        most = float(np.abs(terms[TURNS]).max())
        return bool(abs(terms[SLOPE_DOWN]) <= max(ALIKE * most, STRANGE_SIGMAS * errors[SLOPE_DOWN]))

    def _learn(self, look: Look) -> None:
        self._learning.append(look)
        if len(self._learning) < LEARNING:
            return
        u, v, d, dy = (np.concatenate(parts) for parts in zip(*map(_values, self._learning), strict=True))
        self._reference = _fit(_reference_design(u, v, d), dy)[0]
        low, high = np.percentile(d, [2, 98])
        self._depths = (float(low - BEYOND * (high - low)), float(high + BEYOND * (high - low)))
        for one in self._learning:
            seen = self._field(one)
            if seen is not None:
                self._recent.append(seen)
                self._changes.extend([np.abs(seen.terms - self._recent[-2].terms)] if len(self._recent) > 1 else [])
        self._learning.clear()

    def _field(self, look: Look) -> _Field | None:
        """What displacements are off; None where too few points lie at depths that were learned."""
        assert self._reference is not None
        u, v, d, dy = _values(look)
        near = (d >= self._depths[0]) & (d <= self._depths[1])
        if near.sum() < LEAST_POINTS:
            return None
        off = dy[near] - _reference_design(u[near], v[near], d[near]) @ self._reference
        return _Field(*_fit(_field_design(u[near], v[near]), off))


def _values(look: Look) -> tuple[Floats, Floats, Floats, Floats]:
    return look.u, look.v, look.dx / look.half_px, look.dy


def _field_design(u: Floats, v: Floats) -> Floats:
    return np.stack([np.ones_like(u), u, v, u * v], axis=1)


def _reference_design(u: Floats, v: Floats, d: Floats) -> Floats:
    """The same, curvature, and what depends on disparity d, in half widths."""
    return np.stack([np.ones_like(u), u, v, u * v, u * u, v * v, d, d * v], axis=1)


def _fit(design: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Robust least squares: terms and their standard errors (Huber weights, a little ridge)."""
    weight: Floats = np.ones_like(values)
    ridge: Floats = 1e-3 * np.eye(design.shape[1]) * len(values)
    normal: Floats = ridge
    terms: Floats = np.zeros(design.shape[1])
    scale = 0.0
    for _ in range(4):
        normal = design.T @ (design * weight[:, None]) + ridge
        terms = np.asarray(np.linalg.solve(normal, design.T @ (weight * values)), np.float64)
        off: Floats = np.abs(values - design @ terms)
        scale = max(1.4826 * float(np.median(off)), 0.05)
        weight = np.minimum(1.0, HUBER * scale / np.maximum(off, 1e-9))
    return terms, scale * np.sqrt(np.diag(np.linalg.inv(normal)))


def _shift(field: Floats, look: Look) -> Shift:
    edges = np.array([(1.0, u, v, u * v) for u in (-1.0, 0.0, 1.0) for v in (-0.75, 0.0, 0.75)])
    return Shift(
        shift_px=float(np.abs(edges @ field).max()) * look.scale, roll_deg=-math.degrees(field[1] / look.half_px)
    )
