"""A source with faults injected into it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from pipeline.buffer import BufferSettings, make_pairer
from pipeline.faults.base import Fault, TimedSlot
from pipeline.faults.missing import Truncate
from pipeline.faults.moment import plain, retakable
from pipeline.frame import Camera, Frame, Renderer, Source, Truth
from pipeline.pairing import Slot


class FaultedSource:
    """Delivers another source's frames in its slots, each bent by every fault in turn.

    Frames keep the group in which the source delivered them; where it gives none, they get the number of the slot the
    rig's own pairing puts them in. So a fault changes what a slot holds, never which slot. Truth is noted on every
    frame: where the source does not know it, the recording is assumed to have been in sync.

    make_faults: called once the source is open, when its cameras are known. pairing: as in the rig's own buffer.
    renderer: what rendered the source's frames, if they are rendered and the source is not it itself.
    """

    def __init__(
        self,
        source: Source,
        make_faults: Callable[[Sequence[Camera]], Sequence[Fault]],
        pairing: BufferSettings | None = None,
        renderer: Renderer | None = None,
    ) -> None:
        self._source = source
        self._renderer = source if renderer is None and isinstance(source, Renderer) else renderer
        self._pairing = pairing or BufferSettings()
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

    @property
    def ended(self) -> Collection[str]:
        cut = {fault.camera.name for fault in self._faults if isinstance(fault, Truncate) and fault.ended}
        return cut.union(getattr(self._source, "ended", ()))

    @property
    def pairs(self) -> Sequence[tuple[str, str]] | None:
        told: Sequence[tuple[str, str]] | None = getattr(self._source, "pairs", None)
        return told

    @property
    def dropped(self) -> Mapping[str, int]:
        told: Mapping[str, int] = getattr(self._source, "dropped", {})
        return told

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
            for name, frame in slot.frames.items():
                if frame is not None:
                    yield from [plain(frame)] * (2 if name in slot.repeated else 1)

    def stop(self) -> None:
        self._source.stop()

    def close(self) -> None:
        self._source.close()

    def _slots(self) -> Iterator[TimedSlot]:
        clock = StreamClock(self._source.cameras)
        for index, slot in enumerate(paired_slots(self._source, self._pairing)):
            if any(frame is not None for frame in slot.values()):
                stream_ns = clock.tell(slot)
                frames = {name: frame and self._prepared(frame, index, stream_ns) for name, frame in slot.items()}
                yield TimedSlot(stream_ns, frames)

    def _prepared(self, frame: Frame, index: int, stream_ns: int) -> Frame:
        frame = replace(
            frame,
            group=index if frame.group is None else frame.group,
            truth=frame.truth or Truth(stream_ns, assumed=True),
        )
        return frame if self._renderer is None else retakable(frame, self._renderer)


def paired_slots(source: Source, pairing: BufferSettings) -> Iterator[Slot]:
    """The slots in which the rig's own pairing would put the frames of `source`."""
    pairer = make_pairer(source.cameras, pairing)
    for frame in source.frames():
        yield from pairer.push(frame)
    yield from pairer.flush()


class StreamClock:
    """Stream time of slots, from the first frame on, whichever camera is there and whatever its clock shows."""

    def __init__(self, cameras: Sequence[Camera]) -> None:
        self._period_ns = {camera.name: camera.period_ns for camera in cameras}
        self._zero_ns: dict[str, int] = {}
        self._last_ns: int | None = None

    def tell(self, slot: Slot) -> int:
        """Nanoseconds since the first slot, by a camera heard before, else a period after the slot before."""
        frames = [frame for frame in slot.values() if frame is not None]
        known = [frame for frame in frames if frame.camera in self._zero_ns]
        if known:
            stream_ns = known[0].captured_ns - self._zero_ns[known[0].camera]
        else:
            stream_ns = 0 if self._last_ns is None else self._last_ns + self._period_ns[frames[0].camera]
        for frame in frames:
            self._zero_ns.setdefault(frame.camera, frame.captured_ns - stream_ns)
        self._last_ns = stream_ns
        return stream_ns
