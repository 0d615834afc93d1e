"""A source with faults injected into it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from pipeline.faults.base import Fault, TimedSlot
from pipeline.frame import Camera, Frame, Source, Truth
from pipeline.pairing import Pairer, Slot


class FaultedSource:
    """Delivers another source's frames in its slots, each bent by every fault in turn.

    Frames keep the group in which the source delivered them; where it gives none, they get the number of the slot the
    rig's own pairing puts them in. So a fault changes what a slot holds, never which slot. Truth is noted on every
    frame: where the source does not know it, the recording is taken to be clean and its stamps to be right.

    make_faults: called once the source is open, when its cameras are known.
    """

    def __init__(self, source: Source, make_faults: Callable[[Sequence[Camera]], Sequence[Fault]]) -> None:
        self._source = source
        self._make_faults = make_faults
        self._faults: Sequence[Fault] = ()

    @property
    def cameras(self) -> Sequence[Camera]:
        return self._source.cameras

    @property
    def live(self) -> bool:
        return self._source.live

    @property
    def frame_count(self) -> int | None:
        return self._source.frame_count

    def open(self) -> None:
        self._source.open()
        try:
            self._faults = self._make_faults(self._source.cameras)
        except BaseException:
            self._source.close()
            raise

    def frames(self) -> Iterator[Frame]:
        slots: Iterable[TimedSlot] = self._slots()
        for fault in self._faults:
            slots = fault.apply(slots)
        for slot in slots:
            yield from (frame for frame in slot.frames.values() if frame is not None)

    def stop(self) -> None:
        self._source.stop()

    def close(self) -> None:
        self._source.close()

    def _slots(self) -> Iterator[TimedSlot]:
        first_ns: int | None = None
        for index, slot in enumerate(self._paired()):
            frames = {name: frame and _prepared(frame, index) for name, frame in slot.items()}
            some = next((frame for frame in slot.values() if frame is not None), None)
            if some is None:
                continue
            first_ns = some.captured_ns if first_ns is None else first_ns
            yield TimedSlot(some.captured_ns - first_ns, frames)

    def _paired(self) -> Iterator[Slot]:
        pairer = Pairer(self._source.cameras)
        for frame in self._source.frames():
            yield from pairer.push(frame)
        yield from pairer.flush()


def _prepared(frame: Frame, index: int) -> Frame:
    return replace(
        frame,
        group=index if frame.group is None else frame.group,
        truth=frame.truth or Truth(frame.captured_ns),
    )
