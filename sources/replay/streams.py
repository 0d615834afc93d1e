"""What every recording format is read into: streams of entries, one a camera, whose pictures are not loaded yet."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, TypeAlias

import numpy.typing as npt

from pipeline.frame import NS_PER_S, StampOrigin, StampReference, Truth
from sources.replay.notices import Notices
from sources.replay.settings import ReplaySettings

Raw: TypeAlias = npt.NDArray[Any]
"""A picture as its decoder returns it: any depth, any number of channels."""

DEFAULT_FPS = 30.0
SAME_FPS = 0.01
"""Containers write 29.97 as 30: rates closer than this, as a share of the smaller, are the same."""

SAME_EPOCH_NS = 2 * NS_PER_S
"""Cameras whose timestamps lie further apart than this, end to start, do not share a clock."""


@dataclass(frozen=True, slots=True)
class Told:
    """What a recording of our own tells of a frame besides, as `Frame` has it."""

    clock: str | None = None
    epoch: int = 0
    stamp_reference: StampReference = StampReference.UNKNOWN
    stamp_origin: StampOrigin | None = None
    truth: Truth | None = None


@dataclass(frozen=True, slots=True)
class Entry:
    """One frame of a stream. `load` reads its picture, at most once and before the next entry is asked for.

    arrived_ns: when it was recorded, where that is known. exposure_ns: its exposure, likewise.
    at_ns: where it stands in the recording, in time common to all streams; None: where its stamp says.
    """

    sequence: int | None
    group: int | None
    captured_ns: int
    where: str
    load: Callable[[], Raw]
    arrived_ns: int | None = None
    exposure_ns: int | None = None
    told: Told = field(default_factory=Told)
    at_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Stream:
    """One camera's frames in order, as often as `entries` is called.

    origin_ns: the stamp at which it starts. headers: the same entries, where they can be had without reading pictures
    on the way; theirs cannot be loaded.
    """

    name: str
    where: Path
    fps: float
    count: int | None
    entries: Callable[[], Generator[Entry, None, None]]
    origin_ns: int = 0
    headers: Callable[[], Generator[Entry, None, None]] | None = None

    @property
    def without_pictures(self) -> Stream:
        return self if self.headers is None else replace(self, entries=self.headers)

    @property
    def period_ns(self) -> int:
        return round(NS_PER_S / self.fps)

    def at_ns(self, entry: Entry) -> int:
        """When `entry` is due, comparable over the streams of a recording as long as no clock is set."""
        return entry.captured_ns - self.origin_ns if entry.at_ns is None else entry.at_ns


@dataclass(frozen=True, slots=True)
class Recording:
    """All streams of a recording, in the order of its cameras. pairs: which of them belong together, where it tells."""

    streams: tuple[Stream, ...]
    stamp_origin: StampOrigin
    clock: str = "recording"
    pairs: tuple[tuple[str, str], ...] | None = None


@dataclass(frozen=True, slots=True)
class Request:
    """What a format needs to read a recording."""

    paths: Sequence[Path]
    settings: ReplaySettings
    notices: Notices

    @property
    def as_given(self) -> bool:
        """Whether the user listed the streams one by one, so that their order is meant."""
        return len(self.paths) > 1

    def fps(self, known: float | None) -> float:
        """The rate the user gave, else the one the recording tells, else a guess that is said."""
        if self.settings.fps is not None:
            return self.settings.fps
        if known is None:
            self.notices.warning(f"no frame rate known: {DEFAULT_FPS:g} is assumed; give --fps or source.fps")
        return known or DEFAULT_FPS


def fps_of(stamps_ns: Sequence[int]) -> float | None:
    """The frame rate in Hz by the median interval; None when no two stamps follow one another."""
    intervals = [after - before for before, after in pairwise(stamps_ns) if after > before]
    return NS_PER_S / median(intervals) if intervals else None


def synthesised_ns(index: int, fps: float) -> int:
    return round(index * NS_PER_S / fps)


def origins_ns(stamps_ns: Sequence[Sequence[int]], notices: Notices) -> list[int]:
    """When each stream starts on its clock: together if the stamps overlap, else each with its own first frame."""
    firsts, lasts = [min(stamps) for stamps in stamps_ns], [max(stamps) for stamps in stamps_ns]
    if max(firsts) - min(lasts) <= SAME_EPOCH_NS:
        return [min(stamps[0] for stamps in stamps_ns)] * len(firsts)
    notices.warning("the cameras' timestamps do not overlap: each camera's time is counted from its own first frame")
    return [stamps[0] for stamps in stamps_ns]
