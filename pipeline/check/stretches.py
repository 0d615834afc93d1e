"""Which parts of a long recording are looked at, and in which order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

STRETCH_FRAMES = 240
"""Frames of a stretch: time to warm up, and to see every cause there is."""

SPREAD = 12
"""Stretches spread over a recording."""

WORTH_IT = 8
"""Recordings shorter than so many stretches are judged whole: sampling would save little."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of a recording, in seconds from its start."""

    from_s: float
    to_s: float

    def overlaps(self, other: Stretch) -> bool:
        return self.from_s < other.to_s and other.from_s < self.to_s


def is_short(frames: int) -> bool:
    """Whether so many frames are better judged one and all."""
    return frames < WORTH_IT * STRETCH_FRAMES


def stretches(duration_s: float, fps: float, suspects_s: Sequence[float]) -> list[Stretch]:
    """The stretches to look at: where stamps are suspect, then start, end, middle, and between these."""
    length_s = STRETCH_FRAMES / fps
    latest_s = max(duration_s - length_s, 0.0)
    wanted = [min(max(at_s - length_s / 4, 0.0), latest_s) for at_s in suspects_s]
    wanted += [latest_s * share for share in _bisected(SPREAD)]
    chosen: list[Stretch] = []
    for from_s in wanted:
        stretch = Stretch(from_s, from_s + length_s)
        if not any(stretch.overlaps(other) for other in chosen):
            chosen.append(stretch)
    return chosen


def _bisected(count: int) -> list[float]:
    """0, 1, 1/2, 1/4, 3/4, 1/8 ..., `count` of them: each further place halves what is between."""
    places = [0.0, 1.0]
    parts = 2
    while len(places) < count:
        places += [odd / parts for odd in range(1, parts, 2)]
        parts *= 2
    return places[:count]
