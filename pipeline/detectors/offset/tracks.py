"""Follows corners through the pictures of one camera."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.detectors.offset.arrays import Floats32, Ints, Mask, Points
from pipeline.detectors.offset.working import Working
from pipeline.frame import Picture

WINDOW_PX = 13
"""Side of the patch that is followed: large enough to hold a corner of a VGA picture, small beside objects."""

LEVELS = 3
"""Pyramid levels above the first: guesses may be off by about 2^3 * WINDOW_PX / 2 = 50 px."""

CALM_PX, CALM_LEVELS = 8.0, 1
"""Where most of the picture moves less than that in a frame, a guess from its flow is off by a part of it only."""

STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 8, 0.01)
"""A hundredth of a pixel is the best that 8-bit pictures give; most points are there after five rounds."""

RETURN_PX = 0.3
"""How far a point may land from where it started when followed forth and back: three times a good track's noise."""

RENEW_FRAMES = 6
"""New corners are sought at least this often, so that what enters or starts to move is seen within a step's delay."""


@dataclass(frozen=True, slots=True)
class Tracks:
    """Points of one camera at t, with where they were at t-1 and where they are at t+1.

    ids, age: n; a point keeps its id while it is followed; age counts the frames since it was found.
    before, at, after: n x 2, working pixels.
    """

    index: int
    ids: Ints
    age: Ints
    before: Points
    at: Points
    after: Points

    @property
    def motion(self) -> Points:
        """N x 2: pixels per frame at t, by central difference."""
        return np.asarray((self.after - self.before) / 2, np.float32)

    @property
    def acceleration(self) -> Points:
        """N x 2: pixels per frame squared at t, by second difference."""
        return np.asarray(self.after - 2 * self.at + self.before, np.float32)


@dataclass(frozen=True, slots=True)
class Flow:
    """Rough motion from one picture to the next: h x w x 2, working pixels, each cell `step_px` working pixels wide."""

    field: Floats32
    step_px: float

    def at(self, points: Points) -> Points:
        """N x 2: motion at n points, of the nearest cell."""
        height, width = self.field.shape[:2]
        column, row = (points / self.step_px).astype(int).T
        return np.asarray(self.field[row.clip(0, height - 1), column.clip(0, width - 1)], np.float32)


class Tracker:
    """Pyramidal Lucas-Kanade tracks, each step checked forth and back (Bouguet 2000; Kalal et al. 2010)."""

    def __init__(self, points: int) -> None:
        self._target = points
        self._next_id = 0
        self._last: Tracks | None = None
        self._renewed = -RENEW_FRAMES

    def step(self, index: int, before: Working, now: Working, after: Working, back: Flow, forth: Flow) -> Tracks:
        ids, age, was, at = self._carried(index, now)
        if len(ids) < 0.7 * self._target or index - self._renewed >= RENEW_FRAMES or index < self._renewed:
            self._renewed = index
            fresh = corners(now.image, before.image, at, self._target - len(ids))
            origin, found = follow(now.image, before.image, fresh, fresh - back.at(fresh))
            fresh, origin = fresh[found], origin[found]
            ids = np.concatenate([ids, self._next_id + np.arange(len(fresh))])
            self._next_id += len(fresh)
            age = np.concatenate([age, np.ones(len(fresh), np.int64)])
            was, at = np.concatenate([was, origin]), np.concatenate([at, fresh])
        then, found = ahead(now.image, after.image, at, forth)
        self._last = Tracks(index, ids[found], age[found], was[found], at[found], then[found])
        return self._last

    def _carried(self, index: int, now: Working) -> tuple[Ints, Ints, Points, Points]:
        """Ids, ages, positions at t-1 and t of the points that are followed already and do not crowd."""
        last = self._last
        if last is None or last.index != index - 1:
            none, nowhere = np.empty(0, np.int64), np.empty((0, 2), np.float32)
            return none, none, nowhere, nowhere
        keep = uncrowded(last.after, spacing(now.image, self._target) / 2)
        return last.ids[keep], last.age[keep] + 1, last.at[keep], last.after[keep]


def follow(source: Picture, target: Picture, points: Points, guess: Points) -> tuple[Points, Mask]:
    """Where n x 2 points of `source` are in `target`, and which of them came back to where they started."""
    if len(points) == 0:
        return points, np.empty(0, np.bool_)
    there, found = _flow(source, target, points, guess, LEVELS)
    back, returned = _flow(target, source, there, points, 0)
    return there, found & returned & _inside(there, target) & (np.abs(back - points).max(axis=1) < RETURN_PX)


def ahead(source: Picture, target: Picture, points: Points, flow: Flow) -> tuple[Points, Mask]:
    """As `follow`, from a guess by the flow, but without the way back.

    What goes wrong shows in the other camera's view and in the residuals.
    """
    if len(points) == 0:
        return points, np.empty(0, np.bool_)
    motion = flow.at(points)
    levels = CALM_LEVELS if np.abs(motion).max(axis=1).mean() < CALM_PX else LEVELS
    there, found = _flow(source, target, points, points + motion, levels)
    return there, found & _inside(there, target)


def _inside(points: Points, picture: Picture) -> Mask:
    height, width = picture.shape[:2]
    return np.asarray((points >= 1).all(axis=1) & (points[:, 0] < width - 1) & (points[:, 1] < height - 1), np.bool_)


def _flow(source: Picture, target: Picture, points: Points, guess: Points, levels: int) -> tuple[Points, Mask]:
    there, status, _ = cv2.calcOpticalFlowPyrLK(
        source,
        target,
        np.ascontiguousarray(points).reshape(-1, 1, 2),
        np.ascontiguousarray(guess, np.float32).reshape(-1, 1, 2).copy(),
        winSize=(WINDOW_PX, WINDOW_PX),
        maxLevel=levels,
        criteria=STOP,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(there, np.float32).reshape(-1, 2), np.asarray(status, np.bool_).ravel()


def spacing(image: Picture, count: int) -> float:
    """Side in px of the square cell that each of `count` points may have for itself."""
    return float(np.sqrt(image.shape[0] * image.shape[1] / max(count, 1)))


def uncrowded(points: Points, cell_px: float) -> Mask:
    """One point, the longest followed, in every cell."""
    cells = np.floor(points / max(cell_px, 1.0)).astype(np.int64) @ np.array([1, 100_000])
    keep = np.zeros(len(points), np.bool_)
    keep[np.unique(cells, return_index=True)[1]] = True
    return keep


MOVING_LEVELS = 6.0
"""Grey levels by which a blurred picture changes where something textured moves by a pixel; codec noise is below."""

FLAT = 1e-4
"""Smallest eigenvalue (OpenCV's units, block of 3 at half size) of a patch that can be located: noise of 2 levels."""


def corners(image: Picture, earlier: Picture, taken: Points, count: int) -> Points:
    """At most `count` new corners, the best of each grid cell that holds none, preferring where something moves.

    Looked for in the picture at half its size. Score: the smaller eigenvalue of the gradient matrix (Shi and Tomasi
    1994), times one plus the change since `earlier` in units of MOVING_LEVELS. The common change of brightness does not
    count.
    """
    if count <= 0 or min(image.shape[:2]) < 4 * WINDOW_PX:
        return np.empty((0, 2), np.float32)
    size = (image.shape[1] // 2, image.shape[0] // 2)
    score = cv2.cornerMinEigenVal(cv2.resize(image, size, interpolation=cv2.INTER_AREA), 3)
    if earlier.shape == image.shape:
        small = (image.shape[1] // 4, image.shape[0] // 4)
        change = cv2.resize(image, small, interpolation=cv2.INTER_AREA).astype(np.float32)
        change -= cv2.resize(earlier, small, interpolation=cv2.INTER_AREA).astype(np.float32)
        change = np.minimum(np.abs(change - np.median(change)) / MOVING_LEVELS, 3.0) ** 2
        lively = cv2.resize(1 + change, size, interpolation=cv2.INTER_LINEAR)
    else:
        lively = np.ones_like(score)
    cell = max(4, int(spacing(image, 2 * (count + len(taken)))) // 2)
    border = WINDOW_PX // 4
    rows, columns = (size[1] - 2 * border) // cell, (size[0] - 2 * border) // cell
    area = slice(border, border + rows * cell), slice(border, border + columns * cell)
    usable = np.where(score[area] > FLAT, score[area] * lively[area], 0)
    cells = usable.reshape(rows, cell, columns, cell).swapaxes(1, 2).reshape(rows * columns, cell * cell)
    best = cells.argmax(axis=1)
    value = cells[np.arange(len(cells)), best]
    if len(taken):
        column, row = ((taken / 2 - border) // cell).astype(int).T
        within = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        value[row[within] * columns + column[within]] = 0
    chosen = np.argsort(-value)[:count]
    chosen = chosen[value[chosen] > 0]
    y = chosen // columns * cell + best[chosen] // cell
    x = chosen % columns * cell + best[chosen] % cell
    return np.stack([2 * (x + border) + 0.5, 2 * (y + border) + 0.5], axis=1).astype(np.float32)
