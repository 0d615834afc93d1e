"""Keeps the frames of the few moments at which a pair was furthest apart, as the run goes on."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.frame import Frame, Pair, Picture
from pipeline.pictures import grey, reduced
from pipeline.steady import Steady
from pipeline.verdict import State, Verdict

WIDTH_PX = 640
"""Width of the pictures that are kept: as wide as a column of the page."""

REMEMBERED = 16
"""Frames of a camera that are remembered: a verdict comes a few frames after its own, while windows wait."""

MOST_MOMENTS = 3

COARSE_WIDTH_PX = 160
"""Width at which pictures are compared to see how much moves: noise averages out, motion remains."""

WITHOUT_OFFSET = 1e6
"""Rank of a moment at which a camera is frozen, which no offset describes: before all others."""


class Kept(NamedTuple):
    """A frame as it is kept: reduced to WIDTH_PX, with what its device said of it.

    coarse: grey, reduced to COARSE_WIDTH_PX. change: its mean difference to that of the
    frame before, in levels, without what all of the picture became brighter.
    """

    captured_ns: int
    sequence: int | None
    image: Picture
    coarse: Picture
    change: float


@dataclass(frozen=True, slots=True)
class Moment:
    """Two frames that were delivered together.

    at_s: seconds into the recording. rank: how much the second picture changed during the offset, about, in levels.
    before, after: the second camera's neighbouring frames.
    """

    at_s: float
    verdict: Verdict
    rank: float
    first: Picture
    second: Picture
    before: Picture | None
    after: Picture | None


class Recent:
    """The last frames of every camera."""

    def __init__(self) -> None:
        self._frames: dict[str, deque[Kept]] = {}

    def add(self, frame: Frame) -> None:
        frames = self._frames.setdefault(frame.camera, deque(maxlen=REMEMBERED))
        image = reduced(frame.image, WIDTH_PX)
        coarse = reduced(grey(image), COARSE_WIDTH_PX)
        change = 0.0
        if frames and frames[-1].coarse.shape == coarse.shape:
            step = coarse.astype(np.float32) - frames[-1].coarse
            change = float(np.abs(step - np.median(step)).mean())
        frames.append(Kept(frame.captured_ns, frame.sequence, image, coarse, change))

    def change(self, verdict: Verdict, camera: str) -> float:
        """How much the camera's picture changed with the frame a verdict is about, in levels."""
        _, at, _ = self._around(verdict, camera)
        return 0.0 if at is None else at.change

    def moment(self, verdict: Verdict, pair: Pair, at_s: float, rank: float) -> Moment | None:
        """The frames a verdict is about; None where one is missing or too old."""
        _, first, _ = self._around(verdict, pair.first)
        before, second, after = self._around(verdict, pair.second)
        if first is None or second is None:
            return None
        return Moment(at_s, verdict, rank, first.image, second.image, before and before.image, after and after.image)

    def _around(self, verdict: Verdict, camera: str) -> tuple[Kept | None, Kept | None, Kept | None]:
        """The camera's frame with those before and after it."""
        frames = list(self._frames.get(camera, ()))
        said = verdict.captured_ns.get(camera), verdict.sequence.get(camera)
        at = next((n for n, kept in enumerate(frames) if (kept.captured_ns, kept.sequence) == said), None)
        if at is None:
            return None, None, None
        before = frames[at - 1] if at > 0 else None
        return before, frames[at], frames[at + 1] if at + 1 < len(frames) else None


class Moments:
    """The worst moment of each stretch out of sync, of the worst MOST_MOMENTS stretches of one pair.

    Where nothing was out of sync to stay, the moment with most motion stands for the recording.
    """

    def __init__(self, pair: Pair, period_ns: int) -> None:
        self._pair = pair
        self._expected_frames = pair.expected_offset_ns / period_ns
        self._steady = Steady()
        self._worst: list[Moment] = []
        self._of_stretch: Moment | None = None
        self._example: Moment | None = None

    def add(self, verdict: Verdict, at_s: float, recent: Recent) -> None:
        if self._steady.add(verdict) is not None:
            self._close()
        change = recent.change(verdict, self._pair.second)
        if self._steady.state is State.ASYNC and verdict.state is State.ASYNC:
            self._of_stretch = self._worse(self._of_stretch, verdict, at_s, recent, self._rank(verdict, at_s, change))
        elif not self._worst and self._of_stretch is None:
            self._example = self._worse(self._example, verdict, at_s, recent, change)

    def worst(self) -> list[Moment]:
        """In order of time."""
        self._close()
        if self._worst:
            return sorted(self._worst, key=lambda moment: moment.at_s)
        return [self._example] if self._example is not None else []

    def _worse(self, known: Moment | None, verdict: Verdict, at_s: float, recent: Recent, rank: float) -> Moment | None:
        if known is not None and rank <= known.rank:
            return known
        return recent.moment(verdict, self._pair, at_s, rank) or known

    def _rank(self, verdict: Verdict, at_s: float, change: float) -> float:
        """A frozen camera is furthest off at the end."""
        if verdict.offset_frames is None:
            return WITHOUT_OFFSET + at_s
        return abs(verdict.offset_frames - self._expected_frames) * change

    def _close(self) -> None:
        if self._of_stretch is not None:
            self._worst = sorted([*self._worst, self._of_stretch], key=lambda moment: -moment.rank)[:MOST_MOMENTS]
        self._of_stretch = None
