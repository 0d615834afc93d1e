"""The fixed geometry of a rig, as it shows in displacements across the rows, and what is remembered of it."""

from __future__ import annotations

import numpy as np

from pipeline.detectors.offset.arrays import Floats

PRIOR = np.array([0.3, 0.05, 0.05, 0.04, 0.03, 0.03, 0.02, 0.02])
"""Standard deviations of the terms of `design` before anything is seen, for a focal length of one picture width.

1: pointing up or down, principal point, anything; u: roll, 3 degrees; v: focal lengths, 5 %; d: the baseline's
tilt, 4 %; u v: toe-in, v v: pitch, 2 degrees each; v d: one camera ahead of the other by 2 % of the baseline; v r^2:
different lens distortion. The term v d is the one that driving at constant speed imitates: at 10 m/s, 2 % of a baseline
of 12 cm is 0.2 ms.
"""

TERMS = len(PRIOR)
DISPARITY, AHEAD = 3, 6
"""The terms d and v d."""

MEMORY_WINDOWS = 900
"""Half a minute at 30 Hz: long against changes of speed, short against warming up of a rig."""


def design(u: Floats, v: Floats, d: Floats) -> Floats:
    """N x 8 terms of the displacement across the rows, for small rotations (Hartley and Zisserman 2004, 9.2).

    u, v: position from the centre; d: displacement along the rows; all in picture widths, as is the result.
    """
    return np.asarray(np.stack([np.ones_like(u), u, v, d, u * v, v * v, v * d, v * (u * u + v * v)], axis=1))


class Memory:
    """What past windows say of the terms: information (8 x 8) and information times terms (8), forgetting slowly.

    Each window is learned with its own offset eliminated, so time is never learned as geometry; what no window could
    tell from time stays as uncertain as the prior says.
    """

    def __init__(self, terms: Floats | None = None, information: Floats | None = None) -> None:
        """Starts from a calibration, or what was saved of a rig, if `terms` and their `information` are given."""
        self._prior = np.diag(PRIOR**-2) if information is None else information
        self._prior_vector: Floats = np.zeros(TERMS) if terms is None else self._prior @ terms
        self._information: Floats = np.zeros((TERMS, TERMS))
        self._vector: Floats = np.zeros(TERMS)
        self.windows = 0

    @property
    def information(self) -> Floats:
        return np.asarray(self._information + self._prior, np.float64)

    @property
    def vector(self) -> Floats:
        return np.asarray(self._vector + self._prior_vector, np.float64)

    @property
    def terms(self) -> Floats:
        """8: the best estimate."""
        return np.asarray(np.linalg.solve(self.information, self.vector), np.float64)

    def learn(self, information: Floats, vector: Floats) -> None:
        keep = 1 - 1 / MEMORY_WINDOWS
        self._information = keep * self._information + information
        self._vector = keep * self._vector + vector
        self.windows += 1

    def forget(self) -> None:
        """The rig was knocked, or another one stands in its place."""
        self._information = np.zeros_like(self._information)
        self._vector = np.zeros_like(self._vector)
        self.windows = 0
