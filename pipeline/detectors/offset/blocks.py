"""The matches of one pairing of pictures, and several of them stacked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from pipeline.detectors.offset.arrays import Floats, Ints, Mask
from pipeline.detectors.offset.geometry import design
from pipeline.detectors.offset.matching import Matches
from pipeline.detectors.offset.motion import glance, measure
from pipeline.detectors.offset.tracks import Tracks

MOTION_SHARE = 0.01
"""A point's error is at least so much of its own motion: patches are blurred and deform on the way."""

CURVED = 1.0
"""Share of what a parabola departs from a straight line, between frames, that is doubted: all of it."""

CELLS = 4
"""The picture is cut into 4 x 4 cells: points of one cell may share their errors."""


@dataclass(frozen=True, slots=True)
class Block:
    """The matches of one pairing of pictures: n points, in working pixels unless said otherwise.

    index: slot of the first camera's picture. lag: whole frames between the paired pictures. u, v: positions in widths.
    dx, dy: displacements to the other picture. path: n x 4, the polynomial of a point's way across the rows in frames.
    along: its speed along the rows. speed_variance: squared standard errors of the speed across the rows. cut_px: how
    far points jumped, if they did, in a cut or a gap, about which nothing is known between the two frames. age: frames
    a point has been followed.
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
    path: Floats
    plain: Floats
    along: Floats
    speed_variance: Floats
    cut_px: float

    @property
    def pace(self) -> Floats:
        """N: px a frame."""
        return np.asarray(np.hypot(self.along, self.path[:, 0]), np.float64)

    def only(self, chosen: Mask) -> Block:
        """The block with some of its points."""
        kept = {
            f.name: getattr(self, f.name)[chosen] for f in fields(self) if isinstance(getattr(self, f.name), np.ndarray)
        }
        return replace(self, **kept)


def block_of(
    lag: int,
    size: tuple[int, int],
    matches: Matches,
    all_tracks: Mapping[int, Tracks],
    here: int,
    *,
    known: bool,
) -> Block:
    width, height = size
    tracks = all_tracks[here]
    rows = matches.rows
    u, v = ((tracks.at[rows].astype(np.float64) - [width / 2, height / 2]) / width).T
    dx, dy = matches.displacement.astype(np.float64).T
    basis = np.column_stack([np.ones_like(u), u, v, dx / width, v * dx / width])
    if known:
        motion = measure(tracks, rows, all_tracks.get(here - 1), all_tracks.get(here + 1), basis)
    else:
        motion = glance(tracks, rows)
    plain = np.column_stack([motion.inner[:, 1] - motion.inner[:, 0], motion.inner.sum(axis=1)]) / 2
    return Block(
        here, lag, float(width), tracks.ids[rows], tracks.age[rows], u, v, dx, dy,
        motion.path, plain, motion.along, motion.speed_variance, motion.cut_px,
    )  # fmt: skip


class Stack:
    """The points of several blocks, one after the other."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        def join(name: str) -> Floats:
            return np.asarray(np.concatenate([getattr(b, name) for b in blocks]), np.float64)

        sizes = [len(b.u) for b in blocks]
        self.width = blocks[0].width
        self.u, self.v, self.dx, self.dy = join("u"), join("v"), join("dx"), join("dy")
        self.path, self.plain, self.along, self.age = join("path"), join("plain"), join("along"), join("age")
        self.speed_variance = join("speed_variance") + (MOTION_SHARE * np.hypot(join("along"), join("path")[:, 0])) ** 2
        self.lag = np.repeat([float(b.lag) for b in blocks], sizes)
        self.frame = np.repeat(np.arange(len(blocks)), sizes)
        self.ids, self.track = np.unique(np.concatenate([b.ids for b in blocks]), return_inverse=True)
        column = np.clip(((self.u + 0.5) * CELLS).astype(int), 0, CELLS - 1)
        row = np.clip(((self.v / max(2 * np.abs(self.v).max(), 1e-9) + 0.5) * CELLS).astype(int), 0, CELLS - 1)
        self.cell = row * CELLS + column
        self.cut = np.repeat([b.cut_px for b in blocks], sizes)
        self.pace = np.hypot(self.along, self.path[:, 0])
        self.share = MOTION_SHARE

    def error(self, tau: float, anywhere: bool = False) -> Floats:
        """N: px by which points may be off for moving: blurred, and between frames not exactly where curves say.

        anywhere: as if midway between two frames, whatever tau, so that no weight draws it to a whole frame.
        """
        s = np.abs(tau - self.lag)
        between = 0.25 if anywhere else s * np.abs(1 - s)
        doubt = CURVED * between * np.abs(self.path[:, 1]) + self.cut * anywhere
        return np.asarray(np.hypot(self.share * self.pace, doubt))

    def geometry(self, tau: float) -> Floats:
        """N x 8: pixels by which each term displaces each point, at equal times."""
        d = (self.dx - (tau - self.lag) * self.along) / self.width
        return np.asarray(design(self.u, self.v, d) * self.width, np.float64)

    def moved(self, tau: float) -> Floats:
        """N: px across the rows that points move from the paired picture's moment to tau."""
        s = tau - self.lag
        return np.asarray(s * (self.path[:, 0] + s * (self.path[:, 1] + s * (self.path[:, 2] + s * self.path[:, 3]))))

    def speed(self, tau: float) -> Floats:
        s = tau - self.lag
        return np.asarray(
            self.path[:, 0] + s * (2 * self.path[:, 1] + s * (3 * self.path[:, 2] + s * 4 * self.path[:, 3]))
        )

    def residual(self, tau: float, geometry: Floats, terms: Floats) -> Floats:
        return self.dy - geometry @ terms - self.moved(tau)
