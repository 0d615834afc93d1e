"""Makes offsets of a fraction of a frame from a recording that has none: by leaving frames out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from pipeline.buffer import BufferSettings
from pipeline.faults.source import StreamClock, paired_slots
from pipeline.frame import Camera, Frame, Source, Truth


class SubsampledSource:
    """Every n-th frame of the first camera, every n-th plus k of the others, as a recording of a n-th of the rate.

    ::

        first camera    0 . . . 4 . . . 8        every 4, plus 1
        the others      . 1 . . . 5 . . . 9      offset: +1/4 of the new period
    """

    live = False

    def __init__(self, source: Source, *, every: int, plus: int) -> None:
        self._source = source
        self._every = every
        self._plus = plus

    @property
    def cameras(self) -> Sequence[Camera]:
        return [Camera(camera.name, camera.fps / self._every) for camera in self._source.cameras]

    @property
    def frame_count(self) -> int | None:
        count = self._source.frame_count
        return None if count is None else -(-count // self._every)

    def open(self) -> None:
        self._source.open()

    def frames(self) -> Iterator[Frame]:
        clock = StreamClock(self._source.cameras)
        first = self._source.cameras[0].name
        for index, slot in enumerate(paired_slots(self._source, BufferSettings())):
            present = [frame for frame in slot.values() if frame is not None]
            if not present:
                continue
            stream_ns = clock.tell(slot)
            for frame in present:
                place, rest = divmod(index - (0 if frame.camera == first else self._plus), self._every)
                if rest == 0 and place >= 0:
                    truth = frame.truth or Truth(stream_ns, assumed=True)
                    yield replace(frame, group=place, sequence=place, truth=truth)

    def stop(self) -> None:
        self._source.stop()

    def close(self) -> None:
        self._source.close()
