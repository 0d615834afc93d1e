"""A source that replays a recording: every frame in order, at full speed or paced by its timestamps."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, Camera, Frame, Picture, StampOrigin
from sources.replay.formats import read_recording
from sources.replay.merge import Merge
from sources.replay.notices import Notices
from sources.replay.pictures import PictureMaker
from sources.replay.rounds import Round
from sources.replay.settings import ReplaySettings
from sources.replay.streams import Entry, Recording, Request, Stream

PLAIN: Picture = np.full((8, 8), 128, np.uint8)
LONGEST_NS = 1 << 62
LONGEST_WAIT_S = 3600.0
"""A wait is repeated until its moment has come; a single one of any length would overflow."""


class ReplaySource:
    """Implements Source; never `live`, since a recording can always wait.

    `base` is the folder from which relative paths count; `clock_ns` stamps arrivals and paces.
    """

    live = False

    def __init__(
        self, settings: ReplaySettings, *, base: Path, clock_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._settings = settings
        self._base = base
        self._clock_ns = clock_ns
        self._notices = Notices()
        self._stopped = threading.Event()
        self._recording: Recording | None = None
        self._makers: dict[str, PictureMaker] = {}
        self._started: tuple[int, int] | None = None
        self._merge: Merge | None = None
        self._from_ns = -LONGEST_NS if settings.from_s is None else round(settings.from_s * NS_PER_S)
        self._to_ns = LONGEST_NS if settings.to_s is None else round(settings.to_s * NS_PER_S)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        return tuple(Camera(stream.name, stream.fps) for stream in self._streams)

    @property
    def frame_count(self) -> int | None:
        first = self._streams[0] if self._streams else None
        if self._settings.loop or first is None or first.count is None:
            return None
        if self._from_ns <= 0 and self._to_ns == LONGEST_NS:
            return first.count
        to_ns = min(self._to_ns, first.count * first.period_ns)
        return max(0, round((to_ns - max(self._from_ns, 0)) / first.period_ns))

    @property
    def ended(self) -> Collection[str]:
        return () if self._merge is None else self._merge.ended

    @property
    def pairs(self) -> tuple[tuple[str, str], ...] | None:
        """Which cameras belong together, where the recording tells."""
        return None if self._recording is None else self._recording.pairs

    def open(self) -> None:
        """Recognises the recording and decodes the first picture of every camera."""
        paths = [self._base / _expanded(text) for text in self._settings.paths]
        recording = read_recording(Request(paths, self._settings, self._notices))
        self._makers = {stream.name: PictureMaker(stream.name, self._notices) for stream in recording.streams}
        for stream in recording.streams:
            with closing(stream.entries()) as entries:
                first = next(entries, None)
                if first is None:
                    raise InputError(f"{stream.where}: not one picture in it can be decoded")
                self._picture(stream, first)
        self._recording = recording

    @property
    def stamp_origin(self) -> StampOrigin:
        return self._opened.stamp_origin

    def frames(self) -> Iterator[Frame]:
        for frame, _ in self._replayed(self._streams, self._picture):
            yield frame

    def headers(self) -> Iterator[tuple[Frame, int]]:
        """Every frame with when it is due, in ns from the start of what is replayed.

        Frames have a plain grey picture in place of their own, which is not decoded.
        """
        start_ns = max(self._from_ns, 0)
        for frame, at_ns in self._replayed([one.without_pictures for one in self._streams], lambda _, __: PLAIN):
            yield frame, at_ns - start_ns

    def _replayed(
        self, streams: Sequence[Stream], picture: Callable[[Stream, Entry], Picture]
    ) -> Iterator[tuple[Frame, int]]:
        round_ = Round()
        while True:
            merge = self._merge = Merge(streams)
            with closing(merge.entries()) as entries:
                for stream, entry, at_ns in entries:
                    if self._stopped.is_set():
                        return
                    if at_ns < self._from_ns:
                        continue
                    if at_ns >= self._to_ns:
                        break
                    image = picture(stream, entry)
                    if self._stops_before(round_.shift_ns + at_ns):
                        return
                    round_.saw(stream, entry, at_ns)
                    yield self._frame(self._opened, stream, entry, image, round_), at_ns
                else:
                    if round_.is_empty and self._from_ns > 0:
                        raise InputError(f"source.from_s: the recording ends before {self._from_ns / NS_PER_S:g} s")
            if (said := merge.said()) is not None:
                self._notices.warning(said)
            if not self._settings.loop or round_.is_empty:
                return
            round_ = round_.following(max(stream.period_ns for stream in self._streams))

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self.stop()

    @property
    def _opened(self) -> Recording:
        assert self._recording is not None, "open comes first"
        return self._recording

    @property
    def _streams(self) -> tuple[Stream, ...]:
        return self._recording.streams if self._recording is not None else ()

    def _picture(self, stream: Stream, entry: Entry) -> Picture:
        return self._makers[stream.name].make(entry.load(), entry.where)

    def _frame(self, recording: Recording, stream: Stream, entry: Entry, image: Picture, round_: Round) -> Frame:
        told = entry.told
        return Frame(
            camera=stream.name,
            sequence=None if entry.sequence is None else entry.sequence + round_.shift_sequence,
            captured_ns=entry.captured_ns + round_.shift_ns,
            clock=told.clock or recording.clock,
            arrived_ns=self._clock_ns() if entry.arrived_ns is None else entry.arrived_ns + round_.shift_ns,
            image=image,
            group=None if entry.group is None else entry.group + round_.shift_group,
            epoch=told.epoch + round_.shift_epoch,
            exposure_ns=entry.exposure_ns,
            stamp_reference=told.stamp_reference,
            stamp_origin=told.stamp_origin or recording.stamp_origin,
            truth=told.truth and replace(told.truth, shown_ns=told.truth.shown_ns + round_.shift_ns),
        )

    def _stops_before(self, at_ns: int) -> bool:
        """Waits until `at_ns` in the recording is due; whether `stop` came first."""
        if self._settings.speed == "max":
            return False
        if self._started is None:
            self._started = (self._clock_ns(), at_ns)
        started_ns, first_ns = self._started
        due_ns = started_ns + round((at_ns - first_ns) / self._settings.speed)
        while (early_ns := due_ns - self._clock_ns()) > 0:
            if self._stopped.wait(min(early_ns / NS_PER_S, LONGEST_WAIT_S)):
                return True
        return False


def _expanded(text: str) -> Path:
    try:
        return Path(text).expanduser()
    except RuntimeError:  # ~name of a user who does not exist: then it is a file name
        return Path(text)
